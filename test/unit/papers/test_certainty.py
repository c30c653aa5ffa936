"""The study of the tool's own certainty in its short form."""

from __future__ import annotations

import json

import numpy as np
import pytest

from robot_energy_cli.main import main
from robot_energy_studies import certainty, interval_coverage, savings
from robot_energy_studies.certainty import NOMINAL, reliability_of
from robot_energy_studies.interval_coverage import Judged


def test_reliability_of_figures_whose_errors_are_normal():
    random = np.random.default_rng(1)
    right = [Judged("Coulomb", str(k), 0.0, float(e), 1.0) for k, e in
             enumerate(random.standard_normal(4000))]  # fmt: skip
    narrow = [Judged("copper", f.name, 0.0, 2.0 * f.value, 1.0) for f in right]
    curves = reliability_of([right, narrow])
    nominal, observed = curves["Coulomb"]
    assert nominal is NOMINAL
    assert np.abs(observed - nominal).max() < 0.03
    assert curves["copper"][1][-1] < 0.85  # stated 99 %


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("certainty") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(certainty, "FRESH", savings.FRESH)  # the same plant: identified once
        patch.setattr(interval_coverage, "SECONDS", 15.0)
        patch.setattr(interval_coverage, "RATE", 100.0)
        patch.setattr(interval_coverage, "DEGC", (25.0, 45.0, 65.0))
        assert main(["reproduce", "certainty", "--quick", "--out", str(folder)]) == 0
    return json.loads((folder / "figures.json").read_text()), folder


@pytest.mark.long
def test_every_claim_is_counted(found):
    figures, folder = found
    groups = {row["group"]: row for row in figures["intervals"]}
    assert {"bodies", "Coulomb", "viscous"} <= groups.keys()
    assert groups["Coulomb"]["share"] > 0.6  # six figures or so
    assert figures["bands"]["energy, without"] >= 0.5
    assert 0.5 < figures["bands"]["power, with meter"] <= 1.0
    page = (folder / "report.html").read_text()
    assert "virtual rig" in page
    assert page.count("<img ") == 1


@pytest.mark.long
def test_learned_figures_beat_mistaken_ones(found):
    for row in found[0]["learning"]:
        assert abs(row["error_with"][-1]) < abs(row["error_without"][-1])
