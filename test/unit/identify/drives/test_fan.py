"""Losses of each axis and a fan, from readings whose losses are known (solved by hand)."""

from dataclasses import replace

import numpy as np
import pytest

from robot_energy.model import load
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import MeterLocation
from robot_energy_identify.drives.drive_data import DriveData
from robot_energy_identify.drives.fan import with_fan
from robot_energy_identify.drives.total_power import fit_structure, fit_total, predict
from robot_energy_identify.drives.total_sums import Sums, _scale
from robot_energy_identify.stats.systematic import SensorLimits

COPPER = np.array([6.0, 2.0, 3.0])  # W/(N m)^2, of axes that are taken for alike
CONSTANT, FAN = 80.0, 25.0  # W
ROWS = 400


@pytest.fixture
def readings():
    """Rest and motion in turns, 25 to 44 and 46 to 65 degC; the third axis is hardly loaded.

    In motion the meter is off by 5 % of what is moved, and 30 W too high on average.
    """
    random = np.random.default_rng(7)
    terms = np.zeros((ROWS, 3, 3))
    moving = np.arange(ROWS) // 10 % 2 == 1
    terms[:, 0] = np.repeat(random.uniform(0.0, 8.0, (ROWS // 10, 3)), 10, axis=0)
    terms[:, 0, 2] *= 1e-3
    terms[moving, 1] = random.uniform(20.0, 200.0, (int(moving.sum()), 3))
    moved = np.where(moving, 1500.0, 0.0)
    off = np.where(moving, random.normal(30.0, 75.0, ROWS), random.normal(0.0, 0.5, ROWS))
    measured = CONSTANT + terms[:, 0] @ COPPER + 0.1 * terms[:, 1].sum(axis=1) + off
    degc = np.repeat(np.concatenate([np.linspace(25, 44, 20), np.linspace(46, 65, 20)]), 10)
    unknown = np.full(ROWS, np.nan)
    return Sums(
        ("one", "two", "three"), MeterLocation.GRID, np.ones(ROWS), measured, np.zeros(ROWS),
        terms, unknown, unknown, np.arange(ROWS) // 200, np.arange(ROWS) // 10, np.ones((3, 3)),
        np.zeros((ROWS, 3)), moved, degc, np.zeros(ROWS), SensorLimits(0, 0, 0, 0, 0),
    )  # fmt: skip


def test_each_axis_has_the_copper_loss_that_rest_shows(readings):
    """What axes share is some 4 W/(N m)^2: up to 20 W wrong at rest."""
    fit = fit_total(readings)
    assert fit.structure == "axis"
    np.testing.assert_allclose(fit.coefficients[0, :2], COPPER[:2], rtol=0.02)
    assert fit.constant == pytest.approx(CONSTANT, abs=1.0)
    shared = fit_structure(readings, "shared")
    assert fit.coefficients[0, 2] == pytest.approx(shared.coefficients[0, 2], rel=0.1)
    assert fit.deviations[0, 2] > 10.0 * fit.deviations[0, 0]  # not loaded, so not known
    rest = readings.moved == 0.0
    error = (predict(readings, fit) - readings.measured)[rest]
    worse = (predict(readings, shared) - readings.measured)[rest]
    assert np.sqrt((error**2).mean()) < 0.1 * np.sqrt((worse**2).mean())


def test_a_fan_is_found_where_it_starts(readings):
    runs = readings.warmest_degc >= 45.0
    found, fan = with_fan(replace(readings, measured=readings.measured + FAN * runs))
    assert fan is not None
    assert fan.on_degc - fan.hysteresis / 2.0 == pytest.approx(45.0, abs=5.0)
    assert (found.fan == runs).mean() > 0.95
    fit = fit_total(found)
    assert fit.fan == pytest.approx(FAN, abs=1.0)
    assert fit.constant == pytest.approx(CONSTANT, abs=1.0)


def test_no_fan_is_found_where_none_is(readings):
    assert with_fan(readings) == (readings, None)


def test_motors_without_known_losses_lose_the_same_share_of_their_greatest_power():
    model = load("kr16")
    limits = Robot.from_model(model).limits
    ratio = np.abs([joint.gear_ratio.value for joint in model.joints])
    torque, speed = limits.effort / ratio, limits.velocity * ratio
    data = DriveData(model.joint_names, *[np.zeros(0)] * 11)
    scale = _scale(data, model)
    share = scale * np.stack([torque**2, speed, speed**2]) / (torque * speed)
    np.testing.assert_allclose(share, np.ones((3, 6)))
