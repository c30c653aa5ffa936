"""The programmed motion of a tool: lines, arcs and dwells with their feeds, in metres.

A tool path is geometry and commanded speed, as a program states them. `motion.tool_timing`
makes a motion in time of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from robot_energy.foundation.errors import MotionError

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
    centre: Annotated[
        tuple[float, float], "Coordinates of the axis, x and y where it is vertical. [m]"
    ]
    angle: Annotated[float, "Swept, positive from the first axis of the plane to the second. [rad]"]
    speed: Annotated[float, "Commanded path speed, > 0. [m/s]"]
    source_line: Annotated[int, "Line of the program, from 1; 0 where there is none."] = 0
    extruding: bool = False
    plane: Annotated[Plane, "Indices of the two axes of its plane and of the axis across."] = (
        HORIZONTAL
    )

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
        at: Point | None = None
        for segment in self.segments:
            if isinstance(segment, Dwell):
                continue
            if at is not None and math.dist(at, segment.start) > CLOSED:
                raise MotionError(
                    f"{self.name}, line {segment.source_line}: the move begins at "
                    f"{list(segment.start)} m",
                    f"{list(at)} m, where the one before ended",
                )
            at = segment.end
        if at is None:
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
