"""Self-collision of one robot by the collision shapes of its URDF.

Boxes, cylinders and spheres are looked at, by Coal through Pinocchio; meshes are never opened.
Links that one joint connects, and links of one body, are not compared with each other, nor are
shapes that overlap in the neutral pose (all joints at zero): they are larger than the links.

Source: URDF specification, element `collision`; Pinocchio, `GeometryModel`.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin

from robot_energy.foundation.errors import RobotDescriptionError, check_shape
from robot_energy.model.schema import RobotModel
from robot_energy.physics.urdf.checks import for_dynamics, parse, take_inventory
from robot_energy.timeline.blocks import Float

SHAPES = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length")}
"""Shapes that are looked at, and their lengths."""
FINE = 0.05  # rad or m between two configurations of a move that are looked at


class SelfCollision:
    """Whether links of a robot touch each other.

    Attributes:
        links: Links with shapes, in the order of the URDF.
        without: Links with shapes that are not looked at, as meshes.
    """

    def __init__(self, model: RobotModel) -> None:
        root = parse(model.urdf_xml)
        locked = take_inventory(root, model.joint_names, model.massless_links).locked_joints
        self.links, self.without = _keep_shapes(root)
        text = for_dynamics(root, keep="collision")
        try:
            full = pin.buildModelFromXML(text)
            shapes = pin.buildGeomFromUrdfString(full, text, pin.GeometryType.COLLISION)
            names = [full.getJointId(name) for name in locked]
            body, (geometry, *_) = pin.buildReducedModel(full, [shapes], names, pin.neutral(full))
        except (ValueError, RuntimeError, IndexError) as error:
            raise RobotDescriptionError(
                f"the collision shapes of the URDF are not accepted: {error}",
                "shapes that Pinocchio reads",
            ) from error
        self._body, self._data, self._geometry = body, body.createData(), geometry
        self._names = [full.frames[one.parentFrame].name for one in shapes.geometryObjects]
        at = [body.joints[body.getJointId(name)].idx_v for name in model.joint_names]
        self._order = np.argsort(np.asarray(at, dtype=np.int64))
        self._compare()

    @property
    def pairs(self) -> int:
        """How many pairs of shapes are compared."""
        return len(self._geometry.collisionPairs)

    def _compare(self) -> None:
        """Compare all shapes but those of connected links and those that overlap at zero."""
        above = self._body.parents
        joints = [one.parentJoint for one in self._geometry.geometryObjects]
        for first in range(len(joints)):
            for second in range(first + 1, len(joints)):
                a, b = joints[first], joints[second]
                if a != b and above[a] != b and above[b] != a:
                    self._geometry.addCollisionPair(pin.CollisionPair(first, second))
        self._shapes = pin.GeometryData(self._geometry)
        neutral = pin.neutral(self._body)
        pin.computeCollisions(self._body, self._data, self._geometry, self._shapes, neutral, False)
        for pair, result in zip(
            list(self._geometry.collisionPairs), self._shapes.collisionResults, strict=True
        ):
            if result.isCollision():
                self._geometry.removeCollisionPair(pair)
        self._shapes = pin.GeometryData(self._geometry)

    def touching(self, joint_position: Float) -> tuple[str, str] | None:
        """Return two links that touch in one of several configurations; None if none do.

        Args:
            joint_position: Shape (N, n). [rad] or [m]
        """
        check_shape("joint_position", joint_position.shape, (len(joint_position), self._body.nv))
        if not self.pairs:
            return None
        for row in np.asarray(joint_position, dtype=np.float64)[:, self._order]:
            if pin.computeCollisions(
                self._body, self._data, self._geometry, self._shapes, row, True
            ):
                return self._first()
        return None

    def touching_on_the_way(self, start: Float, goal: Float) -> tuple[str, str] | None:
        """Return two links that touch in a move in which all joints go in step; None if none do.

        Args:
            start: Shape (n,). [rad] or [m]
            goal: Shape (n,). [rad] or [m]
        """
        parts = max(1, math.ceil(float(np.abs(goal - start).max()) / FINE))
        return self.touching(np.linspace(start, goal, parts + 1))

    def _first(self) -> tuple[str, str]:
        """Links of the pair that was found last."""
        for pair, result in zip(
            self._geometry.collisionPairs, self._shapes.collisionResults, strict=True
        ):
            if result.isCollision():
                return self._names[pair.first], self._names[pair.second]
        raise AssertionError("no pair touches")


def touching_moves(shapes: SelfCollision, joint_position: Float) -> tuple[int, str, str] | None:
    """Return the first move of a round trip in which links touch, and the links; None if none do.

    Args:
        joint_position: Configurations, shape (K, n). [rad] or [m]
    """
    for move, goal in enumerate(np.roll(joint_position, -1, axis=0)):
        found = shapes.touching_on_the_way(joint_position[move], goal)
        if found is not None:
            return move, *found
    return None


def _keep_shapes(root: ET.Element) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Remove what is not looked at; return the links with shapes, and those with meshes."""
    kept: dict[str, None] = {}
    left: dict[str, None] = {}
    for link in root.findall("link"):
        name = str(link.get("name"))
        for part in link.findall("collision"):
            shape = part.find("geometry/*")
            if shape is None or shape.tag not in SHAPES:
                link.remove(part)
                left[name] = None
                continue
            for key in SHAPES[shape.tag]:
                _check_lengths(name, shape.tag, key, shape.get(key, ""))
            kept[name] = None
    return tuple(kept), tuple(left)


def _check_lengths(link: str, shape: str, key: str, text: str) -> None:
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    good = all(math.isfinite(value) and value > 0.0 for value in values)
    if not good or len(values) != (3 if key == "size" else 1):
        raise RobotDescriptionError(
            f"the {shape} of link '{link}' has the {key} '{text}'", "lengths in m, > 0"
        )
