"""`robot-energy report`: one page of one or several bags, or of JSON."""

import json
import re

import pytest

from logbook import wheel_bag, wheel_model
from pages import read
from places import ROOT
from robot_energy.cli import main

BAG, WARM = str(ROOT / "bags/kr16_cold"), str(ROOT / "bags/kr16_warm")
MOVES = str(ROOT / "src/examples/programs/kr16_pick_and_place.yaml")
SECTIONS = [
    "Where the energy went", "Predicted against measured", "How sure", "Joints",
    "Temperatures and friction", "Phases", "Data quality",
]  # fmt: skip


def page_of(folder, *words):
    path = folder / "page.html"
    assert main(["report", *words, "--out", str(path)]) == 0
    return path.read_text(encoding="utf-8")


def headings(page, depth):
    return re.findall(rf"<h{depth}[^>]*>([^<]*)", page)


def test_a_page_of_a_bag_holds_all_sections_figures_and_numbers(tmp_path, capsys):
    page = page_of(tmp_path, BAG, "--model", "kr16", "--effort", "motor_torque")
    assert headings(page, 2) == SECTIONS
    assert page.count("<figure>") == 3  # parts of the energy, power over time, temperatures
    assert not re.findall(r'(?:src|href)="(?!data:|#)', page)
    assert "robot-energy report" in page
    assert main(["replay", BAG, "--model", "kr16", "--json", str(tmp_path / "x.json")]) == 0
    energy = json.loads((tmp_path / "x.json").read_text())["energy"]
    cells = read(page).cells
    for part in ("friction", "loss_grid", "brake", "grid_import"):
        assert f"{energy[part] / 1e3:.2f}" in cells
    assert "Shaft energy, measured by motor torque" in page


def test_several_bags_stand_side_by_side_first(tmp_path, capsys):
    page = page_of(tmp_path, BAG, WARM, "--model", "kr16", "--fixed-friction", "40")
    assert headings(page, 2) == ["Side by side", "kr16_cold", "kr16_warm"]
    assert headings(page, 3) == [*SECTIONS, *SECTIONS]
    assert "friction fixed at 40 °C" in page


def test_a_page_of_json_says_the_same_without_curves(tmp_path, capsys):
    words = ("replay", BAG, "--model", "kr16", "--compare", "60")
    assert main([*words, "--json", str(tmp_path / "x.json")]) == 0
    page = page_of(tmp_path, str(tmp_path / "x.json"))
    assert headings(page, 2) == SECTIONS
    assert page.count("<figure>") == 2  # the pieces, and both models next to each other
    plain = page_of(tmp_path, BAG, "--model", "kr16")
    own = set(read(page).cells)
    assert {cell for cell in read(plain).cells if cell.startswith("joint_")} <= own
    assert any("fixed at 60 °C" in cell for cell in own)


def test_a_page_of_predictions_in_json(tmp_path, capsys):
    words = ("predict", MOVES, "--model", "kr16", "--temperature", "20", "--temperature", "60")
    assert main([*words, "--json", str(tmp_path / "x.json")]) == 0
    page = page_of(tmp_path, str(tmp_path / "x.json"))
    assert headings(page, 2)[0] == "Side by side"
    assert page.count("<figure>") == 1


def test_a_bag_without_meter_and_temperatures(tmp_path, capsys):
    bag, model = wheel_bag(tmp_path, power=None), wheel_model(tmp_path)
    page = page_of(tmp_path, str(bag), "--model", str(model))
    assert headings(page, 2) == SECTIONS
    assert page.count("<figure>") == 3


@pytest.mark.parametrize("words", [[BAG], [BAG, "--model", "none"], ["none", "--model", "kr16"]])
def test_what_cannot_be_reported_is_refused_in_one_sentence(words, tmp_path, capsys):
    path = tmp_path / "page.html"
    assert main(["report", *words, "--out", str(path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not path.exists()


def test_a_damaged_bag_is_reported_with_its_problem(tmp_path, capsys):
    wheel_bag(tmp_path, seconds=200.0)
    file = next((tmp_path / "bag").glob("*.mcap"))
    data = file.read_bytes()
    file.write_bytes(data[: len(data) * 2 // 3])
    words = [str(tmp_path / "bag"), "--model", str(wheel_model(tmp_path))]
    assert main(["report", *words, "--out", str(tmp_path / "page.html")]) == 3
    assert "problem: " in (tmp_path / "page.html").read_text()
