from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from logbook import FRICTION, GRID, LOSS_DC, LOSS_GRID, mapping, wheel_bag, write_csv
from robot_energy.foundation.errors import MissingTopicError
from robot_energy.physics.friction import with_fixed_friction
from robot_energy.replay.bag_replay import Replay, replay
from robot_energy.replay.setup import ReplaySetup, Topics
from robot_energy.results.base import SCHEMA_VERSION, count_tags
from robot_energy.results.replay import replay_report
from robot_energy_logs.log_import import import_log
from robot_energy_report.replay import beyond_constant, headline
from robot_energy_report.replay_figures import compared_series, predicted_series
from robots import figure, one_wheel, two_link

SECONDS = 10.0


def run(folder: Path, **shape: Any) -> Replay:
    return replay(wheel_bag(folder, **shape), one_wheel(), keep_curves=True)


def test_a_wheel_at_constant_speed_as_worked_out_by_hand(tmp_path: Path) -> None:
    """68 W from the grid (see logbook), the meter says 80 W: -15 %, for 10 s."""
    report = replay_report(run(tmp_path))
    energy, compared = report.energy, report.comparison
    expected = {
        "grid_import": GRID * SECONDS,
        "grid_return": 0.0,
        "rigid": 0.0,
        "friction": FRICTION * SECONDS,
        "loss_dc": LOSS_DC * SECONDS,
        "loss_grid": LOSS_GRID * SECONDS,
        "brake": 0.0,
        "sum_of_parts": GRID * SECONDS,
    }
    assert {key: getattr(energy, key) for key in expected} == pytest.approx(expected, abs=2e-5)
    assert (energy.drive_loss, energy.capacitor) == (None, None)  # the model has neither
    assert energy.balanced
    assert abs(energy.balance_residual) < 2e-5
    assert compared.predicted_energy_at_meter == pytest.approx(680.0)
    assert compared.measured_energy == pytest.approx(800.0)
    assert compared.predicted_minus_measured_energy == pytest.approx(-120.0)
    assert compared.predicted_minus_measured_relative == pytest.approx(-0.15)
    assert compared.compared_ns == report.time.observed_ns == 10_000_000_000
    # Beyond the 50 W that flow in any case: 180 J next to 300 J.
    assert compared.constant_power_at_meter == 50.0
    assert compared.beyond_constant_relative == pytest.approx(-0.4)
    joint = report.joints[0]
    assert joint.shaft_energy_positive == pytest.approx(180.0)
    assert joint.shaft_energy_negative == pytest.approx(0.0, abs=1e-5)
    assert joint.share_of_grid == pytest.approx(180.0 / 680.0)
    assert joint.last_motor_temperature_degc is None
    assert report.power.predicted_peak_grid_power == pytest.approx(GRID)
    motion = report.phases["motion"]
    assert (motion.time, motion.grid_import_energy) == pytest.approx((10.0, 680.0))
    assert report.phases["hold"].time == 0.0
    assert headline(report) == (
        "predicted 680 J, measured 800 J at the grid: -15.0 % over 10.0 s compared"
    )
    assert beyond_constant(report) == (
        "beyond the model's constant losses of 50 W: predicted 180 J, measured 300 J: -40.0 %"
    )


def test_a_meter_on_the_dc_bus_is_compared_there(tmp_path: Path) -> None:
    """38 W predicted on the bus next to 40 W measured: 380 J, 400 J, -5 %."""
    compared = replay_report(run(tmp_path, power=40.0, location="dc_bus")).comparison
    assert compared.meter_location == "dc_bus"
    assert compared.predicted_energy_at_meter == pytest.approx(380.0)
    assert compared.predicted_minus_measured_relative == pytest.approx(-0.05)
    assert compared.constant_power_at_meter == 20.0


def test_what_is_not_measured_is_null_and_said(tmp_path: Path) -> None:
    result = run(tmp_path, power=None)
    report = replay_report(result)
    compared = report.comparison
    assert compared.measured_energy is None
    assert compared.measured_mean_power is None
    assert compared.predicted_minus_measured_relative is None
    assert compared.meter_location is None
    assert "nothing measured (no meter)" in headline(report)
    assert "no power meter was read: nothing was measured" in report.notes
    assert "NaN" not in json.dumps(report.to_dict(), allow_nan=False)
    assert compared_series(result) is None


def test_json_keys_are_stable(tmp_path: Path) -> None:
    """Scripts depend on these; a change of meaning needs another schema_version."""
    report = replay_report(run(tmp_path, seconds=1.0), "friction fixed at 20 degC")
    summary = report.to_dict()
    assert list(summary) == [
        "result", "schema_version", "tool_version", "model", "energy", "power", "phases",
        "joints", "normalised", "quality", "uncertainty", "problems", "notes", "bag", "origin",
        "topics", "time", "comparison", "shaft", "payload", "inputs", "compared_with", "jobs",
        "condition", "auxiliary",
    ]  # fmt: skip
    assert (summary["result"], summary["schema_version"]) == ("replay", SCHEMA_VERSION)
    assert summary["model"]["change"] == "friction fixed at 20 degC"
    assert summary["model"]["figures"]["assumed"] == 6
    assert list(summary["inputs"]) == [
        "joint_state_messages",
        "temperature_messages",
        "temperature_values",
        "meter_messages",
        "meter_readings",
    ]
    assert all(account["balanced"] for account in summary["inputs"].values())
    assert summary["inputs"]["joint_state_messages"]["received"] == 101
    assert set(summary["topics"]) == {"joint_states", "temperatures", "meter", "payload"}


def test_a_gap_is_time_without_energy(tmp_path: Path) -> None:
    bag = wheel_bag(tmp_path, seconds=10.0)
    log = tmp_path / "wheel.csv"
    lines = log.read_text().splitlines()
    log.write_text("\n".join([*lines[:402], *lines[602:]]) + "\n")  # 4.00 s to 6.01 s

    import_log(log, mapping(), bag, overwrite=True)
    time = replay_report(replay(bag, one_wheel())).time
    assert time.span_ns == time.observed_ns + time.gap_ns == 10_000_000_000
    assert (time.gap_count, time.gap_ns) == (1, 2_010_000_000)


def test_series_end_at_the_energies_of_the_books(tmp_path: Path) -> None:
    result = run(tmp_path, rate=1000.0)  # more points than a plot takes
    pair = compared_series(result)
    assert pair is not None
    for curve, energy in zip(pair, (800.0, 680.0), strict=True):
        assert len(curve.time) <= 2000
        assert curve.energy[0] == 0.0
        assert curve.energy[-1] == pytest.approx(energy)
        assert curve.power.mean() == pytest.approx(energy / SECONDS)
    alone = predicted_series(result)
    assert alone is not None
    assert alone.energy[-1] == pytest.approx(680.0)


def test_figures_are_counted_by_how_they_are_known() -> None:
    data = one_wheel().model_dump(exclude_none=True)
    assert sum(count_tags(one_wheel()).values()) == 6
    assert data["cabinet"]["loss_dc"]["tag"] == "assumed"
    known = one_wheel(
        cabinet={"loss_grid": {**figure(1.0), "tag": "published"}, "loss_dc": figure(1.0)}
    )
    assert count_tags(known) == {"published": 1, "identified": 0, "derived": 0, "assumed": 5}
    fixed = with_fixed_friction(two_link(), 30.0)
    none = {"published": 0, "identified": 0, "derived": 0}
    assert count_tags(fixed) == {**none, "assumed": 11}  # known as its laws are


def test_a_second_topic_of_a_kind_must_be_named(tmp_path: Path) -> None:
    with pytest.raises(MissingTopicError, match="has no /other"):
        replay(
            wheel_bag(tmp_path), one_wheel(), ReplaySetup(topics=Topics(joint_states=("/other",)))
        )


def test_a_meter_that_was_reset_leaves_the_account_balanced(tmp_path: Path) -> None:
    """A counter at 68 W, reset at 5.01 s: known 5 s later, and nothing is counted until then."""
    count = [i + 9000 if i < 501 else i - 501 for i in range(1501)]
    rows = [(i / 100, 2.0 * i / 100, 2.0, 0.68 * count[i]) for i in range(1501)]
    log = write_csv(tmp_path / "log.csv", "t,q_axle,w_axle,p", rows)
    meter = {
        "location": "grid",
        "meaning": "cumulative",
        "reading": {"column": "p", "unit": "J"},
    }
    import_log(log, mapping(power=meter), tmp_path / "bag")
    report = replay_report(replay(tmp_path / "bag", one_wheel()))
    readings = report.inputs["meter_readings"]
    assert readings.rejected == {"meter_counter_low": 500}
    assert any("was reset 1 times" in note for note in report.notes)
    assert readings.balanced
    assert report.problems == ()
    assert report.comparison.compared_ns == 9_990_000_000
    assert report.comparison.predicted_minus_measured_relative == pytest.approx(0, abs=1e-6)
