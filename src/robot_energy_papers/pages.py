"""Pages of the studies: Markdown templates with Jinja2 expressions -> a report, or a terminal.

A template is Markdown in blocks with empty lines between them:

- ``# title``, and as the next block the lead of the document,
- ``## heading``, ``> note``, or a fenced command line,
- ``| cell | cell |``: a table; ``Table: title`` may stand above it, and a last row in bold
  holds the sums,
- ``![caption](name)``: the drawing of that name,
- ``@name``: the part of that name, which Python writes,
- anything else: a paragraph.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from robot_energy_report.document import Document
from robot_energy_report.formats import percent, signed_percent

Piece = Callable[[Any], object]
"""Draws a figure into a buffer, or writes a part onto a page."""

PAPERS = "robot_energy_papers"
BLOCKS = re.compile(r"\n\s*\n")
CELLS = re.compile(r"(?<!\\)\|")
FIGURE = re.compile(r"!\[(.*)\]\((\w+)\)")
ESCAPED = r"\|"
TITLE = "Table: "
BOLD = "**"


def document(
    template: str,
    context: Mapping[str, Any],
    pieces: Mapping[str, Piece],
    package: str = PAPERS,
) -> Document:
    """Return a page."""
    title, lead, *blocks = _blocks(template, context, package)
    page = Document(_joined(title).removeprefix("# "), _joined(lead))
    for block in blocks:
        if (found := FIGURE.fullmatch(_joined(block))) is not None:
            page.figure(pieces[found[2]], found[1])
        elif block.startswith("```"):
            page.paragraph(block.strip("`\n"), "command")
        elif block.startswith("@"):
            pieces[block[1:]](page)
        else:
            _write(block, page)
    return page


def print_template(
    template: str, context: Mapping[str, Any], page: Document, package: str = PAPERS
) -> None:
    """Write text and tables of a template without figures."""
    for block in _blocks(template, context, package):
        _write(block, page)


def hundred(share: float) -> str:
    """Return a share in percent without the sign of percent.

    Args:
        share: [-]
    """
    return f"{100 * share:.1f}"


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cell.replace('|', ESCAPED) for cell in cells)} |"


def _whole(value: float, unit: str = "") -> str:
    return f"{value:.0f}{unit}"


def _hundreds(shares: Sequence[float]) -> list[str]:
    return [hundred(share) for share in shares]


def _of(key: str, table: Mapping[str, object]) -> object:
    return table[key]


def _kilo(value: float) -> str:
    return f"{value / 1e3:.1f}"


FILTERS: dict[str, Callable[..., Any]] = {
    "general": "{:g}".format,
    "hundred": hundred,
    "hundreds": _hundreds,
    "kelvin": "{:.2f} K".format,
    "kilo": _kilo,
    "of": _of,
    "percent": percent,
    "row": _row,
    "signed": signed_percent,
    "tenth": "{:.1f}".format,
    "whole": _whole,
}


def _blocks(template: str, context: Mapping[str, Any], package: str) -> list[str]:
    environment = Environment(
        loader=PackageLoader(package),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(FILTERS)
    text = environment.get_template(f"{template}.md.j2").render(context)
    return BLOCKS.split(text.strip())


def _write(block: str, page: Document) -> None:
    if block.startswith("#"):
        marks, _, text = block.partition(" ")
        page.heading(text, len(marks))
    elif block.startswith("> "):
        page.note(_joined(block[2:]))
    elif block.startswith((TITLE, "|")):
        _table(block, page)
    else:
        page.paragraph(_joined(block))


def _table(block: str, page: Document) -> None:
    title, *lines = block.splitlines() if block.startswith(TITLE) else ["", *block.splitlines()]
    columns, *rows = (
        [cell.strip().replace(ESCAPED, "|") for cell in CELLS.split(text)[1:-1]] for text in lines
    )
    total = None
    if rows[-1][0].startswith(BOLD):
        total = [cell.strip("*") for cell in rows.pop()]
    page.table(title.removeprefix(TITLE), columns, rows, total)


def _joined(block: str) -> str:
    return " ".join(block.split())
