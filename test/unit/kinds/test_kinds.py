"""A drive model and a meter of a user, one file each: everything knows them."""

import io
import os
import subprocess
import sys
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import yaml
from rich.console import Console

from robot_energy import kinds
from robot_energy.bag import BagReader, BagWriter
from robot_energy.bag_replay import Replay, replay
from robot_energy.cdr.types import typestore
from robot_energy.cli.main import main
from robot_energy.errors import (
    KindError,
    ModelFileError,
    NotIdentifiableError,
    ParameterError,
)
from robot_energy.identify.drives.all_drives import DrivesFound
from robot_energy.identify.drives.drive_data import drive_data_of_logs
from robot_energy.identify.drives.drives import AxisFit, DrivesFit, fit_drives, with_drives
from robot_energy.identify.drives.losses import TERMS, Losses
from robot_energy.identify.friction.laws import fitted_laws
from robot_energy.inputs.bag_topics import find_meter
from robot_energy.inputs.meter.kinds import METER_KINDS
from robot_energy.inputs.meter.source import MeterSource
from robot_energy.inputs.sources import Inputs, TemperatureSource
from robot_energy.inputs.temperatures.kinds import TEMPERATURE_KINDS
from robot_energy.kinds import Kind, Kinds
from robot_energy.log_formats import LOG_FORMATS
from robot_energy.logs.recording import LogBlock, RecordingContents
from robot_energy.model import load, shipped_models, validate
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.model.figure import Figure, PositiveFigure
from robot_energy.model.friction_laws import (
    FRICTION_LAWS,
    FrictionLaw,
    LawEntry,
    register_friction_law,
)
from robot_energy.model.joint import Joint
from robot_energy.physics.friction import ViscousLaw, viscous_law
from robot_energy.report.document import Document
from robot_energy.report.drives import drives_document
from robot_energy.report.kinds import kinds_listing
from robot_energy.report.parameters import changes
from robot_energy.report.printing import print_document
from robot_energy.results.drives import drives_report
from robot_energy.results.replay import replay_report

HERE = Path(__file__).parent
TOYS = os.pathsep.join(map(str, sorted(HERE.glob("toy_*.py"))))
DOCUMENT = HERE.parents[2] / "src" / "doc" / "kinds.md"
INT32, TOY = "std_msgs/msg/Int32", "constant_efficiency"
TENTHS, ROOT = "std_msgs/msg/Int32MultiArray", "square_root"
STORE = typestore()
SECOND, RATE, SPAN = 10**9, 100, 10
EFFICIENCY = 0.7


@pytest.fixture
def toys(monkeypatch):
    """The kinds of both files, until the end of the test."""
    monkeypatch.setenv(kinds.VARIABLE, TOYS)
    kinds.load_kinds()
    yield
    forget()


def forget():
    """Take out what the files registered."""
    for table, names in (
        (DRIVE_MODELS, (TOY, ROOT)),
        (METER_KINDS, (INT32,)),
        (TEMPERATURE_KINDS, (TENTHS,)),
        (LOG_FORMATS, ("angles",)),
    ):
        for name in names:
            table.remove(name)
    kinds._loaded.clear()


def figure(value):
    return {"value": value, "tag": "assumed"}


def wheel(**changes):
    """One joint without gravity; its motor needs 0.5 + 0.02 * 10 = 0.7 N m at 10 rad/s."""
    joint = {
        "name": "axle",
        "gear_ratio": figure(10.0),
        "rotor_inertia": figure(0.01),
        "friction": {
            "coulomb": figure(0.5),
            "viscous": {"law": "constant", "viscous": figure(0.02)},
        },
        TOY: {"efficiency": figure(EFFICIENCY)},
    }
    urdf = """
    <robot name="wheel"><link name="base"/><link name="disc">
      <inertial><mass value="8"/>
        <inertia ixx="1" iyy="1" izz="2" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="axle" type="continuous"><parent link="base"/><child link="disc"/>
        <axis xyz="0 0 1"/></joint></robot>"""
    data = {
        "schema_version": 1,
        "robot": {"type": "wheel"},
        "urdf": {"xml": urdf},
        "joints": [joint],
        "drive": TOY,
        "cabinet": {"loss_grid": figure(30.0), "loss_dc": figure(20.0)},
        "temperature": {"fallback_degc": 25.0},
    }
    joint.update(changes.pop("joint", {}))
    return {**data, **changes}


@pytest.fixture
def bag(tmp_path):
    """The wheel turns at 1 rad/s; a meter reads 60 W in milliwatts."""
    folder = tmp_path / "bag"
    time, header = STORE.types["builtin_interfaces/msg/Time"], STORE.types["std_msgs/msg/Header"]
    layout, tenths = STORE.types["std_msgs/msg/MultiArrayLayout"], STORE.types[TENTHS]
    state, number = STORE.types["sensor_msgs/msg/JointState"], STORE.types[INT32]
    with BagWriter(folder) as out:
        out.add_topic("/joint_states", "sensor_msgs/msg/JointState")
        out.add_topic("/milliwatts", INT32)
        out.add_topic("/tenths", TENTHS)
        for row in range(SPAN * RATE + 1):
            stamp = 1_700_000_000 * SECOND + row * SECOND // RATE
            head = header(time(*divmod(stamp, SECOND)), "")
            position, none = np.array([row / RATE]), np.array([])
            message = state(head, ["axle"], position, np.array([1.0]), none)
            raw = bytes(STORE.serialize_cdr(message, "sensor_msgs/msg/JointState"))
            out.write("/joint_states", np.array([stamp]), [raw])
            raw = bytes(STORE.serialize_cdr(number(60_000), INT32))
            out.write("/milliwatts", np.array([stamp]), [raw])
            if row % 10 == 0:
                raw = layout([], 0)
                raw = bytes(STORE.serialize_cdr(tenths(raw, np.array([400], np.int32)), TENTHS))
                out.write("/tenths", np.array([stamp]), [raw])
    return folder


def refused(data):
    with pytest.raises(ModelFileError) as error:
        validate(data, "toy.yaml")
    return error.value


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
    seconds = result.ledger.samples and energy.grid_import / 60.0
    return energy, seconds


def test_a_replay_gives_the_energy_worked_out_by_hand(toys, bag):
    result = replay(bag, validate(wheel(), "toy.yaml"))
    energy, seconds = measured(result)
    # Shaft 7 W, input 7 / 0.7 = 10 W, with 20 W on the DC and 30 W on the grid side: 60 W.
    assert seconds == pytest.approx(SPAN, abs=0.2)
    assert energy.drive_loss == pytest.approx(3.0 * seconds, rel=1e-5)
    assert energy.friction == pytest.approx(7.0 * seconds, rel=1e-5)
    compared = result.ledger.comparison
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


def test_identification_says_that_the_kind_has_no_fit(toys):
    terms = dict.fromkeys(TERMS, 1.0)
    losses = Losses(terms, dict.fromkeys(TERMS, 0.1), (), (), 100, 1.0, {})
    fit = DrivesFit((AxisFit("axle", losses, None, ()),), (), "loss_model", 1.0)
    model, notes = DrivesFound(fit, None).write(validate(wheel(), "toy.yaml"), "test")
    assert model.drive == "loss_model"
    assert DRIVE_MODELS[TOY].of(model.joints[0]) is not None
    assert len(notes) == 1
    assert TOY in notes[0]


def drive_samples(seed):
    """One drive that loses 3 W at 1 rad/s, with the root of its speed, and nothing else."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, 30.0, 0.01)
    phase = random.uniform(0, 6, 3)
    velocity = 80 * np.sin(0.9 * time + phase[0]) + 60 * np.sin(2.3 * time + phase[1])
    torque = 1.5 * np.sin(1.7 * time + phase[2])
    power = torque * velocity + 3.0 * np.sqrt(np.abs(velocity)) + random.normal(size=len(time))
    none = np.full((len(time), 1), np.nan)
    stamp = (seed * 1000 + time * 1e9).astype(np.int64)
    wide = (none, velocity[:, None], torque[:, None], none)
    return LogBlock(stamp, *wide, none[:, 0], power[:, None])


def test_a_fit_of_a_user_is_compared_on_held_out_data_and_chosen(toys):
    held = RecordingContents(("axle",), True, True, False, drive_power=True)
    data = drive_data_of_logs([(held, [drive_samples(seed)]) for seed in (1, 2)], "newton_metre")
    fit = fit_drives(data)
    for comparison in fit.comparisons:
        assert comparison.scores[ROOT].rms == pytest.approx(1.0, rel=0.1)  # the noise
        assert comparison.scores["losses"].rms > 1.3
        assert comparison.scores["map"].rms > 1.3
    assert fit.chosen == ROOT
    model = with_drives(validate(wheel(), "toy.yaml"), fit, "test")
    assert model.drive == ROOT
    assert DRIVE_MODELS[ROOT].of(model.joints[0]).loss.value == pytest.approx(3.0, rel=0.02)
    page, console = Document(), Console(width=200, file=io.StringIO())
    drives_document(drives_report(DrivesFound(fit, None), "log"), page)
    print_document(page, console)
    shown = console.file.getvalue()
    assert shown.count(DRIVE_MODELS[ROOT].label) >= 3  # energy, power, what was chosen


def test_a_user_s_fit_that_fails_leaves_the_comparison_of_the_others(toys):
    kind = DRIVE_MODELS[ROOT]

    def nothing(axis, source):
        raise NotIdentifiableError("not told")

    DRIVE_MODELS.complete(ROOT, fitted=nothing)
    try:
        held = RecordingContents(("axle",), True, True, False, drive_power=True)
        fit = fit_drives(drive_data_of_logs([(held, [drive_samples(1)])], "newton_metre"))
    finally:
        DRIVE_MODELS.complete(ROOT, fitted=kind.fitted)
    assert fit.chosen in ("loss_model", "efficiency_map")
    assert ROOT not in fit.comparisons[0].scores


def test_a_temperature_of_the_user_s_kind_decides_the_friction(toys, bag):
    """Tenths of a degree: 40 degC lies half-way between two points of the table."""
    points = {"motor_temperature_degc": [20.0, 60.0], "viscous": [0.02, 0.01]}
    viscous = {"law": "table", **points, "tag": "assumed"}
    friction = {"coulomb": figure(0.5), "viscous": viscous}
    model = validate(wheel(joint={"friction": friction}), "toy.yaml")
    source = TemperatureSource(
        topic="/tenths", type=TENTHS, joints=("axle",), stamp_source="receive"
    )
    result = replay(bag, model, inputs=Inputs(temperature_sources={"motors": source}))
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
    assert "1 not numeric (first at line 3)" in said
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


class Linear(LawEntry):
    """fv = at_zero + slope T."""

    law: Literal["linear"]
    at_zero: PositiveFigure
    slope: Figure


def linear(entry):
    at_zero, slope = entry.at_zero.value, entry.slope.value
    return ViscousLaw(0.0, 100.0, lambda t: at_zero + slope * t, lambda t: np.full(t.shape, np.nan))


@pytest.fixture
def law():
    kind = FrictionLaw(name="linear", label="line", line="a line", entry=Linear, curve=linear)
    yield register_friction_law(kind)
    FRICTION_LAWS.remove("linear")


def with_viscous(**viscous):
    friction = {"coulomb": figure(0.5), "viscous": viscous}
    data = wheel(drive="ideal", joint={"friction": friction})
    del data["joints"][0][TOY]
    return data


def test_a_friction_law_is_known_to_model_physics_and_tables(law):
    line = {"law": "linear", "at_zero": figure(0.03), "slope": figure(-1e-4)}
    model = validate(with_viscous(**line), "toy.yaml")
    curve = viscous_law(model.joints[0].friction.viscous)
    assert curve.viscous(50.0) == pytest.approx(0.025)
    error = refused(with_viscous(**{**line, "law": "lineer"}))
    assert "linear" in error.remedy
    assert "`linear`" in kinds_listing()
    assert law.text(model.joints[0].friction.viscous.model_dump()) == "at_zero 0.03, slope -0.0001"
    assert "linear" not in fitted_laws()


def test_a_law_that_is_gone_is_unknown():
    line = {"law": "linear", "at_zero": figure(0.03), "slope": figure(-1e-4)}
    assert "linear" in refused(with_viscous(**line)).found


def test_a_kind_that_the_schema_cannot_take_is_not_kept():
    class Nameless(LawEntry):
        law: str

    with pytest.raises(Exception, match="Nameless"):
        register_friction_law(FrictionLaw(name="bad", label="", line="", entry=Nameless))
    assert "bad" not in FRICTION_LAWS
    assert len(load("kr16").joints) == 6


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
