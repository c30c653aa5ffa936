"""What machines do differently with the same G-code, and which of them a program is for.

Only what changes path or time stands here. Sources: src/doc/howto_predict.md.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, NamedTuple

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError

MILLIMETRE = 1e-3  # m
MINUTE = 60.0  # s
IN_BOTH = (("S", 1.0), ("P", 1e-3))
IN_MILLISECONDS = (("P", 1e-3),)
IN_SECONDS = (("P", 1.0),)


class Flavor(Described):
    """How a machine takes G-code."""

    title: str
    printer: Annotated[bool, "Whether it is a printer, with an extruder E."] = True
    rapid_at_feed: Annotated[bool, "Whether G0 moves at the last F, as G1 does."] = True
    dwell: Annotated[
        tuple[tuple[str, float], ...], "Time of a unit of G4's words; the first counts. [s]"
    ] = IN_BOTH
    extruder_follows: Annotated[bool, "Whether G90 and G91 count for E too."] = False
    inches: bool = True
    max_feed: Annotated[float | None, "Speed of one unit of M203; None: unknown. [m/s]"] = None
    turns: Annotated[bool, "Whether P of an arc is its number of turns."] = False
    named: Annotated[bool, "Whether there are commands with names."] = False


FLAVORS: Mapping[str, Flavor] = MappingProxyType(
    {
        "marlin": Flavor("Marlin", extruder_follows=True, max_feed=MILLIMETRE),
        "reprapfirmware": Flavor("RepRapFirmware", max_feed=MILLIMETRE / MINUTE),
        "klipper": Flavor("Klipper", dwell=IN_MILLISECONDS, inches=False, named=True),
        "grbl": Flavor("GRBL", printer=False, rapid_at_feed=False, dwell=IN_SECONDS, named=True),
        "linuxcnc": Flavor(
            "LinuxCNC, as ISO 6983",
            printer=False,
            rapid_at_feed=False,
            dwell=IN_SECONDS,
            turns=True,
        ),
    }
)
MARLIN, LINUXCNC = FLAVORS["marlin"], FLAVORS["linuxcnc"]
LEFT_OUT = {
    40: "no tool radius",
    43: "tool length; the program states the way of its tip",
    49: "no tool length",
    61: "exact stop; corners follow the tolerance of the prediction",
    64: "path mode; corners follow the tolerance of the prediction",
    80: "no cycle",
    94: "feed per minute",
}
LEFT_OUT_BY_PRINTERS = {
    10: "retraction of the extruder",
    11: "retraction of the extruder",
    12: "cleaning",
    27: "parking",
    28: "homing",
    29: "levelling",
    **dict.fromkeys(range(30, 36), "probing"),
    80: "levelling",
    380: "moving to a stop",
    392: "detection of a clogged nozzle",
}
MOVES_THE_ORIGIN = {10, 28, 30, 53}  # on machines that are not printers
FRAMES = range(54, 60)  # G54 to G59: work offsets
MOVING_M = {97, 98, 206, 218, 290, 428}  # programs called, origins moved
VELOCITY_LIMIT = "SET_VELOCITY_LIMIT"
ACCELERATIONS = {"M201", "M204", "M205", "M566", VELOCITY_LIMIT}
HARMLESS = (
    "EXCLUDE_OBJECT", "SET_PRESSURE_ADVANCE", "SET_PRINT_STATS", "SET_FAN", "SET_HEATER",
    "SET_FILAMENT", "SET_LED", "SET_PIN", "SET_TMC", "SET_INPUT_SHAPER", "SET_IDLE_TIMEOUT",
    "SET_DISPLAY", "SET_RETRACTION", "TEMPERATURE_WAIT", "RESPOND", "ACTIVATE_EXTRUDER", "@",
)  # fmt: skip

SLICER_NAMES = {
    **dict.fromkeys(("marlin", "marlin2", "reprap", "repetier", "griffin"), "marlin"),
    **dict.fromkeys(("reprapfirmware", "rrf"), "reprapfirmware"),
    **dict.fromkeys(("mach3", "machinekit", "linuxcnc", "iso"), "linuxcnc"),
    **dict.fromkeys(("klipper", "grbl"), ""),
}
CURA_REPRAP = "RepRap"  # Cura's name of RepRapFirmware; PrusaSlicer calls an older one reprap

STATED = re.compile(
    r"^;[ \t]*(?:(FLAVOR):|gcode_flavor[ \t]*=)[ \t]*([A-Za-z0-9_-]+)", re.MULTILINE
)
SLICER = re.compile(
    r"^;.*?\b((?:Prusa|Super|Orca)Slicer|Slic3r|Cura|BambuStudio|Simplify3D|KISSlicer|ideaMaker)\b",
    re.MULTILINE,
)
LINE_START = r"^[ \t]*(?:N[ \t]*\d+[ \t]*)?"
EXTENDED = re.compile(LINE_START + r"([A-Z]+_[A-Z0-9_]+)(?=[ \t\r]|$)", re.MULTILINE)
DOLLAR = re.compile(r"^[ \t]*(\$[A-Z]{1,3})[ \t\r]*$", re.MULTILINE)
PRINTER = re.compile(
    LINE_START
    + r"(?:(M0*(?:82|83|84|104|106|107|109|140|190|201|203|204|205|220|221))(?![\d.])"
    + r"|G0*[0-3](?!\d)[^;(\r\n]*?(?<![A-Za-z])(E)[ \t]*[-+]?\.?\d)",
    re.MULTILINE,
)


class FoundFlavor(NamedTuple):
    """The flavour of a program."""

    flavor: Flavor
    reason: str
    certain: Annotated[bool, "Whether something in the program or the user said so."] = True


def flavor_of(text: str, name: str | None = None) -> FoundFlavor:
    """Return the flavour of a program.

    What only one machine understands counts first, then what the header states, then the
    slicer, then words of printers.

    Args:
        name: Key of `FLAVORS` where the user names it; None: found from the program.
    """
    if name is not None:
        if name not in FLAVORS:
            raise MotionError(f"the flavour of G-code is '{name}'", ", ".join(FLAVORS))
        return FoundFlavor(FLAVORS[name], "as asked")
    for pattern, key in ((EXTENDED, "klipper"), (DOLLAR, "grbl")):
        if (word := pattern.search(text)) is not None:
            return FoundFlavor(FLAVORS[key], f"for its word {word[1]}")
    if (stated := STATED.search(text)) is not None:
        key = "reprapfirmware" if stated[1] and stated[2] == CURA_REPRAP else stated[2].lower()
        known = SLICER_NAMES.get(key, "marlin") or key
        return FoundFlavor(FLAVORS[known], f"the header states {stated[2]}")
    if (slicer := SLICER.search(text)) is not None:
        return FoundFlavor(MARLIN, f"the header names {slicer[1]}")
    if (word := PRINTER.search(text)) is not None:
        return FoundFlavor(MARLIN, f"for its word {word[1] or word[2]}")
    return FoundFlavor(LINUXCNC, "nothing in it says otherwise", certain=False)
