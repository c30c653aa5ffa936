"""The words of an arc of G-code -> its centre and its angle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError
from robot_energy_plan.motion.tool_corners import CLOSED, HORIZONTAL, Plane, Point

Flat = tuple[float, float]  # in the plane of an arc [m]

PLANES: Mapping[int, Plane] = {17: HORIZONTAL, 18: (2, 0, 1), 19: (1, 2, 0)}  # by G code
CENTRE_WORDS = "IJK"  # along x, y, z
MAX_TURNS = 100
MAX_RADIUS = 1000.0  # m
ARC_SLACK = 1e-5  # m, by which the radii of an arc's ends may differ
ARC_SHARE = 1e-3  # and this share of the radius


class ArcShape(Described):
    """The shape of an arc."""

    centre: Annotated[Flat, "Its axis in the plane. [m]"]
    angle: Annotated[float, "Swept, positive from the first axis of the plane to the second. [rad]"]
    end: Annotated[Point, "Where it ends: the programmed place, moved onto the circle. [m]"]


def arc_shape(
    start: Point,
    end: Point,
    words: Mapping[str, float],
    plane: Plane,
    clockwise: bool,
    absolute: bool = False,
    turns: int = 1,
) -> ArcShape:
    """Return the shape of an arc.

    Args:
        start: Where it begins. [m]
        end: Where it ends by command. [m]
        words: I, J, K or R. [m]
        absolute: Whether I, J and K are the place of the centre, not its way from the start.
    """
    first, last = (start[plane[0]], start[plane[1]]), (end[plane[0]], end[plane[1]])
    names = [CENTRE_WORDS[axis] for axis in plane[:2]]
    by_radius, by_centre = "R" in words, any(name in words for name in names)
    across = CENTRE_WORDS[plane[2]]
    if across in words:
        raise MotionError(
            f"the word {across} in an arc across that axis",
            f"{names[0]} and {names[1]}, or R",
            "choose the plane with G17, G18 or G19",
        )
    if by_radius == by_centre:
        one, two = names
        wrong = f"R together with {one} or {two}" if by_radius else f"no {one}, {two} or R"
        raise MotionError(
            f"an arc with {wrong}",
            f"the centre by {one} and {two}, or the radius by R",
        )
    if by_radius:
        centre = _centre_by_radius(first, last, words["R"], clockwise)
    else:
        base = (0.0, 0.0) if absolute else first
        x, y = (
            base[i] + words[name] if name in words else first[i] for i, name in enumerate(names)
        )
        centre = _centre(first, last, (x, y))
    angle = math.atan2(last[1] - centre[1], last[0] - centre[0]) - math.atan2(
        first[1] - centre[1], first[0] - centre[0]
    )
    if math.dist(first, last) <= CLOSED:
        angle, last = 0.0, first  # a full circle
    sign = -1.0 if clockwise else 1.0
    angle = sign * (((sign * angle) % (2 * math.pi) or 2 * math.pi) + 2 * math.pi * (turns - 1))
    radius, other = math.dist(first, centre), math.dist(last, centre)
    if abs(radius - other) > CLOSED:
        x, y = (c + (e - c) * radius / other for c, e in zip(centre, last, strict=True))
        last = (x, y)
    place = list(end)
    place[plane[0]], place[plane[1]] = last
    return ArcShape(centre, angle, (place[0], place[1], place[2]))


def _centre(start: Flat, end: Flat, centre: Flat) -> Flat:
    """Accept the centre, moved by the rounding of its words so that both radii agree."""
    first, last = math.dist(start, centre), math.dist(end, centre)
    slack = ARC_SLACK + ARC_SHARE * first
    if first <= CLOSED or abs(first - last) > slack or first > MAX_RADIUS:
        raise MotionError(
            f"the arc begins {first * 1e3:.4g} mm from its centre and ends "
            f"{last * 1e3:.4g} mm from it",
            f"equal distances within {slack * 1e3:.2g} mm, above 0",
            "I, J and K count from the start of the arc, after G90.1 from the origin",
        )
    chord = math.dist(start, end)
    if chord <= CLOSED or abs(first * first - last * last) > 2 * chord * slack:
        return centre  # (nearly) a full circle: the end is moved instead
    middle = (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]))
    normal = ((start[1] - end[1]) / chord, (end[0] - start[0]) / chord)
    height = (centre[0] - middle[0]) * normal[0] + (centre[1] - middle[1]) * normal[1]
    return middle[0] + height * normal[0], middle[1] + height * normal[1]


def _centre_by_radius(start: Flat, end: Flat, radius: float, clockwise: bool) -> Flat:
    """Centre of the shorter arc, of the longer one where R is negative."""
    chord = math.dist(start, end)
    if chord <= CLOSED:
        raise MotionError("an arc by R ends where it begins", "a full circle by I and J")
    if 2 * abs(radius) < chord - 2 * ARC_SLACK or abs(radius) > MAX_RADIUS:
        raise MotionError(
            f"an arc of radius {abs(radius) * 1e3:.4g} mm",
            f"at least half of the {chord * 1e3:.4g} mm between its ends",
        )
    height = math.sqrt(max(radius * radius - 0.25 * chord * chord, 0.0))
    left = (radius > 0) != clockwise  # the centre lies to the left of the chord
    height = height if left else -height
    return (
        0.5 * (start[0] + end[0]) + height * (start[1] - end[1]) / chord,
        0.5 * (start[1] + end[1]) + height * (end[0] - start[0]) / chord,
    )
