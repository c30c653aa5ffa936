"""Joint positions that bring a tool to given places, by the structure of the robot.

- A gantry (prismatic joints only): linear, exact.
- A planar arm (parallel revolute axes): closed form where two joints are free, else the
  configuration nearest to the start (`motion.planar`).
- Six or more joints: the tool's orientation is held; Newton steps with the Jacobian, damped
  where it loses rank, each place from the solution of the one before.

Solutions keep to the position limits and bring the tool to within 1e-9 m, or are refused. Along a
path that is sampled densely they are continuous; `motion.tool_motion` refuses jumps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from robot_energy.foundation.errors import MotionError
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion.planar import MAX_STEP, PlanarArm
from robot_energy_plan.motion.ptp import LIMIT_TOLERANCE

IN_PLACE = 1e-10  # m, and rad of the orientation
LEVEL = 1e-9  # m: how far a place may lie off the plane of a planar arm
SINGULAR = 1e-3  # least singular value of a Jacobian [m/rad], a turn counting as one metre
DAMPING = 1e-2  # below this singular value steps are damped
MAX_STEPS = 100
SPATIAL_JOINTS = 6


class InverseKinematics:
    """Joint positions from tool positions.

    Args:
        link: Link of the URDF whose frame is the tool.
        held: Names of joints that stay where they start; planar arms only.
        weight: Weight of each joint in the distance from the start, where a planar arm has more
            joints than it needs: a joint with a small weight moves more. Shape (n,), > 0. [-]
        lifted: The height of a planar arm's tool is left to an axis outside of the model, as
            paper B leaves out the print axis: heights are not looked at.
        orientation: Rotation of the tool in the base frame, for six or more joints; None: as
            at the start. Shape (3, 3). [-]
    """

    def __init__(
        self,
        robot: Robot,
        link: str = "tool0",
        held: Sequence[str] = (),
        weight: Float | None = None,
        lifted: bool = False,
        orientation: Float | None = None,
    ) -> None:
        self.robot, self.link = robot, link
        self._weight = np.ones(robot.n_joints) if weight is None else weight
        self._lifted, self._orientation = lifted, orientation
        self._planar = PlanarArm.of_robot(robot, link)
        self._free = [k for k, name in enumerate(robot.joint_names) if name not in held]
        if self._planar is not None:
            self.structure = "planar"  # gantry, planar or spatial
        elif robot.limits.prismatic.all() and robot.n_joints == 3:
            self.structure = "gantry"
        elif robot.n_joints >= SPATIAL_JOINTS:
            self.structure = "spatial"
        else:
            raise MotionError(
                f"a robot of {robot.n_joints} joints that is neither a gantry of three "
                "prismatic joints nor a planar arm",
                "one of these, or six joints or more",
            )

    def solve(self, tool_position: Float, start: Float) -> Float:
        """Return joint positions along a path of the tool, shape (N, n). [rad] or [m]

        Args:
            tool_position: Places of the link's origin in the base frame, shape (N, 3). [m]
            start: Joint positions from which the first place is searched; decides elbow and
                wrist sides, the positions of held joints, and the reference of redundant ones.
                Shape (n,). [rad] or [m]
        """
        if self._planar is not None:
            found = self._solve_planar(self._planar, tool_position, start)
        elif self.structure == "gantry":
            found = self._solve_gantry(tool_position, start)
        else:
            found = self._solve_spatial(tool_position, start)
        self._check_limits(tool_position, found)
        return found

    def _solve_gantry(self, wanted: Float, begin: Float) -> Float:
        place, _, jacobian = self.robot.link_jacobian(begin, self.link)
        axes = jacobian[:3]
        if np.linalg.svd(axes, compute_uv=False)[-1] < SINGULAR:
            raise MotionError("two axes of the gantry are parallel", "axes that span space")
        return begin + np.linalg.solve(axes, (wanted - place).T).T

    def _solve_planar(self, arm: PlanarArm, wanted: Float, begin: Float) -> Float:
        place, above = arm.split(wanted)
        if not self._lifted and np.abs(above).max() > LEVEL:
            row = int(np.argmax(np.abs(above) > LEVEL))
            raise MotionError(
                f"{_point(wanted, row)} lies {above[row]:.6g} m off the plane in which "
                f"{self.link} moves",
                "points in that plane",
                "move the work piece, or leave the height to an axis outside of the model",
            )
        origin, least, greatest = arm.reach(begin, self._free)
        distance = np.abs(place - origin)
        far = (distance > greatest) | (distance < least)
        if far.any():
            row = int(np.argmax(far))
            raise self._refused(wanted, row, float(distance[row]), greatest, self._free[0], least)
        if len(self._free) == 2:
            found = arm.two_free(place, begin, self._free)
        else:
            found = arm.nearest(place, begin, self._free, self._weight)
        lost = np.isnan(found).any(axis=1)
        if lost.any():
            row = int(np.argmax(lost))
            away = float(distance[row])
            raise self._refused(wanted, row, away, greatest, self._free[0], how="is singular")
        return found

    def _solve_spatial(self, wanted: Float, begin: Float) -> Float:
        orientation = self._orientation
        if orientation is None:
            orientation = self.robot.link_pose(begin, self.link)[1]
        found = np.empty((len(wanted), self.robot.n_joints))
        posture = begin
        for row, place in enumerate(wanted):
            posture, missed, least = self._approach(place, orientation, posture)
            if missed > IN_PLACE or least < SINGULAR:
                origins = self.robot.joint_origins(posture)
                chain = np.vstack([origins, self.robot.link_pose(posture, self.link)[0]])
                reach = float(np.linalg.norm(np.diff(chain, axis=0), axis=1).sum())
                away = float(np.linalg.norm(place - origins[0]))
                lost = missed > IN_PLACE
                how = f"is missed by {missed:.3g} m or rad" if lost else "is singular"
                raise self._refused(
                    wanted, row, away, reach, 0, how=how * (away <= reach or not lost)
                )
            found[row] = posture
        return found

    def _approach(
        self, place: Float, orientation: Float, posture: Float
    ) -> tuple[Float, float, float]:
        """Newton steps: posture, distance still missed, least singular value there."""
        posture = posture.copy()
        missed, least = np.inf, 0.0
        for _ in range(MAX_STEPS):
            here, turned, jacobian = self.robot.link_jacobian(posture, self.link)
            error = np.concatenate([place - here, rotation_vector(orientation @ turned.T)])
            missed = float(np.abs(error).max())
            left, size, right = np.linalg.svd(jacobian, full_matrices=False)
            least = float(size[-1])
            if missed < IN_PLACE:
                break
            damping = max(0.0, DAMPING - least)
            step = right.T @ (size / (size**2 + damping**2) * (left.T @ error))
            longest = float(np.abs(step).max())
            posture += step * min(1.0, MAX_STEP / longest) if longest > 0 else step
        return posture, missed, least

    def _check_limits(self, wanted: Float, found: Float) -> None:
        limits = self.robot.limits
        off = (found < limits.lower - LIMIT_TOLERANCE) | (found > limits.upper + LIMIT_TOLERANCE)
        if off.any():
            row, joint = (int(k) for k in np.argwhere(off)[0])
            raise MotionError(
                f"{_point(wanted, row)} puts {self.robot.joint_names[joint]} at "
                f"{found[row, joint]:.6g} {limits.unit(joint)}",
                f"{limits.lower[joint]:.6g} to {limits.upper[joint]:.6g}",
                "begin with another configuration, or move the work piece",
            )

    def _refused(
        self,
        wanted: Float,
        row: int,
        away: float,
        reach: float,
        joint: int,
        least: float = 0.0,
        how: str = "",
    ) -> MotionError:
        """Why a place is refused; ``how`` is empty where it is out of reach."""
        point, name = _point(wanted, row), self.robot.joint_names[joint]
        if how:
            return MotionError(
                f"{point} {how}: it lies {away:.4g} m from {name}, reach {reach:.4g} m",
                "points that the tool reaches in this orientation, clear of stretched "
                "configurations",
                "move the work piece (--base), or begin with another configuration "
                "(--start-position)",
            )
        return MotionError(
            f"{point} lies {away:.4g} m from {name}",
            f"{least:.4g} to {reach:.4g} m, the reach of {self.link}",
            "move the work piece or the robot (--base)",
        )


def rotation_vector(rotation: Float) -> Float:
    """Return axis times angle, shape (3,). [rad]

    ``R - R^T`` gives ``sin(angle)`` and the axis; close to half a turn the axis is that of
    ``R + R^T = 2 cos(angle) I + 2 (1 - cos(angle)) a a^T``.

    Args:
        rotation: Shape (3, 3). [-]
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation.tolist()
    skew = 0.5 * np.array([zy - yz, xz - zx, yx - xy])
    sine, cosine = math.sqrt(float(skew @ skew)), 0.5 * (xx + yy + zz - 1.0)
    angle = math.atan2(sine, cosine)
    if cosine > -0.9:
        return skew * (angle / sine if sine > 0.0 else 1.0)
    outer = 0.5 * (rotation + rotation.T) - cosine * np.eye(3)
    axis = outer[int(np.argmax(np.diag(outer)))]
    return axis * (math.copysign(angle, float(axis @ skew)) / math.sqrt(float(axis @ axis)))


def _point(wanted: Float, row: int) -> str:
    x, y, z = wanted[row]
    return f"point {row + 1} of the tool path, ({x:.4g}, {y:.4g}, {z:.4g}) m,"
