"""The order of an identification, what it leaves out and why, and its test on held-out data."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import drive_reports
from plants import PROGRAM, two_link_profile
from robot_energy.certainty.priors import figure_std
from robot_energy.model import RobotModel, load
from robot_energy.model.figure import PositiveFigure
from robot_energy.pipeline import Settings
from robot_energy.replay.bag_replay import Progress, replay
from robot_energy.replay.setup import ReplaySetup
from robot_energy.results.replay import replay_report
from robot_energy.timeline.blocks import EffortMeaning, Float, MeterLocation, Phase
from robot_energy_identify import run_all, steps
from robot_energy_identify.cabinet import fan, supply
from robot_energy_identify.cabinet.cabinet import CabinetFit, Level
from robot_energy_identify.cabinet.supply import fit_supply
from robot_energy_identify.data.bags import Bag, Kept, facts, folds_of, read_all
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.drives.all_drives import DrivesReport
from robot_energy_identify.drives.drive_data import drive_data
from robot_energy_identify.drives.drive_power import MeasuredDrivePower, drive_topics
from robot_energy_identify.dynamics.dynamics import DynamicsReport
from robot_energy_identify.provenance import sha256_of
from robot_energy_identify.results.identification import identification_report
from robot_energy_identify.run_all import (
    FullIdentification,
    identify_everything,
    order_of,
    usable_effort,
    with_provenance,
)
from robot_energy_identify.stats.held_out_energy import GIVEN, held_out_energy
from robot_energy_identify.steps import Subject
from robot_energy_report.document import Document
from robot_energy_report.identify_all import identification_overview
from robot_energy_report.printing import print_document
from robot_energy_rig import RigConfig, VirtualRig
from robot_energy_rig.record import record

TORQUE = EffortMeaning.MOTOR_TORQUE
NEVER = MeasuredDrivePower(np.empty(0, np.int64), np.empty((0, 2)), 0)


class Altered(Bag):
    """A bag of which something is missing or wrong."""

    missing: str = ""

    def whole(self, model: RobotModel, progress: Progress | None = None) -> Recording:
        recording = super().whole(model, progress)
        torque, power, meter = recording.torque, recording.power, recording.meter
        assert meter is not None
        match self.missing:
            case "effort":
                gone = np.full_like(torque.motor_torque_measured, np.nan)
                torque = replace(torque, motor_torque_measured=gone)
            case "temperature":
                gone = np.full_like(power.motor_temperature_degc, np.nan)
                power = replace(power, motor_temperature_degc=gone)
            case "elbow temperature":
                gone = power.motor_temperature_degc.copy()
                gone[:, 1] = np.nan
                power = replace(power, motor_temperature_degc=gone)
            case "early temperature":
                gone = power.motor_temperature_degc.copy()
                gone[: len(gone) // 2] = np.nan
                power = replace(power, motor_temperature_degc=gone)
            case "but one temperature":
                gone = np.full_like(power.motor_temperature_degc, np.nan)
                gone[0] = power.motor_temperature_degc[0]
                power = replace(power, motor_temperature_degc=gone)
            case "meter":
                meter = None
            case "rest":  # neither rest nor braking, and hardly a reading
                power = replace(power, phase=np.full_like(power.phase, Phase.MOTION))
                power = replace(power, bus_power=np.abs(power.bus_power))
                meter = meter[:10]
            case "truth":
                meter = replace(meter, power=3.0 * meter.power)
            case _:
                pass
        return replace(recording, torque=torque, power=power, meter=meter)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The two-link rig at three temperatures, and the model file of another robot like it."""
    where = tmp_path_factory.mktemp("rig")
    profile = two_link_profile(where)
    for number, degc in enumerate((25.0, 40.0, 55.0)):
        rig = VirtualRig(profile, PROGRAM, RigConfig(), number, degc)
        record(rig, 15.0, where / f"at_{degc:.0f}")
    return where


@pytest.fixture(scope="module")
def model(folder: Path) -> RobotModel:
    return load(folder / "two_link.yaml")


@cache
def kept(path: Path, effort: EffortMeaning) -> Kept:
    """A bag that is read once, as `identify all` does."""
    return Kept(Bag(path, effort).whole(load(path.parent / "two_link.yaml")))


def bags_in(folder: Path, missing: str = "", effort: EffortMeaning = TORQUE) -> list[Bag]:
    paths = [folder / f"at_{degc}" for degc in (25, 40, 55)]
    return [Altered(one, effort, kept=kept(one, effort), missing=missing) for one in paths]


@pytest.fixture(scope="module")
def whole(folder: Path, model: RobotModel) -> FullIdentification:
    return identify_everything(bags_in(folder), model)


def test_each_step_begins_with_what_the_one_before_left(
    whole: FullIdentification, folder: Path, model: RobotModel
) -> None:
    assert [step.subject for step in whole.steps] == [
        "dynamics",
        "friction",
        "cabinet",
        "drives",
        "capacitor",
        "thermal",
    ]
    assert "at least 600 s" in whole.step("thermal").reason
    assert {"dynamics", "friction", "drives"} <= set(whole.taken)
    bodies = whole.step("dynamics").model.urdf_xml
    assert bodies != model.urdf_xml
    assert whole.model.urdf_xml == bodies
    assert whole.model.drive == "loss_model"
    # friction alone, on the bodies of the dynamics, is the friction of the whole
    alone = identify_everything(
        bags_in(folder),
        whole.step("dynamics").model,
        ("dynamics", "cabinet", "drives", "capacitor"),
    )
    for one, other in zip(alone.model.joints, whole.model.joints, strict=True):
        assert one.friction.coulomb.value == pytest.approx(other.friction.coulomb.value, rel=1e-12)


def test_a_long_recording_from_cold_shows_the_thermal_networks(
    tmp_path: Path, folder: Path, model: RobotModel
) -> None:
    profile = two_link_profile(tmp_path)
    rig = VirtualRig(profile, PROGRAM, RigConfig(thermal_speedup=8.0), 1, 22.0, 22.0, rate_hz=50.0)
    record(rig, 900.0, tmp_path / "long")
    others = ("dynamics", "friction", "cabinet", "drives", "capacitor")
    found = identify_everything([Bag(tmp_path / "long", TORQUE)], model, others)
    assert found.taken == ("thermal",)
    assert found.step("thermal").found.ambient_degc == pytest.approx(22.0, abs=1.0)
    networks = [joint.thermal for joint in found.model.joints]
    assert any(network is not None for network in networks)
    assert all(joint.thermal is None for joint in model.joints)
    read = [
        facts(bag, bag.whole(model)) for bag in (*bags_in(folder), Bag(tmp_path / "long", TORQUE))
    ]
    asked = identification_report(found, found.model, read[:-1], (), None)
    assert "no recording shows a warm-up" in asked.notes[-1]
    assert not identification_report(found, found.model, read, (), None).notes
    shown = identification_report(found, found.model, (), (), None)
    page, stream = Document(), io.StringIO()
    identification_overview(shown, page)
    print_document(page, Console(width=200, file=stream))
    assert "free run at most" in stream.getvalue()


@pytest.mark.parametrize(
    ("missing", "others", "said"),
    [
        (
            "effort",
            ("cabinet", "drives", "capacitor"),
            {"dynamics": "have no effort", "friction": "have no effort"},
        ),
        (
            "meter",
            ("dynamics",),
            {
                "cabinet": "no recording has a power meter",
                "drives": "neither the power of the drives nor a power meter",
            },
        ),
        (
            "rest",
            ("dynamics",),
            {"cabinet": "record at least ten seconds of rest", "drives": "record longer"},
        ),
    ],
)
def test_what_is_missing_is_said_and_the_rest_goes_on(
    folder: Path, model: RobotModel, missing: str, others: Sequence[Subject], said: dict[str, str]
) -> None:
    result = identify_everything(bags_in(folder, missing), model, others)
    for step in result.steps:
        if step.subject in said:
            assert step.found is None
            assert said[step.subject] in step.reason.lower()
            assert step.reason.endswith(".")
        elif step.subject in others:
            assert step.reason == "left out, as asked"
    assert result.model is not None


def test_an_effort_without_a_meaning_or_a_constant_is_not_used(
    folder: Path, model: RobotModel
) -> None:
    others = ("cabinet", "drives", "capacitor")
    result = identify_everything(bags_in(folder, effort=EffortMeaning.NONE), model, others)
    for subject in ("dynamics", "friction"):
        assert "--effort" in result.step(subject).reason
    refused = usable_effort(model, EffortMeaning.MOTOR_CURRENT)
    assert "torque_constant" in refused
    assert usable_effort(model, TORQUE) == ""
    bags = bags_in(folder, effort=EffortMeaning.NONE)
    again = identify_everything(bags, model, others, effort_refused=refused)
    assert again.step("friction").reason == refused


def test_without_temperatures_dynamics_says_friction(folder: Path, model: RobotModel) -> None:
    result = identify_everything(
        bags_in(folder, "temperature"), model, ("cabinet", "drives", "capacitor")
    )
    assert result.taken == ("dynamics",)
    assert "stays that of the dynamics" in result.step("friction").reason
    assert {joint.friction.viscous.law for joint in result.model.joints} == {"constant"}


def test_an_axis_without_temperature_gets_a_constant_and_the_other_its_law(
    folder: Path, whole: FullIdentification
) -> None:
    others = ("dynamics", "cabinet", "drives", "capacitor")
    bodies = whole.step("dynamics").model
    result = identify_everything(bags_in(folder, "elbow temperature"), bodies, others)
    shoulder, elbow = (joint.friction.viscous for joint in result.model.joints)
    other, _ = (joint.friction.viscous for joint in whole.step("friction").model.joints)
    assert (elbow.law, elbow.viscous.tag) == ("constant", "identified")
    assert 0.0 < elbow.viscous.std < 0.5 * elbow.viscous.value
    assert shoulder == other
    assert shoulder.law != "constant"
    (note,) = identification_report(result, result.model, (), (), None).notes
    assert note.startswith("no motor temperature of elbow, so that friction is a constant there")


def test_axes_recorded_at_one_temperature_are_named(
    folder: Path, whole: FullIdentification
) -> None:
    others = ("dynamics", "cabinet", "drives", "capacitor")
    result = identify_everything(bags_in(folder)[:1], whole.step("dynamics").model, others)
    (note,) = identification_report(result, result.model, (), (), None).notes
    assert note.startswith("friction of shoulder, elbow was recorded at one temperature each")
    laws = [joint.friction.viscous for joint in result.model.joints]
    assert all(law.law == "constant" and law.fitted_degc is not None for law in laws)


def test_a_recording_without_the_temperature_of_one_axis_is_named(
    folder: Path, whole: FullIdentification
) -> None:
    others = ("dynamics", "cabinet", "drives", "capacitor")
    bags = [*bags_in(folder)[:2], bags_in(folder, "elbow temperature")[2]]
    result = identify_everything(bags, whole.step("dynamics").model, others)
    (note,) = identification_report(result, result.model, (), (), None).notes
    assert note.startswith("at_55: no motor temperature of elbow in 100 % of its samples")
    assert not identification_report(whole, whole.model, (), (), None).notes


def test_samples_without_the_temperatures_of_others_count_neither_for_friction_nor_drives(
    folder: Path, model: RobotModel, whole: FullIdentification
) -> None:
    """Their friction is that of the fallback temperature, which a meter would count as losses."""
    bags = [*bags_in(folder)[:2], bags_in(folder, "early temperature")[2]]
    sound, late = (
        drive_data(read_all(some, model), [None] * 3, measured_torque=False).motor_torque
        for some in (bags_in(folder), bags)
    )
    begin = len(late) - len(read_all(bags[2:], model)[0])
    half = (begin + len(late)) // 2
    assert np.isnan(late[begin:half]).all()
    assert np.isfinite(sound[begin:half]).any()
    assert np.array_equal(np.delete(late, slice(begin, half), 0),
                          np.delete(sound, slice(begin, half), 0), equal_nan=True)  # fmt: skip
    others = ("dynamics", "cabinet", "drives", "capacitor")
    result = identify_everything(bags, whole.step("dynamics").model, others)
    notes = identification_report(result, result.model, (), (), None).notes
    assert "at_55: no motor temperature of shoulder, elbow in 50 % of its samples" in notes[0]


def test_drives_leave_out_no_sample_for_the_only_temperature_of_all(
    folder: Path, model: RobotModel
) -> None:
    none, one = (
        drive_data(
            read_all([*bags_in(folder, missing)[:1], *bags_in(folder, "temperature")[1:]], model),
            [None] * 3,
            measured_torque=False,
        ).motor_torque
        for missing in ("temperature", "but one temperature")
    )
    assert np.array_equal(np.isnan(one), np.isnan(none))
    assert np.isfinite(one).any()


@pytest.mark.parametrize("fall", [None, 0.001])
def test_measured_torque_needs_no_temperature_unless_magnets_weaken(
    folder: Path, model: RobotModel, fall: float | None
) -> None:
    if fall is not None:
        figure = PositiveFigure(value=fall, tag="assumed")
        model = model.with_joints("torque_constant_fall", {"elbow": figure})
    sound, late = (
        drive_data(
            read_all([*bags_in(folder)[:2], last], model), [None] * 3, measured_torque=True
        ).motor_torque
        for last in (bags_in(folder)[2], bags_in(folder, "early temperature")[2])
    )
    assert np.array_equal(np.isnan(late), np.isnan(sound)) is (fall is None)


def test_bodies_that_are_right_already_stay(folder: Path, whole: FullIdentification) -> None:
    """The bodies of the first pass are those of the plant as well as these data determine."""
    again = identify_everything(
        bags_in(folder), whole.model, ("friction", "cabinet", "drives", "capacitor")
    )
    step = again.step("dynamics")
    assert step.found is not None
    assert not step.taken
    assert "so they stay" in step.reason
    assert again.model is whole.model


def test_bodies_are_said_at_one_temperature(
    folder: Path, model: RobotModel, whole: FullIdentification
) -> None:
    """Friction over temperature is not an error of the bodies where temperatures are known."""
    others = ("friction", "cabinet", "drives", "capacitor")
    blind = identify_everything(bags_in(folder, "temperature"), model, others).steps[0].found
    known = whole.step("dynamics").found
    assert isinstance(blind, DynamicsReport)
    assert isinstance(known, DynamicsReport)
    for test in ("held_out_model_file", "held_out_given_bodies"):
        assert known.torque_error[test].total < 0.97 * blind.torque_error[test].total
    assert "was removed first" in whole.step("dynamics").notes[0]


def test_dynamics_of_a_fold_keep_no_rows(folder: Path, model: RobotModel) -> None:
    found = steps.dynamics_step(bags_in(folder), model, "bags", in_fold=True).found
    assert isinstance(found, DynamicsReport)
    assert len(found.result.observations.segment) == 0
    assert list(found.torque_error) == ["held_out_model_file", "held_out_given_bodies"]


def test_drives_come_first_where_their_power_is_measured(folder: Path) -> None:
    bags = bags_in(folder)
    assert order_of(bags) == (
        "dynamics", "friction", "cabinet", "drives", "capacitor", "thermal",
    )  # fmt: skip
    bags[1] = replace(bags[1], drive_power=NEVER)
    assert order_of(bags) == (
        "dynamics", "friction", "drives", "cabinet", "capacitor", "thermal",
    )  # fmt: skip


def test_the_cabinet_is_the_meter_less_measured_drives(tmp_path: Path) -> None:
    """The meter at the DC bus shows the drives and 90 W of the rig's DC side."""
    kr16 = load("kr16")
    path = drive_reports.record(tmp_path / "bag", 1, 20.0)
    power = drive_topics("/drive_power").read(path, kr16.joint_names)
    bags = [Bag(path, TORQUE, None, power)]
    result = identify_everything(bags, kr16, ("dynamics", "friction", "capacitor"))
    assert isinstance(result.step("drives").found, DrivesReport)
    assert result.model.cabinet.loss_dc.value == pytest.approx(90.0, abs=0.5)
    assert result.model.cabinet.loss_dc.tag == "identified"


def test_what_is_tested_is_never_fitted(folder: Path, model: RobotModel) -> None:
    """A meter that lies in one recording changes no prediction of that recording."""
    skip = ("dynamics", "friction", "capacitor")
    sound = bags_in(folder)[:2]
    lying = [sound[0], Altered(sound[1].path, TORQUE, missing="truth")]
    predicted: list[list[float]] = []
    for bags in (sound, lying):
        kind, folds = folds_of(bags, [], [])
        assert kind == "recordings"
        fitted = identify_everything(bags, model, skip)
        test = held_out_energy(kind, folds, fitted, skip)
        assert [entry.name for entry in test.tested] == ["at_25", "at_40"]
        predicted.append([entry.predictions["drives"].energy for entry in test.tested])
    assert predicted[0][1] == predicted[1][1]
    assert predicted[0][0] != predicted[1][0]


def test_energy_errors_are_those_of_replay(
    folder: Path, model: RobotModel, whole: FullIdentification
) -> None:
    kind, folds = folds_of(bags_in(folder)[:2], bags_in(folder)[2:], [])
    assert kind == "test"
    test = held_out_energy(kind, folds, whole)
    (entry,) = test.tested
    for stage, used in ((GIVEN, model), ("capacitor", whole.model)):
        settings = Settings(effort=TORQUE)
        known = replay_report(
            replay(folder / "at_55", used, ReplaySetup(settings=settings))
        ).comparison
        assert entry.error(stage) == pytest.approx(known.predicted_minus_measured_relative)
        assert entry.duration == pytest.approx(known.compared_time)
    assert entry.beyond == pytest.approx(14.0, abs=2.0)  # the fit knows 25 and 40 degC
    assert test.within == ()
    assert test.less_energy_error
    assert test.less_power_error


@pytest.mark.long
def test_blocks_of_one_recording_do_not_overlap_with_their_fit(
    folder: Path, model: RobotModel
) -> None:
    bag = bags_in(folder)[0]
    span = bag.whole(model).span_ns
    kind, folds = folds_of([bag], [], [span])
    assert kind == "blocks"
    assert len(folds) == 5
    seen = 0
    for fold in folds:
        tested = np.concatenate([part.torque.stamp_ns for part in fold.test[0].read(model)])
        fitted = np.concatenate([part.torque.stamp_ns for part in fold.train[0].read(model)])
        apart = np.abs(tested[:, None] - fitted[None, ::10]).min()
        assert apart >= 0.4e9
        seen += len(tested)
    assert seen >= len(bag.whole(model)) - 1
    skip = ("dynamics", "friction", "cabinet", "capacitor")
    test = held_out_energy(kind, folds, identify_everything([bag], model, skip), skip)
    assert [entry.name for entry in test.tested] == [f"at_25, block {k}" for k in range(1, 6)]
    assert sum(entry.duration for entry in test.tested) < 15.0


def test_the_model_says_what_it_was_made_from(
    folder: Path, model: RobotModel, whole: FullIdentification
) -> None:
    read = [facts(bag, bag.whole(model)) for bag in bags_in(folder)]
    assert len({entry.sha256 for entry in read}) == 3
    written = with_provenance(whole, read)
    assert written.provenance.bags == tuple(f"{e.name} sha256:{e.sha256}" for e in read)
    assert "virtual rig" in written.provenance.notes
    assert written.provenance.data_date == ""  # stamps of the rig are not dates
    other = folder / "at_25" / "metadata.yaml"
    other.write_text(other.read_text() + "\n")
    assert sha256_of(bags_in(folder)[0].path) == read[0].sha256  # of the messages, not of the index


@pytest.fixture
def constants(monkeypatch: pytest.MonkeyPatch) -> None:
    """25 W at rest, as the rig of these bags has no rest."""
    hold = Level(25.0, 0.5, 10, 5, 0.0)
    grid = MeterLocation.GRID
    fit = CabinetFit(grid, hold, None, 25.0, None, None, None, (), {"sum": hold.parts})
    for place in (steps, run_all, supply):
        monkeypatch.setattr(place, "fit_cabinet", lambda *_: fit)


@pytest.mark.usefixtures("constants")
def test_a_likely_fan_changes_no_watt_and_widens_the_grid_side_alone_by_its_power(
    folder: Path, model: RobotModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    def found(likely: float) -> tuple[RobotModel, Float]:
        monkeypatch.setattr(fan, "_by_levels", lambda _: fan.FanFound(None, "levels", likely))
        skip: list[Subject] = ["dynamics", "friction", "capacitor", "thermal"]
        written = identify_everything(bags_in(folder), model, skip).model
        assert written.covariance is not None
        sides = [written.covariance.figures.index(name) for name in ("loss_dc", "loss_grid")]
        return written, np.array(written.covariance.matrix)[np.ix_(sides, sides)]

    (same, before), (other, after) = found(0.0), found(40.0)
    assert after - before == pytest.approx(np.diag([0.0, 40.0**2]), abs=1e-3)
    assert other.cabinet.loss_grid.std == pytest.approx(after[1, 1] ** 0.5)
    assert other.cabinet.loss_dc == same.cabinet.loss_dc
    assert other.constant_power() == same.constant_power()
    assert other.cabinet.fan is None


@pytest.mark.usefixtures("constants")
@pytest.mark.parametrize("verb", ["cabinet", "all"])
def test_a_likely_fan_is_in_the_grid_side_without_losses_of_the_drives(
    folder: Path, model: RobotModel, monkeypatch: pytest.MonkeyPatch, verb: str
) -> None:
    def found(likely: float) -> RobotModel:
        monkeypatch.setattr(fan, "_by_levels", lambda _: fan.FanFound(None, "levels", likely))
        bags = bags_in(folder)
        if verb == "cabinet":
            return fit_supply(read_all(bags, model), "bags").model
        skip: list[Subject] = ["dynamics", "friction", "drives", "capacitor", "thermal"]
        return identify_everything(bags, model, skip).model

    same, other = found(0.0), found(40.0)
    before = figure_std(same.cabinet.loss_grid, "loss_grid")
    assert other.cabinet.loss_grid.std == pytest.approx(np.hypot(before, 40.0))
    assert other.cabinet.loss_dc == same.cabinet.loss_dc
