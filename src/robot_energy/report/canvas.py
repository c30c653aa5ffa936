"""What all figures share: style, colours, formats, and a canvas that is saved at the end.

Measured and predicted have the same colours in every figure; the same input gives the
same bytes.
"""

from __future__ import annotations

import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from robot_energy.errors import ReportError

Axes = Any  # the annotations of matplotlib are partly unknown

COLOURS = {"measured": "#1a1a1a", "predicted": "#0072b2", "fixed": "#d55e00"}
LINES = {"measured": "-", "predicted": "-", "fixed": "--"}
SERIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#1a1a1a")
FORMATS = {".png", ".svg", ".pdf"}
STYLE = {
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "svg.hashsalt": "robot_energy",
    "figure.dpi": 100.0,
}


@contextmanager
def canvas(
    path: str | Path, size: tuple[float, float], title: str = ""
) -> Generator[Any, None, None]:
    """Open a figure, and save it when all is drawn: whole, or not at all after an error.

    Args:
        path: File to write: PNG, SVG or PDF by its suffix. It is replaced whole.
        size: Width and height. [inch]
        title: Above the figure.

    Yields:
        The figure, whose layout fits itself to what is drawn.

    Raises:
        ReportError: If the suffix is none of these, or the file cannot be written.
    """
    target = Path(path)
    check_format(target)
    from matplotlib import style
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with style.context(["default", STYLE]):
        figure: Any = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(figure)
        yield figure
        if title:
            figure.suptitle(title, fontsize=10, x=0.02, ha="left")
        _save(figure, target)


def panels(figure: Any, count: int, columns: int = 3) -> Any:
    """Divide a figure into panels, row by row; those that are not needed are hidden.

    Args:
        figure: From `canvas`.
        count: How many are needed, >= 1.
        columns: At most.

    Returns:
        Array of axes, shape (rows, columns); the first `count` of its `flat` are shown.
    """
    wide, high = panel_grid(count, columns)
    grid: Any = figure.subplots(high, wide, squeeze=False)
    for axes in list(grid.flat)[count:]:
        axes.set_visible(False)
    return grid


def panel_grid(count: int, columns: int = 3) -> tuple[int, int]:
    """Return the columns and rows that a number of panels takes."""
    wide = min(count, columns)
    return wide, -(-count // wide)


def check_format(path: Path) -> None:
    """Refuse a file that is no picture.

    Raises:
        ReportError: If the suffix is not one of the formats.
    """
    if path.suffix.lower() not in FORMATS:
        raise ReportError(
            f"the figure '{path}' has no known format",
            f"a name that ends in {', '.join(sorted(FORMATS))}",
        )


def _save(figure: Any, target: Path) -> None:
    """Write without dates and versions."""
    kind = target.suffix.lower().removeprefix(".")
    metadata: dict[str, Any] = {
        "png": {"Software": None},
        "svg": {"Date": None, "Creator": None},
        "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    }[kind]
    draft = target.with_name(target.name + ".part")
    try:
        figure.savefig(draft, format=kind, dpi=150, metadata=metadata)
        os.replace(draft, target)
    except OSError as error:
        raise ReportError(
            f"the figure '{target}' cannot be written ({error.strerror})", "a writable folder"
        ) from error
