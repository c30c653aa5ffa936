"""The HTML document: one file, nothing loaded from elsewhere, nothing lost or misread."""

from __future__ import annotations

import base64
import re
from io import BytesIO
from pathlib import Path

import pytest

from pages import read
from robot_energy.foundation.errors import ReportError
from robot_energy_report.canvas import COLOURS, PART_COLOURS, canvas
from robot_energy_report.document import Column, Document
from robot_energy_report.html import page_html, write_page
from robot_energy_report.page.saved_page import static_file


@pytest.mark.parametrize(("reasons", "shown"), [(("", None), False), (("", "at its bound"), True)])
def test_an_optional_column_is_shown_where_one_row_has_something(reasons, shown) -> None:
    document = Document()
    columns = [Column("joint", lambda row: "a1"), Column("reason", lambda row: row, optional=True)]
    document.rows("figures", columns, reasons)
    assert ("reason" in read(page_html(document)).cells) is shown


def test_a_table_without_rows_is_left_out() -> None:
    page = Document("Nothing")
    page.rows("none", [Column("a", "a"), Column("b", "b", total=max)], [], "all")
    page.table("none", ("a",), [])
    assert page.parts == []


def test_what_is_written_for_a_terminal_is_read_from_the_page() -> None:
    document = Document("A title", "what it is")
    document.table("watts", ("joint", "P [W]"), [("a<1>", "1.5")], ("total", "1.5"))
    document.pairs([("name", "a & b")])
    document.note("`x` is not known")
    document.paragraph("a plain line")
    reader = read(page_html(document))
    assert reader.cells == [
        "joint",
        "P [W]",
        "a<1>",
        "1.5",
        "total",
        "1.5",
        "name",
        "a & b",
    ]
    assert reader.notes == 1
    assert "<code>x</code> is not known" in page_html(document)
    assert 'class="total"' in page_html(document)


def test_a_figure_is_drawn_once_and_looks_as_matplotlib_alone_lays_it_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from matplotlib.lines import Line2D

    drawn: list[object] = []
    draw = Line2D.draw
    monkeypatch.setattr(Line2D, "draw", lambda line, to: (drawn.append(line), draw(line, to)))

    def picture() -> tuple[bytes, int]:
        drawn.clear()
        file = BytesIO()
        with canvas(file, (3.0, 2.0), "a title") as figure:
            axes = figure.subplots(2, 1, sharex=True)
            (line,) = axes[0].plot([0, 1], [0, 1e-5], label="a line")
            axes[0].legend()
            axes[1].set_ylabel("a long label of an axis")
        return file.getvalue(), drawn.count(line)

    ours, once = picture()
    monkeypatch.setattr("robot_energy_report.canvas._draw_once", lambda figure: None)
    theirs, _ = picture()
    assert once == 1
    assert ours == theirs


def test_a_figure_lies_in_the_file(tmp_path: Path) -> None:
    document = Document("A title")

    def draw(path: Path) -> None:
        with canvas(path, (3.0, 2.0), "drawn") as figure:
            figure.subplots().plot([0, 1], [0, 1])

    document.figure(draw, 'a "line"')
    write_page(document, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    found = re.search(r'src="data:image/svg\+xml;base64,([^"]+)" alt="a &quot;line&quot;"', page)
    assert found is not None
    assert b"</svg>" in base64.b64decode(found[1])
    assert re.findall(r'(?:src|href)="(?!data:|#)', page) == []
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


def test_sections_are_listed_and_reached() -> None:
    document = Document("A title")
    for name in ("One", "Two", "Two", "Three & four"):
        document.heading(name)
        document.heading("inner", 3)
    page = page_html(document)
    targets = re.findall(r'href="#([^"]+)"', page)
    assert len(targets) == len(set(targets)) == 4
    assert all(f'id="{target}"' in page for target in targets)


def test_bad_requests_are_refused(tmp_path: Path) -> None:
    document = Document("A title")
    with pytest.raises(ReportError, match="has 1 cells"):
        document.table("t", ("a", "b"), [("1",)])
    with pytest.raises(ReportError, match="depth 1"):
        document.heading("x", 1)
    with pytest.raises(ReportError, match="cannot be written"):
        write_page(document, tmp_path / "none" / "page.html")
    assert list(tmp_path.iterdir()) == []


def test_figures_have_the_colours_of_the_page() -> None:
    light = static_file("/page.css").content.decode().partition("}")[0]
    colours = {name: COLOURS[name] for name in ("predicted", "measured")} | PART_COLOURS
    assert {name: re.search(rf"--{name}: (#\w+);", light)[1] for name in colours} == colours
