"""Tool path -> motion of the tool in time -> motion of the joints.

Along each piece of the path (`motion.tool_corners`) the speed rises, stays and falls with
the acceleration that is allowed along it; rounded corners are passed at constant speed. The
whole motion then goes through a moving average of length ``T`` in time, as in `motion.ptp`:
acceleration becomes continuous, jerk at most ``2 a / T``, no bound on speed or acceleration
is ever exceeded because an average never is, and the tool leaves the path by at most
``a T^2 / 24`` more, which is taken off the tolerance.

The joint positions come from the inverse kinematics at equal steps of time; a spline of the
fifth degree goes through them, and its derivatives are the joint velocities and accelerations.
So all three belong to one motion whatever the robot, redundant ones included, and no kinematics
but the inverse is needed.

The spline is made in blocks that overlap by `MARGIN` knots, within which the influence of its
ends has died away (a factor of 0.43 per knot), so memory does not grow with the length.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.timeline.blocks import Float, Int
from robot_energy_plan.motion.inverse_kinematics import InverseKinematics
from robot_energy_plan.motion.ptp import Trajectory
from robot_energy_plan.motion.tool_corners import Dwell, PathPieces, ToolPath, pieces_of

NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)
ROWS = 65_536  # phases integrated at once
MAX_SMOOTHING = 1.0  # s
MIN_ACCELERATION, MAX_ACCELERATION = 1e-6, 1e4  # m/s^2, of a tool
MAX_TOLERANCE = 10.0  # m, of a corner
REST = 1e-12  # s


class ToolLimits(Described):
    """What the tool may do. None of it stands in a G-code program."""

    acceleration: Annotated[float, "Greatest, > 0; default assumed. [m/s^2]"] = 2.0
    corner_tolerance: Annotated[
        float,
        "Greatest distance of the tool from the programmed corner; default what paper B calls "
        "sufficient for printing (section 5.2.1). 0 stops in every corner. [m]",
    ] = 3e-3
    smoothing: Annotated[float, "T, >= 0; default assumed. [s]"] = 0.02

    def __post_init__(self) -> None:
        if not MIN_ACCELERATION <= self.acceleration <= MAX_ACCELERATION:
            raise MotionError(
                f"the tool's acceleration is {self.acceleration} m/s^2",
                f"{MIN_ACCELERATION:g} to {MAX_ACCELERATION:g} m/s^2",
            )
        if not 0 <= self.corner_tolerance <= MAX_TOLERANCE:
            raise MotionError(
                f"the corner tolerance is {self.corner_tolerance} m", f"0 to {MAX_TOLERANCE:g} m"
            )
        if not 0 <= self.smoothing <= MAX_SMOOTHING:
            raise MotionError(f"smoothing is {self.smoothing} s", f"0 to {MAX_SMOOTHING:g} s")
        if 0 < self.corner_tolerance <= self.averaging_deviation:
            raise MotionError(
                f"smoothing over {self.smoothing} s at {self.acceleration} m/s^2 leaves the path "
                f"by up to {self.averaging_deviation * 1e3:.3g} mm",
                f"less than the corner tolerance of {self.corner_tolerance * 1e3:.3g} mm",
                "smooth over a shorter time or allow a larger tolerance",
            )

    @property
    def averaging_deviation(self) -> float:
        """How far the moving average can leave the path, a T^2 / 24. [m]"""
        return self.acceleration * self.smoothing**2 / 24.0


class ToolTrajectory(Described):
    """Motion of a tool at given times, shape (N, 3) each."""

    position: Annotated[Float, "[m]"]
    velocity: Annotated[Float, "[m/s]"]
    acceleration: Annotated[Float, "[m/s^2]"]


class TimedPath:
    """A tool path in time.

    Attributes:
        duration: Time from rest to rest, smoothing included. [s]
        length: Length of the path with rounded corners. [m]
        stops: Number of rests on the way that no dwell asks for: corners that could not
            be rounded.
        full_speed_share: Share of the way passed at the commanded speed. [-]
    """

    def __init__(self, path: ToolPath, limits: ToolLimits | None = None) -> None:
        self.path = path
        self.limits = limits or ToolLimits()
        tolerance = max(self.limits.corner_tolerance - self.limits.averaging_deviation, 0.0)
        self._pieces = pieces_of(path, self.limits.acceleration, tolerance)
        self.length = float(self._pieces.length.sum())
        speed = _junction_speeds(self._pieces)
        dwelling = self._pieces.length == 0
        at_dwell = dwelling | np.append(dwelling[1:], False)
        self.stops = int(((speed[1:-1] == 0) & ~at_dwell[:-1] & ~dwelling[1:]).sum())
        self._phases(speed)
        self._integrate()

    def _phases(self, junction: Float) -> None:
        pieces = self._pieces
        first, last, a = junction[:-1], junction[1:], pieces.acceleration
        moves, rises = pieces.length > 0, a > 0
        peak = np.minimum(pieces.speed, np.sqrt(0.5 * (first**2 + last**2) + a * pieces.length))
        peak = np.maximum(peak, np.maximum(first, last))  # rounding
        some = np.where(rises, a, 1.0)
        rise, fall = (np.where(rises, (peak - end) / some, 0.0) for end in (first, last))
        up, down = 0.5 * (peak + first) * rise, 0.5 * (peak + last) * fall
        level = np.maximum(pieces.length - up - down, 0.0)
        cruise = np.where(moves, level / np.where(moves, peak, 1.0), 0.0)
        rest = np.where(moves, 0.0, pieces.dwell + self.limits.smoothing)
        self.full_speed_share = float(
            level[moves & (peak >= pieces.commanded * (1 - 1e-9))].sum() / self.length
        )
        zero = np.zeros_like(rise)
        length = np.stack([rise, cruise + rest, fall], axis=1).ravel()
        way = np.stack([zero, up, up + level], axis=1).ravel()
        speed = np.stack([first, np.where(moves, peak, 0.0), peak], axis=1).ravel()
        gain = np.stack([np.where(rise > 0, a, 0.0), zero, np.where(fall > 0, -a, 0.0)], 1).ravel()
        piece = np.repeat(np.arange(len(pieces.length)), 3)
        used = length > REST
        self._length, self._way = length[used], way[used]
        self._speed, self._gain, self._piece = speed[used], gain[used], piece[used]
        self._begin = np.concatenate([[0.0], np.cumsum(self._length)])
        self._raw = float(self._begin[-1])
        self.duration = self._raw + self.limits.smoothing
        # A dwell stands where the piece before it ends, or where the next one begins.
        self._still = np.zeros((len(pieces.length), 3))
        at = np.asarray(next(s.start for s in self.path.segments if not isinstance(s, Dwell)))
        ends = self._on(np.arange(len(pieces.length)), pieces.length)
        for index in np.flatnonzero(~moves).tolist():
            at = ends[index - 1] if index and moves[index - 1] else at
            self._still[index] = at
            ends[index] = at

    def _on(self, piece: Int, way: Float) -> Float:
        """Position on a piece, shape (N, 3). [m]"""
        p = self._pieces
        angle = p.rate[piece] * way
        return (
            p.origin[piece]
            + (p.radius[piece] * np.cos(angle))[:, None] * p.first[piece]
            + (p.radius[piece] * np.sin(angle))[:, None] * p.second[piece]
            + way[:, None] * p.drift[piece]
        )

    def _position(self, phase: Int, local: Float) -> Float:
        piece = self._piece[phase]
        way = self._way[phase] + local * (self._speed[phase] + 0.5 * self._gain[phase] * local)
        place = self._on(piece, way)
        still = self._pieces.length[piece] == 0
        place[still] = self._still[piece[still]]
        return place

    def _integrate(self) -> None:
        """Integral of the position up to the beginning of every phase, shape (K + 1, 3)."""
        count = len(self._length)
        total = np.zeros((count + 1, 3))
        for start in range(0, count, ROWS):
            rows = np.arange(start, min(start + ROWS, count))
            total[rows + 1] = self._partial(rows, self._length[rows])
        self._area = np.cumsum(total, axis=0)
        ends = np.array([0, count - 1])
        self._ends = self._position(ends, np.array([0.0, self._length[-1]]))

    def _partial(self, phase: Int, local: Float) -> Float:
        """Integral of the position from the beginning of a phase, shape (N, 3). [m s]"""
        half = 0.5 * local
        total = np.zeros((len(phase), 3))
        for node, weight in zip(NODES.tolist(), WEIGHTS.tolist(), strict=True):
            total += weight * self._position(phase, half * (1.0 + node))
        return total * half[:, None]

    def _find(self, time: Float) -> tuple[Int, Float]:
        inside = np.clip(time, 0.0, self._raw)
        phase = np.searchsorted(self._begin, inside, side="right") - 1
        phase = np.minimum(phase, len(self._length) - 1)
        return phase, inside - self._begin[phase]

    def _exact(self, time: Float) -> tuple[Float, Float, Float]:
        """Position, velocity and acceleration before smoothing."""
        phase, local = self._find(time)
        p, piece = self._pieces, self._piece[phase]
        speed = self._speed[phase] + self._gain[phase] * local
        way = self._way[phase] + local * (self._speed[phase] + 0.5 * self._gain[phase] * local)
        angle = p.rate[piece] * way
        cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
        bend = (p.radius[piece] * p.rate[piece])[:, None]
        first, second = p.first[piece], p.second[piece]
        tangent = bend * (cosine * second - sine * first) + p.drift[piece]
        normal = -bend * p.rate[piece][:, None] * (cosine * first + sine * second)
        outside = (time < 0) | (time > self._raw)
        speed = np.where(outside, 0.0, speed)
        gain = np.where(outside, 0.0, self._gain[phase])
        return (
            self._position(phase, local),
            speed[:, None] * tangent,
            gain[:, None] * tangent + (speed**2)[:, None] * normal,
        )

    def sample(self, time: Float) -> ToolTrajectory:
        """Return the motion; the tool rests before its start and after its end.

        Args:
            time: Since the start, shape (N,). [s]
        """
        time = np.atleast_1d(np.asarray(time, dtype=np.float64))
        smooth = self.limits.smoothing
        now = self._exact(time)
        if smooth == 0:
            return ToolTrajectory(*now)
        before = self._exact(time - smooth)
        return ToolTrajectory(
            (self._integral(time) - self._integral(time - smooth)) / smooth,
            (now[0] - before[0]) / smooth,
            (now[1] - before[1]) / smooth,
        )

    def _integral(self, time: Float) -> Float:
        """Integral of the position from time 0, the rests outside included. [m s]"""
        phase, local = self._find(time)
        before, after = np.minimum(time, 0.0), np.maximum(time - self._raw, 0.0)
        return (
            self._area[phase]
            + self._partial(phase, local)
            + before[:, None] * self._ends[0]
            + after[:, None] * self._ends[1]
        )

    def source_line(self, time: Float) -> Int:
        """Return the line of the program that is executed, shape (N,).

        Args:
            time: Since the start, shape (N,). [s]
        """
        phase, _ = self._find(np.asarray(time) - 0.5 * self.limits.smoothing)
        return self._pieces.source_line[self._piece[phase]]


def _junction_speeds(pieces: PathPieces) -> Float:
    """Greatest speed at the beginning of every piece that both sides allow, shape (K + 1,)."""
    speed = pieces.speed
    limit = np.minimum(
        pieces.entry, np.minimum(np.append(speed, np.inf), np.insert(speed, 0, np.inf))
    )
    limit[0] = limit[-1] = 0.0
    square: list[float] = (limit**2).tolist()
    gain: list[float] = (2.0 * pieces.acceleration * pieces.length).tolist()
    for index in range(len(gain) - 1, -1, -1):
        square[index] = min(square[index], square[index + 1] + gain[index])
    for index, more in enumerate(gain):
        square[index + 1] = min(square[index + 1], square[index] + more)
    return np.sqrt(np.asarray(square))


DEGREE = 5
STEP = 0.01  # s; see decision 0038 for what a shorter one changes
MARGIN = 40  # knots: 0.43^40 = 2e-15
BLOCK = 4096  # knots
MAX_KNOTS = 20_000_000
MAX_OFFSET = 1000.0  # m, of the base from the origin of the program
MAX_JUMP = 0.5  # rad or m between two knots


class ToolPlacement(Described):
    """Where the robot's base stands in the frame of the program."""

    x: Annotated[float, "[m]"] = 0.0
    y: Annotated[float, "[m]"] = 0.0
    z: Annotated[float, "[m]"] = 0.0
    yaw: Annotated[float, "Turn of the base about the vertical axis, anticlockwise. [rad]"] = 0.0

    def __post_init__(self) -> None:
        if not all(abs(value) <= MAX_OFFSET for value in (self.x, self.y, self.z, self.yaw)):
            raise MotionError(
                f"the base stands at {self}", f"finite numbers within {MAX_OFFSET:g} m and rad"
            )

    def in_base(self, position: Float) -> Float:
        """Return positions of the program's frame in the base frame.

        Args:
            position: Shape (N, 3). [m]
        """
        moved = position - np.array([self.x, self.y, self.z])
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return moved @ turn.T


class ToolMotion:
    """Motion of the joints that moves a tool along a timed path.

    Args:
        start: Joint positions near the first one; decides which solution is taken,
            shape (n,). [rad] or [m]
        placement: Place of the robot's base in the frame of the program.
        step: Time between knots, > 0. [s]
        anchored: Whether every solution depends on ``start``, as where a redundant arm stays
            as near to it as it can; otherwise each is solved from the one before.

    Attributes:
        duration: [s]
    """

    def __init__(
        self,
        path: TimedPath,
        kinematics: InverseKinematics,
        start: Float,
        limits: JointLimits,
        placement: ToolPlacement | None = None,
        step: float = STEP,
        anchored: bool = False,
    ) -> None:
        if not 0 < step < math.inf:
            raise MotionError(f"the step is {step} s", "a time > 0 s")
        if not path.duration / step <= MAX_KNOTS:
            raise MotionError(
                f"{path.path.name} lasts {path.duration:.4g} s, which makes more than "
                f"{MAX_KNOTS} steps of {step:g} s",
                "fewer",
                "check the feeds, or take longer steps",
            )
        self._path = path
        self._kinematics = kinematics
        self._start = np.asarray(start, dtype=np.float64)
        self._anchored = anchored
        self._limits = limits
        self._placement = placement or ToolPlacement()
        self._count = max(2 * DEGREE, math.ceil(path.duration / step - 1e-9)) + 1
        self._step = path.duration / (self._count - 1)
        self.duration, self.joint_names = path.duration, limits.joint_names
        self.sample_count = self._count

    def blocks(self) -> Iterator[tuple[Float, Trajectory]]:
        """Yield times since the start, shape (N,) [s], and the motion at them, joint side."""
        joints = np.empty((0, len(self._start)))
        first, solved, last = 0, 0, self._start  # first: index of the first row of joints
        done = 0
        while done < self._count:
            until = min(done + BLOCK, self._count)
            need = min(until + MARGIN, self._count)
            if need > solved:
                fresh = self._solve(solved, need, last)
                joints = np.concatenate([joints, fresh])
                solved, last = need, joints[-1]
            yield self._derive(joints, first, done, until)
            keep = max(until - MARGIN, 0)
            joints, first, done = joints[keep - first :], keep, until

    def _solve(self, begin: int, end: int, start: Float) -> Float:
        time = np.arange(begin, end) * self._step
        tool = self._placement.in_base(self._path.sample(time).position)
        begin_from = self._start if self._anchored else start
        try:
            joints = self._kinematics.solve(tool, begin_from)
        except MotionError as error:
            row, first = self._first_refused(tool, begin_from, error)
            line = int(self._path.source_line(time[row : row + 1])[0])
            raise MotionError(
                f"{self._path.path.name}, line {line}, at {time[row]:.3f} s: {first.found}",
                first.expected,
                first.remedy,
            ) from error
        jump = np.diff(joints, axis=0, prepend=start[None, :] if begin else joints[:1])
        self._refuse_more(
            np.abs(jump), np.full(len(self._start), MAX_JUMP), time, "jumps by", "",
            "the path passes a singular configuration; move the base or start elsewhere",
        )  # fmt: skip
        return joints

    def _derive(self, joints: Float, first: int, begin: int, end: int) -> tuple[Float, Trajectory]:
        """Derivatives of the spline through all knots at hand."""
        from scipy.interpolate import make_interp_spline

        before = MARGIN if first == 0 else 0  # the robot rests before the start
        after = MARGIN if first + len(joints) == self._count else 0  # and after the end
        known = np.pad(joints, ((before, after), (0, 0)), mode="edge")
        knots = np.arange(first - before, first + len(joints) + after) * self._step
        spline = make_interp_spline(knots, known, k=DEGREE)
        rows = slice(begin - first, end - first)
        time = np.arange(begin, end) * self._step
        velocity = np.asarray(spline.derivative(1)(time))
        self._refuse_more(
            velocity, self._limits.velocity, time, "moves at", "/s",
            "reduce the feed, move the base or start elsewhere",
        )  # fmt: skip
        acceleration = np.asarray(spline.derivative(2)(time))
        return time, Trajectory(joints[rows], velocity, acceleration)

    def _refuse_more(
        self, values: Float, most: Float, time: Float, verb: str, per: str, remedy: str
    ) -> None:
        bad = np.abs(values) > most * (1 + 1e-9)
        if not bad.any():
            return
        row = int(np.argmax(bad.any(axis=1)))
        joint = int(np.argmax(bad[row]))
        unit = self._limits.unit(joint) + per
        line = int(self._path.source_line(time[row : row + 1])[0])
        raise MotionError(
            f"{self._path.path.name}, line {line}: joint '{self._limits.joint_names[joint]}' "
            f"{verb} {values[row, joint]:.4g} {unit} at {time[row]:.3f} s",
            f"at most {most[joint]:.4g} {unit}",
            remedy,
        )

    def _first_refused(
        self, tool: Float, start: Float, error: MotionError
    ) -> tuple[int, MotionError]:
        """Find the first place that cannot be solved, and why: ever shorter beginnings."""
        good, bad = 0, len(tool)  # the first `good` places can, the first `bad` cannot
        while bad - good > 1:
            middle = (good + bad) // 2
            try:
                self._kinematics.solve(tool[:middle], start)
                good = middle
            except MotionError as sooner:
                bad, error = middle, sooner
        return bad - 1, error
