"""How far a meter is behind the power in readings: steps of the power, jumps of the clock, cutting."""

from __future__ import annotations

import numpy as np
import pytest

from robot_energy.accounting.late_meter import LateMeter

MS = 1_000_000
STAMP = np.arange(0, 2000, 10) * MS
AFTER = (STAMP - 1000 * MS) * 1e-9
BEHIND = np.where(AFTER < 0.0, 0.0, -400.0 * np.exp(-AFTER / 0.3))  # a step of 400 W
END = np.arange(100, 2001, 100) * MS
LENGTH = np.full(len(END), 100 * MS)


def test_a_step_is_missed_and_then_decays():
    meter = LateMeter()
    meter.take(STAMP, BEHIND)
    late = meter.of_readings(END, LENGTH)
    assert (late[:10] == 0.0).all()  # nothing has changed
    assert late[10] == pytest.approx(400.0)
    assert late[11] == pytest.approx(400.0)  # the greatest of the newest 0.2 s
    # From the five samples of the reading, 0.2 s and more after the step less the newest 0.2 s.
    seen = 400.0 * np.exp(-(np.arange(5) * 0.02 + 0.02) / 0.3)
    assert late[12] == pytest.approx(seen.mean(), rel=1e-6)
    assert late[-1] < 40.0


def test_nothing_is_late_across_a_jump_of_the_clock():
    meter = LateMeter()
    meter.take(STAMP, BEHIND)
    meter.jump()
    meter.take(STAMP, np.zeros(len(STAMP)))
    assert (meter.of_readings(END, LENGTH) == 0.0).all()


def test_cutting_makes_no_difference():
    random = np.random.default_rng(0)
    behind = random.uniform(-900.0, 900.0, len(STAMP))
    whole, cut = LateMeter(), LateMeter()
    whole.take(STAMP, behind)
    for part in np.array_split(np.arange(len(STAMP)), 61):
        cut.take(STAMP[part], behind[part])
    late = whole.of_readings(END, LENGTH)
    assert (late == cut.of_readings(END, LENGTH)).all()
    assert (whole.of_periods(END, LENGTH * 1e-9) == late).all()
