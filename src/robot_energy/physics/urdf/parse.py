"""Text of a URDF -> its elements, bounded, with every number of the dynamics checked.

The parser behind the dynamics leaves out what it cannot read: an inertial with one bad number
is gone without a word, and so are its kilograms. So everything is read here first.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from difflib import get_close_matches
from xml.parsers import expat

import numpy as np

from robot_energy.foundation.errors import RobotDescriptionError

LIMITS = ("lower", "upper", "effort", "velocity")
UNLIMITED = 1e12  # stands for infinity, which the URDF parser does not accept
MAX_EFFORT = 1e6
"""No joint of a robot has more: the largest industrial arms need some 1e5. [N m] or [N]"""
MAX_TURNING = 100.0
"""Rotary joints turn slower: quick wrists reach 20, legs with direct drive 55. [rad/s]"""
MAX_SLIDING = 20.0  # linear joints move slower: axes with linear motors reach 10 [m/s]


def limit_values(limit: ET.Element) -> dict[str, float]:
    """Return what an element ``limit`` of a checked URDF says, by the four keys of a URDF."""
    return {key: float(text) for key, text in limit.items() if key in LIMITS}


def usable_limit(kind: str, key: str, value: float) -> float:
    """Return a limit of effort or velocity, or inf where the URDF gives none that can be one.

    Args:
        value: As in the URDF, joint side. [N m], [N], [rad/s] or [m/s]
    """
    largest = MAX_EFFORT if key == "effort" else fastest(kind)
    return value if 0.0 < value < largest else np.inf


def first_names(names: Sequence[str], most: int = 6) -> str:
    """Return names of joints as one phrase, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def fastest(kind: str) -> float:
    """Return the speed that no joint of a kind reaches. [rad/s] or [m/s]"""
    return MAX_SLIDING if kind == "prismatic" else MAX_TURNING


MAX_URDF_BYTES = 8 * 1024 * 1024
MAX_ELEMENTS = 200_000
MAX_DEPTH = 50  # elements inside elements; a real URDF has six
MAX_ATTRIBUTES = 100  # of one element; a real URDF has six
MAX_VALUE = 1e9  # no figure of a robot is larger, whatever its unit
MIN_AXIS_LENGTH = 1e-6  # length of an axis that still has a direction
INERTIA_TOLERANCE = 1e-5  # kg m^2 by which a principal moment may be negative: digits cut off
JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
RESERVED_NAMES = ("universe", "root_joint")  # of the dynamics library

XACRO = (
    "the URDF is a xacro file that was not expanded",
    "a URDF",
    "write one with `xacro FILE > robot.urdf` (pip install xacro); `robot-energy model init FILE` "
    "expands it by itself",
)

INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_ENDLESS = re.compile(r"[+-]?inf(inity)?", re.IGNORECASE)
_COUNTS = {("origin", "xyz"): 3, ("origin", "rpy"): 3, ("axis", "xyz"): 3}
_KEYS = {
    "mass": ("value",),
    "inertia": INERTIA,
    "origin": ("xyz", "rpy"),
    "axis": ("xyz",),
    "limit": LIMITS,
}
_LIKE = 0.65  # of two keys, one of which is misspelt


def read_elements(urdf_xml: str) -> ET.Element:
    """Return the root element of a URDF.

    Prefixes stay parts of names, as the parsers of other programs for URDFs leave them: so a
    prefix need not be declared, and a default namespace changes nothing.
    """
    if len(urdf_xml) > MAX_URDF_BYTES:
        raise RobotDescriptionError(
            f"the URDF has {len(urdf_xml)} characters", f"at most {MAX_URDF_BYTES}"
        )
    if "<!DOCTYPE" in urdf_xml or "<!ENTITY" in urdf_xml:
        raise RobotDescriptionError("the URDF declares a DOCTYPE or entities", "plain XML")
    parser, builder = expat.ParserCreate(), _Builder()
    parser.buffer_text = True
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(urdf_xml.strip(), True)
        return builder.close()
    except RobotDescriptionError:
        raise
    except (expat.ExpatError, ValueError) as error:
        raise RobotDescriptionError(
            f"the URDF is not well-formed XML ({error})", "a URDF"
        ) from error


class _Builder(ET.TreeBuilder):
    """Builds elements up to a depth and a number of them."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0
        self._count = 0
        self._xacro = {"xacro"}  # prefixes of xacro

    def start(self, tag: str, attrs: dict[str, str], /) -> ET.Element:
        """Begin an element."""
        self._depth += 1
        self._count += 1
        if self._depth > MAX_DEPTH:
            raise RobotDescriptionError(
                f"the URDF nests elements more than {MAX_DEPTH} deep", "a robot"
            )
        for key, text in attrs.items():
            if key.startswith("xmlns:") and text.endswith("/xacro"):
                self._xacro.add(key[6:])
        if tag.partition(":")[0] in self._xacro and ":" in tag:
            raise RobotDescriptionError(*XACRO)
        if self._count > MAX_ELEMENTS:
            raise RobotDescriptionError(f"the URDF has over {MAX_ELEMENTS} elements", "a robot")
        if len(attrs) > MAX_ATTRIBUTES:
            raise RobotDescriptionError(
                f"the URDF has an element of {len(attrs)} attributes", f"at most {MAX_ATTRIBUTES}"
            )
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ET.Element:
        """End an element."""
        self._depth -= 1
        return super().end(tag)


def check_numbers(root: ET.Element) -> None:
    """Refuse names, numbers and inertias that the dynamics would take for something else."""
    for element in (*root.findall("link"), *root.findall("joint")):
        name = element.get("name")
        held = element.tag == "joint" and element.get("type") == "fixed"
        if not name or (name in RESERVED_NAMES and not held):
            raise RobotDescriptionError(
                f"the URDF has a {element.tag} of the name {name!r}",
                "a name that is not empty and not reserved",
                "rename it",
            )
        owner = f"{element.tag} '{name}'"
        if element.tag == "joint" and element.get("type") not in JOINT_TYPES:
            raise RobotDescriptionError(
                f"{owner} is of type '{element.get('type')}'", " or ".join(JOINT_TYPES)
            )
        for part in (*element, *element.iterfind("inertial/*")):
            if part.tag in _KEYS:
                _check_keys(owner, part)
        if element.tag == "link":
            _check_inertial(element, owner)
        axis = element.find("axis")
        if axis is not None and element.get("type") not in ("fixed", "floating"):
            xyz = axis.get("xyz")
            if xyz is None or np.linalg.norm([float(w) for w in xyz.split()]) < MIN_AXIS_LENGTH:
                raise RobotDescriptionError(
                    f"{owner} has an axis without xyz"
                    if xyz is None
                    else f"{owner} has the axis '{xyz}'",
                    "an axis with a direction",
                    'write it as in <axis xyz="0 0 1"/>, or leave the element out for the x axis',
                )


def principal_moments(inertia: ET.Element) -> list[float]:
    """Return the principal moments, from the smallest to the largest. [kg m^2]"""
    ixx, iyy, izz, ixy, ixz, iyz = (float(inertia.get(key, "0")) for key in INERTIA)
    matrix = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    return np.linalg.eigvalsh(matrix).tolist()


def _check_keys(owner: str, part: ET.Element) -> None:
    """Check the attributes of one element; others than its own are left out, as everywhere."""
    own = _KEYS[part.tag]
    for key, text in part.items():
        if key in own:
            _check_entry(owner, part.tag, key, text)
            continue
        lacking = [name for name in own if name not in part.attrib]
        for meant in get_close_matches(key, lacking, 1, _LIKE):
            raise RobotDescriptionError(
                f"{owner} has <{part.tag} {key}=...>, and no {meant}",
                f"the attribute {meant}",
                "correct the name",
            )


def _check_entry(owner: str, tag: str, key: str, text: str) -> None:
    """Check one attribute: as many numbers as belong there, of a size that can be."""
    words = text.split()
    endless = [tag == "limit" and bool(_ENDLESS.fullmatch(word)) for word in words]
    good = len(words) == _COUNTS.get((tag, key), 1) and all(
        is_endless or _NUMBER.fullmatch(word)
        for word, is_endless in zip(words, endless, strict=True)
    )
    if good and tag != "limit":
        good = all(abs(float(word)) <= MAX_VALUE for word in words)
    if not good or (tag == "mass" and float(text) < 0):
        count = _COUNTS.get((tag, key), 1)
        numbers = "a finite number" if count == 1 else f"{count} finite numbers"
        raise RobotDescriptionError(
            f"{owner} has the {tag} {'' if key == 'value' else key + '='}'{text[:80]}'",
            "a mass of 0 or more" if tag == "mass" else f"{numbers} of at most {MAX_VALUE:g}",
        )


def _check_inertial(link: ET.Element, owner: str) -> None:
    """Check that mass and inertia belong to a body that can be."""
    inertial = link.find("inertial")
    if inertial is None:
        return
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None and inertia is None:
        return
    if mass is None or mass.get("value") is None:
        raise RobotDescriptionError(f"{owner} has an inertial without mass", "a mass")
    missing = [key for key in INERTIA if inertia is None or key not in inertia.attrib]
    if inertia is None or missing:
        raise RobotDescriptionError(
            f"{owner} has a mass, but its inertia lacks {', '.join(missing)}",
            "all six of ixx, iyy, izz, ixy, ixz, iyz",
            "a body of which only the mass is known has an inertia of zeros",
        )
    moments = principal_moments(inertia)
    if moments[0] < -(INERTIA_TOLERANCE + 1e-3 * moments[2]):
        raise RobotDescriptionError(
            f"{owner} has a principal moment of inertia of {moments[0]:.3g} kg m^2",
            "none below 0",
            "correct the signs or the order of its inertia",
        )
