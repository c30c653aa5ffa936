"""Where the work stands: all configurations of a program move with the workpiece.

The workpiece, or the base the other way, is shifted in a box without being turned. Each
configuration follows by inverse kinematics from where it is now, so elbow and wrist keep their
sides; a place that a configuration cannot reach within its limits is left out. Between two
configurations joints move in step, so limits hold there as well. Where the URDF has collision
shapes, a place is left out where the robot would touch itself, on the way too.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from robot_energy.foundation.errors import MotionError
from robot_energy.physics.collision import SelfCollision, touching_moves
from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion.inverse_kinematics import InverseKinematics
from robot_energy_plan.optimization.candidates import Candidates, PtpMoves
from robot_energy_plan.optimization.chain import TORQUE_SHARE, PowerChain
from robot_energy_plan.optimization.ptp_form import PtpForm

POINTS = 5  # along each axis of the box, in each of two rounds
SMALL = 1e-6  # m, below which an axis of the box is none


@dataclass(frozen=True)
class Placement:
    """The best place that was found.

    Attributes:
        offset: From where the work is now, in the base frame, shape (3,). [m]
        joint_position: Configurations there, shape (K, n). [rad] or [m]
        tried: Places that were looked at.
        touching: Of these, cheaper than what was found, but the robot would touch itself.
    """

    offset: Float
    joint_position: Float
    tried: int
    reachable: int
    touching: int = 0


def best_place(
    form: PtpForm,
    chain: PowerChain,
    box: Float,
    link: str,
    wait_power: float = 0.0,
    collision: SelfCollision | None = None,
) -> Placement:
    """Return the place where the program as it is needs least energy; if none is better, its own.

    Args:
        box: Half widths of the box, in the base frame, shape (3,); 0 for an axis that is
            fixed. [m]
        link: Frame that holds the work.
        wait_power: Power of the wait that takes what is left of the cycle. [W]
        collision: Shapes of the robot; None: not looked at.

    Raises:
        MotionError: If the box makes no sense, or the robot has no inverse kinematics.
        RobotDescriptionError: If there is no such link.
    """
    if box.shape != (3,) or not (np.isfinite(box) & (box >= 0)).all() or box.max() < SMALL:
        raise MotionError(
            f"the box has half widths {box.tolist()} m", "three lengths >= 0 m, one of them > 0"
        )
    search = _Search(form, chain, link, wait_power, collision)
    steps = [np.linspace(-1.0, 1.0, POINTS) if side >= SMALL else np.zeros(1) for side in box]
    best, offset = search.best(np.array(list(product(*steps))) * box, np.zeros(3))
    finer = box / (POINTS - 1)
    around = np.clip(offset + np.array(list(product(*steps))) * finer, -box, box)
    best, offset = search.best(around, offset)
    return Placement(offset, best, search.tried, search.reachable, search.touching)


class _Search:
    """Costs of the program at many places at once."""

    def __init__(
        self,
        form: PtpForm,
        chain: PowerChain,
        link: str,
        wait_power: float,
        collision: SelfCollision | None,
    ) -> None:
        self._wait, self._collision = wait_power, collision
        self._form, self._chain = form, chain
        self._poses = [chain.robot.link_pose(via, link) for via in form.joint_position]
        self._kinematics = [
            InverseKinematics(chain.robot, link, orientation=pose[1])
            if chain.robot.n_joints >= len(pose[1]) * 2
            else InverseKinematics(chain.robot, link)
            for pose in self._poses
        ]
        self.tried = self.reachable = self.touching = 0
        energy, self._period, _ = self._costs(form.joint_position[None])
        self._least = float(energy[0])
        self._found: Float = form.joint_position

    def best(self, offsets: Float, offset: Float) -> tuple[Float, Float]:
        """Return configurations and offset of the best place so far."""
        places: list[Float] = []
        kept: list[Float] = []
        for one in offsets:
            self.tried += 1
            try:
                places.append(self._at(one))
            except MotionError:
                continue
            kept.append(one)
        if not kept:
            return self._found, offset
        energy, period, torque = self._costs(np.array(places))
        usable = (period <= self._period[0] * (1 + 1e-9)) & (torque <= TORQUE_SHARE)
        self.reachable += int(usable.sum())
        cheaper = np.flatnonzero(usable & (energy < self._least))
        for row in map(int, cheaper[np.argsort(energy[cheaper])]):
            if self._collision is None or touching_moves(self._collision, places[row]) is None:
                self._least, self._found = float(energy[row]), places[row]
                return self._found, kept[row]
            self.touching += 1
        return self._found, offset

    def _at(self, offset: Float) -> Float:
        """Configurations with the work shifted."""
        return np.array(
            [
                kinematics.solve((place + offset)[None], via)[0]
                for kinematics, (place, _), via in zip(
                    self._kinematics, self._poses, self._form.joint_position, strict=True
                )
            ]
        )

    def _costs(self, places: Float) -> tuple[Float, Float, Float]:
        """Energy minus that of a wait as long, period, and use of the torque limits."""
        count, moves, joints = places.shape
        start = places.reshape(-1, joints)
        goal = np.roll(places, -1, axis=1).reshape(-1, joints)
        base, limits = self._form.base, self._form.full_limits
        every = Candidates(
            np.arange(int(count * moves)),
            np.tile(base.speed, count),
            np.tile(base.acceleration, count),
        )
        use = self._chain.moves(PtpMoves(start, goal, limits), every)
        needed = self._form.needed
        rest = self._chain.rests(start).energy.reshape(count, moves) @ needed
        period = use.duration.reshape(count, moves).sum(axis=1) + needed.sum()
        return (
            use.energy.reshape(count, moves).sum(axis=1) + rest - self._wait * period,
            period,
            use.torque_use.reshape(count, moves).max(axis=1),
        )
