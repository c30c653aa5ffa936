"""The report of a fleet: its sums against the rows, what it finds, and what it writes."""

import json
import math
from dataclasses import replace
from datetime import UTC, datetime
from zoneinfo import ZoneInfo

import polars as pl
import pytest
from fleet_study import judged

import robot_energy as re
from fleets import dataset, fleet, written
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.foundation.units import HOUR_NS, MINUTE_NS
from robot_energy.model import load
from robot_energy_cli.main import main
from robot_energy_fleet.dataset import read_tables
from robot_energy_fleet.documents.fleet import fleet_document, fleet_headline
from robot_energy_fleet.identify import identify_fleet
from robot_energy_fleet.report import fleet_report
from robot_energy_fleet.tables import FleetTables
from robot_energy_history.tariffs import PricePeriod
from robot_energy_report.document import Document
from robot_energy_report.html import page_html
from robot_energy_report.page.settings import PageSettings
from robot_energy_studies.generated_fleet import FleetPlan

ROBOTS = 6
PLAN = FleetPlan(ROBOTS, 1, 3)


@pytest.fixture(scope="module")
def tables():
    return fleet(ROBOTS)


@pytest.fixture(scope="module")
def report(tables):
    return fleet_report(tables, "fleet")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """The fleet as a dataset."""
    return dataset(tmp_path_factory.mktemp("fleet") / "data", ROBOTS)


def test_payload_and_standby_are_found_and_nothing_else(report):
    row = judged(report, PLAN.faulty())
    kinds = {robot: kind for robot, kind in PLAN.faulty().items() if kind != "friction"}
    assert set(row.found) == set(kinds)  # a week is too short for the axis that wears
    assert row.false == ()
    for one in report.findings:
        if one.kind == "payload":
            assert one.size == pytest.approx(-5.0, abs=1.5)
            assert one.certainty > 0.99
        if one.kind == "standby":
            assert one.size == pytest.approx(0.5, abs=0.1)


def test_every_sum_is_that_of_the_rows(report, tables):
    energy = tables.runs["grid_energy"].sum()
    assert math.fsum(one.grid_energy for one in report.robots) == pytest.approx(energy)
    assert math.fsum(one.grid_energy for one in report.shifts) == pytest.approx(energy)
    assert sum(one.jobs for one in report.robots) == len(tables.jobs)
    assert sum(one.bags for one in report.robots) == report.bags == len(tables.runs)
    awake = next(robot for robot, kind in PLAN.faulty().items() if kind == "standby")
    standby = {one.robot: one.standby_time for one in report.robots}
    assert standby[awake] > 5 * 1700.0
    night = next(one for one in report.shifts if one.name == "22:00 to 06:00")
    assert night.standby_time == pytest.approx(5 * 1800.0, abs=30.0)
    for one in report.programmes:
        rows = tables.jobs.filter(pl.col("name") == one.name)
        net = rows["grid_energy"] - rows["predicted_return_energy"]
        assert one.mean_energy == pytest.approx(net.mean())
        assert one.lowest <= one.mean_energy <= one.highest


def test_a_dataset_on_disk_gives_the_same_report(place, report):
    again = fleet_report(read_tables(place), "fleet")
    for before, one in zip(report.findings, again.findings, strict=True):
        assert (one.robot, one.kind, one.subject) == (before.robot, before.kind, before.subject)
        assert one.size == pytest.approx(before.size)
    assert [one.robot for one in again.robots] == [one.robot for one in report.robots]
    for before, one in zip(report.robots, again.robots, strict=True):
        assert one.grid_energy == pytest.approx(before.grid_energy, rel=1e-9)


def test_many_robots_to_look_at_fit_on_a_page(report):
    one = report.findings[0]
    many = tuple(replace(one, robot=f"robot-{number:03d}") for number in range(40))
    page = Document("Fleet")
    fleet_document(replace(report, findings=many), page, PageSettings())
    text = page_html(page)
    assert text.count("robot-039") == 1  # in the table alone
    assert "30 findings more" in text
    assert fleet_headline(replace(report, findings=many)).count("robot-0") < 10


def test_standby_costs_what_the_hour_costs(tables, report):
    night = PricePeriod(begin="22:00", end="06:00", price_per_kwh=0.1)
    settings = PageSettings(price_per_kwh=0.3, time_of_use=(night,), timezone="UTC")
    priced = fleet_report(tables, "fleet", settings)
    for before, one in zip(report.shifts, priced.shifts, strict=True):
        price = 0.1 if one.name == "22:00 to 06:00" else 0.3
        assert before.cost is None
        assert one.cost == pytest.approx(price * one.grid_energy / 3.6e6)
        assert one.standby_cost == pytest.approx(price * one.standby_energy / 3.6e6)


def test_a_price_that_changes_within_an_hour_holds_from_that_minute_on(tables):
    """Bags are priced by the time that they have before and after, in half-hour zones too."""
    key = tables.hours["key"].to_list()[0]
    runs = tables.runs.filter(pl.col("key") == key)
    hour_ns = runs["start_ns"][0] // HOUR_NS * HOUR_NS
    hours = tables.hours.filter(pl.col("key") == key).head(1).with_columns(
        hour_ns=pl.lit(hour_ns), grid_energy=pl.lit(3.6e6), standby_energy=pl.lit(1.8e6),
        standby_time=pl.lit(100.0),
    )  # fmt: skip
    utc = datetime.fromtimestamp(hour_ns / 1e9, UTC)
    india = utc.astimezone(ZoneInfo("Asia/Kolkata"))
    assert india.minute == 30

    def costs(first, last, clock, zone):
        own = runs.with_columns(
            start_ns=pl.lit(hour_ns + first * MINUTE_NS), end_ns=pl.lit(hour_ns + last * MINUTE_NS)
        )
        dear = PricePeriod(begin=clock, end="24:00", price_per_kwh=0.5)
        settings = PageSettings(price_per_kwh=0.1, time_of_use=(dear,), timezone=zone)
        report = fleet_report(
            FleetTables(own, tables.jobs.clear(), hours, tables.joints.clear()), "x", settings
        )
        assert math.fsum(one.grid_energy for one in report.shifts) == pytest.approx(3.6e6)
        cost = math.fsum(one.cost for one in report.shifts)
        (robot,) = report.robots
        assert robot.standby_cost == pytest.approx(cost / 2)
        return cost, any("shared by the time" in note for note in report.notes)

    half, next_hour = f"{utc:%H}:30", f"{india.hour + 1:02d}:00"
    for clock, zone in ((half, "UTC"), (next_hour, "Asia/Kolkata")):
        assert costs(0, 60, clock, zone) == (pytest.approx(0.3), True)
        assert costs(40, 50, clock, zone) == (pytest.approx(0.5), True)
        assert costs(20, 40, clock, zone) == (pytest.approx(0.3), True)
    assert costs(0, 60, f"{utc:%H}:00", "UTC") == (pytest.approx(0.5), False)


def test_what_could_not_be_compared_is_not_said_to_be_sound(tables, report):
    """One bag of one robot, then six robots of one bag each."""
    for keys in (tables.runs["key"].head(1), tables.runs.unique("robot")["key"]):
        few = FleetTables(
            *(one.filter(pl.col("key").is_in(keys.implode())) for one in vars(tables).values())
        )
        found = fleet_report(few, "few")
        assert (found.compared_with_sisters, found.compared_with_before) == (0, 0)
        assert f"compared with sisters: 0 of {len(keys)} robot" in found.not_compared[0]
        page = Document("Fleet")
        fleet_document(found, page, PageSettings())
        text = page_html(page)
        assert "too few robots or bags" in text
        assert "none has changed" not in text
        assert "none differs" not in text
        assert ("Friction against the model" in text) == (len(keys) > 2)
        assert "no robot could be compared" in fleet_headline(found)
    assert report.compared_with_sisters == ROBOTS


def test_the_error_by_temperature_holds_every_bag_with_a_meter(report, tables):
    known = tables.runs.filter(pl.col("motor_temperature_degc").is_not_null())
    assert sum(one.bags for one in report.model_errors) == len(known)
    predicted, measured = known["predicted_energy_at_meter"], known["measured_energy"]
    errors = [one.error for one in report.model_errors]
    assert min(errors) <= predicted.sum() / measured.sum() - 1.0 <= max(errors)


def test_a_bag_that_could_not_be_read_is_named_and_counts_for_nothing(tables, report):
    bad = tables.runs.head(1).with_columns(
        key=pl.lit("bad"), reason=pl.lit("no joint states"), grid_energy=pl.lit(None, pl.Float64)
    )
    other = FleetTables(pl.concat([tables.runs, bad]), tables.jobs, tables.hours, tables.joints)
    again = fleet_report(other, "fleet")
    assert [one.reason for one in again.refused] == ["no joint states"]
    assert again.robots == report.robots
    assert again.findings == report.findings


def test_bags_of_one_robot_that_overlap_are_named(tables, tmp_path, capsys):
    """By report, page, JSON and advice, with the time that counts twice; not those of others."""
    first = tables.runs.filter(pl.col("robot") == pl.col("robot").min()).sort("start_ns").head(1)
    again = first.with_columns(
        key=pl.lit("again"), bag=pl.lit("converted"), start_ns=pl.col("start_ns") + 30 * 10**9
    )
    other = FleetTables(pl.concat([tables.runs, again]), tables.jobs, tables.hours, tables.joints)
    shared = (first["end_ns"][0] - first["start_ns"][0]) * 1e-9 - 30.0
    said = f"{first['robot'][0]}: {first['bag'][0]}, converted overlap in time, by {shared:.1f} s"
    place = str(written(tmp_path / "d", other))
    page, data = tmp_path / "d.html", tmp_path / "d.json"
    assert main(["fleet", "report", place, "--html", str(page), "--json", str(data)]) == 0
    for text in (capsys.readouterr().out, page.read_text()):
        assert " ".join(text.split()).count(said) == 1
        assert text.count("overlap in time") == 1
    assert sum(said in note for note in json.loads(data.read_text())["notes"]) == 1
    advice = re.advise(place, "kr16")
    assert sum(note.startswith(said) for note in advice.report.notes) == 1
    assert not any("overlap" in note for note in fleet_report(tables, "fleet").notes)


def test_a_finding_is_there_once_when_the_model_changes(tables, report):
    """Halfway all robots get another model, one of them with other names of joints."""
    middle = tables.runs["start_ns"].median()
    runs = tables.runs.with_columns(
        model_id=pl.when(pl.col("start_ns") < middle).then("model_id").otherwise(pl.lit("new"))
    )
    named = runs.filter((pl.col("model_id") == "new") & (pl.col("robot") == pl.col("robot").max()))
    renamed = pl.col("key").is_in(named["key"].implode())
    runs = runs.with_columns(
        model_id=pl.when(renamed).then(pl.lit("renamed")).otherwise("model_id")
    )
    joints = tables.joints.with_columns(
        joint=pl.when(renamed).then("axis_" + pl.col("joint")).otherwise("joint")
    )
    changed = FleetTables(runs, tables.jobs, tables.hours, joints)
    found = fleet_report(changed, "fleet")
    subjects = [(one.robot, one.kind, one.subject) for one in found.findings]
    assert len(set(subjects)) == len(subjects)
    assert set(subjects) == {(one.robot, one.kind, one.subject) for one in report.findings}
    fleet, _ = identify_fleet(changed, load("kr16"), "fleet")
    assert {one.name for one in fleet.axes} == set(load("kr16").joint_names)


def test_a_fleet_without_measured_torque_has_energies_and_standby(tables, report):
    bare = tables.joints.with_columns(
        friction_rows=pl.lit(0, pl.Int64),
        **{
            name: pl.lit([], kind)
            for name, kind in tables.joints.schema.items()
            if isinstance(kind, pl.List)
        },
    )
    found = fleet_report(FleetTables(tables.runs, tables.jobs, tables.hours, bare), "fleet")
    assert found.robots == report.robots
    assert found.friction == ()
    assert [one.kind for one in found.findings] == ["standby"]


def test_one_model_from_all_bags_is_better_on_bags_it_has_not_seen(tables):
    model = load("kr16")
    found, written = identify_fleet(tables, model, "fleet")
    assert found.robots == ROBOTS - 1  # that with the other payload is left out
    better = [one for one in found.held_out if one.rms < one.rms_before]
    assert len(better) == len(found.held_out) == 6
    assert all(abs(one.energy_error) < 0.1 for one in found.held_out)
    for fit, joint in zip(found.axes, written.joints, strict=True):
        assert joint.friction.coulomb.tag == "identified"
        assert joint.friction.coulomb.value == fit.coulomb
        assert joint.friction.coulomb.std == pytest.approx(fit.coulomb_std)
        assert {"scatter", "torque"} <= set(fit.parts["coulomb"])
    assert written.provenance.bags[-1].startswith("dataset fleet: ")
    with pytest.raises(NotIdentifiableError, match="made with model"):
        identify_fleet(tables, load("ur5e"), "fleet")


def test_bags_without_temperature_take_that_of_the_model_where_others_have_one(tables, report):
    model, first = load("kr16"), tables.runs["key"][0]

    def instead(degc, where):
        joints = tables.joints.with_columns(
            motor_temperature_degc=pl.when(where)
            .then(pl.lit(degc, pl.Float64))
            .otherwise("motor_temperature_degc")
        )
        return FleetTables(tables.runs, tables.jobs, tables.hours, joints)

    one = pl.col("key") == first
    axes, filled = (
        identify_fleet(instead(degc, one), model, "fleet")[0].axes
        for degc in (None, model.temperature.fallback_degc)
    )
    assert [fit.laws for fit in axes] == [fit.laws for fit in filled]
    none = instead(None, pl.lit(True))
    assert fleet_report(none, "fleet").friction[0].degc == ()
    for fit in identify_fleet(none, model, "fleet")[0].axes:
        assert fit.law.fitted_degc is None


def test_the_command_writes_page_json_and_model(place, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    data = str(place)
    assert main(["fleet", "report", data, "--html", "f.html", "--json", "f.json"]) == 0
    html, out = (tmp_path / "f.html").read_text(), capsys.readouterr().out
    for name in PLAN.faulty():
        assert name in html
    assert html.count("<svg") or html.count("data:image/svg+xml") == 4
    assert "gravity says" in out
    assert "standby of the hour in which it has lasted a minute" in out
    assert len(json.loads((tmp_path / "f.json").read_text())["robots"]) == ROBOTS
    assert main(["fleet", "identify", data, "--model", "kr16", "--out", "m.yaml"]) == 0
    assert load("m.yaml").joints[0].friction.coulomb.tag == "identified"


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["report", "nothing"], "nothing does not exist"),
        (["report", "data", "--shifts", "14,6"], "not a rising list of hours"),
    ],
)
def test_what_cannot_be_used_is_refused(words, text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["fleet", *words]) == 2
    assert text in capsys.readouterr().err
