"""What all figures share: style, colours, formats, and a canvas that is saved at the end.

Measured and predicted have the same colours in every figure; the same input gives the
same bytes.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

from robot_energy.foundation.errors import ReportError
from robot_energy.foundation.extras import require
from robot_energy.foundation.files.output_files import GENERATOR, PICTURE, write_file
from robot_energy.foundation.shown_text import shown, shown_lines
from robot_energy_report.formats import typeset

Axes = Any  # the annotations of matplotlib are partly unknown
Target = str | Path | BytesIO  # a file, or a buffer for SVG
# Colours are those of page.css, as it is in the light.
COLOURS = {"measured": "#b4470b", "predicted": "#0b5cad", "fixed": "#7a3fc4"}
PART_COLOURS = {
    "motion": "#12805c", "friction": "#c2570c", "drives": "#7a3fc4", "cabinet": "#5b6b7d",
    "brake": "#be1844", "capacitor": "#8a6d0f",
}  # fmt: skip
LINES = {"measured": "-", "predicted": "-", "fixed": "--"}
SERIES = ("#0b5cad", "#c2570c", "#12805c", "#be1844", "#8a6d0f", "#7a3fc4", "#5b6b7d")
MAX_TICK = 40  # characters of a name next to an axis
FONT = b"'DejaVu Sans'"  # with which figures are laid out
PAGE_FONTS = b"system-ui, 'Segoe UI', Roboto, 'Liberation Sans', 'DejaVu Sans', sans-serif"
FORMATS = {".png", ".svg", ".pdf"}
STYLE = {
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "text.color": "#16202b",
    "axes.labelcolor": "#16202b",
    "axes.edgecolor": "#51606f",
    "xtick.color": "#51606f",
    "ytick.color": "#51606f",
    "grid.color": "#d9dfe7",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "svg.hashsalt": "robot_energy",
    "figure.dpi": 100.0,
    "svg.fonttype": "none",  # text stays text: found, read out, in the font of the page
    "text.parse_math": False,  # a "$" belongs to a name
}


@contextmanager
def canvas(path: Target, size: tuple[float, float], title: str = "") -> Generator[Any, None, None]:
    """Yield a figure that fits itself to what is drawn, saved whole at the end, not after an error.

    Args:
        size: Width and height. [inch]
    """
    if not isinstance(path, BytesIO):
        check_format(Path(path))
    require("matplotlib", "a figure")
    from matplotlib import style
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    with style.context(["default", STYLE]):
        figure: Any = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)
        yield figure
        if title:
            figure.suptitle(title, fontsize=10, x=0.02, ha="left")
        for text in figure.findobj(Text):
            text.set_text(typeset(shown_lines(text.get_text())))
        _save(figure, path)


@contextmanager
def panels(
    path: Target,
    names: Sequence[str],
    panel: tuple[float, float],
    edge: tuple[float, float],
    labels: tuple[str, str],
    columns: int = 3,
    title: str = "",
) -> Generator[tuple[Any, list[Any]]]:
    """Yield a figure, saved as `canvas` does, and the axes of its panels, row by row.

    Args:
        panel: Width and height of each. [inch]
        edge: What the figure has beyond them, likewise. [inch]
    """
    wide = min(len(names), columns)
    high = -(-len(names) // wide)
    size = panel[0] * wide + edge[0], panel[1] * high + edge[1]
    with canvas(path, size, title) as figure:
        grid: Any = figure.subplots(high, wide, squeeze=False)
        for axes in grid[-1]:
            axes.set_xlabel(labels[0])
        for axes in grid[:, 0]:
            axes.set_ylabel(labels[1])
        for axes, name in zip(grid.flat, names, strict=False):
            axes.set_title(name, fontsize=9, loc="left")
        shown_axes, hidden = list(grid.flat)[: len(names)], list(grid.flat)[len(names) :]
        for axes in hidden:
            axes.set_visible(False)
        yield figure, shown_axes


def named_ticks(axis: Any, places: Any, names: Iterable[str]) -> None:
    """Name the places of an axis with texts from outside, made safe to show."""
    axis.set_ticks(places, [typeset(shown(name, MAX_TICK)) for name in names])


def saving_bars(
    axes: Axes, names: Sequence[str], values: Any, halves: Any, claimed: Sequence[bool], label: str
) -> None:
    """Draw a bar for each saving, the first on top, with its band; grey where it is not claimed."""
    place = range(len(names))[::-1]
    axes.barh(place, values, 0.6, color=[SERIES[2] if one else SERIES[6] for one in claimed])
    axes.errorbar(values, place, xerr=halves, fmt="none", ecolor="#16202b", capsize=3, linewidth=1)
    named_ticks(axes.yaxis, place, names)
    axes.axvline(0.0, color="#51606f", linewidth=0.8)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel(label)


def check_format(path: Path) -> None:
    """Refuse a file that is not a picture."""
    if path.suffix.lower() not in FORMATS:
        raise ReportError(
            f"the figure '{path}' has no known format",
            f"a name that ends in {', '.join(sorted(FORMATS))}",
        )


def _save(figure: Any, path: Target) -> None:
    """Write without dates and versions, with the mark of this tool."""
    kind = "svg" if isinstance(path, BytesIO) else Path(path).suffix.lower().removeprefix(".")
    metadata: dict[str, Any] = {
        "png": {"Software": GENERATOR},
        "svg": {"Date": None, "Creator": GENERATOR},
        "pdf": {"CreationDate": None, "Creator": GENERATOR, "Producer": None},
    }[kind]
    picture = path if isinstance(path, BytesIO) else BytesIO()
    _draw_once(figure)
    figure.savefig(picture, format=kind, dpi=150, metadata=metadata, transparent=kind == "svg")
    if kind == "svg":
        text = picture.getvalue().replace(FONT, PAGE_FONTS)
        picture.seek(0)
        picture.write(text)
    if not isinstance(path, BytesIO):
        write_file(path, picture.getvalue(), PICTURE, "the figure")


def _draw_once(figure: Any) -> None:
    """Only lay a figure out where matplotlib draws it for that, and drops what it has drawn."""
    layout, draw = figure.get_layout_engine(), figure.draw

    def drawn(renderer: Any) -> None:
        if figure.get_layout_engine() is not layout:
            draw(renderer)
        elif figure.axes:
            layout.execute(figure)

    figure.draw = drawn
