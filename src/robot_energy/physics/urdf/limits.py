"""Which limits of a URDF are limits, and which only fill the place of one.

A URDF must give an effort and a velocity limit to every revolute and prismatic joint. Where
exporters know none they write 0, 1e3, 1e9 or a range without extent.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

LIMITS = ("lower", "upper", "effort", "velocity")
UNLIMITED = 1e12  # stands for infinity, which the URDF parser does not accept
MAX_EFFORT = 1e6
"""No joint of a robot has more: the largest industrial arms need some 1e5. [N m] or [N]"""
MAX_TURNING = 100.0
"""Rotary joints turn slower: quick wrists reach 20, legs with direct drive 55. [rad/s]"""
MAX_SLIDING = 20.0
"""Linear joints move slower: axes with linear motors reach 10. [m/s]"""


def limit_values(limit: ET.Element) -> dict[str, float]:
    """Return what an element ``limit`` of a checked URDF says, by the key.

    Args:
        limit: Other attributes than the four of a URDF are left out.
    """
    return {key: float(text) for key, text in limit.items() if key in LIMITS}


def usable_limit(kind: str, key: str, value: float) -> float:
    """Return a limit of effort or velocity, or inf where the URDF gives none that can be one.

    Args:
        value: As in the URDF, joint side. [N m], [N], [rad/s] or [m/s]
    """
    largest = MAX_EFFORT if key == "effort" else _fastest(kind)
    return value if 0.0 < value < largest else np.inf


def limit_remarks(root: ET.Element, joint_names: Sequence[str]) -> list[str]:
    """Return a sentence for each kind of limit that counts as not given, though it is stated."""
    found: dict[str, list[str]] = {}
    joints = {str(joint.get("name")): joint for joint in root.findall("joint")}
    for name in joint_names:
        kind, limit = str(joints[name].get("type")), joints[name].find("limit")
        given = {} if limit is None else limit_values(limit)
        for key in ("effort", "velocity"):
            value = given.get(key, 0.0)
            if value and np.isinf(usable_limit(kind, key, value)) and not np.isinf(value):
                found.setdefault(_unusable(kind, key, value), []).append(name)
        low, high = given.get("lower", 0.0), given.get("upper", 0.0)
        if kind != "continuous" and low > high:
            text = f"lower limit {low:.4g} is above the upper limit {high:.4g}: the range counts "
            found.setdefault(text + "as not given; exchange them", []).append(name)
    return [f"{first_names(names)}: {text}" for text, names in found.items()]


def first_names(names: Sequence[str], most: int = 6) -> str:
    """Return names of joints as one phrase, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def _unusable(kind: str, key: str, value: float) -> str:
    linear = kind == "prismatic"
    effort_unit, speed_unit = ("N", "m/s") if linear else ("N m", "rad/s")
    unit = effort_unit if key == "effort" else speed_unit
    if value < 0.0:
        why = "a limit is above 0"
    elif key == "effort":
        why = f"no joint of a robot has {MAX_EFFORT:.0e} {unit}"
    else:
        why = f"a joint moves at less than {_fastest(kind):g} {unit}"
        if not linear:
            why += "; are these degrees per second?"
    return f"{key} limit of {value:.4g} {unit} in the URDF counts as not given ({why})"


def _fastest(kind: str) -> float:
    return MAX_SLIDING if kind == "prismatic" else MAX_TURNING
