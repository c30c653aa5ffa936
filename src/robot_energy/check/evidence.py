"""A recording run through the stages of the monitor, and what the checks need of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robot_energy.bag_replay import Replay, replay
from robot_energy.blocks import (
    DOUBTFUL,
    NANOSECOND,
    EffortMeaning,
    Float,
    Int,
    MeterBlock,
    PowerBlock,
    TorqueBlock,
)
from robot_energy.inputs.sources import Inputs
from robot_energy.model import RobotModel
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.rigid_body import Robot
from robot_energy.pipeline import Output, Settings

MAX_ROWS = 2500  # of the torque checks


@dataclass(frozen=True)
class Evidence:
    """What the checks look at. Joint side unless it says ``motor``; n joints.

    Attributes:
        model: The model that the recording is checked against.
        robot: Its rigid bodies, with its payload.
        drivetrain: Its gears and rotors.
        effort: What the effort of the recording was said to mean.
        stamp_ns: Of the samples with a full derivative window, shape (N,). [ns]
        segment: Stretches without gaps, shape (N,).
        position: Shape (N, n). [rad] or [m]
        velocity: Shape (N, n). [rad/s] or [m/s]
        acceleration: Shape (N, n). [rad/s^2] or [m/s^2]
        motor_torque: Measured, shape (N, n); NaN where unknown. [N m]
        temperature_degc: Motor temperatures that were used, shape (N, n). [degC]
        replay: The replay itself, with its accounting and notes; None for rows of a log.
        meter: Readings of the meter; None without one.
        power: Predicted powers of every sample; None without one.
    """

    model: RobotModel
    robot: Robot
    drivetrain: Drivetrain
    effort: EffortMeaning
    stamp_ns: Int
    segment: Int
    position: Float
    velocity: Float
    acceleration: Float
    motor_torque: Float
    temperature_degc: Float
    replay: Replay | None
    meter: MeterBlock | None
    power: PowerBlock | None

    @property
    def names(self) -> tuple[str, ...]:
        """Joint names in model order."""
        return self.model.joint_names

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Which samples of which joint move, shape (N, n)."""
        standstill = np.array([joint.standstill_velocity for joint in self.model.joints])
        noise = rest_noise(self)
        limit = np.maximum(standstill, 4.0 * np.where(np.isfinite(noise), noise, 0.0))
        return np.asarray(np.abs(self.velocity) > limit)

    def thinned(self, parts: int = 1) -> Evidence:
        """Return at most `MAX_ROWS` samples, evenly taken.

        Args:
            parts: Of how many recordings it is one, which share the samples.
        """
        step = max(1, -(-len(self.stamp_ns) * parts // MAX_ROWS))
        rows = slice(None, None, step)
        names = ("stamp_ns", "segment", "position", "velocity", "acceleration", "motor_torque",
                 "temperature_degc")  # fmt: skip
        return replace(self, **{name: getattr(self, name)[rows] for name in names})


def gather(
    path: str | Path,
    model: RobotModel,
    effort: EffortMeaning = EffortMeaning.NONE,
    inputs: Inputs | None = None,
) -> Evidence:
    """Run a bag through the monitor's own stages and keep what the checks need.

    Args:
        path: MCAP file or rosbag2 folder.
        model: The model to check it against.
        effort: What the effort in the joint states means.
        inputs: What the inputs of a live monitor are, to read the bag in the same way.

    Returns:
        The evidence.

    Raises:
        RobotEnergyError: If the bag cannot be read, or gives no sample with this model.
    """
    outputs: list[Output] = []
    settings = Settings(effort=effort, power_period=None)
    if inputs is not None:
        settings = replace(settings, meter_max_gap=inputs.meter_max_gap)
    result = replay(path, model, None, settings, inputs=inputs, on_output=outputs.append)
    torque = TorqueBlock.concatenate([part.torque for part in outputs if part.torque is not None])
    power = [part.power for part in outputs if part.power is not None]
    meter = [part.meter for part in outputs if part.meter is not None]
    block = PowerBlock.concatenate(power) if power else None
    sound = (torque.quality & np.uint32(DOUBTFUL)) == 0
    temperature = np.full(torque.joint_position.shape, np.nan)
    if block is not None and len(block) == len(torque):
        temperature = block.motor_temperature_degc
    return Evidence(
        model=model,
        robot=Robot.from_model(model),
        drivetrain=Drivetrain.from_model(model),
        effort=effort,
        stamp_ns=torque.stamp_ns[sound],
        segment=torque.segment[sound],
        position=torque.joint_position[sound],
        velocity=torque.joint_velocity[sound],
        acceleration=torque.joint_acceleration[sound],
        motor_torque=torque.motor_torque_measured[sound],
        temperature_degc=temperature[sound],
        replay=result,
        meter=MeterBlock.concatenate(meter) if meter else None,
        power=block,
    )


def rest_noise(evidence: Evidence) -> Float:
    """Noise of each joint's velocity, from the quietest stretches at rest or at constant speed.

    The standard deviation about a straight line within windows of a quarter of a second, of
    which the lowest twentieth counts.

    Args:
        evidence: The recording.

    Returns:
        Shape (n,), NaN with too few samples. [rad/s] or [m/s]
    """
    return velocity_noise(evidence.stamp_ns, evidence.velocity)


def velocity_noise(stamps: Int, velocity: Float) -> Float:
    """Noise of velocities, as of `rest_noise`.

    Args:
        stamps: Rising, shape (N,). [ns]
        velocity: Shape (N, n). [rad/s] or [m/s]

    Returns:
        Shape (n,), NaN with too few samples. [rad/s] or [m/s]
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
