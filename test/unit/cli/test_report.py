"""`robot-energy report`: one page of one or several bags, or of JSON."""

import json
import re
import shutil
from base64 import b64decode
from html import unescape
from pathlib import Path

import pytest

from logbook import wheel_bag, wheel_model
from pages import read
from places import ROOT
from robot_energy_cli import main

BAG, WARM = str(ROOT / "bags/kr16_cold"), str(ROOT / "bags/kr16_warm")
MOVES = str(ROOT / "src/examples/programs/kr16_pick_and_place.yaml")
SECTIONS = [
    "Where the energy went", "Predicted against measured", "How sure", "Joints",
    "Temperatures and friction", "Phases", "Conditions, cycles and states", "Data quality",
    "Model and provenance", "Terms",
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
    assert page.count("<figure>") == 2  # power over time, temperatures
    assert page.count("data-flow=") == 1
    assert not re.findall(r'(?:src|href)="(?!data:|#)', page)
    assert "robot-energy report" in page
    assert main(["replay", BAG, "--model", "kr16", "--json", str(tmp_path / "x.json")]) == 0
    energy = json.loads((tmp_path / "x.json").read_text())["energy"]
    cells = read(page).cells
    for part in ("friction", "loss_grid", "brake", "grid_import"):
        assert f"{energy[part] / 1e3:.2f}" in cells
    assert "Shaft energy, measured by motor torque" in page


def test_several_bags_come_in_order_of_time_with_totals_and_trend(tmp_path, capsys):
    page = page_of(tmp_path, WARM, BAG, "--model", "kr16", "--fixed-friction", "40")
    # Both began at the same instant of the virtual clock: the order given stays.
    assert headings(page, 2) == [
        "Where the energy went", "Recordings in order of time", "1. kr16_warm", "2. kr16_cold",
        "Terms",
    ]  # fmt: skip
    assert headings(page, 3) == 2 * SECTIONS[:-1]
    assert "friction fixed at 40 °C" in page
    assert page.count("data-flow=") == 3  # the sum, and each


def test_recordings_are_sorted_summed_and_named_by_robot(tmp_path, capsys):
    shown = tmp_path / "x.json"
    assert main(["replay", BAG, "--model", "kr16", "--json", str(shown)]) == 0
    later = json.loads(shown.read_text())
    first = json.loads(shown.read_text())
    later["time"]["start_ns"] += 86_400 * 10**9
    later["bag"], first["bag"] = "monday/b", "sunday/a"
    other = json.loads(shown.read_text())
    other["model"]["robot"], other["model"]["serial"] = "UR5e", "S 7"
    other["comparison"] |= {"measured_energy": None, "predicted_energy_at_meter": None}
    names = [str(tmp_path / name) for name in ("later.json", "other.json", "first.json")]
    for name, values in zip(names, (later, other, first), strict=True):
        Path(name).write_text(json.dumps(values))
    page = page_of(tmp_path, *names)
    assert [one for one in headings(page, 2) if one[0].isdigit()] == [
        "1. kr16_cold", "2. a", "3. b",
    ]  # fmt: skip
    assert "UR5e S 7, model " in page
    energy, compared = first["energy"], first["comparison"]
    net = energy["grid_import"] - energy["grid_return"]
    cells = read(page).cells
    assert f"{2 * net / 1e3:.2f}" in cells  # of the two of one robot
    assert f"{2 * compared['measured_energy'] / 1e3:.2f}" in cells
    assert "1 recording without a measured energy" in page
    # The flows add up to the digit that is shown.
    for text in re.findall(r'data-flow="([^"]*)"', page):
        picture = json.loads(unescape(text))
        into = sum(units for _, to, units in picture["flows"] if to == "bus")
        out = sum(units for source, _, units in picture["flows"] if source == "bus")
        assert into == out
        assert picture["net"] * picture["unit"] == pytest.approx(
            net / 1e3 * round(picture["net"] * picture["unit"] * 1e3 / net), rel=1e-3
        )


def test_a_recording_given_twice_counts_once_and_is_named(tmp_path, capsys):
    copy = shutil.copytree(WARM, tmp_path / "copy")
    page = page_of(tmp_path, WARM, BAG, WARM, str(copy), "--model", "kr16")
    assert len([one for one in headings(page, 2) if one[0].isdigit()]) == 2
    said = unescape(page)
    assert f"{WARM} was given twice: it counts once" in said
    assert f"{copy} is the same recording as {WARM}: they count once" in said
    # both began at the same instant of the virtual clock
    assert f"{BAG}, {WARM} overlap in time, by 36.0 s in all" in said
    twice = page_of(tmp_path, WARM, WARM, "--model", "kr16")
    assert headings(twice, 2) == SECTIONS
    assert "it counts once" in twice


def test_prices_and_emissions_are_on_the_first_page(tmp_path, capsys):
    settings = tmp_path / "page.yaml"
    settings.write_text("price_per_kwh: 0.5\nco2_kg_per_kwh: 0.4\n")
    page = page_of(tmp_path, BAG, "--model", "kr16", "--page-settings", str(settings))
    assert main(["replay", BAG, "--model", "kr16", "--json", str(tmp_path / "x.json")]) == 0
    kwh = json.loads((tmp_path / "x.json").read_text())["energy"]["grid_import"] / 3.6e6
    assert f'<p class="big">{kwh * 0.5:.4f} <small>EUR</small>' in page
    assert f'<p class="big">{kwh * 400:.1f} <small>g</small>' in page


def test_a_page_of_json_says_the_same_without_curves(tmp_path, capsys):
    words = ("replay", BAG, "--model", "kr16", "--compare", "60")
    assert main([*words, "--json", str(tmp_path / "x.json")]) == 0
    page = page_of(tmp_path, str(tmp_path / "x.json"))
    assert headings(page, 2) == SECTIONS
    assert page.count("<figure>") == 1  # both models next to each other
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
    assert page.count("<figure>") == 2


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


def test_a_doubtful_figure_is_a_problem_on_the_page_but_no_damage(tmp_path, monkeypatch):
    monkeypatch.setattr("robot_energy.results.replay.unbalanced", lambda account: ["in doubt"])
    page = page_of(tmp_path, BAG, "--model", "kr16", "--effort", "motor_torque")
    assert "problem: in doubt" in page


def test_a_pdf_needs_a_browser_and_says_so_before_the_work(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PATH", str(tmp_path))
    path = tmp_path / "page.pdf"
    for words in (["report", BAG, "--out"], ["replay", BAG, "--report"]):
        assert main([*words, str(path), "--model", "kr16"]) == 2
        said = capsys.readouterr()
        assert "chromium" in said.err
        assert ".html" in said.err
        assert not said.out
    assert list(tmp_path.iterdir()) == []


def test_replay_writes_a_report_that_holds_all_and_says_so(tmp_path, capsys):
    page, out = tmp_path / "page.html", tmp_path / "out"
    words = ["replay", wheel_bag(tmp_path), "--model", wheel_model(tmp_path), "--compare",
             "--report", page, "--out", out, "--json", tmp_path / "r.json"]  # fmt: skip
    assert main([str(word) for word in words]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[-3:] == [
        f"wrote {out}: bag",
        f"wrote {tmp_path / 'r.json'}: all figures as JSON",
        f"wrote {page}: report",
    ]
    text = page.read_text()
    read(text)  # whole, and nothing is loaded from elsewhere
    before = text[text.index("<main") : text.index("data-flow=")]
    assert before.count("<h2") == 1  # the flow comes first
    assert text.count("<figure>") >= 3


def test_jobs_are_listed_summed_and_part_of_the_trend(tmp_path, capsys):
    jobs = tmp_path / "jobs.yaml"
    jobs.write_text(
        "jobs: [{name: part A, begin: 1000000001, end: 1000000010}, "
        "{name: part A, begin: 1000000010, end: 1000000019}]"
    )
    words = ["replay", BAG, "--model", "kr16", "--jobs", str(jobs)]
    assert main([*words, "--json", str(tmp_path / "x.json")]) == 0
    assert "part A" in capsys.readouterr().out
    energies = [job["energy"] for job in json.loads((tmp_path / "x.json").read_text())["jobs"]]
    assert len(energies) == 2
    page = page_of(tmp_path, BAG, WARM, "--model", "kr16", "--jobs", str(jobs))
    cells = read(page).cells
    for energy in (*energies, sum(energies) / 2):
        assert f"{energy / 1e3:.2f}" in cells
    assert "mean of 4 of 'part A'" in unescape(page)
    assert "energy per job" in b64decode(re.findall('base64,([^"]+)" alt="Trend', page)[0]).decode()
