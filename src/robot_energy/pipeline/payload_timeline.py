"""Which payload the robot carries at which instant."""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from robot_energy.foundation.errors import PayloadError
from robot_energy.model.payload import Payload
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import JointBlock

MAX_COMING = 100  # changes that may wait for their stamps


@dataclass(frozen=True)
class PayloadChange:
    """A payload and when it comes into force.

    Attributes:
        from_ns: First instant of validity; 0: from the start. [ns]
        payload: The body that its link carries from then on, instead of any before.
        carried: All bodies that the robot carries then.
    """

    from_ns: int
    payload: Payload
    carried: tuple[Payload, ...] = field(default=(), compare=False)


class PayloadTimeline:
    """Keeps the robot with the payload in force, and the changes still to come.

    One body per link: a change replaces all that its link carried, also what the model
    file says, and leaves other links alone; a mass of 0 takes it off. A change comes into
    force at the first sample that is not older than its stamp, and stays until the next,
    across backward jumps of the stamps as well: the gripper does not open when a
    simulation restarts. The result does not depend on how samples are cut into blocks.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._coming: list[PayloadChange] = []
        self._done_ns: int | None = None  # newest sample that was handed out

    @property
    def coming(self) -> tuple[PayloadChange, ...]:
        """Changes that no sample has reached yet, in order of their stamps."""
        return tuple(self._coming)

    def carried_at(self, stamp_ns: int) -> tuple[Payload, ...]:
        """Return the bodies that the robot carries at a stamp after the newest torque."""
        carried = {body.link: body for body in self.robot.payload}
        due = [change.payload for change in self._coming if change.from_ns <= stamp_ns]
        carried |= {body.link: body for body in due}
        return tuple(body for body in carried.values() if body.mass)

    def set(self, payload: Payload, from_ns: int) -> PayloadChange:
        """Return a change with the instant from which it really counts, and take it.

        Args:
            from_ns: First instant of validity; one that has passed means the next
                sample. [ns]

        Raises:
            RobotDescriptionError: If the URDF lacks the link; nothing changes then.
            PayloadError: If too many changes wait for stamps that never come.
        """
        if len(self._coming) >= MAX_COMING:
            raise PayloadError(
                f"{len(self._coming)} payloads already wait for their stamps",
                f"fewer than {MAX_COMING}",
                "set stamps in the time of the joint states",
            )
        self.robot.with_payload([payload])  # refuses an unknown link
        change = PayloadChange(from_ns, payload)
        insort(self._coming, change, key=lambda entry: entry.from_ns)
        if self._done_ns is not None and from_ns <= self._done_ns:
            change = PayloadChange(self._done_ns + 1, payload)
        return replace(change, carried=self.carried_at(change.from_ns))

    def pieces(self, block: JointBlock) -> Iterator[tuple[Robot, JointBlock]]:
        """Yield samples between changes of the payload, with the robot as it is loaded."""
        self._done_ns = int(block.stamp_ns[-1])
        start = 0
        while self._coming:
            reached = block.stamp_ns[start:] >= self._coming[0].from_ns
            first = start + int(np.argmax(reached))
            if not reached.any():
                break
            if first > start:
                yield self.robot, block[slice(start, first)]
            start = first
            self._apply(self._coming.pop(0).payload)
        yield self.robot, block if start == 0 else block[slice(start, None)]

    def _apply(self, payload: Payload) -> None:
        others = [body for body in self.robot.payload if body.link != payload.link]
        carried = [*others, payload] if payload.mass else others
        self.robot = self.robot.with_payload(carried)
