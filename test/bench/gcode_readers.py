"""Programs as we read them against two readers from PyPI: way, time without acceleration.

    pip install --no-deps --target build/gcode_readers -r test/bench/requirements-gcode.txt
    PYTHONPATH=build/gcode_readers:$PYTHONPATH python test/bench/gcode_readers.py FOLDER

Prints one row for each program of the folder. The time is that of the moves at their feeds, of
the extruder alone and of G4; rapids of machines that are not printers have no feed and are left
out. What the slicer states in the program stands next to it, acceleration included.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from robot_energy.foundation.errors import MotionError
from robot_energy_plan.motion.gcode import GcodeProgram, gcode_text, read_gcode
from robot_energy_plan.motion.tool_corners import Dwell, LineSegment

CHORD, TURN = 0.02, 1.0  # mm and deg of an arc's pieces
STATED = re.compile(
    r"^;\s*(?:TIME:(\d+)|estimated printing time \(normal mode\) = (.*)"
    r"|.*total estimated time: (.*))",
    re.MULTILINE,
)
PARTS = {"d": 86_400, "h": 3600, "m": 60, "s": 1}


class Move(NamedTuple):
    """One line of a program, as a reader takes it."""

    places: list[tuple[float, float, float]]  # gone through, mm
    named: frozenset[str]  # axes that the line names
    feed: float | None  # mm/min
    fed: float = 0.0  # mm of material
    rapid: bool = False
    rest: float = 0.0  # s


def measured(moves: Iterable[Move], printer: bool) -> tuple[float, float]:
    """Way [m] and time [s]; the tool begins where the program first puts each axis."""
    known: set[str] = set()
    at, way, time, moved = [0.0, 0.0, 0.0], 0.0, 0.0, False
    for move in moves:
        length = 0.0
        for place in move.places:
            for index, axis in enumerate("XYZ"):
                if axis in move.named and axis not in known and not moved:
                    at[index] = place[index]
            length += math.dist(at, place)
            at = list(place)
        known |= move.named
        moved = moved or length > 0.0
        way += length
        time += move.rest
        if move.feed and (printer or not move.rapid):
            time += (length or abs(move.fed)) / (move.feed / 60.0)
    return 1e-3 * way, time


def by_gcode_lib(text: str) -> Iterator[Move]:
    """Moves of gcode-lib."""
    from gcode_lib import parse_lines
    from gcode_lib._state import iter_with_state, linearize_arc_points

    held = list(iter_with_state(parse_lines(f"{text}\n; end")))
    following = [state for _, state in held[1:]]
    for (line, before), after in zip(held, following, strict=False):
        if line.command == "G4":
            rest = line.words.get("S", line.words.get("P", 0.0) * 1e-3)
            yield Move([], frozenset(), None, rest=rest)
        if not (line.is_move or line.is_arc):
            continue
        places = [(after.x, after.y, after.z)]
        if line.is_arc:
            flat = linearize_arc_points(
                before, line.words, line.command in ("G2", "G02"), CHORD, TURN
            )
            rise = after.z - before.z
            places = [
                (x, y, before.z + rise * (number + 1) / len(flat))
                for number, (x, y) in enumerate(flat)
            ]
        named = frozenset("XYZ") & set(line.words)
        rapid = line.command in ("G0", "G00")
        yield Move(places, named, after.f, after.e - before.e, rapid)


def by_printrun(text: str) -> Iterator[Move]:
    """Moves of Printrun; it takes an arc as its chord."""
    from printrun.gcoder import GCode

    feed = None
    for line in GCode(text.splitlines()).lines:
        if line.command == "G4":
            yield Move(
                [], frozenset(), None, rest=1e-3 * (line.p or 0.0) if hasattr(line, "p") else 0.0
            )
        if not line.is_move:
            continue
        feed = feed if line.f is None else line.f
        named = frozenset(axis for axis in "XYZ" if getattr(line, axis.lower()) is not None)
        place = (line.current_x or 0.0, line.current_y or 0.0, line.current_z or 0.0)
        fed = 0.0 if line.e is None or not line.relative_e else line.e
        yield Move([place], named, feed, fed, line.command == "G0")


def ours(program: GcodeProgram) -> tuple[float, float]:
    """The same figures of our path."""
    time = 0.0
    for segment in program.path.segments:
        if isinstance(segment, Dwell):
            time += segment.time
        elif (
            not isinstance(segment, LineSegment)
            or not segment.rapid
            or (program.flavor.flavor.printer)
        ):
            time += segment.length / segment.speed
    return program.path.length, time


def stated(text: str) -> float:
    """Time that the slicer states; nan where it states none. [s]"""
    if (found := STATED.search(text)) is None:
        return math.nan
    if found[1]:
        return float(found[1])
    parts = re.findall(r"(\d+)([dhms])", found[2] or found[3])
    return float(sum(int(count) * PARTS[unit] for count, unit in parts))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="of the programs")
    args = parser.parse_args()
    heads = ("program", "flavour", "way", "gcode-lib", "Printrun", "time", "gcode-lib", "Printrun")
    print("{:34s} {:9s} {:>9s} {:>9s} {:>9s} {:>9s} {:>9s} {:>9s} {:>8s}".format(*heads, "slicer"))
    for path in sorted(args.folder.iterdir()):
        try:
            text = gcode_text(path)
            program = read_gcode(text, path.name)
        except MotionError as error:
            print(f"{path.name[:34]:34s} {error}")
            continue
        printer = program.flavor.flavor.printer
        rows = [ours(program)]
        for reader in (by_gcode_lib, by_printrun):
            try:
                rows.append(measured(reader(text), printer))
            except Exception as error:
                print(f"  {reader.__name__}: {type(error).__name__} {error}")
                rows.append((math.nan, math.nan))
        ways, times = zip(*rows, strict=True)
        figures = " ".join(f"{value:9.3f}" for value in ways) + " "
        figures += " ".join(f"{value:9.1f}" for value in times)
        title = program.flavor.flavor.title.split(",")[0][:9]
        print(f"{path.name[:34]:34s} {title:9s} {figures} {stated(text):8.0f}")


if __name__ == "__main__":
    main()
