"""Table of the layouts, and the files of all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from robot_energy.foundation.errors import LayoutError
from robot_energy.foundation.files.output_files import FileKind, check_file, write_file
from robot_energy.foundation.kinds import Kind, Kinds
from robot_energy_report.layouts.foxglove import foxglove, lichtblick
from robot_energy_report.layouts.plotjuggler import plotjuggler, rqt
from robot_energy_report.layouts.plots import Page, pages

MARK = b"robot-energy"


@dataclass(frozen=True, kw_only=True)
class Layout(Kind):
    """A layout for one viewer.

    Attributes:
        file: Its file name.
        start: First bytes of the file.
        make: Makes its text.
    """

    file: str
    start: bytes
    make: Callable[[Sequence[Page]], str]


LAYOUTS = Kinds(
    "viewer",
    *(
        Layout(name=name, label=label, line=line, file=file, start=start, make=make)
        for name, label, line, file, start, make in (
            ("foxglove", "Foxglove", "layout of version 1", "foxglove.json", b"{", foxglove),
            ("lichtblick", "Lichtblick", "layout of the older form", "lichtblick.json", b"{",
             lichtblick),
            ("plotjuggler", "PlotJuggler 3", "layout with a ROS 2 streamer", "plotjuggler.xml",
             b"<?xml", plotjuggler),
            ("rqt", "rqt", "perspective with the first page and the diagnostics", "rqt.perspective",
             b"{", rqt),
        )
    ),
)  # fmt: skip


def write_layouts(folder: str | Path, joint_names: Sequence[str]) -> list[Path]:
    """Return the files of the layouts of all viewers; earlier ones of this tool are replaced.

    Args:
        folder: Folder of the files; made if it is missing.
    """
    place = Path(folder)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LayoutError(
            f"the folder '{place}' cannot be made ({error.strerror})", "a place for one"
        ) from error
    made = pages(joint_names)
    files = [(place / one.file, one) for one in LAYOUTS.values()]
    for path, one in files:
        check_file(path, _kinds(one), "the layout", error=LayoutError)
    for path, one in files:
        write_file(path, one.make(made).encode(), _kinds(one), "the layout", LayoutError)
    return [path for path, _ in files]


def _kinds(one: Layout) -> tuple[FileKind, ...]:
    return (FileKind(f"a layout for {one.label}", one.start, MARK),)
