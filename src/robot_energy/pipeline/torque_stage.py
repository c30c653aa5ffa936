"""First stage: joint states -> rigid-body torque, with the payload in force at each instant."""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterator
from dataclasses import field, replace
from itertools import starmap
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import PayloadError
from robot_energy.model import RobotModel
from robot_energy.model.payload import Payload
from robot_energy.physics.derivative import Derivative
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.effort import Effort, EffortCheck
from robot_energy.physics.equations import mapped
from robot_energy.physics.rigid_body import Robot
from robot_energy.pipeline.settings import Settings
from robot_energy.timeline.blocks import EffortMeaning, JointBlock, TorqueBlock

MAX_COMING = 100  # changes that may wait for their stamps


class PayloadChange(Described):
    """A payload and when it comes into force."""

    from_ns: Annotated[int, "First instant of validity; 0: from the start. [ns]"]
    payload: Annotated[
        Payload, "The body that its link carries from then on, instead of any before."
    ]
    carried: Annotated[tuple[Payload, ...], "All bodies that the robot carries then."] = field(
        default=(), compare=False
    )


class PayloadTimeline:
    """Keeps the robot with the payload in force, and the changes still to come.

    One body per link: a change replaces all that its link carried, also what the model
    file says, and leaves other links alone; a mass of 0 takes it off. A change comes into
    force at the first sample that is not older than its stamp, and stays until the next,
    across backward jumps of the stamps as well: the gripper does not open when a
    simulation restarts. The result does not depend on how samples are cut into blocks.

    Attributes:
        coming: Changes that no sample has reached yet, in order of their stamps.
        done_ns: Newest sample that was handed out; None before the first. [ns]
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.coming: list[PayloadChange] = []
        self.done_ns: int | None = None

    def carried_at(self, stamp_ns: int) -> tuple[Payload, ...]:
        """Return the bodies that the robot carries at a stamp after the newest torque."""
        carried = {body.link: body for body in self.robot.payload}
        due = [change.payload for change in self.coming if change.from_ns <= stamp_ns]
        carried |= {body.link: body for body in due}
        return tuple(body for body in carried.values() if body.mass)

    def set(self, payload: Payload, from_ns: int) -> PayloadChange:
        """Return a change with the instant from which it really counts, and take it.

        Raises:
            RobotDescriptionError: If the URDF lacks the link; nothing changes then.
            PayloadError: If too many changes wait for stamps that never come.
        """
        if len(self.coming) >= MAX_COMING:
            raise PayloadError(
                f"{len(self.coming)} payloads already wait for their stamps",
                f"fewer than {MAX_COMING}",
                "set stamps in the time of the joint states",
            )
        self.robot.with_payload([payload])  # refuses an unknown link
        change = PayloadChange(from_ns, payload)
        insort(self.coming, change, key=lambda entry: entry.from_ns)
        if self.done_ns is not None and from_ns <= self.done_ns:
            change = PayloadChange(self.done_ns + 1, payload)
        return replace(change, carried=self.carried_at(change.from_ns))

    def pieces(self, block: JointBlock) -> Iterator[tuple[Robot, JointBlock]]:
        """Yield samples between changes of the payload, with the robot as it is loaded."""
        start = 0
        while self.coming:
            reached = block.stamp_ns[start:] >= self.coming[0].from_ns
            first = start + int(np.argmax(reached))
            if not reached.any():
                break
            if first > start:
                yield self.robot, block[slice(start, first)]
            start, payload = first, self.coming.pop(0).payload
            others = [body for body in self.robot.payload if body.link != payload.link]
            self.robot = self.robot.with_payload([*others, payload] if payload.mass else others)
        yield self.robot, block if start == 0 else block[slice(start, None)]


class TorqueStage:
    """Differentiates joint states and computes the torque that moves the bodies.

    The effort of the driver, if its meaning is set, becomes measured motor torque.

    Attributes:
        newest_ns: Newest joint state that has arrived, also one that `step` takes later: a payload
            that is set now counts after it; None before the first. [ns]
    """

    def __init__(self, model: RobotModel, settings: Settings | None = None) -> None:
        settings = settings or Settings()
        robot = Robot.from_model(model)
        self._payload = PayloadTimeline(robot)
        self._drivetrain = Drivetrain.from_model(model)
        self._effort: Effort | None = None
        if settings.effort is not EffortMeaning.NONE:
            self._effort = Effort.from_model(model, settings.effort, self._drivetrain)
        self.effort_check = EffortCheck(settings.effort, model, self._drivetrain)
        self._derivative = Derivative(
            settings.derivative_window,
            settings.derivative_lag,
            robot.limits.wraps,
        )
        self.newest_ns: int | None = None

    @property
    def robot(self) -> Robot:
        """The robot with the payload in force at the newest torque."""
        return self._payload.robot

    @property
    def coming_payloads(self) -> tuple[PayloadChange, ...]:
        """Changes of the payload that no torque has reached yet."""
        return tuple(self._payload.coming)

    @property
    def next_payload(self) -> tuple[Payload, ...]:
        """Bodies that the robot carries at the next joint state."""
        return self._payload.carried_at(0 if self.newest_ns is None else self.newest_ns + 1)

    def set_payload(self, payload: Payload, from_ns: int | None = None) -> PayloadChange:
        """Return the change of what one link carries, with the instant from which it counts.

        It replaces all that the link carried before, also what the model file says; other
        links keep theirs. A mass of 0 takes it off.

        Args:
            from_ns: First instant of validity, in the time of the joint states; None: from
                the next joint state on. One that has passed counts from the next torque
                on. [ns]
        """
        if from_ns is None:
            from_ns = 0 if self.newest_ns is None else self.newest_ns + 1
        return self._payload.set(payload, from_ns)

    def step(self, block: JointBlock) -> TorqueBlock | None:
        """Return the torques whose window is complete; None while every sample still waits."""
        if not len(block):
            return None
        self.newest_ns = int(block.stamp_ns[-1])
        return self._torque(self._derivative.step(block))

    def plan(self, block: JointBlock) -> TorqueBlock | None:
        """Return the torques of a planned motion, whose accelerations are exact; None for none."""
        if not len(block):
            return None
        self.newest_ns = int(block.stamp_ns[-1])
        return self._torque([block])

    def restart(self) -> None:
        """Drop what waits for its window, as after an error."""
        self._derivative.restart()

    def flush(self) -> TorqueBlock | None:
        """Return what still waits, as at the end of a bag."""
        return self._torque(self._derivative.flush())

    def _torque(self, parts: list[JointBlock]) -> TorqueBlock | None:
        if not parts:
            return None
        joints = JointBlock.concatenate(parts)
        payload = self._payload
        payload.done_ns = int(joints.stamp_ns[-1])
        pieces = payload.pieces(joints) if payload.coming else [(payload.robot, joints)]
        torque = TorqueBlock.concatenate([*starmap(self._rigid, pieces)])
        if self._effort is not None:
            self.effort_check.step(joints.joint_effort, torque.motor_torque_rigid)
        return torque

    @np.errstate(invalid="ignore", over="ignore")  # bad samples become NaN, nothing else
    def _rigid(self, robot: Robot, block: JointBlock) -> TorqueBlock:
        """Return the torque that moves bodies and rotors (paper A, eq. 2), and the measured one.

        ``motor_torque_rigid = C^-T (M qdd + c + g) + rotor_inertia * motor_acceleration``.
        """
        effort, drivetrain = block.joint_effort, self._drivetrain
        transmission, acceleration = drivetrain.transmission, block.joint_acceleration
        joint_torque = robot.joint_torque(block.joint_position, block.joint_velocity, acceleration)
        return TorqueBlock(
            stamp_ns=block.stamp_ns,
            segment=block.segment,
            quality=block.quality,
            joint_position=block.joint_position,
            joint_velocity=block.joint_velocity,
            joint_acceleration=acceleration,
            joint_torque_rigid=joint_torque,
            motor_velocity=mapped(transmission, block.joint_velocity),
            motor_torque_rigid=mapped(drivetrain.torque_map, joint_torque)
            + mapped(transmission, acceleration) * drivetrain.rotor_inertia,
            motor_torque_measured=np.full_like(effort, np.nan)
            if self._effort is None
            else self._effort.motor_torque(effort),
            payload_mass=np.full(len(block), robot.payload_mass),
        )
