"""A document as one self-contained HTML file.

Everything lies in the file: style, figures and numbers; it opens without a network, on a
phone, and on paper.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from html import escape as escaped
from io import BytesIO
from pathlib import Path

from robot_energy.files.output_files import HTML, HTML_MARK, write_file
from robot_energy.report.document import HEADINGS, Document, Illustration, Part, Table, Text
from robot_energy.report.formats import typeset
from robot_energy.shown_text import shown_lines

LEFT = ' class="text"'
PROSE = 24  # characters from which a cell is read as a sentence
STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: #1a1a1a;
  max-width: 104rem; margin: 0 auto; padding: 1.5rem 1.5rem 4rem; background: #fff; }
main { display: flex; flex-wrap: wrap; align-items: flex-start; column-gap: 3rem; }
main > * { flex: 0 0 100%; box-sizing: border-box; }
main > p { max-width: none; padding-right: max(.8rem, calc(100% - 52rem)); }
main > figure { flex: 1 1 34rem; max-width: 60rem; min-width: 0; }
main > .wide { flex: 0 1 auto; min-width: 0; max-width: 100%; }
h1 { font-size: 1.7rem; line-height: 1.25; margin: 0 0 .2rem; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .6rem; padding-top: .8rem;
  border-top: 1px solid #dcdcdc; }
h3 { font-size: 1.05rem; margin: 1.8rem 0 .4rem; }
h4 { font-size: 1rem; margin: 1.2rem 0 .3rem; }
p { margin: .5rem 0; max-width: 48rem; }
p.lead { color: #555; }
p.strong { font-weight: 600; font-size: 1.05rem; }
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
figure img { width: 100%; height: auto; }
figcaption { font-size: .9rem; color: #444; max-width: 48rem; }
code { font-family: ui-monospace, "DejaVu Sans Mono", monospace; font-size: .9em; }
pre { background: #f5f5f5; padding: .6rem .8rem; white-space: pre-wrap;
  overflow-wrap: anywhere; font-size: .88rem; }
@media print { h2 { break-after: avoid; } figure, tr { break-inside: avoid; }
  body { max-width: none; } main { display: block; } }
"""


def write_page(document: Document, path: str | Path) -> None:
    """Write a page whole or not at all.

    Args:
        document: What it says.
        path: File to write.

    Raises:
        ReportError: If it cannot be written, or a figure cannot be drawn.
    """
    write_file(path, page_html(document).encode("utf-8", "backslashreplace"), HTML, "the report")


def page_html(document: Document) -> str:
    """Return the whole page.

    Args:
        document: What it says.
    """
    parts = document.shown("page")
    anchors = {
        place: f"{place}-{re.sub(r'[^a-z0-9]+', '-', part.text.lower()).strip('-')}"
        for place, part in enumerate(parts)
        if isinstance(part, Text) and part.kind == "h2"
    }
    sections = [
        f'<li><a href="#{anchor}">{_escape(str(getattr(parts[place], "text", "")))}</a></li>'
        for place, anchor in anchors.items()
    ]
    contents = f"<nav><ol>{''.join(sections)}</ol></nav>" if len(sections) > 2 else ""
    lead = f'<p class="lead">{_prose(document.lead)}</p>' if document.lead else ""
    body = "\n".join(_part(part, anchors.get(place, "")) for place, part in enumerate(parts))
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f"{HTML_MARK}"
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{_escape(document.title)}</title><style>{STYLE}</style></head><body>\n"
        f"<h1>{_escape(document.title)}</h1>\n{lead}\n{contents}\n<main>\n{body}\n</main></body></html>\n"
    )


def _part(part: Part, anchor: str) -> str:
    match part:
        case Table():
            return _table(part)
        case Illustration():
            return _figure(part)
        case Text("", _):
            return ""
        case Text(text, "command"):
            return f"<pre><code>{_literal(text)}</code></pre>"
        case Text(text, kind) if kind in HEADINGS.values():
            place = f' id="{anchor}"' if anchor else ""
            return f"<{kind}{place}>{_escape(text)}</{kind}>"
        case Text(text, kind):
            style = {"plain": "", "strong": ' class="strong"'}.get(kind, ' class="note"')
            before = "problem: " if kind == "problem" else ""
            return f"<p{style}>{_prose(before + text)}</p>"


def _table(table: Table) -> str:
    body = [*table.rows, *([table.total] if table.total is not None else [])]
    columns = table.columns or ("", "")
    left = [
        index == 0 or any(len(row[index]) > PROSE for row in body) for index in range(len(columns))
    ]
    lines = [
        _row("th", columns, left),
        *(_row("td", row, left) for row in table.rows),
        *([] if table.total is None else [_row("td", table.total, left, ' class="total"')]),
    ]
    caption = f"<caption>{_escape(table.title)}</caption>" if table.title else ""
    return f'<div class="wide"><table>{caption}{"".join(lines)}</table></div>'


def _row(tag: str, cells: Sequence[str], left: Sequence[bool], kind: str = "") -> str:
    inner = "".join(
        f"<{tag}{LEFT if side else ''}>{_escape(cell)}</{tag}>"
        for cell, side in zip(cells, left, strict=True)
    )
    return f"<tr{kind}>{inner}</tr>"


def _figure(figure: Illustration) -> str:
    picture = BytesIO()
    figure.draw(picture)
    data = base64.b64encode(picture.getvalue()).decode("ascii")
    return (
        f'<figure><img src="data:image/svg+xml;base64,{data}" alt="{_escape(figure.caption)}">'
        f"<figcaption>{_prose(figure.caption)}</figcaption></figure>"
    )


def _literal(text: str) -> str:
    """Return text as HTML, without characters that reorder or hide what is shown."""
    return escaped(shown_lines(text))


def _escape(text: str) -> str:
    """The same with true signs and units."""
    return escaped(typeset(shown_lines(text)))


def _prose(text: str) -> str:
    """The same; what stands between backticks is code, and stays as it is."""
    parts = re.split(r"`([^`]+)`", text)
    return "".join(
        f"<code>{_literal(part)}</code>" if number % 2 else _escape(part)
        for number, part in enumerate(parts)
    )
