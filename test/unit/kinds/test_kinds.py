"""A drive model and a meter of a user, one file each: everything knows them."""

import os
import subprocess
import sys

import pytest
import yaml

from places import ROOT
from robot_energy.bag import BagReader
from robot_energy.foundation import kinds
from robot_energy.foundation.errors import KindError, ParameterError
from robot_energy.foundation.kinds import Kind, Kinds
from robot_energy.inputs.bag_topics import find_meter
from robot_energy.inputs.meter.source import MeterSource
from robot_energy.inputs.sources import Inputs, TemperatureSource
from robot_energy.model import load, shipped_models, validate
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.model.joint import Joint
from robot_energy.replay.bag_replay import Replay, replay
from robot_energy.replay.setup import ReplaySetup
from robot_energy.results.replay import replay_report
from robot_energy_cli.kinds import kinds_listing
from robot_energy_cli.main import main
from robot_energy_report.identify_all import changes
from robots import figure
from toy_kinds import (
    EFFICIENCY,
    INT32,
    SECOND,
    SPAN,
    TENTHS,
    TOY,
    TOYS,
    forget,
    refused,
    wheel,
)

DOCUMENT = ROOT / "src" / "doc" / "kinds.md"


def test_the_model_file_knows_the_drive_model(toys):
    model = validate(wheel(), "toy.yaml")
    assert DRIVE_MODELS[TOY].of(model.joints[0]).efficiency.value == EFFICIENCY
    assert "constant_effciency" in refused(wheel(drive="constant_effciency")).found
    assert f"'{TOY}'" in refused(wheel(drive="constant_effciency")).expected
    assert TOY in refused(wheel(drive="constant_effciency")).remedy
    misspelt = refused(wheel(joint={"constant_eficiency": {}}))
    assert misspelt.expected == f"'{TOY}'"
    assert TOY in refused(wheel(joint={TOY: None})).found
    inner = refused(wheel(joint={TOY: {"efficency": figure(0.9)}}))
    assert f"axle.{TOY}.efficency" in inner.found
    assert inner.expected == "'efficiency'"


def test_models_keep_their_identity_when_a_kind_comes_and_goes(monkeypatch):
    before = {name: load(path).model_id for name, path in shipped_models().items()}
    monkeypatch.setenv(kinds.VARIABLE, TOYS)
    kinds.load_kinds()
    try:
        assert {name: load(path).model_id for name, path in shipped_models().items()} == before
    finally:
        forget()
    assert TOY not in Joint.model_fields
    assert TOY in refused(wheel(drive="ideal")).found


def measured(result: Replay):
    energy = replay_report(result).energy
    seconds = result.account.counts.samples and energy.grid_import / 60.0
    return energy, seconds


def test_a_replay_gives_the_energy_worked_out_by_hand(toys, bag):
    result = replay(bag, validate(wheel(), "toy.yaml"))
    energy, seconds = measured(result)
    # Shaft 7 W, input 7 / 0.7 = 10 W, with 20 W on the DC and 30 W on the grid side: 60 W.
    assert seconds == pytest.approx(SPAN, abs=0.2)
    assert energy.drive_loss == pytest.approx(3.0 * seconds, rel=1e-5)
    assert energy.friction == pytest.approx(7.0 * seconds, rel=1e-5)
    compared = result.account.comparison
    assert compared.measured_energy == pytest.approx(compared.compared_ns * 60e-9, rel=1e-5)
    assert compared.predicted_energy == pytest.approx(compared.measured_energy, rel=1e-5)
    assert compared.compared_ns > 9 * SECOND


def test_a_bag_shows_its_meter_and_parameters_know_what_it_implies(toys, bag):
    source, notes = find_meter(BagReader(bag), None, None)
    assert source == MeterSource(topic="/milliwatts", type=INT32)
    assert notes == []
    assert source.factor == 1e-3
    with pytest.raises(ParameterError):
        MeterSource(type=INT32, unit="kW")
    with pytest.raises(ParameterError):
        MeterSource(type=INT32, value_path="data")


def test_without_the_file_the_meter_needs_settings(bag):
    assert find_meter(BagReader(bag), None, None) == (None, [])
    with pytest.raises(ParameterError):
        MeterSource(type=INT32)


def test_tables_show_the_kind(toys, bag, tmp_path, capsys):
    path = tmp_path / "toy.yaml"
    path.write_text(yaml.safe_dump(wheel()))
    assert main(["models", "check", str(path)]) == 0
    assert DRIVE_MODELS[TOY].label in capsys.readouterr().out
    assert main(["replay", str(bag), "--model", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "drive losses" in shown
    assert "not modelled" not in shown
    better = wheel(joint={TOY: {"efficiency": figure(0.8)}})
    (change,) = changes(validate(wheel(), ""), validate(better, ""))
    assert (change.name, change.after.value) == ("axle efficiency", 0.8)


def test_a_temperature_of_the_user_s_kind_decides_the_friction(toys, bag):
    """Tenths of a degree: 40 degC lies half-way between two points of the table."""
    points = {"motor_temperature_degc": [20.0, 60.0], "viscous": [0.02, 0.01]}
    viscous = {"law": "table", **points, "tag": "assumed"}
    friction = {"coulomb": figure(0.5), "viscous": viscous}
    model = validate(wheel(joint={"friction": friction}), "toy.yaml")
    source = TemperatureSource(
        topic="/tenths", type=TENTHS, joints=("axle",), stamp_source="receive"
    )
    result = replay(bag, model, ReplaySetup(inputs=Inputs(temperature_sources={"motors": source})))
    energy = replay_report(result).energy
    # 0.5 N m and 0.015 N m s/rad at 10 rad/s: 6.5 W of the shaft, input 6.5 / 0.7 W and 50 W.
    share = 6.5 / (6.5 / EFFICIENCY + 50.0)
    assert energy.friction / energy.grid_import == pytest.approx(share, rel=0.005)
    with pytest.raises(ParameterError):
        TemperatureSource(type=TENTHS, topic="/tenths")  # which joints?


def test_a_log_of_the_user_s_format_is_imported(toys, tmp_path, capsys):
    log = tmp_path / "angles.txt"
    log.write_text("0\n90\nx\n180\n")
    assert main(["import", "angles", str(log), "--out", str(tmp_path / "bag")]) == 0
    said = capsys.readouterr().out
    assert "4 rows, 3 used" in said
    assert "1 not numeric (first at line 3, where angle is 'x')" in said
    main(["identify", "drives", "--help"])
    assert "--angles" in capsys.readouterr().out
    assert "`angles`" in kinds_listing()


def test_the_command_knows_kinds_of_files(tmp_path):
    command = [sys.executable, "-m", "robot_energy", "kinds"]
    environment = {**os.environ, kinds.VARIABLE: TOYS}
    shown = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert f"`{TOY}`" in shown.stdout
    assert f"`{INT32}`" in shown.stdout


def test_a_file_that_cannot_be_run_is_refused(monkeypatch, tmp_path, capsys):
    for text in (None, "1 / 0"):
        path = tmp_path / f"kinds_{text is None}.py"
        if text is not None:
            path.write_text(text)
        monkeypatch.setenv(kinds.VARIABLE, str(path))
        with pytest.raises(KindError):
            kinds.load_kinds()
        assert main(["kinds"]) == 2
        assert path.name in capsys.readouterr().err


def test_names_are_unique_and_the_nearest_is_said():
    table = Kinds("toy", Kind(name="spring", label="", line=""))
    with pytest.raises(KindError):
        table.register(Kind(name="spring", label="", line=""))
    with pytest.raises(KindError) as error:
        table["sprnig"]
    assert "spring" in error.value.remedy


def test_the_document_lists_what_the_tables_have(toys):
    assert f"`{TOY}`" in kinds_listing()
    assert f"`{INT32}`" in kinds_listing()


def test_the_document_is_up_to_date():
    text = DOCUMENT.read_text()
    listing = text.partition("<!-- robot-energy kinds -->\n")[2]
    assert listing.partition("<!-- end -->")[0].strip() == kinds_listing().strip()
