"""How far a learner comes: a model that is wrong, a robot at work on the rig, one power meter.

The model file is given friction and constant losses that are off by known shares; the robot
starts cold and warms with its own losses. No bag is written: the samples of the rig go
straight into the pipeline that a monitor runs.

And when wear is found: friction of one axis is multiplied in the plant, and the monitor sees joint
states, temperatures and motor torque alone. The hall swings between 15 and 60 degC once a day, and
the payload changes every half hour; half of the changes are unknown to the monitor.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from robot_energy.condition.wear import WearMonitor
from robot_energy.foundation.described import Described
from robot_energy.inputs.joint_states import decode
from robot_energy.model import RobotModel, load
from robot_energy.model.payload import payload
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


COLD, HOT = 15.0, 60.0  # of the hall [degC]
WEAR_RATE = 25.0  # of the joint states [Hz]
CHANGE_EVERY = 30  # min between two payloads
HIDDEN = 3.0  # greatest mass that the monitor does not get [kg]
DAY_HOURS = 24  # h


class WearRow(Described):
    """One axis that was made to wear."""

    joint: int
    found: Annotated[float, "From the beginning of wear until the alarm; NaN: none. [h]"]
    motion: Annotated[float, "Motion of this axis in that time. [h]"]
    named: Annotated[tuple[int, ...], "Axes with an alarm that somebody should look at."]
    size: Annotated[float, "Change stated at the end. [-]"]
    std: Annotated[float, "Its standard deviation. [-]"]


class Shift:
    """A rig at work in a hall that swings, with payloads that change, watched by a monitor."""

    def __init__(self, profile: PlantProfile, hard: bool = True) -> None:
        self._model = load(profile.body)
        config = RigConfig.hard() if hard else RigConfig()
        start = (COLD + HOT) / 2
        self._rig = VirtualRig(
            profile, work(profile, 0), config, 0, start, start, rate_hz=WEAR_RATE
        )
        self._pipeline = pipeline_of(self._model, Learning.OBSERVE, True)
        self._random = np.random.default_rng(0)
        self._minute = 0
        learner = self._pipeline.condition
        self.monitor: WearMonitor = learner.wear

    def run(self, minutes: int, wear: np.ndarray | None = None) -> None:
        """Work on.

        Args:
            wear: Factor on the friction of each axis, shape (n,); None leaves it. [-]
        """
        for _ in range(minutes):
            swing = np.sin(2 * np.pi * self._minute / (60 * DAY_HOURS))
            ambient = (COLD + HOT) / 2 + (HOT - COLD) / 2 * swing
            self._rig.change(ambient_degc=float(ambient), wear=wear)
            if self._minute % CHANGE_EVERY == 0:
                self._carry()
            output = self._rig.step(round(60 * WEAR_RATE))
            self._pipeline.step(joint_block(output.joints), output.temperatures, output.meter)
            self._minute += 1

    def _carry(self) -> None:
        """Take another payload, known to the monitor or not."""
        if not self._model.payload:
            return
        body = self._model.payload[0]
        kind = self._random.integers(4)
        known = body.mass * (self._random.uniform(0.2, 1.0) if kind == 2 else 1.0)
        true = known + (self._random.uniform(0.0, HIDDEN) if kind == 3 else 0.0)
        carried = [
            payload(body.link, float(mass), body.centre_of_mass, body.inertia)
            for mass in (true, known)
        ]
        self._rig.change(payload=carried[:1])
        self._pipeline.torque.set_payload(carried[1])

    def hours(self, joint: int) -> float:
        """Return how long an axis has moved. [h]"""
        return self.monitor.state().hours[joint]

    @property
    def alarms(self) -> tuple[int, ...]:
        """Axes whose friction has risen, by the monitor."""
        tests = self.monitor.joints
        return tuple(
            joint for joint, test in enumerate(tests) if test.changes and not test.drift.fell
        )


def detection(shift: Shift, joint: int, rise: float, before: float, after: float) -> WearRow:
    """Return when the wear of one axis is found.

    Args:
        rise: Of its friction, at once. [-]
        before: Time without wear. [h]
        after: Time with it. [h]
    """
    shift.run(round(60 * before))
    tests = shift.monitor.joints
    found, motion, worn = float("nan"), float("nan"), np.ones(len(tests))
    worn[joint] += rise
    begun = shift.hours(joint)
    for minute in range(1, round(60 * after) + 1):
        shift.run(1, worn)
        if np.isnan(found) and joint in shift.alarms:
            found, motion = minute / 60, shift.hours(joint) - begun
    drift = tests[joint].drift
    return WearRow(joint, found, motion, shift.alarms, drift.size, drift.std)
