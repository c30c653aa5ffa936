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
