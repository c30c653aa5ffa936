"""What a meter shows late: steps of the power, restarts of the clock, cutting of the input."""

from __future__ import annotations

import numpy as np
import pytest

from robot_energy.accounting.late_meter import LateMeter

MS = 1_000_000
STAMP = np.arange(0, 2000, 10) * MS
STEP = np.where(STAMP < 1000 * MS, 100.0, 500.0)
END = np.arange(100, 2001, 100) * MS
LENGTH = np.full(len(END), 100 * MS)


def late_of(meter: LateMeter, power=STEP):
    meter.take(STAMP, power)
    meter.follow()
    return meter.of_readings(END, LENGTH)


def test_a_step_is_missed_and_then_decays():
    late = late_of(LateMeter(0.3))
    assert (late[:10] == 0.0).all()  # nothing has changed
    assert late[10] == pytest.approx(400.0)
    assert late[11] == pytest.approx(400.0)  # the greatest of the newest 0.2 s
    # From the five samples of the reading, 0.2 s and more after the step less the newest 0.2 s.
    seen = 400.0 * np.exp(-(np.arange(5) * 0.02 + 0.02) / 0.3)
    assert late[12] == pytest.approx(seen.mean(), rel=1e-6)
    assert late[-1] < 40.0


def test_a_meter_without_a_time_constant_is_never_late():
    assert (late_of(LateMeter()) == 0.0).all()


def test_a_time_constant_counts_from_when_it_is_known():
    meter = LateMeter()
    meter.learn(1500 * MS, 0.3)
    power = np.where((STAMP < 1000 * MS) | (STAMP >= 1700 * MS), 100.0, 500.0)
    late = late_of(meter, power)
    assert (late[:17] == 0.0).all()
    assert late[17] == pytest.approx(400.0)


def test_nothing_is_late_across_a_jump_of_the_clock():
    meter = LateMeter(0.3)
    late_of(meter, np.full(len(STAMP), 100.0))
    meter.jump()
    assert (late_of(meter, np.full(len(STAMP), 900.0)) == 0.0).all()


@pytest.mark.parametrize("unknown", [0, 3])
def test_cutting_makes_no_difference(unknown):
    random = np.random.default_rng(unknown)
    power = random.uniform(0.0, 900.0, len(STAMP))
    power[random.choice(len(STAMP), 20 * unknown, replace=False)] = np.nan
    whole, cut = LateMeter(0.3), LateMeter(0.3)
    for part in np.array_split(np.arange(len(STAMP)), 61):
        cut.take(STAMP[part], power[part])
        cut.follow()
    late = late_of(whole, power)
    assert (late == cut.of_readings(END, LENGTH)).all()
    periods = whole.of_periods(END, LENGTH * 1e-9)
    assert (periods == late).all()
