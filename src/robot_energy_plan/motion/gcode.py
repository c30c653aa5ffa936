"""G-code of printing and machining programs -> tool path (paper B, section 5.2.2).

Understood are G0 G1 G2 G3 (arcs in all three planes by I J K or R, turns, helices), G4, G17 to
G21, G90 G91 G90.1 G91.1, G92, M82 M83 with E words, M203, M220, M2 and M30. Where machines
differ, the flavour of the program counts (`motion.gcode_flavors`). Words of the machine are
listed and left out; what could move the tool elsewhere is refused with its line.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Annotated

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError
from robot_energy.foundation.files.regular_file import read_regular
from robot_energy_plan.motion.gcode_flavors import ACCELERATIONS, FoundFlavor, flavor_of
from robot_energy_plan.motion.gcode_machine import (
    MAX_SPEED,
    MIN_SPEED,
    ProgramMachine,
)
from robot_energy_plan.motion.tool_corners import ToolPath

MAX_BYTES = 64 * 1024 * 1024
RAPID_SPEED = 0.25  # m/s, assumed: programs do not state it
BINARY = b"GCDE"  # first bytes of binary G-code


class GcodeProgram(Described):
    """Content of a program."""

    path: ToolPath
    notes: tuple[str, ...]
    unknown: Annotated[dict[str, int], "Codes without meaning here, and how often."]
    flavor: FoundFlavor
    accelerations: Annotated[bool, "Whether the program states accelerations; not followed."]


def load_gcode(
    path: str | Path, rapid_speed: float = RAPID_SPEED, flavor: str | None = None
) -> GcodeProgram:
    """Return the tool path of a G-code file, and what was read over.

    Args:
        rapid_speed: Speed of G0 where no F counts for it. [m/s]
    """
    return read_gcode(gcode_text(path), str(path), rapid_speed, flavor)


def gcode_text(path: str | Path) -> str:
    """Return the text of a G-code file: UTF-8, UTF-16 with its mark, else Latin-1."""
    try:
        data = read_regular(path, MAX_BYTES)
    except OSError as error:
        raise MotionError(
            f"there is no G-code file at '{path}' ({error.strerror})", "a text file"
        ) from error
    if data.startswith(BINARY):
        raise MotionError(
            f"{path} is binary G-code", "text", "export it without the option for binary G-code"
        )
    encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    if "\0" in text:
        raise MotionError(f"{path} has zero bytes", "text", "save it as UTF-8")
    return text


def read_gcode(
    text: str,
    name: str = "the program",
    rapid_speed: float = RAPID_SPEED,
    flavor: str | None = None,
) -> GcodeProgram:
    """Return the tool path of G-code, and what was read over.

    The tool begins where the program first puts each axis; an axis that is first named after the
    first move began at 0.

    Args:
        rapid_speed: Speed of G0 where no F counts for it. [m/s]
    """
    if not MIN_SPEED <= rapid_speed <= MAX_SPEED:
        raise MotionError(
            f"the rapid speed is {rapid_speed} m/s", f"{MIN_SPEED:g} to {MAX_SPEED:g} m/s"
        )
    if len(text) > MAX_BYTES:
        raise MotionError(f"{name} has over {MAX_BYTES} characters", "a smaller program")
    machine = ProgramMachine(name, rapid_speed, flavor_of(text, flavor))
    for number, line in enumerate(io.StringIO(text, newline=None), start=1):
        if machine.ended:
            break
        machine.take(line.rstrip("\n").removeprefix("/"), number)
    notes: list[str] = []
    if machine.noted:
        found = (
            f"{code} {count} time{'s' if count > 1 else ''}"
            for code, count in machine.noted.items()
        )
        notes.append(f"left out of {name}, with the time that they take: {', '.join(found)}")
    return GcodeProgram(
        ToolPath(machine.segments, name),
        tuple(notes),
        dict(machine.noted),
        machine.found,
        bool(ACCELERATIONS & set(machine.noted)),
    )
