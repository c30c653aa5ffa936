"""No table loses a character at any width of the terminal."""

from __future__ import annotations

import ast
import io
from pathlib import Path

import hypothesis.strategies as st
import pytest
from hypothesis import given
from rich.console import Console

from places import LIBRARY, ROOT
from robot_energy_cli.main import main
from robot_energy_papers.wall import Wall
from robot_energy_report.document import Document
from robot_energy_report.printing import fitted_table, print_document
from terminal_tables import WIDTHS, lost, recorded_tables

BAG = str(ROOT / "bags/kr16_cold")
ROBOTS = ["--model", "mantis", "--base=-1.2,-0.2,0", "--model", "testbed", "--base=0,0,0",
          "--model", "irb4600", "--base=-1,0.15,0"]  # fmt: skip
WORD = st.text("0123456789.-+abc[]%/é宽", min_size=1, max_size=30)
CELL = st.lists(WORD, max_size=6).map(" ".join)

COMMANDS = {
    "replay": ["replay", BAG, "--model", "kr16"],
    "compare": ["replay", BAG, "--model", "kr16", "--compare", "22"],
    "shaft": ["replay", BAG, "--model", "kr16", "--effort", "motor_torque"],
    "model": ["model", "check", "kr16"],
    "bag": ["info", BAG],
    "cabinet": ["identify", "cabinet", BAG, "--model", "kr16"],
}


def text(columns: list[str], rows: list[list[str]], width: int) -> list[str]:
    stream = io.StringIO()
    Console(file=stream, width=width).print(fitted_table(columns, rows, width), crop=False)
    return stream.getvalue().splitlines()


@pytest.mark.parametrize("name", [*COMMANDS, "predict"])
def test_the_tables_of_a_command_are_whole_at_every_width(name: str, tmp_path: Path) -> None:
    words = COMMANDS.get(name)
    if words is None:  # three robots make one part
        (tmp_path / "wall.gcode").write_text(Wall(length=0.1, width=0.1).gcode())
        words = ["predict", str(tmp_path / "wall.gcode"), *ROBOTS, "--temperature", "40"]
    with recorded_tables() as tables:
        assert main(words) == 0
    assert tables
    for columns, rows, total in tables:
        for width in WIDTHS:
            assert not lost(columns, rows, total, width), (columns, width)


@given(st.data(), st.integers(1, 10), st.integers(0, 4), st.integers(20, 200), st.booleans())
def test_any_table_is_whole_at_any_width(
    data: st.DataObject, wide: int, high: int, width: int, summed: bool
) -> None:
    row = st.lists(CELL, min_size=wide, max_size=wide)
    columns, rows = data.draw(row), [data.draw(row) for _ in range(high)]
    assert not lost(columns, rows, data.draw(row) if summed else None, width)


def test_a_table_that_is_too_wide_is_set_in_even_blocks_that_begin_alike() -> None:
    columns = ["joint", *(f"column_{number}" for number in range(6))]
    rows = [["joint_1", *["123.456"] * 6]]
    lines = text(columns, rows, 50)
    assert max(map(len, lines)) <= 50
    assert sum(line.split()[:1] == ["joint_1"] for line in lines) == 2
    assert [len(line.split()) for line in lines if "joint_1" in line] == [4, 4]


def test_prose_wraps_between_words_and_figures_never() -> None:
    note = "a sentence that is much longer than the terminal is wide, and goes on"
    lines = text(["joint", "value", "note"], [["joint_1", "12.345", note]], 60)
    assert max(map(len, lines)) <= 60
    assert " ".join(lines).split().count("12.345") == 1


def test_what_fits_in_no_way_keeps_its_width() -> None:
    lines = text(["a_long_heading", "12345678901"], [["0.1", "0.2"]], 20)
    assert any("a_long_heading  12345678901" in line for line in lines)


def test_pairs_wrap_between_words() -> None:
    stream = io.StringIO()
    path = "/a/path/without/any/space/in/it/that/is/longer/than/the/terminal"
    page = Document()
    page.pairs([("model file", path), ("notes", "one two " * 10)])
    print_document(page, Console(file=stream, width=30))
    assert path in stream.getvalue().splitlines()[0]
    assert stream.getvalue().split().count("two") == 10


def test_only_printing_makes_tables_for_a_terminal() -> None:
    """One that rich lays out by itself is cropped, or folded within figures."""
    packages = (*LIBRARY, ROOT / "ros2_energy_monitor/ros2_energy_monitor")
    files = [path for package in packages for path in package.rglob("*.py")]
    found = {
        path.name
        for path in files
        if "rich" in (text := path.read_text())  # others take most of the time
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.ImportFrom) and node.module == "rich.table"
    }
    assert found == {"printing.py"}
