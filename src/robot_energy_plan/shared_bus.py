"""Robots on one supply: shifted starts; on one DC bus: what one feeds back, another uses.

The power of the supply is the sum of the powers of the robots, each over its own cycle of equal
length. Starts are shifted to the least peak, or on one DC bus to the least of what the rectifiers
give: braking of one robot then meets acceleration of another. Of two robots every shift is looked
at. Of more, one robot after the other takes its best shift until none improves, from several
beginnings: that finds a good choice, not surely the best.

With ``D_i = P_dc,i + P_l,dc,i`` of each robot, its own rectifier gives ``max(D_i, 0)`` and its own
resistor takes ``max(-D_i, 0)`` (paper A, section II). On one bus the rectifiers give
``max(sum_i D_i, 0)``, as diodes feed nothing back, and the resistor takes what is left below 0.
Capacitors are in parallel, ``C = sum_i C_i``. Saved is ``S = sum_i E_i - E``; without capacitors
and regenerative supplies losses are the same, and S is what the resistors no longer take. The
powers are recorded together, or planned in one cycle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError
from robot_energy.foundation.units import SECOND_NS
from robot_energy.model import RobotModel
from robot_energy.model.figure import PositiveFigure
from robot_energy.model.schema import Cabinet, Capacitor
from robot_energy.physics.drives_and_cabinet import CabinetStage, FanStage
from robot_energy.physics.drivetrain import motor_rest
from robot_energy.physics.equations import Balance
from robot_energy.pipeline import Output
from robot_energy.timeline.blocks import NANOSECOND, Float, Int
from robot_energy_plan.motion.planned import STEP, PlannedMotion
from robot_energy_plan.optimization.deviations import DeviationSums
from robot_energy_plan.prediction import predict

SHIFT = 0.02  # s between shifts of a start
BEGINNINGS, SEED = 8, 0  # for more than two robots
MAX_SWEEPS = 50
MAX_SHIFTS = 5000  # of a cycle
Figure = Callable[[Float], Float]
"""Power of the supply over a cycle, shape (..., N) -> what shall be least, shape (...). [W]"""


def peak(power: Float) -> Float:
    """Return the greatest power, shape (...). [W]

    Args:
        power: Shape (..., N). [W]
    """
    return np.asarray(power.max(axis=-1))


def drawn(power: Float) -> Float:
    """Return the mean power that rectifiers give one bus, which return nothing, shape (...). [W]

    Args:
        power: Demand of all robots, shape (..., N). [W]
    """
    return np.asarray(np.maximum(power, 0.0).mean(axis=-1))


class Levelling(Described):
    """Starts of the robots within the common cycle."""

    start: Annotated[Float, "After the begin of the cycle; 0 for the first robot, shape (R,). [s]"]
    together: Annotated[float, "The figure with all starts at once. [W]"]
    least: Annotated[float, "With these starts. [W]"]
    any_start: Annotated[float, "Its mean over starts that fall anywhere. [W]"]
    mean: Annotated[float, "Power of the supply, whatever the starts. [W]"]


def level_starts(power: Sequence[Float], cycle_time: float, figure: Figure = peak) -> Levelling:
    """Return the starts with the least of a figure.

    Args:
        power: Of each robot over one cycle, at equal steps, all of one length, shape (N,). [W]
        cycle_time: Of all. [s]
    """
    from scipy.linalg import circulant

    curves = np.stack(power)
    count, size = curves.shape
    # row k of each: the power when the robot starts k samples later
    shifted = [circulant(one[-np.arange(size)]) for one in curves]
    random = np.random.default_rng(SEED)
    best = np.zeros(count, dtype=np.int64)
    least = together = float(figure(curves.sum(axis=0)))
    for turn in range(1 if count == 2 else BEGINNINGS):
        begin = np.zeros(count, dtype=np.int64)
        if turn:
            begin[1:] = random.integers(size, size=count - 1)
        start, found = _descend(shifted, begin, figure)
        if found < least * (1 - 1e-9):
            best, least = start, found
    anywhere = random.integers(size, size=(size, count - 1))
    anywhere[:, 0] = np.arange(size)  # of two robots, every shift once
    total = curves[0] + sum(one[rows] for one, rows in zip(shifted[1:], anywhere.T, strict=True))
    return Levelling(
        best * (cycle_time / size),
        together,
        least,
        float(figure(total).mean()),
        float(curves.sum(axis=0).mean()),
    )


def _descend(shifted: Sequence[Float], start: Int, figure: Figure) -> tuple[Int, float]:
    """Give one robot after the other its best shift until none improves."""
    least = np.inf
    for _ in range(MAX_SWEEPS):
        before = least
        for robot in range(1, len(start)):
            others = sum(
                (shifted[k][start[k]] for k in range(len(start)) if k != robot),
                np.zeros(len(shifted[0])),
            )
            values = figure(shifted[robot] + others)
            start[robot] = int(np.argmin(values))
            least = float(values[start[robot]])
        if least >= before * (1 - 1e-9):
            break
    return start, least


def samples_of(cycle_time: float) -> int:
    """Return how many samples the power over one cycle has.

    Args:
        cycle_time: [s]
    """
    return int(np.clip(round(cycle_time / SHIFT), 2, MAX_SHIFTS))


ROOM = 0.8  # of the energy of their capacitors, on one bus of robots with other voltages [-]
MAX_STEPS = 500_000  # of a cycle
ROUNDING = 1e-3  # s, by which a motion may be longer than its cycle


class BusExchange(Described):
    """Power flows of the same robots on supplies of their own and on one bus."""

    stamp_ns: Annotated[Int, "Shape (N,). [ns]"]
    own: tuple[Balance, ...]
    shared: Balance
    tight: Annotated[Balance, "As `shared`, but with `ROOM` of the capacitors."]

    @property
    def duration(self) -> float:
        """Over which all powers are known. [s]"""
        return float(self._energy(np.ones_like(self.shared.grid_power)))

    def grid_energy(self, flows: Balance) -> float:
        """Return the energy from the grid, less what a regenerative supply returns. [J]"""
        return self._energy(flows.grid_power)

    def brake_energy(self, flows: Balance) -> float:
        """Return the energy into the brake resistor. [J]"""
        return self._energy(flows.brake_power)

    def peak_power(self, flows: Sequence[Balance]) -> float:
        """Return the greatest power from the grid of several supplies together. [W]"""
        return float(np.nanmax(sum(one.grid_power for one in flows)))

    def after(self, start_ns: int) -> BusExchange:
        """Return the part from an instant on, such as a cycle after one that charged capacitors."""
        rows = np.flatnonzero(self.stamp_ns >= start_ns)
        *own, shared, tight = (
            Balance(*(flow[rows] for flow in vars(one).values()))
            for one in (*self.own, self.shared, self.tight)
        )
        return BusExchange(self.stamp_ns[rows], tuple(own), shared, tight)

    @property
    def saved(self) -> float:
        """S, the energy that one bus saves. [J]"""
        return sum(map(self.grid_energy, self.own)) - self.grid_energy(self.shared)

    @property
    def for_want_of_room(self) -> float:
        """What the bus saves less where its capacitors have `ROOM`. [J]"""
        return self.grid_energy(self.tight) - self.grid_energy(self.shared)

    def _energy(self, power: Float) -> float:
        """Trapezoids between samples at which every robot is known (paper A, eq. 7)."""
        power = np.where(np.isfinite(self.shared.grid_power), power, np.nan)
        time = np.diff(self.stamp_ns) * NANOSECOND
        return float(np.nansum(0.5 * (power[1:] + power[:-1]) * time))


def shared_cabinet(cabinets: Sequence[Cabinet], room: float = 1.0) -> Cabinet:
    """Return the cabinet of one bus for several robots.

    Constant losses add up, as each robot keeps its controller; capacitances add up between the
    highest rectified voltage, at which the bus stands, and the lowest chopper voltage, at which the
    first resistor starts. Where some supply is regenerative, the best one returns what is left.

    Args:
        room: Share of the capacitances that is there. [-]
    """

    def derived(value: float) -> PositiveFigure:
        return PositiveFigure(value=value, tag="derived", source="of the robots on one bus")

    capacitors = [one.capacitor for one in cabinets if one.capacitor is not None]
    capacitor = None
    if capacitors:
        nominal = max(one.nominal_voltage.value for one in capacitors)
        chopper = min(one.chopper_voltage.value for one in capacitors)
        if nominal >= chopper:
            raise MotionError(
                f"one rectifier gives {nominal:g} V, and another chopper starts at {chopper:g} V",
                "robots whose DC links have about the same voltage",
            )
        capacitor = Capacitor(
            capacitance=derived(room * sum(one.capacitance.value for one in capacitors)),
            nominal_voltage=derived(nominal),
            chopper_voltage=derived(chopper),
        )
    returned = [
        one.regeneration_efficiency.value
        for one in cabinets
        if one.regeneration_efficiency is not None
    ]
    return Cabinet(
        loss_grid=derived(sum(one.loss_grid.value for one in cabinets)),
        loss_dc=derived(sum(one.loss_dc.value for one in cabinets)),
        regeneration_efficiency=derived(max(returned)) if returned else None,
        capacitor=capacitor,
    )


def exchange(
    stamp_ns: Int, bus_power: Float, cabinets: Sequence[Cabinet], fan_power: Float | None = None
) -> BusExchange:
    """Return the flows of robots on supplies of their own, and on one bus.

    Args:
        stamp_ns: Rising, shape (N,). [ns]
        bus_power: P_dc of each robot, drive inputs without constant losses, shape (R, N); NaN
            where one is not known, which is not counted for any. [W]
        cabinets: Of each robot; capacitors are empty at the start.
        fan_power: Of each robot, shape (R, N); None: no fan runs. [W]
    """
    fans = np.zeros_like(bus_power) if fan_power is None else fan_power
    known = bus_power + 0.0 * bus_power.sum(axis=0)  # NaN for all where one is
    segment, total = np.zeros(len(stamp_ns), dtype=np.int64), known.sum(axis=0)
    shared, tight = (
        CabinetStage(shared_cabinet(cabinets, room)).step(
            stamp_ns, segment, total, fans.sum(axis=0)
        )
        for room in (1.0, ROOM)
    )
    own = tuple(
        CabinetStage(cabinet).step(stamp_ns, segment, power, fan)
        for cabinet, power, fan in zip(cabinets, known, fans, strict=True)
    )
    return BusExchange(stamp_ns, own, shared, tight)


@dataclass
class BusRobot:
    """What one robot gives the bus and takes from it, as the pipeline finds it.

    Attributes:
        assumed: Whether temperatures are those of the motors, as planned, and no readings.
        deviations: What errors of the model do to its energies.
        problems: What makes its figures doubtful, one sentence each.
    """

    name: str
    model: RobotModel
    assumed: bool = False
    notes: list[str] = field(default_factory=list[str])
    problems: list[str] = field(default_factory=list[str])

    def __post_init__(self) -> None:
        self.deviations = DeviationSums(self.model)
        self._fan = FanStage(self.model.cabinet, self.assumed)
        self._parts: list[tuple[Int, Int, Float]] = []
        self.moves_at_end = False  # some motor turns at the last sample

    def take(self, output: Output) -> None:
        """Take what a step of the pipeline gave."""
        self.deviations.take(output)
        if output.power is not None and len(block := output.power):
            fan = self._fan.step(block.motor_temperature_degc) + np.zeros(len(block))
            powers = np.stack([block.bus_power, fan])
            self._parts.append((block.stamp_ns, block.segment, powers))
            speed = np.abs(block.motor_velocity[-1])
            self.moves_at_end = bool((speed > motor_rest(self.model)).any())

    def power(self) -> tuple[Int, Float]:
        """Return stamps, shape (N,) [ns], and P_dc and power of the fan, shape (2, N) [W].

        Both powers are NaN amid each gap.
        """
        if not self._parts:
            raise MotionError(f"{self.name} gave no power", "samples of motion")
        stamp, segment, power = (
            np.concatenate(part, axis=-1) for part in zip(*self._parts, strict=True)
        )
        if (np.diff(stamp) < 0).any():
            raise MotionError(
                f"the time of {self.name} jumps back",
                "a recording of one run",
                "name a part of it with --start and --end",
            )
        stamp, first = np.unique(stamp, return_index=True)
        segment, power = segment[first], power[:, first]
        gap = np.flatnonzero(np.diff(segment))
        middle = (stamp[gap] + stamp[gap + 1]) // 2
        return np.insert(stamp, gap + 1, middle), np.insert(power, gap + 1, np.nan, axis=1)


def recorded_exchange(robots: Sequence[BusRobot], same_start: bool = False) -> BusExchange:
    """Return the flows over the time in which all robots were recorded.

    Between samples of a robot its power is linear.

    Args:
        same_start: Whether the recordings, made at other times, count as begun at once.
    """
    series = [robot.power() for robot in robots]
    if same_start:
        series = [(stamp - stamp[0], power) for stamp, power in series]
    begin = max(int(stamp[0]) for stamp, _ in series)
    end = min(int(stamp[-1]) for stamp, _ in series)
    if begin >= end:
        apart = (begin - end) * NANOSECOND
        raise MotionError(
            f"the recordings were not made at one time: {apart:.6g} s lie between the end of one "
            "and the start of another",
            "recordings of robots that ran together",
            "--same-start treats them as begun at once, to see what would be saved",
        )
    stamp = np.unique(np.concatenate([one for one, _ in series]))
    stamp = stamp[(stamp >= begin) & (stamp <= end)]
    powers: list[list[Float]] = [
        [np.interp(stamp - begin, own - begin, one) for one in both] for own, both in series
    ]
    bus, fan = np.array(powers).swapaxes(0, 1)
    return exchange(stamp, bus, [robot.model.cabinet for robot in robots], fan)


class PlannedBus(Described):
    """Robots in a common cycle."""

    together: Annotated[BusExchange, "Flows with all starts at once."]
    best: Annotated[BusExchange, "Flows with the starts that need least."]
    levelling: Annotated[Levelling, "These starts, and what any others need; without capacitors."]


def planned_robot(
    name: str,
    model: RobotModel,
    motion: PlannedMotion,
    degc: float | Sequence[float] | Float,
    repeat: int = 1,
) -> BusRobot:
    """Return a robot with the predicted power of a motion.

    Args:
        degc: Of all motors, or of each, shape (n,). [degC]
    """
    robot = BusRobot(name, model, assumed=True)
    found = predict(model, motion, degc, name, repeat=repeat, on_output=robot.take)
    robot.notes += found.notes
    robot.problems += found.limits.sentences()
    return robot


def planned_exchange(robots: Sequence[BusRobot], cycle_time: float | None = None) -> PlannedBus:
    """Return the flows of planned motions that repeat in a common cycle.

    Each robot waits at its end, at the power it has there, until the cycle is over. Capacitors are
    as they are after a cycle.

    Args:
        cycle_time: Of all; None: the longest motion. [s]
    """
    series = [robot.power() for robot in robots]
    times = [(stamp - stamp[0]) * NANOSECOND for stamp, _ in series]
    durations = [float(one[-1]) for one in times]
    cycle = max(durations) if cycle_time is None else cycle_time
    for robot, duration in zip(robots, durations, strict=True):
        if duration > cycle + ROUNDING:
            raise MotionError(
                f"{robot.name} takes {duration:.4g} s", f"at most the cycle time, {cycle:g} s"
            )
        if robot.moves_at_end and duration < cycle - ROUNDING:
            raise MotionError(
                f"{robot.name} is in motion at its end and cannot wait there until {cycle:.4g} s",
                "a motion that ends at rest",
            )

    def at(time: Float, start: Float) -> Float:
        """P_dc and power of the fan of all robots at times of the cycle, shape (2, R, N)."""
        powers: list[list[Float]] = [
            [np.interp((time - float(begin)) % cycle, own, one) for one in both]
            for begin, own, (_, both) in zip(start.tolist(), times, series, strict=True)
        ]
        return np.array(powers).swapaxes(0, 1)

    cabinets = [robot.model.cabinet for robot in robots]
    rounds = 1 + any(one.capacitor is not None for one in cabinets)
    steps = min(max(1, round(cycle / STEP)), MAX_STEPS)
    time = np.arange(rounds * steps + 1) * (cycle / steps)
    stamp = np.rint(time * SECOND_NS).astype(np.int64)

    def flows(start: Float) -> BusExchange:
        bus, fan = at(time, start)
        return exchange(stamp, bus, cabinets, fan).after(int(stamp[(rounds - 1) * steps]))

    count = samples_of(cycle)
    losses = np.array([[one.loss_dc.value] for one in cabinets])
    middle = (np.arange(count) + 0.5) * cycle / count
    demand = at(middle, np.zeros(len(robots)))[0] + losses
    found = level_starts(list(demand), cycle, drawn)
    together = flows(np.zeros(len(robots)))
    best = flows(found.start)
    if best.saved <= together.saved:  # capacitors keep what the search takes as lost
        best = together
        found = Levelling(np.zeros(len(robots)), found.together, found.together, found.any_start,
                          found.mean)  # fmt: skip
    return PlannedBus(together, best, found)
