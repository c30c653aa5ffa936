"""A machine that executes G-code: modes, places and speeds -> segments of a tool path."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated

from robot_energy.foundation.errors import MotionError
from robot_energy_plan.motion.gcode_arcs import MAX_TURNS, PLANES, arc_shape
from robot_energy_plan.motion.gcode_flavors import (
    FRAMES,
    HARMLESS,
    LEFT_OUT,
    LEFT_OUT_BY_PRINTERS,
    MILLIMETRE,
    MINUTE,
    MOVES_THE_ORIGIN,
    MOVING_M,
    VELOCITY_LIMIT,
    Flavor,
    FoundFlavor,
)
from robot_energy_plan.motion.gcode_words import Word, named_command, words_of
from robot_energy_plan.motion.tool_corners import CLOSED, Arc, Dwell, LineSegment, Point, Segment

MAX_SEGMENTS = 500_000
MAX_NOTES = 50  # different codes that are named
MAX_COORDINATE = 1000.0  # m, of any coordinate
MIN_SPEED, MAX_SPEED = 1e-6, 100.0  # m/s
MAX_OVERRIDE = 1000.0  # %
MAX_DWELL = 86_400.0  # s
INCH = 0.0254  # m
MOTIONS = {0, 1, 2, 3}
AXES = "XYZ"
OTHER_AXES = set("ABCUVW")
ARC_WORDS = "IJKR"
KNOWN_G = MOTIONS | {4, 20, 21, 90, 91, 92} | set(PLANES) | set(LEFT_OUT) | set(FRAMES)


@dataclass
class ProgramMachine:
    """The modal state of an interpreter."""

    name: str
    rapid_speed: Annotated[float, "Speed of G0 where no F counts for it. [m/s]"]
    found: FoundFlavor
    position: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # m, of the machine
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # m, by G92
    unit: float = MILLIMETRE
    absolute: bool = True
    centre_absolute: bool = False
    plane: int = 17
    frame: int | None = None
    extruder_absolute: bool = True
    extruder: float = 0.0  # in units of the program
    feed: float | None = None  # m/s
    override: float = 1.0  # of all speeds, by M220
    saved_override: float = 1.0
    max_speed: dict[str, float] = field(default_factory=dict[str, float])  # by axis [m/s]
    max_path_speed: float = math.inf  # m/s
    motion: int | None = None
    known: set[str] = field(default_factory=set[str])  # axes whose place the program stated
    moved: bool = False
    ended: bool = False
    refusal: MotionError | None = None  # of the next move
    turns: int = 0  # of arcs beyond their first
    line: int = 0
    segments: list[Segment] = field(default_factory=list[Segment])
    noted: Annotated[
        Counter[str], "Codes that were left out, and how often they stood in the program."
    ] = field(default_factory=Counter[str])

    @property
    def flavor(self) -> Flavor:
        """What is taken how."""
        return self.found.flavor

    def take(self, text: str, line: int) -> None:
        """Execute one line."""
        self.line = line
        command = named_command(text)
        if command is not None and (self.flavor.named or command[0] == "@"):
            self._named(command, text.partition(";")[0])
            return
        words = words_of(text, f"{self.name}, line {line}", self.flavor.printer)
        if words:
            self._words(words)

    def _words(self, words: list[Word]) -> None:
        codes = [
            self._code(word) for word in words if word.letter == "G" and not self._centres(word)
        ]
        of_machine = any(word.letter in "MT" for word in words)
        self._machine_words(words)
        if not codes and of_machine:
            axes = {word.letter for word in words} & set(AXES)
            if self.flavor.printer or not axes:
                return  # the other words belong to the M code
        values = self._values(words)
        moving = [code for code in codes if code in MOTIONS]
        if len(moving) > 1 or (moving and {4, 92} & set(codes)):
            raise self._error(
                f"{' and '.join(f'G{code}' for code in codes)} are in one line",
                "one of them",
                "write two lines",
            )
        for code in codes:
            self._modal(code, values)
        if moving:
            self.motion = moving[0]
        given = [axis for axis in AXES if axis in values]
        if "F" in values:
            self.feed = values["F"] * self.unit / MINUTE
            if not MIN_SPEED <= self.feed <= MAX_SPEED:
                raise self._error(
                    f"the feed F{values['F']:g} is {self.feed:g} m/s",
                    f"{MIN_SPEED:g} to {MAX_SPEED:g} m/s",
                )
        if {4, 92} & set(codes):
            return
        if given or (self.motion in (2, 3) and set(ARC_WORDS) & set(values)):
            self._move(values)
        elif "E" in values:
            self._extrude_alone(values)
        if not codes and not given:
            for word in words:
                if word.letter not in "EFGMT":
                    self._note(word.letter)

    def _named(self, command: str, text: str) -> None:
        """A command with a name: what it does is known to the machine alone."""
        if command == VELOCITY_LIMIT:
            values = dict(part.split("=", 1) for part in text.split()[1:] if "=" in part)
            try:
                limit = MILLIMETRE * float(values.get("VELOCITY", "nan"))
            except ValueError:
                limit = 0.0
            if limit <= 0.0:
                raise self._error(f"{command} without a speed > 0", "VELOCITY in mm/s")
            if not math.isnan(limit):
                self.max_path_speed = limit
            if set(values) != {"VELOCITY"}:
                self._note(command)
            return
        if not command.startswith(HARMLESS) and command not in ("$X", "$C"):
            self._elsewhere(command)
        self._note(command)

    def _elsewhere(self, what: str) -> None:
        """Refuse the next move if there was one before: the tool may not be where it was."""
        if self.moved and self.refusal is None:
            self.refusal = self._error(
                f"{what} between two moves can move the tool",
                "moves that the program states itself",
                "remove the line if the tool is afterwards where it was",
            )

    def _centres(self, word: Word) -> bool:
        """G90.1 and G91.1: whether centres of arcs are places, or ways from their start."""
        if word.value not in (90.1, 91.1):
            return False
        self.centre_absolute = word.value == 90.1
        return True

    def _code(self, word: Word) -> int:
        code = int(word.value)
        if self.flavor.printer and code in LEFT_OUT_BY_PRINTERS:
            self._note(f"{word} ({LEFT_OUT_BY_PRINTERS[code]})")
            return code
        if not self.flavor.printer and code in MOVES_THE_ORIGIN and word.value == code:
            return code
        if word.value != code or code not in KNOWN_G:
            raise self._error(
                f"{word} is not known",
                "G0 to G4, G17 to G21, G28, G90, G91 or G92",
                "remove it, or write the motion with these codes",
            )
        return code

    def _machine_words(self, words: list[Word]) -> None:
        for place, word in enumerate(words):
            if word.letter == "M" and word.value in (82, 83):
                self.extruder_absolute = word.value == 82
            elif word.letter == "M" and word.value in (2, 30):
                self.ended = True
            elif word.letter == "M" and word.value == 220 and self.flavor.printer:
                self._set_override({each.letter: each.value for each in words[place + 1 :]})
            elif word.letter == "M" and word.value == 203 and self.flavor.max_feed is not None:
                self._set_max_speeds(words[place + 1 :], self.flavor.max_feed)
            elif word.letter in "MT":
                if word.letter == "M" and word.value in MOVING_M:
                    self._elsewhere(str(word))
                self._note(str(word))

    def _set_override(self, values: dict[str, float]) -> None:
        if "B" in values:
            self.saved_override = self.override
        if "R" in values:
            self.override = self.saved_override
        share = values.get("S", 100.0 * self.override)
        if not 0.0 < share <= MAX_OVERRIDE:
            raise self._error(f"M220 S{share:g}", f"a share of the speed, up to {MAX_OVERRIDE:g} %")
        self.override = 0.01 * share

    def _set_max_speeds(self, words: Sequence[Word], unit: float) -> None:
        if any(word.letter == "S" and word.value == 1 for word in words):
            unit = MILLIMETRE  # RepRapFirmware: per second
        for word in words:
            if word.letter in "XYZE":
                speed = word.value * unit * (self.unit / MILLIMETRE)
                if not MIN_SPEED <= speed:
                    raise self._error(
                        f"M203 {word} is {speed:g} m/s", f"at least {MIN_SPEED:g} m/s"
                    )
                self.max_speed[word.letter] = speed

    def _values(self, words: list[Word]) -> dict[str, float]:
        values: dict[str, float] = {}
        for word in words:
            if word.letter in "GMNT":
                continue
            if word.letter in values:
                raise self._error(f"{word.letter} is given twice", "each word once")
            values[word.letter] = word.value
        return values

    def _modal(self, code: int, values: dict[str, float]) -> None:
        if code in (20, 21):
            if code == 20 and not self.flavor.inches:
                raise self._error(f"{self.flavor.title} takes no inches", "G21")
            self.unit = INCH if code == 20 else MILLIMETRE
        elif code in PLANES:
            self.plane = code
        elif code in (90, 91):
            self.absolute = code == 90
            if self.flavor.extruder_follows:
                self.extruder_absolute = self.absolute
        elif code == 4:
            self._dwell(values)
        elif code == 92:
            self._set_position(values)
        elif code in FRAMES:
            if self.frame not in (None, code):
                raise self._error(
                    f"G{code} after G{self.frame} moves the origin",
                    "one work offset",
                    "write the program in one of them",
                )
            self.frame = code
        elif self.flavor.printer and code in LEFT_OUT_BY_PRINTERS:
            values.clear()  # its words are not coordinates
        elif code in MOVES_THE_ORIGIN and not self.flavor.printer:
            if values or code != 53:
                self._elsewhere(f"G{code}")
            self._note(f"G{code}")
            values.clear()
        elif code in LEFT_OUT:
            self._note(f"G{code} ({LEFT_OUT[code]})")

    def _dwell(self, values: dict[str, float]) -> None:
        times = {
            word: second * values[word] for word, second in self.flavor.dwell if word in values
        }
        for word in sorted({"P", "S"} & set(values) - set(list(times)[:1])):
            self._note(f"G4 {word}")
        time = next(iter(times.values()), 0.0)
        if not self.found.certain and any(values.get(word) for word in "PS"):
            raise self._error(
                "G4 counts seconds for machining and milliseconds for printers",
                "a program that states its flavour",
                "name it with --flavor",
            )
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

    def _extruded(self, values: dict[str, float]) -> float:
        """How much material the line feeds, in units of the program; < 0: is drawn back."""
        if "E" not in values:
            return 0.0
        before = self.extruder
        self.extruder = values["E"] if self.extruder_absolute else before + values["E"]
        return self.extruder - before

    def _extrude_alone(self, values: dict[str, float]) -> None:
        """The tool rests while the extruder moves."""
        way = abs(self._extruded(values)) * self.unit
        if way > 0.0 and self.feed is not None and self.flavor.printer:
            time = way / min(self.feed * self.override, self.max_speed.get("E", math.inf))
            if not time <= MAX_DWELL:
                raise self._error(f"the extruder moves for {time:g} s", f"0 to {MAX_DWELL:g} s")
            self._add(Dwell(time, self.line))

    def _move(self, values: dict[str, float]) -> None:
        if self.motion is None:
            raise self._error(
                "coordinates stand before any G0, G1, G2 or G3", "one of them in the line"
            )
        if bad := sorted(OTHER_AXES & set(values)):
            raise self._error(f"a move of the axis {bad[0]}", "moves of X, Y and Z alone")
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
        flat = PLANES[self.plane][:2]
        if self.motion in (2, 3) and any(self._unknown(AXES[axis]) for axis in flat):
            raise self._error(
                "the arc begins at an unknown place", "a G0 or G1 to X and Y before", ""
            )
        self.known.update(axis for axis in AXES if axis in values)
        start, end = self._point(self.position), self._point(target)
        extruding = self._extruded(values) > 0.0
        if self.motion in (2, 3):
            end = self._arc(start, end, values, extruding)
        elif math.dist(start, end) > CLOSED:
            rapid = self.motion == 0
            length = math.dist(start, end)
            speed = self._speed([abs(b - a) / length for a, b in zip(start, end, strict=True)])
            self._add(LineSegment(start, end, speed, self.line, rapid, extruding))
        self.position = list(end)

    def _unknown(self, axis: str) -> bool:
        return self.absolute and not self.moved and axis not in self.known

    def _speed(self, shares: Sequence[float]) -> float:
        """Commanded speed of a move in which each axis moves at so much of it."""
        at_feed = self.motion != 0 or (self.flavor.rapid_at_feed and self.feed is not None)
        if at_feed and self.feed is None:
            raise self._error(
                f"G{self.motion} moves but no feed has been given",
                "a word F, in mm or inch per minute",
                "write F into this line or one before",
            )
        speed = (self.feed or 0.0) if at_feed else self.rapid_speed
        speed = min(speed * self.override, self.max_path_speed)
        for axis, share in zip(AXES, shares, strict=True):
            if axis in self.max_speed and share > 0.0:
                speed = min(speed, self.max_speed[axis] / share)
        if not MIN_SPEED <= speed <= MAX_SPEED:
            raise self._error(f"the speed is {speed:g} m/s", f"{MIN_SPEED:g} to {MAX_SPEED:g} m/s")
        return speed

    def _arc(self, start: Point, end: Point, values: dict[str, float], extruding: bool) -> Point:
        plane = PLANES[self.plane]
        words = {word: values[word] * self.unit for word in ARC_WORDS if word in values}
        if self.centre_absolute:
            for axis, word in enumerate("IJK"):
                if word in words:
                    words[word] += self.offset[axis]
        turns = self._turns(values.get("P", 1.0))
        try:
            shape = arc_shape(
                start, end, words, plane, self.motion == 2, self.centre_absolute, turns
            )
        except MotionError as error:
            raise self._error(error.found, error.expected, error.remedy) from error
        flat = abs(shape.angle) * math.dist(shape.centre, (start[plane[0]], start[plane[1]]))
        rise = abs(end[plane[2]] - start[plane[2]])
        length = math.hypot(flat, rise)
        shares = [flat / length] * 3  # the greatest of each axis, wherever on the arc
        shares[plane[2]] = rise / length
        speed = self._speed(shares)
        self._add(
            Arc(start, shape.end, shape.centre, shape.angle, speed, self.line, extruding, plane)
        )
        return shape.end

    def _turns(self, count: float) -> int:
        if self.flavor.turns:
            if count != int(count) or not 1 <= count <= MAX_TURNS:
                raise self._error(f"an arc of P{count:g} turns", f"1 to {MAX_TURNS} turns")
            self.turns += int(count) - 1
            return int(count)
        if count > 1:
            raise self._error(
                f"an arc with P{count:g}, which {self.flavor.title} takes in some versions only",
                "no P",
                "write full circles as lines of their own",
            )
        return 1

    def _add(self, segment: Segment) -> None:
        if len(self.segments) + self.turns >= MAX_SEGMENTS:
            raise self._error(f"more than {MAX_SEGMENTS} moves", "fewer", "split the program")
        if not isinstance(segment, Dwell):
            if self.refusal is not None:
                raise self.refusal
            self.moved = True
        self.segments.append(segment)

    def _note(self, code: str) -> None:
        if code in self.noted or len(self.noted) < MAX_NOTES:
            self.noted[code] += 1

    def _point(self, values: list[float]) -> Point:
        return values[0], values[1], values[2]

    def _error(self, found: str, expected: str, remedy: str = "") -> MotionError:
        return MotionError(f"{self.name}, line {self.line}: {found}", expected, remedy)
