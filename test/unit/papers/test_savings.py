"""The study of savings in its short form, and its counts."""

from __future__ import annotations

import json

import pytest

from robot_energy_cli.main import main
from robot_energy_studies.savings import _shares, exceeded_limits
from robot_energy_studies.savings_study import JudgedSaving


def judged(claim, half, truth):
    return JudgedSaving(1, 40.0, "slack", 1000.0, claim, half, truth, 0.0, 0.5)


def test_claims_signs_and_bands_are_counted():
    rows = [judged(50, 20, 60), judged(50, 20, -10), judged(5, 20, -10), judged(-30, 10, -35)]
    found = _shares(rows)
    assert (found["changes"], found["claimed"]) == (4, 2)
    assert found["sign_right"] == 0.5
    assert found["inside"] == 0.75
    assert found["inside_claimed"] == 0.5
    assert found["median_claim"] == 0.05


def test_no_random_program_leaves_its_limits():
    assert exceeded_limits(7, 4) == 0


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("savings") / "out"
    assert main(["reproduce", "savings", "--quick", "--out", str(folder)]) == 0
    return json.loads((folder / "figures.json").read_text()), folder


@pytest.mark.long
def test_the_short_form_writes_figures_and_a_page(found):
    figures, folder = found
    assert figures["by_measure"]["all"]["changes"] >= 4
    assert figures["limits"]["exceeded"] == 0
    control = figures["unchanged"]
    assert control["programs"] == 1
    assert max(control["predicted"], control["on_the_rig"]) < 1e-9
    assert "unchanged" not in figures["by_measure"]
    page = (folder / "report.html").read_text()
    assert "virtual rig" in page
    assert page.count("<img ") == 2


@pytest.mark.long
def test_waits_are_judged_alone(tmp_path):
    folder = tmp_path / "out"
    assert main(["reproduce", "savings", "--quick", "--waits", "--out", str(folder)]) == 0
    figures = json.loads((folder / "figures.json").read_text())
    assert figures["by_measure"]["slack"]["changes"] == 1
    # nothing else became slower: the cycle lasts as long, so what is saved was waiting
    assert all(abs(row["faster"]) < 1e-6 for row in figures["savings"])
    page = (folder / "report.html").read_text()
    assert "3 to 8 s" in page
    assert "--quick --waits" in page


@pytest.mark.long
def test_faster_is_cheaper_with_much_standby_and_a_cold_robot_wants_to_be_slower(found):
    best = {(row["standing"], row["degc"]): row["best"] for row in found[0]["curves"]}
    assert best[1.0, 70.0] > best[1.0, 10.0] > best[0.1, 10.0]
    assert best[1.0, 70.0] > best[0.1, 70.0] > best[0.1, 10.0]
