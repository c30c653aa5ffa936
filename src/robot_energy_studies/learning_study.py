"""How far a learner comes: a model that is wrong, a robot at work on the rig, one power meter.

The model file is given friction and constant losses that are off by known shares; the robot
starts cold and warms with its own losses. No bag is written: the samples of the rig go
straight into the pipeline that a monitor runs.
"""

from __future__ import annotations

from typing import Annotated

from robot_energy.foundation.described import Described
from robot_energy.inputs.joint_states import decode
from robot_energy.model import RobotModel, load
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.timeline.blocks import EffortMeaning, JointBlock, Learning
from robot_energy_papers.models import with_friction_times, with_values
from robot_energy_plan.motion import MotionLimits, Program, random_program
from robot_energy_rig import PlantProfile, RigConfig, RigJoints, VirtualRig

MINUTE = 60  # s
RATE = 125.0  # of the joint states [Hz]
FRICTION, LOSSES = 0.7, 0.85  # of the mistaken model, over the true ones [-]
REST = 2.0  # s, at every third pose: a cell waits for its parts


class LearningRow(Described):
    """One minute of work."""

    minute: int
    error: Annotated[float, "Predicted over measured energy of this minute, less 1. [-]"]
    degc: Annotated[float, "Mean motor temperature at its end. [degC]"]


def mistaken(model: RobotModel, friction: float, losses: float) -> RobotModel:
    """Return a model whose friction and constant losses are multiplied by factors.

    Args:
        friction: Factor on Coulomb and viscous friction of all joints. [-]
        losses: Factor on the constant losses of the cabinet. [-]
    """
    laws = {joint.name: with_friction_times(joint, friction, friction) for joint in model.joints}
    cabinet = model.cabinet
    loss_dc, loss_grid = losses * cabinet.loss_dc.value, losses * cabinet.loss_grid.value
    cabinet = with_values(cabinet, loss_dc=loss_dc, loss_grid=loss_grid)
    return model.with_joints("friction", laws).changed(cabinet=cabinet)


def joint_block(joints: RigJoints, with_torque: bool = True) -> JointBlock:
    """Return joint states of a rig as the pipeline takes them: one segment of good samples.

    Args:
        with_torque: Whether the effort is the motor torque that the drives report.
    """
    effort = joints.measured_motor_torque if with_torque else None
    return decode.joint_block(joints.stamp_ns, joints.joint_position, joints.joint_velocity, effort)


def work(
    profile: PlantProfile, seed: int, moves: int = 30, zone: float = 0.6, override: float = 1.0
) -> Program:
    """Return the work of a robot: drawn point-to-point motions, a rest at every third pose.

    Args:
        zone: Share of the joint ranges that is used. [-]
        override: Share of full speed, in (0, 1]. [-]
    """
    limits: MotionLimits = profile.motion_limits(profile.mechanics()[0])
    via = random_program(limits, seed, moves, zone).via
    dwell = [REST if place % 3 == 0 else 0.1 for place in range(len(via))]
    return Program(via, limits, dwell, override)


def pipeline_of(model: RobotModel, learning: Learning, with_torque: bool) -> EnergyPipeline:
    """Return a pipeline for a robot with or without measured torque."""
    effort = EffortMeaning.MOTOR_TORQUE if with_torque else EffortMeaning.NONE
    return EnergyPipeline(model, Settings(effort=effort, power_period=None, learning=learning))


def at_work(
    pipeline: EnergyPipeline, rig: VirtualRig, minutes: int, with_torque: bool
) -> list[LearningRow]:
    """Return what a monitor says of a robot at work, one row per minute."""
    rows: list[LearningRow] = []
    for minute in range(1, minutes + 1):
        output = rig.step(round(MINUTE / rig.period))
        before = pipeline.account.comparison.joule
        joints = joint_block(output.joints, with_torque)
        pipeline.step(joints, output.temperatures, output.meter)
        measured, predicted = pipeline.account.comparison.joule - before
        degc = float(output.truth.motor_temperature_degc[-1].mean())
        rows.append(LearningRow(minute, float(predicted / measured - 1.0), degc))
    return rows


def learning_study(
    profile: PlantProfile,
    learning: Learning,
    with_torque: bool,
    minutes: int = 30,
    seed: int = 0,
    config: RigConfig | None = None,
) -> tuple[list[LearningRow], EnergyPipeline]:
    """Return one row per minute of a robot that starts cold, and the pipeline at the end.

    Args:
        profile: The plant; the monitor has the model of its bodies, mistaken.
    """
    rig = VirtualRig(profile, work(profile, seed), config, seed, rate_hz=RATE)
    model = mistaken(load(profile.body), FRICTION, LOSSES)
    pipeline = pipeline_of(model, learning, with_torque)
    return at_work(pipeline, rig, minutes, with_torque), pipeline
