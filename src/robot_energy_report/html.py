"""A document as one self-contained HTML file, or printed from it as PDF.

Everything lies in the file: look, figures and numbers; it opens without a network, on a phone,
and on paper. Look and energy flow are those of the live page.
"""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Sequence
from html import escape as escaped
from io import BytesIO
from pathlib import Path

from robot_energy.foundation.files.output_files import HTML, HTML_MARK, PDF, write_file
from robot_energy.foundation.shown_text import shown_lines
from robot_energy_report.document import (
    HEADINGS,
    Document,
    FlowDiagram,
    Illustration,
    Part,
    Table,
    Text,
    Tiles,
)
from robot_energy_report.formats import PROSE, number, percent, typeset
from robot_energy_report.page.energy_flow import GRID
from robot_energy_report.page.headless_browser import printed
from robot_energy_report.page.json_numbers import json_text
from robot_energy_report.page.saved_page import TERMS, inline_parts, terms_in

NUMBER = ' class="n"'
MARK = (
    '<svg class="mark" viewBox="0 0 32 32" aria-hidden="true">'
    '<path d="M18 3 7 18h8l-1 11 11-15h-8z"/></svg>'
)
THEME = '<button id="theme" type="button" aria-label="Colours: as the system">Auto</button>'


def write_page(document: Document, path: str | Path) -> None:
    """Write a page whole or not at all; a name that ends in .pdf makes a PDF."""
    html = page_html(document).encode("utf-8", "backslashreplace")
    if Path(path).suffix.lower() == ".pdf":
        write_file(path, printed(html), PDF, "the report")
    else:
        write_file(path, html, HTML, "the report")


def page_html(document: Document) -> str:
    """Return the whole page."""
    sections: list[list[Part]] = [[]]
    for part in document.shown("page"):
        if isinstance(part, Text) and part.kind == "h2":
            sections.append([])
        sections[-1].append(part)
    named = {_anchor(place, parts): parts for place, parts in enumerate(sections) if parts}
    links = [
        f'<li><a href="#{anchor}">{_escape(str(getattr(parts[0], "text", "")))}</a></li>'
        for anchor, parts in named.items()
        if anchor
    ]
    contents = ""
    if len(links) > 2:
        contents = f'<nav class="card" aria-label="Contents"><ol>{"".join(links)}</ol></nav>'
    lead = f'<p class="small">{_prose(document.lead)}</p>' if document.lead else ""
    cards = "".join(_card(anchor, parts) for anchor, parts in named.items())
    title, (head, script) = _escape(document.title), inline_parts()
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f"{HTML_MARK}"
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        f"<title>{title}</title>{head}</head><body>\n"
        f'<header><h1>{MARK}{title}</h1><nav aria-label="Page">{THEME}</nav></header>\n'
        f'<main class="report">\n{lead}{contents}\n{cards}{_terms(terms_in(cards))}</main>\n'
        f"{script}</body></html>\n"
    )


def parts_html(parts: Sequence[Part]) -> str:
    """Return parts of a document as HTML to stand in another page."""
    return f"<div>{''.join(map(_part, parts))}</div>"


def _anchor(place: int, parts: Sequence[Part]) -> str:
    """Target of a link to a section; empty for what stands before the first heading."""
    text = parts[0].text if place and isinstance(parts[0], Text) else ""
    return f"{place}-{re.sub(r'[^a-z0-9]+', '-', text.lower()).strip('-')}" if place else ""


def _card(anchor: str, parts: Sequence[Part]) -> str:
    place = f' id="{anchor}"' if anchor else ""
    first = any(isinstance(part, FlowDiagram) for part in parts)
    inner = "\n".join(filter(None, map(_part, parts)))
    return f'<section class="card{" first" if first else ""}"{place}>\n{inner}\n</section>\n'


def _terms(terms: Sequence[str]) -> str:
    if not terms:
        return ""
    table = _table(Table("", (), [(term, TERMS[term]) for term in terms]))
    return f'<section class="card" id="terms">\n<h2>Terms</h2>\n{table}\n</section>\n'


def _part(part: Part) -> str:
    match part:
        case Table():
            return _table(part)
        case Illustration():
            return _figure(part)
        case Tiles(tiles):
            return f'<div class="tiles">{"".join(_tile(*tile) for tile in tiles)}</div>'
        case FlowDiagram():
            return _flow(part)
        case Text("", _):
            return ""
        case Text(text, "command"):
            return f"<pre><code>{_literal(text)}</code></pre>"
        case Text(text, kind) if kind in HEADINGS.values():
            return f"<{kind}>{_escape(text)}</{kind}>"
        case Text(text, kind):
            style = {"plain": "", "strong": ' class="strong"'}.get(kind, ' class="note"')
            before = "problem: " if kind == "problem" else ""
            return f"<p{style}>{_prose(before + text)}</p>"


def _tile(name: str, value: str, note: str) -> str:
    size, _, unit = value.partition(" ")
    shown_unit = f" <small>{_escape(unit)}</small>" if unit else ""
    return (
        f'<div class="tile"><p class="name">{_escape(name)}</p>'
        f'<p class="big">{_escape(size)}{shown_unit}</p>'
        f'<p class="small">{_escape(note)}</p></div>'
    )


def _flow(diagram: FlowDiagram) -> str:
    """The picture, drawn by the script of the live page, and the same as a table."""
    picture = diagram.picture
    digits = max(0, round(-math.log10(picture.unit / diagram.factor)))
    drawn = sum(flow.units for flow in picture.flows if flow.source == GRID)
    rows = [
        (
            picture.labels[flow.source],
            picture.labels[flow.target],
            number(flow.units * picture.unit / diagram.factor, digits),
            percent(flow.units / drawn if drawn else None),
        )
        for flow in picture.flows
    ]
    data = escaped(json_text({**picture.plain(diagram.factor), "energy": diagram.unit}))
    table = _table(Table("", ("from", "to", diagram.unit, "share"), rows))
    return (
        f'<figure class="flow"><div class="figure" data-flow="{data}"></div>'
        f"<figcaption>{_prose(diagram.caption)}</figcaption>"
        f"<details><summary>As a table</summary>{table}</details></figure>"
    )


def _table(table: Table) -> str:
    body = [*table.rows, *([table.total] if table.total is not None else [])]
    columns = table.columns or ("", "")
    left = [
        index == 0 or any(len(row[index]) > PROSE for row in body) for index in range(len(columns))
    ]
    caption = f"<caption>{_escape(table.title)}</caption>" if table.title else ""
    head = f"<thead>{_row(columns, left, head=True)}</thead>" if table.columns else ""
    lines = [
        *(_row(row, left) for row in table.rows),
        *([] if table.total is None else [_row(table.total, left, ' class="total"')]),
    ]
    name = _escape(table.title or "Table")
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{name}">'
        f"<table>{caption}{head}<tbody>{''.join(lines)}</tbody></table></div>"
    )


def _row(cells: Sequence[str], left: Sequence[bool], kind: str = "", head: bool = False) -> str:
    """A row; the first cell of each is its header, and an empty one is not a header."""
    inner: list[str] = []
    for place, (cell, side) in enumerate(zip(cells, left, strict=True)):
        tag = "th" if cell and (head or place == 0) else "td"
        scope = f' scope="{"col" if head else "row"}"' if tag == "th" else ""
        inner.append(f"<{tag}{scope}{'' if side else NUMBER}>{_escape(cell)}</{tag}>")
    return f"<tr{kind}>{''.join(inner)}</tr>"


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
