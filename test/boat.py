"""A boat for printing: a hull that leans outwards, a cabin with a doorway (paper B, section 5.2.1).

The paper prints a tug boat that is not ours to ship. This one has what makes such a shape harder
than a wall: outlines that change from layer to layer, curves of every radius, and layers with an
opening. ``python test/boat.py`` writes ``boat.stl``.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from robot_energy.timeline.blocks import Float

LENGTH, BEAM, DEPTH = 1000.0, 500.0, 300.0  # of the hull [mm]
KEEL = 0.7  # length and beam of the bottom over those of the deck [-]
FULLNESS = 2.5  # exponent of the outline: 2 is an ellipse [-]
CABIN = (-350.0, 50.0, -150.0, 150.0)  # x from, to, y from, to [mm]
DOOR, WALL, ROOF = 70.0, 80.0, 550.0  # half the doorway, front wall, height above ground [mm]
POINTS, LEVELS = 48, 6  # of an outline, of the hull
FAN = [(0, k, k + 1) for k in range(1, POINTS - 1)]
"""Triangles of the deck and of the bottom, by corners of the outline."""
LIDS = [(0, 1, 6), (0, 6, 7), (1, 2, 6), (2, 5, 6), (2, 3, 5), (3, 4, 5)]
"""Triangles of the roof and of the floor of the cabin."""


def hull_outline(share: float) -> Float:
    """Return corners of the hull at a height, counterclockwise, shape (POINTS, 2). [mm]

    Args:
        share: Height over the depth, 0 to 1. [-]
    """
    angle = 2.0 * np.pi * np.arange(POINTS) / POINTS
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    curve = np.sign(unit) * np.abs(unit) ** (2.0 / FULLNESS)
    return 0.5 * (KEEL + (1.0 - KEEL) * share) * curve * (LENGTH, BEAM)


def cabin_outline() -> Float:
    """Return corners of the cabin, a U open to the stern, counterclockwise, shape (8, 2). [mm]"""
    back, front, low, high = CABIN
    inside = front - WALL
    return np.array(
        [(back, low), (front, low), (front, high), (back, high),
         (back, DOOR), (inside, DOOR), (inside, -DOOR), (back, -DOOR)]
    )  # fmt: skip


def boat() -> Float:
    """Return the surface of the boat, hull and cabin each closed, shape (K, 3, 3). [mm]

    Corners of triangles, outward by the right-hand rule.
    """
    heights = np.linspace(0.0, DEPTH, LEVELS)
    hull = [_at(hull_outline(z / DEPTH), z) for z in heights.tolist()]
    cabin = [_at(cabin_outline(), z) for z in (DEPTH, ROOF)]
    return np.concatenate([_solid(hull, FAN), _solid(cabin, LIDS)])


def _at(outline: Float, height: float) -> Float:
    return np.insert(outline, 2, height, axis=1)


def _solid(rings: Sequence[Float], lids: Sequence[tuple[int, int, int]]) -> Float:
    """Sides between rings of corners, a bottom on the first and a lid on the last."""
    parts = [rings[0][np.array(lids)[:, ::-1]], rings[-1][np.array(lids)]]
    for low, high in pairwise(rings):
        following, above = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
        parts += [np.stack([low, following, above], axis=1), np.stack([low, above, high], axis=1)]
    return np.concatenate(parts)


def stl(triangles: Float) -> bytes:
    """Return a surface as a binary STL file.

    Args:
        triangles: Corners, shape (K, 3, 3). [mm]
    """
    rows = np.zeros(len(triangles), dtype=[("at", "<f4", (4, 3)), ("unused", "<u2")])
    rows["at"][:, 1:] = triangles
    return bytes(80) + struct.pack("<I", len(rows)) + rows.tobytes()


if __name__ == "__main__":
    Path("boat.stl").write_bytes(stl(boat()))
