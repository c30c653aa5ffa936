"""Drive losses identified from real drives: a UR3e, a motor on a bench, a cobot."""

import json
import os
from pathlib import Path

import pytest
from left_out import ur3e, width_ratio, xarm_friction, yu_cobot

from places import ROOT
from robot_energy.model import load
from robot_energy_cli.main import main

DATA = os.environ.get("ROBOT_ENERGY_DATA", "")


@pytest.mark.skipif(not DATA, reason="skipped: no data folder (ROBOT_ENERGY_DATA)")
def test_a_real_ur3e_is_predicted_better_than_by_shaft_power_and_a_constant(tmp_path, capsys):
    """Measured on its 48 V bus, every recording predicted from the two others."""
    logs = sorted(map(str, (Path(DATA) / "rad_ur3e").glob("L*.csv")))
    out, report = tmp_path / "ur3e.yaml", tmp_path / "report.json"
    words = ["identify", "drives", *logs, "--ur-rtde", "--model", "ur3e"]
    assert main([*words, "--out", str(out), "--json", str(report)]) == 0
    ways = json.loads(report.read_text())["total"]["ways"]
    assert ways["identified"]["rms"] < 0.7 * ways["shaft"]["rms"] < 0.7 * ways["constant"]["rms"]
    assert abs(ways["identified"]["worst"]) < 0.03
    assert load(out).cabinet.loss_dc.tag == "identified"


@pytest.mark.skipif(not DATA, reason="skipped: no data folder (ROBOT_ENERGY_DATA)")
def test_bands_of_real_energies_hold_and_are_of_use():
    """Each recording left out of the fit; friction of the UR3e was never measured."""
    known = list(ur3e(Path(DATA) / "rad_ur3e"))
    assert len(known) == 3
    assert all(row.inside for row in known)
    assert 1.64 < width_ratio(known) < 4.0
    cobot = list(yu_cobot(Path(DATA) / "voraus" / "test.parquet"))
    assert sum(row.inside for row in cobot) >= 3


@pytest.mark.skipif(not DATA, reason="skipped: no data folder (ROBOT_ENERGY_DATA)")
def test_real_friction_at_a_temperature_left_out_lies_in_its_interval():
    rows = list(xarm_friction(Path(DATA) / "xarm6_j3" / "no_payload.csv.gz"))
    assert sum(row.inside for row in rows) >= 0.85 * len(rows) > 10.0
    assert max(row.half for row in rows) < 0.03


@pytest.mark.skipif(not DATA, reason="skipped: no data folder (ROBOT_ENERGY_DATA)")
def test_the_curves_of_a_real_motor_on_a_test_bench_are_predicted(tmp_path):
    """Each voltage predicted from the four others, without positions and times."""
    folder = Path(DATA) / "drive_efficiency" / "frc_motors" / "motors" / "dc" / "rev-neo"
    logs, report = sorted(map(str, folder.glob("measured/*.csv"))), tmp_path / "report.json"
    mapping = ROOT / "src" / "examples" / "mappings" / "rev_neo_bench.yaml"
    words = ["identify", "drives", "--log", *logs, "--mapping", str(mapping)]
    assert main([*words, "--json", str(report)]) == 0
    comparisons = json.loads(report.read_text())["drives"]["comparisons"]
    scores = next(c for c in comparisons if c["split"] == "recordings")["scores"]
    assert scores["losses"]["accuracy"] > 0.98
    assert scores["losses"]["rms"] < 0.3 * min(scores["none"]["rms"], scores["constant"]["rms"])


@pytest.mark.skipif(not DATA, reason="skipped: no data folder (ROBOT_ENERGY_DATA)")
def test_the_drives_of_a_real_cobot_are_predicted(tmp_path):
    """Every second of four predicted from the three others, each drive and their sum."""
    log, report = Path(DATA) / "voraus" / "test.parquet", tmp_path / "report.json"
    mapping = ROOT / "src" / "examples" / "mappings" / "voraus.yaml"
    words = ["identify", "drives", "--log", str(log), "--mapping", str(mapping)]
    assert main([*words, "--json", str(report)]) == 0
    found = json.loads(report.read_text())
    held = next(c for c in found["drives"]["comparisons"] if c["split"] == "recordings")
    rms = {way: score["rms"] for way, score in held["scores"].items()}
    assert rms["losses"] < 0.3 * min(rms["none"], rms["constant"], rms["map"])
    assert held["scores"]["losses"]["accuracy"] > 0.98
    ways = found["total"]["ways"]
    assert ways["identified"]["rms"] < 0.8 * ways["shaft"]["rms"] < 0.8 * ways["constant"]["rms"]
