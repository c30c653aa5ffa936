"""G-code of printing programs -> tool path (paper B, section 5.2.2).

Understood are G0 G1 G2 G3 (arcs in the horizontal plane by I J or R, helices), G4 (P in
ms, S in s), G17, G20 G21, G90 G91, G92, M82 M83 with E words, M2 and M30. A G0 moves at the
feed of its own line, as printers do, and else at the rapid speed. What can make no difference
to the motion is noted; what could is refused with its line.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from robot_energy.errors import MotionError
from robot_energy.files.regular_file import read_regular
from robot_energy.motion.gcode_words import Word, words_of
from robot_energy.motion.tool_path import CLOSED, Arc, Dwell, LineSegment, Point, Segment, ToolPath

MAX_BYTES = 64 * 1024 * 1024
MAX_SEGMENTS = 500_000
MAX_NOTES = 50  # different codes that are named
MAX_COORDINATE = 1000.0  # m, of any coordinate
MIN_SPEED, MAX_SPEED = 1e-6, 100.0  # m/s
MAX_DWELL = 86_400.0  # s
RAPID_SPEED = 0.25  # m/s, assumed: programs do not state it
MILLIMETRE, INCH = 1e-3, 0.0254  # m
MINUTE = 60.0  # s
ARC_SLACK = 1e-5  # m, by which the radii of an arc's ends may differ
ARC_SHARE = 1e-3  # and this share of the radius

WITHOUT_EFFECT = {
    10: "retraction of the extruder",
    11: "retraction of the extruder",
    28: "homing; the position is kept",
    29: "levelling",
    40: "no tool radius",
    49: "no tool length",
    54: "first work offset",
    61: "exact stop; corners follow the tolerance of the prediction",
    64: "path mode; corners follow the tolerance of the prediction",
    80: "no cycle",
    94: "feed per minute",
}
MOTIONS = {0, 1, 2, 3}
AXES = "XYZ"
OTHER_AXES = set("ABCUVW")
KNOWN_G = MOTIONS | {4, 17, 20, 21, 90, 91, 92} | set(WITHOUT_EFFECT)


@dataclass(frozen=True)
class GcodeProgram:
    """Content of a program.

    Attributes:
        path: The tool path.
        notes: What was read over, one sentence each.
        unknown: Codes without meaning here and how often they stood in the program.
    """

    path: ToolPath
    notes: tuple[str, ...]
    unknown: dict[str, int]


def load_gcode(path: str | Path, rapid_speed: float = RAPID_SPEED) -> GcodeProgram:
    """Return the tool path of a G-code file, and what was read over.

    Args:
        path: The file.
        rapid_speed: Speed of G0 without F. [m/s]

    Raises:
        MotionError: If it cannot be read, naming the line.
    """
    try:
        text = read_regular(path, MAX_BYTES).decode("utf-8", "replace")
    except OSError as error:
        raise MotionError(
            f"there is no G-code file at '{path}' ({error.strerror})", "a text file"
        ) from error
    return read_gcode(text, str(path), rapid_speed)


def read_gcode(
    text: str, name: str = "the program", rapid_speed: float = RAPID_SPEED
) -> GcodeProgram:
    """Return the tool path of G-code, and what was read over.

    The tool begins where the program first puts each axis; an axis that is first named after the
    first move began at 0.

    Args:
        text: The program.
        name: Name of the program, for messages.
        rapid_speed: Speed of G0 without F. [m/s]

    Raises:
        MotionError: Naming line, what was found and what was expected.
    """
    if not MIN_SPEED <= rapid_speed <= MAX_SPEED:
        raise MotionError(
            f"the rapid speed is {rapid_speed} m/s", f"{MIN_SPEED:g} to {MAX_SPEED:g} m/s"
        )
    if len(text) > MAX_BYTES:
        raise MotionError(f"{name} has over {MAX_BYTES} characters", "a smaller program")
    machine = _Machine(name, rapid_speed)
    for number, line in enumerate(text.splitlines(), start=1):
        if machine.ended:
            break
        words = words_of(line.removeprefix("/"), f"{name}, line {number}")
        if words:
            machine.take(words, number)
    return machine.result()


@dataclass
class _Machine:
    """The modal state of an interpreter."""

    name: str
    rapid_speed: float
    position: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # m, of the machine
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # m, by G92
    unit: float = MILLIMETRE
    absolute: bool = True
    extruder_absolute: bool = True
    extruder: float = 0.0  # in units of the program
    feed: float | None = None  # m/s
    motion: int | None = None
    known: set[str] = field(default_factory=set[str])  # axes whose place the program stated
    moved: bool = False
    ended: bool = False
    line: int = 0
    segments: list[Segment] = field(default_factory=list[Segment])
    noted: Counter[str] = field(default_factory=Counter[str])

    def take(self, words: list[Word], line: int) -> None:
        """Execute one line."""
        self.line = line
        codes = [self._code(word) for word in words if word.letter == "G"]
        self._miscellaneous(words)
        values = self._values(words)
        if not codes and any(word.letter == "M" for word in words):
            return  # the other words belong to the M code
        moving = [code for code in codes if code in MOTIONS]
        if len(moving) > 1 or (moving and {4, 92} & set(codes)):
            raise self._error(
                f"{' and '.join(f'G{code}' for code in codes)} stand in one line",
                "one of them",
                "write two lines",
            )
        for code in codes:
            self._modal(code, values)
        if moving:
            self.motion = moving[0]
        given = [axis for axis in AXES if axis in values]
        if "F" in values:
            self._set_feed(values["F"])
        if {4, 92} & set(codes):
            return
        if given or (self.motion in (2, 3) and set("IJR") & set(values)):
            self._move(values)
        elif "E" in values:
            self._extruded(values)  # the extruder alone
        if not codes and not given:
            for word in words:
                if word.letter not in "EFMT":
                    self._note(word.letter)

    def _code(self, word: Word) -> int:
        if word.value != int(word.value) or int(word.value) not in KNOWN_G | {18, 19}:
            raise self._error(
                f"{word} is not known",
                "G0 to G4, G17, G20, G21, G28, G90, G91 or G92",
                "remove it, or write the motion with these codes",
            )
        if word.value in (18, 19):
            raise self._error(
                f"{word} asks for arcs in a vertical plane",
                "G17, arcs in the horizontal plane",
                "write such arcs as short lines",
            )
        return int(word.value)

    def _miscellaneous(self, words: list[Word]) -> None:
        for word in words:
            if word.letter == "M" and word.value in (82, 83):
                self.extruder_absolute = word.value == 82
            elif word.letter == "M" and word.value in (2, 30):
                self.ended = True
            elif word.letter in "MT":
                self._note(str(word))

    def _values(self, words: list[Word]) -> dict[str, float]:
        values: dict[str, float] = {}
        for word in words:
            if word.letter in "GMNT":
                continue
            if word.letter in values:
                raise self._error(f"{word.letter} stands twice", "each word once")
            values[word.letter] = word.value
        return values

    def _modal(self, code: int, values: dict[str, float]) -> None:
        if code in (20, 21):
            self.unit = INCH if code == 20 else MILLIMETRE
        elif code in (90, 91):
            self.absolute = self.extruder_absolute = code == 90
        elif code == 4:
            self._dwell(values)
        elif code == 92:
            self._set_position(values)
        elif code in WITHOUT_EFFECT:
            self._note(f"G{code} ({WITHOUT_EFFECT[code]})")
            if code in (28, 29, 10, 11):  # their words are not coordinates
                values.clear()

    def _dwell(self, values: dict[str, float]) -> None:
        time = values.get("S", values.get("P", 0.0) * 1e-3)
        if not 0 <= time <= MAX_DWELL:
            raise self._error(f"the dwell lasts {time:g} s", f"0 to {MAX_DWELL:g} s")
        self._add(Dwell(time, self.line))

    def _set_position(self, values: dict[str, float]) -> None:
        """G92: the place where the tool is gets new coordinates; without words all are 0."""
        given = {axis: values[axis] for axis in "XYZE" if axis in values} or dict.fromkeys(
            "XYZE", 0.0
        )
        for index, axis in enumerate(AXES):
            if axis in given:
                self.offset[index] = self.position[index] - given[axis] * self.unit
                self.known.add(axis)
        self.extruder = given.get("E", self.extruder)

    def _set_feed(self, value: float) -> None:
        feed = value * self.unit / MINUTE
        if not MIN_SPEED <= feed <= MAX_SPEED:
            raise self._error(
                f"the feed F{value:g} is {feed:g} m/s", f"{MIN_SPEED:g} to {MAX_SPEED:g} m/s"
            )
        self.feed = feed

    def _extruded(self, values: dict[str, float]) -> bool:
        """Whether the line feeds material."""
        if "E" not in values:
            return False
        before = self.extruder
        self.extruder = values["E"] if self.extruder_absolute else before + values["E"]
        return self.extruder > before

    def _move(self, values: dict[str, float]) -> None:
        if self.motion is None:
            raise self._error(
                "coordinates stand before any G0, G1, G2 or G3", "one of them in the line"
            )
        if bad := sorted(OTHER_AXES & set(values)):
            raise self._error(f"a move of the axis {bad[0]}", "moves of X, Y and Z alone")
        if "K" in values:
            raise self._error("the word K asks for an arc in a vertical plane", "I and J, or R")
        target = list(self.position)
        for index, axis in enumerate(AXES):
            if axis in values:
                way = values[axis] * self.unit
                target[index] = way + (self.offset if self.absolute else self.position)[index]
                if self._unknown(axis):  # the tool is put there before the program runs
                    self.position[index] = target[index]
        if max(map(abs, target)) > MAX_COORDINATE:
            raise self._error(
                f"the target {target} m lies far outside any robot's reach",
                f"coordinates within {MAX_COORDINATE:g} m",
                "check the unit, G20 or G21",
            )
        if self.motion in (2, 3) and (self._unknown("X") or self._unknown("Y")):
            raise self._error(
                "the arc begins at an unknown place", "a G0 or G1 to X and Y before", ""
            )
        self.known.update(axis for axis in AXES if axis in values)
        start, end = self._point(self.position), self._point(target)
        extruding = self._extruded(values)
        self.position = target
        if self.motion in (2, 3):
            self._arc(start, end, values, extruding)
        elif math.dist(start, end) > CLOSED:
            rapid = self.motion == 0
            speed = self.rapid_speed if rapid and "F" not in values else self._feed()
            self._add(LineSegment(start, end, speed, self.line, rapid, extruding))

    def _unknown(self, axis: str) -> bool:
        """Whether the program has not stated yet where the tool is."""
        return self.absolute and not self.moved and axis not in self.known

    def _feed(self) -> float:
        if self.feed is None:
            raise self._error(
                f"G{self.motion} moves but no feed has been given",
                "a word F, in mm or inch per minute",
                "write F into this line or one before",
            )
        return self.feed

    def _arc(self, start: Point, end: Point, values: dict[str, float], extruding: bool) -> None:
        clockwise = self.motion == 2
        by_radius, by_centre = "R" in values, "I" in values or "J" in values
        if by_radius == by_centre:
            raise self._error(
                f"G{self.motion} has {'R together with I or J' if by_radius else 'no I, J or R'}",
                "the centre by I and J from the start, or the radius by R",
            )
        if by_radius:
            centre = self._centre_by_radius(start, end, values["R"] * self.unit, clockwise)
        else:
            i, j = (values.get(word, 0.0) * self.unit for word in "IJ")
            centre = self._centre(start, end, (start[0] + i, start[1] + j))
        begin = math.atan2(start[1] - centre[1], start[0] - centre[0])
        angle = math.atan2(end[1] - centre[1], end[0] - centre[0]) - begin
        if math.dist(start[:2], end[:2]) <= CLOSED:
            angle, end = 0.0, (*start[:2], end[2])  # a full circle
        sign = -1.0 if clockwise else 1.0
        angle = sign * ((sign * angle) % (2 * math.pi) or 2 * math.pi)
        radius, last = math.dist(start[:2], centre), math.dist(end[:2], centre)
        if abs(radius - last) > CLOSED:
            x, y = (c + (e - c) * radius / last for c, e in zip(centre, end[:2], strict=True))
            self.position[:2] = x, y
            end = (x, y, end[2])
        self._add(Arc(start, end, centre, angle, self._feed(), self.line, extruding))

    def _centre(self, start: Point, end: Point, centre: tuple[float, float]) -> tuple[float, float]:
        """Accept the centre, moved by the rounding of its words so that both radii agree."""
        first, last = math.dist(start[:2], centre), math.dist(end[:2], centre)
        slack = ARC_SLACK + ARC_SHARE * first
        if first <= CLOSED or abs(first - last) > slack or first > MAX_COORDINATE:
            raise self._error(
                f"the arc begins {first * 1e3:.4g} mm from its centre and ends "
                f"{last * 1e3:.4g} mm from it",
                f"equal distances within {slack * 1e3:.2g} mm, above 0",
                "I and J count from the start of the arc",
            )
        chord = math.dist(start[:2], end[:2])
        if chord <= CLOSED or abs(first * first - last * last) > 2 * chord * slack:
            return centre  # (nearly) a full circle: the end is moved instead
        middle = (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]))
        normal = ((start[1] - end[1]) / chord, (end[0] - start[0]) / chord)
        height = (centre[0] - middle[0]) * normal[0] + (centre[1] - middle[1]) * normal[1]
        return middle[0] + height * normal[0], middle[1] + height * normal[1]

    def _centre_by_radius(
        self, start: Point, end: Point, radius: float, clockwise: bool
    ) -> tuple[float, float]:
        """Centre of the shorter arc, of the longer one where R is negative."""
        chord = math.dist(start[:2], end[:2])
        if chord <= CLOSED:
            raise self._error("an arc by R ends where it begins", "a full circle by I and J")
        if 2 * abs(radius) < chord - 2 * ARC_SLACK or abs(radius) > MAX_COORDINATE:
            raise self._error(
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

    def _add(self, segment: Segment) -> None:
        if len(self.segments) == MAX_SEGMENTS:
            raise self._error(f"more than {MAX_SEGMENTS} moves", "fewer", "split the program")
        self.moved = self.moved or not isinstance(segment, Dwell)
        self.segments.append(segment)

    def _note(self, code: str) -> None:
        if code in self.noted or len(self.noted) < MAX_NOTES:
            self.noted[code] += 1

    def _point(self, values: list[float]) -> Point:
        return values[0], values[1], values[2]

    def _error(self, found: str, expected: str, remedy: str = "") -> MotionError:
        return MotionError(f"{self.name}, line {self.line}: {found}", expected, remedy)

    def result(self) -> GcodeProgram:
        """Return what was read."""
        notes = [
            f"{code} stands {count} time{'s' if count > 1 else ''} in {self.name} and has no "
            "effect on the predicted motion"
            for code, count in self.noted.items()
        ]
        return GcodeProgram(ToolPath(self.segments, self.name), tuple(notes), dict(self.noted))
