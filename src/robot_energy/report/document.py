"""One self-contained HTML document: text, tables and figures in a single file.

Everything lies in the file: style, figures and numbers; it opens without a network, on a
phone, and on paper. `report.printing` writes its lines and tables into a document as it
does to a terminal, so a report says in both places the same.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Callable, Sequence
from html import escape as escaped
from io import BytesIO
from pathlib import Path

from robot_energy.errors import ReportError
from robot_energy.files.output_files import HTML, HTML_MARK, write_file
from robot_energy.shown_text import shown_lines

MOST_DEPTH = 4  # of headings
LEFT = ' class="text"'
PROSE = 24  # characters from which a cell is read as a sentence
STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: #1a1a1a;
  max-width: 62rem; margin: 0 auto; padding: 1.5rem 1rem 4rem; background: #fff; }
h1 { font-size: 1.7rem; line-height: 1.25; margin: 0 0 .2rem; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .6rem; padding-top: .8rem;
  border-top: 1px solid #dcdcdc; }
h3 { font-size: 1.05rem; margin: 1.8rem 0 .4rem; }
h4 { font-size: 1rem; margin: 1.2rem 0 .3rem; }
p { margin: .5rem 0; max-width: 48rem; }
p.lead { color: #555; }
p.note { border-left: 3px solid #d55e00; background: #fdf4ee; padding: .4rem .8rem; }
nav { margin: 1rem 0; font-size: .93rem; }
nav ol { margin: 0; padding-left: 1.4rem; }
a { color: #0072b2; }
.wide { overflow-x: auto; margin: .8rem 0 1.2rem; }
table { min-width: min(100%, 28rem); border-collapse: collapse; font-size: .88rem;
  font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding-bottom: .3rem; }
th, td { padding: .22rem .8rem .22rem 0; text-align: right; vertical-align: baseline; }
th { border-bottom: 1px solid #1a1a1a; font-weight: 600; vertical-align: bottom; }
td { border-bottom: 1px solid #ececec; }
th.text, td.text { text-align: left; }
tr.total td { border-top: 1px solid #1a1a1a; font-weight: 600; }
figure { margin: 1rem 0 1.4rem; }
figure img { max-width: 100%; height: auto; }
figcaption { font-size: .9rem; color: #444; max-width: 48rem; }
code { font-family: ui-monospace, "DejaVu Sans Mono", monospace; font-size: .9em; }
pre { background: #f5f5f5; padding: .6rem .8rem; overflow-x: auto; font-size: .88rem; }
@media print { h2 { break-after: avoid; } figure, tr { break-inside: avoid; }
  body { max-width: none; } }
"""


class Document:
    """A page that grows from top to bottom.

    Args:
        title: Of the document.
        lead: One or two sentences below it: what this is, and of what data.
    """

    def __init__(self, title: str, lead: str = "") -> None:
        self.title = title
        self._lead = lead
        self._parts: list[str] = []
        self._contents: list[tuple[str, str]] = []

    def heading(self, text: str, depth: int = 2) -> None:
        """Begin a section; those of depth 2 are listed at the top.

        Raises:
            ReportError: If the depth is not 2, 3 or 4.
        """
        if not 2 <= depth <= MOST_DEPTH:
            raise ReportError(f"a heading of depth {depth}", f"2 to {MOST_DEPTH}")
        anchor = f"{len(self._parts)}-{re.sub(r'[^a-z0-9]+', '-', text.lower()).strip('-')}"
        if depth == 2:
            self._contents.append((anchor, text))
        self._parts.append(f'<h{depth} id="{anchor}">{escape(text)}</h{depth}>')

    def paragraph(self, text: str) -> None:
        """Add plain text; what stands between backticks is set as code."""
        self._parts.append(f"<p>{_prose(text)}</p>")

    def note(self, text: str) -> None:
        """Add a sentence that must not be overlooked: a warning, or what is not known."""
        self._parts.append(f'<p class="note">{_prose(text)}</p>')

    def command(self, text: str) -> None:
        """Add a command line that makes what is shown."""
        self._parts.append(f"<pre><code>{escape(text)}</code></pre>")

    def table(
        self,
        title: str,
        columns: Sequence[str],
        rows: Sequence[Sequence[str]],
        total: Sequence[str] | None = None,
    ) -> None:
        """Add a table: first column and sentences left, numbers right.

        Args:
            title: Above the table.
            columns: Names.
            rows: Cells, as many as columns in each.
            total: A last row of sums.

        Raises:
            ReportError: If a row has another number of cells.
        """
        body = [*rows, *([total] if total is not None else [])]
        for row in body:
            if len(row) != len(columns):
                raise ReportError(
                    f"a row of '{title}' has {len(row)} cells", f"{len(columns)}, one per column"
                )
        left = [
            index == 0 or any(len(row[index]) > PROSE for row in body)
            for index in range(len(columns))
        ]
        lines = [
            _row("th", columns, left),
            *(_row("td", row, left) for row in rows),
            *([_row("td", total, left, ' class="total"')] if total is not None else []),
        ]
        caption = f"<caption>{escape(title)}</caption>" if title else ""
        self._parts.append(f'<div class="wide"><table>{caption}{"".join(lines)}</table></div>')

    def figure(self, draw: Callable[[BytesIO], object], caption: str) -> None:
        """Add a figure.

        Args:
            draw: Writes it as SVG to what it is given.
            caption: What is to be seen; also read out where the figure cannot be shown.
        """
        picture = BytesIO()
        draw(picture)
        data = base64.b64encode(picture.getvalue()).decode("ascii")
        self._parts.append(
            f'<figure><img src="data:image/svg+xml;base64,{data}" alt="{escape(caption)}">'
            f"<figcaption>{_prose(caption)}</figcaption></figure>"
        )

    def html(self) -> str:
        """Return the whole document."""
        lead = f'<p class="lead">{_prose(self._lead)}</p>' if self._lead else ""
        entries = "".join(
            f'<li><a href="#{anchor}">{escape(text)}</a></li>' for anchor, text in self._contents
        )
        contents = f"<nav><ol>{entries}</ol></nav>" if len(self._contents) > 2 else ""
        return (
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            f"{HTML_MARK}"
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{escape(self.title)}</title><style>{STYLE}</style></head><body>\n"
            f"<h1>{escape(self.title)}</h1>\n{lead}\n{contents}\n"
            + "\n".join(self._parts)
            + "\n</body></html>\n"
        )

    def write(self, path: str | Path) -> None:
        """Write the document whole or not at all.

        Raises:
            ReportError: If it cannot be written.
        """
        write_file(path, self.html().encode("utf-8", "backslashreplace"), HTML, "the report")


def escape(text: str) -> str:
    """Return text as HTML, without characters that reorder or hide what is shown."""
    return escaped(shown_lines(text))


def _prose(text: str) -> str:
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))


def _row(tag: str, cells: Sequence[str], left: Sequence[bool], kind: str = "") -> str:
    inner = "".join(
        f"<{tag}{LEFT if side else ''}>{escape(cell)}</{tag}>"
        for cell, side in zip(cells, left, strict=True)
    )
    return f"<tr{kind}>{inner}</tr>"
