"""A recording run through the stages of the monitor, and what the checks need of it.

Of a recording of any length whole windows are kept, evenly spread: memory is bounded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, fields, replace
from typing import Annotated, TypeVar

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.inputs.joint_states.plausibility import JointStateProblem
from robot_energy.inputs.sources import Inputs
from robot_energy.model import RobotModel
from robot_energy.model.payload import Payload
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.rigid_body import Robot
from robot_energy.physics.torque_limits import TorqueLimitWatch
from robot_energy.pipeline import Output
from robot_energy.replay.bag_replay import Replay
from robot_energy.timeline.blocks import (
    DOUBTFUL,
    NANOSECOND,
    Block,
    EffortMeaning,
    Float,
    Int,
    MeterBlock,
    PowerBlock,
    Quality,
    SupplyBlock,
    TorqueBlock,
)
from robot_energy_identify.check.effort import check_effort
from robot_energy_identify.check.finding import Finding

BY_SAMPLE = (
    "stamp_ns", "segment", "position", "velocity", "acceleration", "motor_torque",
    "temperature_degc", "moving",
)  # fmt: skip
HARMLESS = ("duplicate_stamp", "unknown_joint")  # said twice, or of another robot
MAX_ROWS = 300  # of the torque checks: many times the samples that count as independent
WINDOW_NS = 10_000_000_000
MAX_SAMPLES = 60_000  # kept; some 0.5 kB each for six joints
NEEDED = (
    "joint_position", "joint_velocity", "joint_acceleration", "motor_torque_measured",
    "motor_torque_rigid", "shaft_power_measured", "motor_temperature_degc",
)  # fmt: skip
Kept = TypeVar("Kept", bound=Block)
Window = tuple[list[TorqueBlock], list[PowerBlock], list[MeterBlock]]


class Remarks(Described):
    """What the stages of the monitor noticed while the recording ran through them."""

    problems: Annotated[tuple[str, ...], "Of the bag, one sentence each."] = ()
    temperatures: Annotated[tuple[str, ...] | None, "Of temperatures; None without a topic."] = None
    stuck: Annotated[tuple[str, ...], "Joints whose temperature stands although losses warm."] = ()
    meter: tuple[str, ...] = ()
    effort_factors: Annotated[
        Mapping[EffortMeaning, tuple[float, float]],
        "Measured over body torque and correlation, by meaning; see `EffortCheck.factors`.",
    ] = field(default_factory=dict[EffortMeaning, tuple[float, float]])
    stream: Annotated[tuple[JointStateProblem, ...], "What is wrong with stamps, publishers."] = ()
    refused: Annotated[
        Mapping[str, float], "Share of the joint states that were refused, by reason. [-]"
    ] = field(default_factory=dict[str, float])
    repeating: Annotated[bool, "Whether the driver repeats its joint states."] = False


class Evidence(Described):
    """What the checks look at. Joint side unless it says ``motor``; n joints."""

    model: RobotModel
    robot: Annotated[Robot, "Its rigid bodies, with its payload."]
    drivetrain: Drivetrain
    effort: Annotated[EffortMeaning, "What the effort of the recording was said to mean."]
    stamp_ns: Annotated[Int, "Of the samples with position and velocity, shape (N,). [ns]"]
    segment: Annotated[Int, "Stretches without gaps, shape (N,)."]
    position: Annotated[Float, "Shape (N, n). [rad] or [m]"]
    velocity: Annotated[Float, "Shape (N, n). [rad/s] or [m/s]"]
    acceleration: Annotated[Float, "NaN without a full window, shape (N, n). [rad/s^2] or [m/s^2]"]
    motor_torque: Annotated[
        Float,
        "Measured, at the shaft where its power is known, shape (N, n); NaN if unknown. [N m]",
    ]
    temperature_degc: Annotated[Float, "Motor temperatures that were used, shape (N, n). [degC]"]
    moving: Annotated[NDArray[np.bool_], "Which samples of which joint move, shape (N, n)."]
    supply: Annotated[SupplyBlock | None, "Predicted powers of every sample."] = None
    shaft_power: Annotated[Float | None, "Measured, rows of `supply`, shape (M, n). [W]"] = None
    meter: Annotated[MeterBlock | None, "Readings of the meter; None without one."] = None
    beyond_torque: Annotated[
        Mapping[str, str], "Joints beyond their torque limit too often, a sentence each."
    ] = field(default_factory=dict[str, str])
    remarks: Annotated[Remarks, "What the stages of the monitor noticed."] = field(
        default_factory=Remarks
    )
    inputs: Annotated[Inputs, "How the recording was read."] = field(default_factory=Inputs)
    name: Annotated[str, "Of the recording, where it is one of several."] = ""
    derived: Annotated[bool, "Whether velocities come from the positions."] = False
    of_effort: Annotated[tuple[Finding, ...], "What is wrong with it, found without a fit."] = ()

    @property
    def names(self) -> tuple[str, ...]:
        return self.model.joint_names

    @property
    def durations(self) -> Float:
        """Time that each sample stands for, shape (N,); gaps do not count. [s]"""
        step = np.diff(self.stamp_ns, append=self.stamp_ns[-1:]) * NANOSECOND
        return np.asarray(np.clip(step, 0.0, 5.0 * np.median(step)))

    def thinned(self) -> Evidence:
        """Return at most `MAX_ROWS` samples, evenly taken, and no power."""
        few = self.rows(slice(None, None, max(1, -(-len(self.stamp_ns) // MAX_ROWS))))
        return replace(few, supply=None, shaft_power=None, meter=None)

    def rows(self, chosen: slice) -> Evidence:
        return replace(self, **{name: getattr(self, name)[chosen] for name in BY_SAMPLE})

    @property
    def motion(self) -> tuple[Float, Float, Float]:
        """Position, velocity and acceleration as the rigid bodies take them, shape (N, n) each."""
        as_rows = np.ascontiguousarray
        return as_rows(self.position), as_rows(self.velocity), as_rows(self.acceleration)


def remarks_of(result: Replay) -> Remarks:
    account = result.joint_states.rejections
    stuck = zip(result.model.joint_names, result.pipeline.power.watch.stuck, strict=True)
    return Remarks(
        tuple(result.problems),
        tuple(note for note in result.notes if "temperature" in note)
        if result.temperatures.topics
        else None,
        tuple(name for name, is_so in stuck if is_so),
        tuple(result.account.judgement.findings(result.account.comparison, ended=True)),
        result.pipeline.torque.effort_check.factors(),
        tuple(result.joint_states.stream_findings()),
        {
            reason: count / account.received
            for reason, count in account.rejected.most_common()
            if reason not in HARMLESS
        },
        result.joint_states.repeating,
    )


def evidence_of(
    model: RobotModel,
    effort: EffortMeaning,
    torque: TorqueBlock,
    power: PowerBlock | None,
    meter: MeterBlock | None,
    remarks: Remarks,
    inputs: Inputs | None = None,
    carried: Sequence[Payload] | None = None,
    beyond_torque: Mapping[str, str] | None = None,
) -> Evidence:
    """Return the evidence in what the stages of the monitor gave.

    The power may be of some of the samples; the payload carried at the end is that of the model
    where it is None, and joints beyond their torque limit are counted from these samples.
    """
    robot, drivetrain = Robot.from_model(model), Drivetrain.from_model(model)
    if beyond_torque is None:
        limit_watch = TorqueLimitWatch(robot.limits, drivetrain)
        limit_watch.step(torque)
        beyond_torque = limit_watch.sentences()
    torque = torque[np.asarray(torque.payload_mass == torque.payload_mass[-1])]
    doubtful = (torque.quality & np.uint32(DOUBTFUL)) != 0
    acceleration = np.where(doubtful[:, None], np.nan, torque.joint_acceleration)
    torque = replace(torque, joint_acceleration=acceleration)
    known = np.isfinite(torque.joint_position).all(axis=1)
    torque = torque[np.asarray(known & np.isfinite(torque.joint_velocity).all(axis=1))]
    temperature = np.full(torque.joint_position.shape, np.nan)
    measured, supply, shafts = torque.motor_torque_measured.copy(), None, None
    if power is not None:
        _, ours, theirs = np.intersect1d(torque.stamp_ns, power.stamp_ns, return_indices=True)
        temperature[ours] = power.motor_temperature_degc[theirs]
        measured[ours] = power.motor_torque_measured[theirs]  # at the shaft
        supply, shafts = power.supply, power.shaft_power_measured
    return Evidence(
        model=model,
        robot=robot if carried is None else robot.with_payload(carried),
        drivetrain=drivetrain,
        effort=effort,
        stamp_ns=torque.stamp_ns,
        segment=torque.segment,
        position=torque.joint_position,
        velocity=torque.joint_velocity,
        acceleration=torque.joint_acceleration,
        motor_torque=np.full_like(measured, np.nan) if effort is EffortMeaning.NONE else measured,
        temperature_degc=temperature,
        moving=moving(model, torque.stamp_ns, torque.joint_velocity),
        supply=supply,
        shaft_power=shafts,
        meter=meter,
        beyond_torque=beyond_torque,
        remarks=remarks,
        inputs=inputs or Inputs(),
        derived=bool((torque.quality & np.uint32(Quality.VELOCITY_DERIVED)).all()),
        of_effort=()
        if effort is EffortMeaning.NONE
        else tuple(check_effort(model.joint_names, torque)),
    )


def joined(parts: Sequence[Evidence]) -> Evidence:
    """Return thinned recordings of one robot and payload as one, of as many samples as three."""
    parts = [one.rows(slice(None, None, -(-len(parts) // 3))) for one in parts]
    columns = {name: np.concatenate([getattr(one, name) for one in parts]) for name in BY_SAMPLE}
    return replace(parts[0], **columns)


def moving(model: RobotModel, stamps: Int, velocity: Float) -> NDArray[np.bool_]:
    """Return which samples of which joint move, shape (N, n).

    Args:
        stamps: Rising, shape (N,). [ns]
        velocity: Shape (N, n). [rad/s] or [m/s]
    """
    standstill = np.array([joint.standstill_velocity for joint in model.joints])
    noise = velocity_noise(stamps, velocity)
    limit = np.maximum(standstill, 4.0 * np.where(np.isfinite(noise), noise, 0.0))
    return np.asarray(np.abs(velocity) > limit)


def velocity_noise(stamps: Int, velocity: Float) -> Float:
    """Return the noise of each joint's velocity, NaN with too few samples, as in `moving`, (n,).

    It is from the quietest stretches, at rest or at constant speed: the standard deviation about a
    straight line within windows of a quarter of a second, of which the lowest twentieth counts.
    """
    unknown = np.full(velocity.shape[1], np.nan)
    if len(stamps) < 2:
        return unknown
    period = float(np.median(np.diff(stamps))) * NANOSECOND
    size = max(5, round(0.25 / period)) if period > 0 else 5
    count = len(stamps) // size
    if count < 4:
        return unknown
    windows = velocity[: count * size].reshape(count, size, -1)
    ramp = np.linspace(-1.0, 1.0, size)[None, :, None]
    slope: Float = (windows * ramp).sum(axis=1, keepdims=True) / float((ramp**2).sum())
    rest: Float = windows - windows.mean(axis=1, keepdims=True) - slope * ramp
    ordered = np.sort(np.std(rest, axis=1), axis=0)
    return np.asarray(ordered[int(0.05 * len(ordered))], dtype=np.float64)


class Windows:
    """Keeps all windows, then every second one, every fourth, ... as they become too many."""

    def __init__(self, model: RobotModel) -> None:
        robot = Robot.from_model(model)
        self._limits = TorqueLimitWatch(robot.limits, Drivetrain.from_model(model))
        self._begin = self._samples = 0
        self._every = 1
        self._windows: dict[int, Window] = {}

    @property
    def beyond(self) -> dict[str, str]:
        """Joints of the whole recording that need more than their torque limit too often."""
        return self._limits.sentences()

    def take(self, output: Output) -> None:
        if output.torque is not None:
            self._limits.step(output.torque)
        for kind, block in enumerate((output.torque, output.power, output.meter)):
            if block is None or not len(block):
                continue
            self._begin = self._begin or int(block.stamp_ns[0])
            number = (int(block.stamp_ns[0]) - self._begin) // WINDOW_NS
            if number % self._every:
                continue
            window = self._windows.setdefault(number, ([], [], []))
            window[kind].append(_needed(block))  # type: ignore[arg-type]
            if kind == 0:
                self._samples += len(block)
        while self._samples > MAX_SAMPLES and len(self._windows) > 1:
            self._every *= 2
            for number in [one for one in self._windows if one % self._every]:
                self._samples -= sum(map(len, self._windows.pop(number)[0]))

    def blocks(self) -> tuple[TorqueBlock, PowerBlock | None, MeterBlock | None]:
        """Return what is kept; a window that does not follow the one before is a segment."""
        torque: list[TorqueBlock] = []
        power: list[PowerBlock] = []
        meter: list[MeterBlock] = []
        for number, window in sorted(self._windows.items()):
            apart = number << 32 if self._every > 1 else 0
            torque += [replace(one, segment=one.segment + apart) for one in window[0]]
            power += [replace(one, segment=one.segment + apart) for one in window[1]]
            meter += window[2]
        return (
            TorqueBlock.concatenate(torque),
            PowerBlock.concatenate(power) if power else None,
            MeterBlock.concatenate(meter) if meter else None,
        )


def _needed(block: Kept) -> Kept:
    """Without the columns of each joint that no check looks at."""
    none = np.empty((len(block), 0))
    wide = {
        one.name: none
        for one in fields(block)
        if one.name not in NEEDED and np.ndim(getattr(block, one.name)) == 2
    }
    return replace(block, **wide)
