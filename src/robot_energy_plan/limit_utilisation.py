"""How much of its limits a predicted motion uses: a robot that cannot make it uses more.

Source: URDF specification, element `limit`: velocity and effort of a joint.
"""

from __future__ import annotations

import numpy as np

from robot_energy.model import RobotModel
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, PowerBlock, TorqueBlock

ROUNDING = 1e-6  # by which a use may exceed 1 and still be within the limit
SAME = 0.02  # of the limit, within which two motions use as much of it


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
