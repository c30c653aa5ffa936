"""Tool path, as a program states it -> pieces of constant curvature, corners rounded.

A corner between two lines turning by ``theta`` is replaced by a circle of radius ``r``
tangent to both. It passes the corner at the distance ``r (1 / cos(theta/2) - 1)``, which is
kept within the tolerance, and takes ``r tan(theta/2)`` of each line, at most one half. It is
no larger than the commanded speed ``v`` needs: ``r = v^2 / a``. What cannot be rounded -
reversals, corners with an arc, all corners where the tolerance is 0 - is a stop.

Every piece is ``p(s) = c + r (u cos(k s) + w sin(k s)) + d s`` of its way ``s``: a line has
``r = 0``, a circle ``d = 0``, a helix neither.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Annotated, Any, NamedTuple

import numpy as np

from robot_energy.foundation.errors import MotionError
from robot_energy.timeline.blocks import Float, Int

Point = tuple[float, float, float]  # x, y, z [m]
Plane = tuple[int, int, int]
HORIZONTAL: Plane = (0, 1, 2)

CLOSED = 1e-9  # m: ends that are nearer than this are the same point


@dataclass(frozen=True, slots=True)
class LineSegment:
    """A straight move."""

    start: Annotated[Point, "Where it begins. [m]"]
    end: Annotated[Point, "Where it ends. [m]"]
    speed: Annotated[float, "Commanded path speed, > 0. [m/s]"]
    source_line: Annotated[int, "Line of the program, from 1; 0 where there is none."] = 0
    rapid: Annotated[bool, "Whether it was commanded as a positioning move (G0)."] = False
    extruding: bool = False

    @property
    def length(self) -> float:
        """Length of the way. [m]"""
        return math.dist(self.start, self.end)


@dataclass(frozen=True, slots=True)
class Arc:
    """A circular move about an axis of the frame; a helix where it also moves along it."""

    start: Annotated[Point, "Where it begins. [m]"]
    end: Annotated[Point, "Where it ends. [m]"]
    centre: Annotated[tuple[float, float], "Coordinates of the axis; x and y if vertical. [m]"]
    angle: Annotated[float, "Swept, positive from the first axis of the plane to the second. [rad]"]
    speed: Annotated[float, "Commanded path speed, > 0. [m/s]"]
    source_line: Annotated[int, "Line of the program, from 1; 0 where there is none."] = 0
    extruding: bool = False
    plane: Annotated[Plane, "The two axes of its plane and that across."] = HORIZONTAL

    def flat(self, point: Point) -> tuple[float, float]:
        """Return the coordinates of a point in the plane. [m]"""
        return point[self.plane[0]], point[self.plane[1]]

    @property
    def radius(self) -> float:
        """Distance from the axis. [m]"""
        return math.dist(self.flat(self.start), self.centre)

    @property
    def rise(self) -> float:
        """Way along the axis. [m]"""
        return self.end[self.plane[2]] - self.start[self.plane[2]]

    @property
    def length(self) -> float:
        """Length of the way. [m]"""
        return math.hypot(self.radius * self.angle, self.rise)


@dataclass(frozen=True, slots=True)
class Dwell:
    """A rest."""

    time: Annotated[float, "How long, >= 0. [s]"]
    source_line: Annotated[int, "Line of the program, from 1; 0 where there is none."] = 0


Segment = LineSegment | Arc | Dwell


@dataclass(frozen=True)
class ToolPath:
    """A sequence of segments, each beginning where the one before ends."""

    segments: Sequence[Segment]
    name: str = "the tool path"

    def __post_init__(self) -> None:
        if all(isinstance(segment, Dwell) for segment in self.segments):
            raise MotionError(
                f"{self.name} moves nothing", "at least one move (G1, G2 or G3) to a new position"
            )

    @property
    def length(self) -> float:
        """Length of all moves. [m]"""
        return math.fsum(s.length for s in self.segments if not isinstance(s, Dwell))

    @property
    def printed_length(self) -> float:
        """Length of the moves during which material flows. [m]

        Where no move extrudes, as in programs for pumped material, the length of all moves
        but the rapid ones.
        """
        moves = [s for s in self.segments if not isinstance(s, Dwell)]
        if any(move.extruding for move in moves):
            return math.fsum(move.length for move in moves if move.extruding)
        return math.fsum(m.length for m in moves if isinstance(m, Arc) or not m.rapid)


TANGENT = 1e-6  # rad: a smaller corner is rounding
NEARLY_TANGENT = 0.02  # rad: up to here an unrounded corner is passed, slowly enough
VELOCITY_STEP = 1e-3  # m/s: change of velocity at such a corner
REVERSAL = 3.0  # rad: sharper corners are stops
MAX_PIECE = 0.5  # rad of a circle, so that integrals over a piece are exact
NORMAL_SHARE = 0.8  # of the acceleration on arcs; 0.6 is left along them, together 1
ALONG_SHARE = 0.6


Vector = tuple[float, float, float]
NOTHING: Any = 0.0
ZERO: Any = (0.0, 0.0, 0.0)


class PathPieces(NamedTuple):
    """Pieces of a path in order, shape (K,) or (K, 3); while it is followed, one of them."""

    length: Annotated[Float, "Length of each, 0 for a dwell. [m]"] = NOTHING
    origin: Annotated[Float, "c. [m]"] = ZERO
    radius: Annotated[Float, "r. [m]"] = NOTHING
    rate: Annotated[Float, "k. [rad/m]"] = NOTHING
    first: Float = ZERO
    second: Float = ZERO
    drift: Annotated[Float, "d. [-]"] = ZERO
    commanded: Annotated[Float, "Speed by command. [m/s]"] = NOTHING
    speed: Annotated[Float, "Greatest speed, by command and curvature. [m/s]"] = NOTHING
    acceleration: Annotated[Float, "Greatest along the path; 0 on corners. [m/s^2]"] = NOTHING
    entry: Annotated[Float, "Greatest speed at the begin; 0: stop, shape (K + 1,). [m/s]"] = NOTHING
    dwell: Annotated[Float, "Rest, of dwells alone. [s]"] = NOTHING
    source_line: Int = NOTHING


def pieces_of(path: ToolPath, acceleration: float, tolerance: float) -> PathPieces:
    """Return the pieces of a path with rounded corners.

    Args:
        acceleration: Greatest of the tool, > 0. [m/s^2]
        tolerance: Greatest distance between path and rounded path, >= 0. [m]
    """
    maker = _Maker(acceleration, tolerance)
    for segment, following in zip_longest(path.segments, path.segments[1:]):
        maker.take(segment, following)
    whole = PathPieces(*map(np.array, zip(*maker.pieces, strict=True)))
    return whole._replace(entry=np.append(whole.entry, 0.0))


class _Maker:
    """Goes along a path and writes down its pieces."""

    def __init__(self, acceleration: float, tolerance: float) -> None:
        self._acceleration = acceleration
        self._tolerance = tolerance
        self._cut = 0.0  # taken from the beginning of the next line by the last corner
        self._entry = 0.0
        self.pieces: list[PathPieces] = []

    def take(self, segment: Segment, following: Segment | None) -> None:
        """Write the pieces of a segment and of the corner behind it."""
        if isinstance(segment, Dwell):
            self._entry = 0.0
            self._add(dwell=segment.time, source_line=segment.source_line)
            return
        taken, radius, passing = 0.0, 0.0, 0.0
        if following is not None and not isinstance(following, Dwell):
            taken, radius, passing = self._corner(segment, following)
        if isinstance(segment, LineSegment):
            self._line(segment, taken)
        else:
            self._arc(segment)
        self._entry, self._cut = passing, taken
        if radius > 0 and isinstance(segment, LineSegment) and isinstance(following, LineSegment):
            self._round(segment, following, taken, radius)

    def _corner(
        self, before: LineSegment | Arc, after: LineSegment | Arc
    ) -> tuple[float, float, float]:
        """Way taken from both lines, radius, and the greatest speed in between."""
        turn = _angle(_direction(before, True), _direction(after, False))
        speed = min(before.speed, after.speed)
        if turn <= TANGENT:
            return 0.0, 0.0, speed
        lines = isinstance(before, LineSegment) and isinstance(after, LineSegment)
        if lines and turn < REVERSAL and self._tolerance > 0:
            half = math.tan(0.5 * turn)
            sagitta = 2.0 * math.sin(0.25 * turn) ** 2 / math.cos(0.5 * turn)
            radius = min(
                self._tolerance / sagitta,
                speed * speed / self._acceleration,
                0.5 * min(before.length, after.length) / half,
            )
            return radius * half, radius, min(speed, math.sqrt(self._acceleration * radius))
        if turn < NEARLY_TANGENT:
            return 0.0, 0.0, min(speed, VELOCITY_STEP / (2.0 * math.sin(0.5 * turn)))
        return 0.0, 0.0, 0.0

    def _line(self, line: LineSegment, taken: float) -> None:
        length = line.length - self._cut - taken
        direction = _direction(line, False)
        if length > TANGENT * line.length:
            self._add(
                length=length,
                origin=_mixed(line.start, 1.0, direction, self._cut),
                drift=direction,
                commanded=line.speed,
                speed=line.speed,
                acceleration=self._acceleration,
                source_line=line.source_line,
            )

    def _arc(self, arc: Arc) -> None:
        parts = max(1, math.ceil(abs(arc.angle) / MAX_PIECE))
        length, radius = arc.length, arc.radius
        sign = math.copysign(1.0, arc.angle)
        rate = abs(arc.angle) / length
        rise = arc.rise / length
        limit = math.sqrt(NORMAL_SHARE * self._acceleration / (radius * rate * rate))
        begin = _place(arc, arc.start)
        for part in range(parts):
            angle = begin + arc.angle * part / parts
            cosine, sine = math.cos(angle), math.sin(angle)
            height = arc.start[arc.plane[2]] + arc.rise * part / parts
            self._add(
                length=length / parts,
                origin=_in_frame(arc, *arc.centre, height),
                radius=radius,
                rate=rate,
                first=_in_frame(arc, cosine, sine, 0.0),
                second=_in_frame(arc, -sign * sine, sign * cosine, 0.0),
                drift=_in_frame(arc, 0.0, 0.0, rise),
                commanded=arc.speed,
                speed=min(arc.speed, limit),
                acceleration=ALONG_SHARE * self._acceleration,
                source_line=arc.source_line,
            )
            self._entry = arc.speed

    def _round(self, before: LineSegment, after: LineSegment, taken: float, radius: float) -> None:
        one, two = _direction(before, False), _direction(after, False)
        turn = _angle(one, two)
        begin = _mixed(before.end, 1.0, one, -taken)
        cosine, sine = math.cos(turn), math.sin(turn)
        inward = _mixed(_mixed(two, 1.0, one, -cosine), 1.0 / sine, ZERO, 0.0)
        centre = _mixed(begin, 1.0, inward, radius)
        commanded = min(before.speed, after.speed)
        speed = min(commanded, math.sqrt(self._acceleration * radius))
        parts = max(1, math.ceil(turn / MAX_PIECE))
        for part in range(parts):
            angle = turn * part / parts
            cosine, sine = math.cos(angle), math.sin(angle)
            outward = _mixed(inward, -cosine, one, sine)
            forward = _mixed(inward, sine, one, cosine)
            self._add(
                length=radius * turn / parts,
                origin=centre,
                radius=radius,
                rate=1.0 / radius,
                first=outward,
                second=forward,
                commanded=commanded,
                speed=speed,
                source_line=before.source_line,
            )
            self._entry = speed

    def _add(self, **figures: Any) -> None:
        figures["entry"] = self._entry
        self.pieces.append(PathPieces(**figures))


def _direction(segment: LineSegment | Arc, at_end: bool) -> Vector:
    if isinstance(segment, LineSegment):
        way = _mixed(segment.end, 1.0, segment.start, -1.0)
        return _mixed(way, 1.0 / segment.length, ZERO, 0.0)
    angle = _place(segment, segment.end if at_end else segment.start)
    rise = segment.rise / segment.length
    flat = math.copysign(math.sqrt(max(1.0 - rise * rise, 0.0)), segment.angle)
    return _in_frame(segment, -flat * math.sin(angle), flat * math.cos(angle), rise)


def _place(arc: Arc, point: Point) -> float:
    """Angle of a point on an arc. [rad]"""
    first, second = arc.flat(point)
    return math.atan2(second - arc.centre[1], first - arc.centre[0])


def _in_frame(arc: Arc, first: float, second: float, along: float) -> Vector:
    """Coordinates in the plane of an arc and along its axis, as x, y, z."""
    result = [0.0, 0.0, 0.0]
    for axis, value in zip(arc.plane, (first, second, along), strict=True):
        result[axis] = value
    return result[0], result[1], result[2]


def _angle(one: Vector, two: Vector) -> float:
    """Angle between unit vectors, accurate when small. [rad]"""
    return 2.0 * math.atan2(
        math.dist(one, two), math.hypot(one[0] + two[0], one[1] + two[1], one[2] + two[2])
    )


def _mixed(one: Vector, share: float, two: Vector, other: float) -> Vector:
    return (
        share * one[0] + other * two[0],
        share * one[1] + other * two[1],
        share * one[2] + other * two[2],
    )
