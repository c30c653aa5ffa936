"""A fan by the levels of recordings with it and without it."""

from types import SimpleNamespace

import numpy as np
import pytest

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import load
from robot_energy.model.schema import CabinetFan, Covariance
from robot_energy_identify.cabinet import fan
from robot_energy_identify.cabinet.cabinet import with_likely_fan
from robot_energy_identify.cabinet.levels import FanLevels, level_step
from robot_energy_identify.stats.systematic import DEFAULT_LIMITS
from robots import figure

COLD = np.array([20.0, 25.0, 30.0, 35.0])  # degC, of a warm-up that ends before the fan starts


def levels(power, degc=(*COLD, 45.0, 60.0), recording=(0, 0, 0, 0, 1, 2), names="abc"):
    """A warm-up, and a recording at 45 and one at 60 degC."""
    power = np.asarray(power, dtype=float)
    number = np.asarray(recording)
    return FanLevels(tuple(names), number, np.asarray(degc), power, 1e-4 * np.eye(len(power)))


def test_a_step_of_25_watts_lies_between_the_recordings_without_it_and_with_it():
    found = level_step(levels([100.0] * 4 + [125.0] * 2))
    assert found.power == pytest.approx(25.0)
    assert (found.below, found.above, found.recordings) == (35.0, 45.0, 2)
    assert found.score > fan.BY_LEVELS_SURE


def test_a_slope_of_what_is_warm_is_not_in_the_step():
    """0.2 W/K of it, as of warm windings."""
    degc = np.array([*COLD, 45.0, 60.0])
    found = level_step(levels(100.0 + 0.2 * degc + 25.0 * (degc > 40.0)))
    assert found.power == pytest.approx(25.0)


@pytest.mark.parametrize(
    "power",
    [
        [100.0, 102.0, 104.0, 106.0, 110.0, 116.0],  # rises evenly
        [130.0, 120.0, 113.0, 108.0, 102.0, 100.0],  # falls and flattens, as friction does
        [100.0, 100.0, 100.0, 100.0, 125.0, 100.0],  # up and down
        [100.0, 100.0, 100.0, 100.0, 103.0, 103.0],  # within the errors of recordings
        [100.0, 125.0, 100.0, 125.0, 100.0, 125.0],  # not in the order of temperatures
    ],
)  # fmt: skip
def test_levels_that_something_else_explains_show_no_fan(power):
    assert level_step(levels(power)).score < fan.LIKELY


def test_a_step_within_a_recording_is_none_of_levels():
    """It may be the begin of a warm-up; whether it is a fan says the power at rest."""
    assert level_step(levels([100.0, 125.0], (20.0, 40.0), (0, 0))) is None


def test_levels_at_one_temperature_show_nothing():
    assert level_step(levels([100.0, 130.0], (40.0, 40.0), (0, 1))) is None


def test_where_the_start_lies_is_as_wide_as_the_levels_leave_it():
    """A level of 10 W of scatter may lie on either side."""
    some = levels([100.0] * 4 + [112.0, 125.0])
    some.covariance[4, 4] = 100.0
    found = level_step(some)
    assert (found.below, found.above) == (35.0, 60.0)


@pytest.mark.filterwarnings("error")
def test_no_levels_show_nothing_and_warn_of_nothing():
    assert level_step(levels([], (), ())) is None


SHORT = levels([100.0, 135.0, 135.0], (20.0, 40.0, 60.0), (0, 1, 2))
CLEAR = levels([100.0, 150.0, 150.0], (20.0, 40.0, 60.0), (0, 1, 2))
LONG = levels([100.0, 100.0, 150.0, 150.0], (20.0, 22.0, 40.0, 60.0), (0, 0, 1, 2))
MORE = levels([100.0, 100.0, 150.0, 150.0], (20.0, 22.0, 40.0, 60.0), (0, 3, 1, 2), "abcd")


def no_step(recordings):
    raise NotIdentifiableError("no step")


@pytest.mark.parametrize("some", [SHORT, CLEAR, LONG])
def test_levels_of_three_recordings_make_a_fan_likely_and_not_sure(monkeypatch, some):
    """A step and a slope leave no recording to test them, however many deviations it has."""
    monkeypatch.setattr(fan, "levels_of", lambda recordings, _: some)
    monkeypatch.setattr(fan, "_usable", lambda part: part is not None)
    monkeypatch.setattr(fan, "find_fan", no_step)
    monkeypatch.setattr(fan, "thermometers_of", lambda recordings: None)
    model = load("ur10e")
    same, found = fan.with_fan(model, [SHORT], "bags")
    assert same is model
    assert found.fan is None
    assert found.likely == pytest.approx(some.power[-1] - some.power[0])
    hot = f"{some.power[-1]:.0f} W at"
    assert "a 100 W at 20" in found.reason
    assert f"b {hot} 40 degC, c {hot} 60 degC" in found.reason
    assert "Let the warm-up go on until the fan of the cabinet runs" in found.reason


def test_levels_of_four_recordings_show_a_fan(monkeypatch):
    monkeypatch.setattr(fan, "levels_of", lambda recordings, _: MORE)
    monkeypatch.setattr(fan, "_usable", lambda part: True)
    monkeypatch.setattr(fan, "find_fan", no_step)
    monkeypatch.setattr(fan, "thermometers_of", lambda recordings: None)
    recording = SimpleNamespace(sensors=DEFAULT_LIMITS)
    _, found = fan.with_fan(load("ur10e"), [recording], "bags")
    assert found.fan.power == pytest.approx(50.0)


def test_levels_are_not_looked_at_where_the_model_has_a_fan(monkeypatch):
    monkeypatch.setattr(fan, "levels_of", lambda recordings, _: SHORT)
    monkeypatch.setattr(fan, "_usable", lambda part: part is not None)
    monkeypatch.setattr(fan, "find_fan", no_step)
    figures = {"power": figure(20.0), "on_above_degc": figure(45.0)}
    model = load("ur10e")
    given = model.cabinet.model_copy(update={"fan": CabinetFan.model_validate(figures)})
    assert fan.with_fan(model.changed(cabinet=given), [SHORT], "bags")[1].likely == 0.0


def test_a_likely_fan_is_in_the_deviation_of_power_and_energy_at_rest():
    """3 W of the figure and 4 W of the fan are 5 W, with a covariance or without one."""
    model = load("ur10e")
    side = model.cabinet.loss_grid.model_copy(update={"std": 3.0})
    model = model.changed(cabinet=model.cabinet.model_copy(update={"loss_grid": side}))
    assert with_likely_fan(model, 0.0) is model
    assert with_likely_fan(model, 4.0).cabinet.loss_grid.std == pytest.approx(5.0)
    both = Covariance(figures=("loss_dc", "loss_grid"), matrix=((10.0, -9.0), (-9.0, 9.0)))
    known = with_likely_fan(model.changed(covariance=both), 4.0)
    assert known.covariance.matrix == ((10.0, -9.0), (-9.0, 25.0))  # of their sum 1 + 16
    assert known.cabinet.loss_grid.std == pytest.approx(5.0)
