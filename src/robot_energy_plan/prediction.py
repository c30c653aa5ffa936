"""Prediction: the energy of a motion before it is made, through the stages that run live.

The motion is known, so its accelerations are taken as they are instead of being derived from
samples (`EnergyPipeline.plan`); torque, friction, drives, cabinet and energy account are those
of live operation and replay. Motor temperatures are assumed and held. A motion that the robot
cannot make uses more than its limits (URDF specification, element `limit`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Unpack

import numpy as np

from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.auxiliary import AuxiliaryAccount
from robot_energy.accounting.averaging import MeanBlock
from robot_energy.foundation.errors import MotionError, UnknownJointError
from robot_energy.inputs.joint_states.decode import joint_block
from robot_energy.model import RobotModel
from robot_energy.model.auxiliary import AuxiliaryLoad
from robot_energy.model.friction_laws import FRICTION_LAWS
from robot_energy.model.payload import Payload, several_carried
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.friction import FrictionModel
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.pipeline import EnergyPipeline, Output, Settings
from robot_energy.pipeline.work_sums import WorkSums
from robot_energy.timeline.blocks import (
    NANOSECOND,
    PLAUSIBLE_DEGC,
    Float,
    Int,
    JointBlock,
    PowerBlock,
    TemperatureBlock,
    TorqueBlock,
)
from robot_energy_plan.motion.planned import MAX_DURATION, PlannedMotion, planned_ns, repeated
from robot_energy_plan.motion.ptp import Trajectory
from robot_energy_plan.options import PredictOptions

ROUNDING = 1e-6  # by which a use may exceed 1 and still be within the limit
SAME = 0.02  # of the limit, within which two motions use as much of it
START_NS = 1_000_000_000  # stamps of 0 mean that there is none
POINTS = 1500  # of the curve of power, at most
MIN_PERIOD = 0.02  # s
MAX_REPEATS = 100_000
MAX_SAMPLES = 5_000_000  # of all repetitions: minutes of work, and hours of motion


class LimitUse:
    """Greatest share of the speed and torque limits of the URDF, joint by joint.

    The torque is that of the drive at the joint: bodies, rotor and friction.

    Attributes:
        speed: Greatest speed over its limit, NaN where there is no limit, shape (n,). [-]
        torque: Greatest torque or force over its limit, same. [-]
    """

    def __init__(self, model: RobotModel, limits: JointLimits, start_ns: int) -> None:
        self._limits = limits
        self._drivetrain = Drivetrain.from_model(model)
        self._start_ns = start_ns
        size = len(limits.joint_names)
        self.speed: Float = np.where(np.isfinite(limits.velocity), 0.0, np.nan)
        self.torque: Float = np.where(np.isfinite(limits.effort), 0.0, np.nan)
        self._outside: Float = np.zeros(size)  # rad or m beyond the range of positions
        self._when = {name: np.zeros(size) for name in ("speed", "torque", "outside")}  # s

    def motion(self, block: TorqueBlock) -> None:
        """Take positions and speeds."""
        limits, position = self._limits, block.joint_position
        outside = np.maximum(limits.lower - position, position - limits.upper)
        self._outside = self._greater("outside", self._outside, outside, block.stamp_ns)
        speed = np.abs(block.joint_velocity) / limits.velocity
        self.speed = self._greater("speed", self.speed, speed, block.stamp_ns)

    def drives(self, block: PowerBlock) -> None:
        """Take the torques of the drives."""
        torque = np.abs(self._drivetrain.joint_torque_from_motor(block.motor_torque))
        use = torque / self._limits.effort
        self.torque = self._greater("torque", self.torque, use, block.stamp_ns)

    def _greater(self, name: str, known: Float, values: Float, stamp_ns: Int) -> Float:
        row = np.argmax(values, axis=0)
        found = values[row, np.arange(values.shape[1])]
        more = found > known
        time = (stamp_ns[row] - self._start_ns) * NANOSECOND
        self._when[name] = np.where(more, time, self._when[name])
        return np.where(more, found, known)

    def sentences(self, given: LimitUse | None = None) -> list[str]:
        """Return one sentence for each joint and limit that the motion exceeds.

        Args:
            given: Of a motion that the robot makes; what uses no more than it is left out.
        """
        found: list[str] = []
        most = (1.0, 1.0) if given is None else (given.speed + SAME, given.torque + SAME)
        most_speed, most_torque = (
            np.broadcast_to(np.fmax(one, 1.0), self.speed.shape) for one in most
        )
        for joint, name in enumerate(self._limits.joint_names):
            if self._outside[joint] > ROUNDING:
                found.append(
                    f"joint '{name}' is {self._outside[joint]:.4g} {self._limits.unit(joint)} "
                    f"beyond its range at {self._when['outside'][joint]:.3f} s"
                )
            for what, use, limit in (
                ("speed", self.speed, most_speed),
                ("torque", self.torque, most_torque),
            ):
                if use[joint] > limit[joint] + ROUNDING:
                    found.append(
                        f"joint '{name}' needs {100 * use[joint]:.0f} % of its {what} limit at "
                        f"{self._when[what][joint]:.3f} s: the robot cannot make this motion"
                    )
        return found


@dataclass
class Prediction:
    """What a prediction gave."""

    program: str
    model: RobotModel
    motor_temperature_degc: Annotated[Float, "Assumed and held, shape (n,). [degC]"]
    extrapolated: Annotated[tuple[str, ...], "Joints extrapolated to that temperature."]
    one_temperature: Annotated[tuple[str, ...], "Joints with one friction at every temperature."]
    duration: Annotated[float, "Of all repetitions. [s]"]
    repeat: int
    pipeline: EnergyPipeline
    limits: LimitUse
    work: Annotated[WorkSums, "Path of the tool and work on the bodies."]
    means: MeanBlock | None = None
    notes: list[str] = field(default_factory=list[str])
    payload: Annotated[
        tuple[Payload, ...], "Given; it replaces the model's on that link alone."
    ] = ()

    @property
    def account(self) -> EnergyAccount:
        """Registers and phases."""
        return self.pipeline.account


def predict(
    model: RobotModel,
    motion: PlannedMotion,
    motor_temperature_degc: float | Sequence[float] | Float,
    program: str = "the motion",
    *,
    notes: Sequence[str] = (),
    on_output: Callable[[Output], None] | None = None,
    **options: Unpack[PredictOptions],
) -> Prediction:
    """Return the predicted energy of a motion, with its account.

    Args:
        motion: From start to end; its joints are matched by name.
        motor_temperature_degc: One for all motors, or shape (n,). [degC]
        notes: What a reader should know of the motion, one sentence each.
    """
    payload, auxiliary = options.get("payload", ()), options.get("auxiliary", {})
    repeat, max_samples = options.get("repeat", 1), options.get("max_samples", MAX_SAMPLES)
    progress = options.get("progress")
    temperature = _temperatures(motor_temperature_degc, len(model.joints))
    order = _order(model, motion.joint_names)
    samples = planned_samples(motion, repeat)
    duration = motion.duration * repeat
    if samples > max_samples:
        raise MotionError(
            f"{program} has {samples} samples over {duration:.4g} s",
            f"at most {max_samples} samples",
            "predict fewer repetitions or a part of it, or allow more",
        )
    period = max(MIN_PERIOD, duration / POINTS)
    pipeline = EnergyPipeline(model, Settings(power_period=period, temperature_assumed=True))
    if model.auxiliary or auxiliary:
        pipeline.account.auxiliary = AuxiliaryAccount(_loads(model, auxiliary), planned=True)
    for body in payload:
        pipeline.torque.set_payload(body)
    friction = FrictionModel.from_model(model)
    outside = friction.extrapolated(temperature)
    names = model.joint_names
    result = Prediction(
        program=program,
        model=model,
        motor_temperature_degc=temperature,
        extrapolated=tuple(name for name, is_so in zip(names, outside, strict=True) if is_so),
        one_temperature=tuple(
            joint.name
            for joint in model.joints
            if not FRICTION_LAWS[joint.friction.viscous.law].follows_temperature
        ),
        duration=duration,
        repeat=repeat,
        pipeline=pipeline,
        limits=LimitUse(model, pipeline.torque.robot.limits, START_NS),
        work=WorkSums(pipeline.torque.robot),
        notes=[*notes, *_besides(model, payload)],
        payload=tuple(payload),
    )
    means: list[MeanBlock] = []

    def take(output: Output) -> None:
        result.work.take(output)
        if output.torque is not None:
            result.limits.motion(output.torque)
        if output.power is not None:
            result.limits.drives(output.power)
        if output.means is not None:
            means.append(output.means)
        if on_output is not None:
            on_output(output)

    held: TemperatureBlock | None = TemperatureBlock(
        stamp_ns=np.array([START_NS]), motor_temperature_degc=temperature[None, :]
    )
    for time, path in repeated(motion, repeat):
        take(pipeline.step(planned_block(time, path, order), held, planned=True))
        held = None
        if progress is not None:
            progress(min(1.0, float(time[-1]) / duration))
    take(pipeline.flush())
    result.means = MeanBlock.concatenate(means) if means else None
    return result


def planned_samples(motion: PlannedMotion, repeat: int) -> int:
    """Return how many samples a prediction has, before it is made."""
    if not 1 <= repeat <= MAX_REPEATS:
        raise MotionError(f"{repeat} repetitions were asked for", f"1 to {MAX_REPEATS}")
    duration = motion.duration * repeat
    if not 0 < duration <= MAX_DURATION:
        raise MotionError(f"all repetitions last {duration:.4g} s", f"at most {MAX_DURATION:g} s")
    return motion.sample_count * repeat


def _besides(model: RobotModel, payload: Sequence[Payload]) -> list[str]:
    """A note where bodies that were given count besides those of the model."""
    given = {body.link: body for body in payload}
    carried = [*(body for body in model.payload if body.link not in given), *given.values()]
    several = several_carried(carried) if any(body.mass for body in payload) else ""
    return [
        f"the robot carries {several}: a payload counts besides what the model has on other links; "
        "where both are one body, give it the link of the model"
    ] * bool(several)


def _loads(model: RobotModel, states: Mapping[str, str]) -> list[AuxiliaryLoad]:
    loads = {load.name: load for load in model.auxiliary or ()}
    for name, state in states.items():
        if name not in loads:
            raise MotionError(
                f"the model has no auxiliary load '{name}'", ", ".join(loads) or "a model with one"
            )
        if state not in loads[name].states:
            known = ", ".join(loads[name].states)
            raise MotionError(f"the load '{name}' has no state '{state}'", known)
        loads[name] = loads[name].model_copy(update={"state": state})
    return list(loads.values())


def _temperatures(given: float | Sequence[float] | Float, n_joints: int) -> Float:
    try:
        values = np.atleast_1d(np.asarray(given, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise MotionError(f"the motor temperatures are {given!r}", "numbers in degC") from error
    if values.shape not in ((1,), (n_joints,)):
        raise MotionError(
            f"{values.size} motor temperatures were given",
            f"one for all motors, or one for each of {n_joints} joints",
        )
    low, high = PLAUSIBLE_DEGC
    if not ((values >= low) & (values <= high)).all():
        raise MotionError(
            f"the motor temperatures are {values.tolist()} degC", f"{low:g} to {high:g} degC"
        )
    return np.broadcast_to(values, (n_joints,)).copy()


def _order(model: RobotModel, joint_names: Sequence[str]) -> list[int]:
    missing = [name for name in model.joint_names if name not in joint_names]
    foreign = [name for name in joint_names if name not in model.joint_names]
    if missing or foreign:
        which = f"lacks {missing[0]}" if missing else f"moves {foreign[0]} as well"
        raise UnknownJointError(
            f"the motion moves {', '.join(joint_names)} and {which}",
            f"the joints of the model, {', '.join(model.joint_names)}",
            "use the model of this robot",
        )
    return [list(joint_names).index(name) for name in model.joint_names]


def planned_block(
    time: Float, path: Trajectory, order: list[int] | slice = slice(None)
) -> JointBlock:
    """Return a motion as the pipeline takes it; the first sample is at `START_NS`.

    Args:
        time: Since the start, shape (N,). [s]
        order: Joints of the model among those of the motion.
    """
    stamp = START_NS + planned_ns(time)
    states = (path.joint_position, path.joint_velocity, path.joint_acceleration)
    position, velocity, acceleration = (np.ascontiguousarray(one[:, order]) for one in states)
    return replace(joint_block(stamp, position, velocity), joint_acceleration=acceleration)
