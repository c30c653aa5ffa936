"""The phase of a mean: that which held for the largest part of its period, by time."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from accounts import power_block
from robot_energy.accounting.account import EnergyAccount
from robot_energy.certainty.deviation import FORM, LOSS_GRID
from robot_energy.pipeline import Settings
from robot_energy.timeline.blocks import Phase

MS = 1_000_000  # ns
U, H, M, G = Phase.UNKNOWN, Phase.HOLD, Phase.MOTION, Phase.GENERATING


def phases(stamp_ms, phase, cuts=(), segment=0):
    """Phases of periods of 100 ms."""
    grid = np.where(np.asarray(phase) == U, np.nan, 10.0)
    block = power_block(np.asarray(stamp_ms, dtype=np.int64) * MS, grid, segment)
    block = replace(block, phase=np.asarray(phase, dtype=np.uint8))
    account = EnergyAccount(2, Settings(power_period=0.1))
    edges = sorted({0, len(block), *(cut for cut in cuts if cut < len(block))})
    parts = [account.step(block[slice(a, b)]) for a, b in pairwise(edges)]
    means = [part for part in (*parts, account.flush()) if part is not None]
    return [int(value) for part in means for value in part.phase]


@pytest.mark.parametrize(
    ("stamp_ms", "phase", "expected"),
    [
        # nine samples of HOLD in 20 ms, two of MOTION in 70 ms
        ([0, 2, 4, 6, 8, 10, 12, 14, 20, 50, 90], [H] * 9 + [M] * 2, [M]),
        # the last sample is not the period: 60 ms of HOLD, 30 ms of GENERATING
        ([0, 30, 60, 90], [H, H, H, G], [H]),
        # equal parts: the later
        ([0, 40, 80], [M, H, M], [M]),
        ([0, 40, 80], [M, M, H], [H]),
        # 30 ms of MOTION once and again outweigh 40 ms of HOLD
        ([0, 30, 70, 99], [M, M, H, M], [M]),
        # unknown power counts as time, but does not win by being last
        ([0, 20, 40, 60, 80], [M, M, M, M, U], [M]),
        ([0, 20, 40, 60, 80], [M, M, U, U, U], [U]),
        # the time up to the first sample of a period is that period's
        ([0, 50, 99, 160, 199], [H, H, H, M, H], [H, M]),
        # one sample alone has held for no time
        ([0], [G], []),
    ],
)
def test_the_phase_that_held_longest(stamp_ms, phase, expected):
    assert phases(stamp_ms, phase) == expected


def test_a_gap_is_no_phase():
    assert phases([0, 10, 70, 80, 90], [H, H, M, M, U], segment=[0, 0, 1, 1, 1]) == [U]
    assert phases([0, 20, 70, 80, 85], [H, H, M, M, U], segment=[0, 0, 1, 1, 1]) == [H]


def test_the_mean_power_is_what_is_drawn_less_what_is_returned():
    """60 W for 50 ms, then -20 W: trapezoids of 60, of 60 to -20 and of -20 W in equal parts."""
    power = np.array([60.0, 60.0, -20.0, -20.0])
    block = power_block(np.array([0, 25, 50, 75]) * MS, power)
    account = EnergyAccount(2, Settings(power_period=0.1))
    (mean,) = [part for part in (account.step(block), account.flush()) if part is not None]
    drawn, returned = (60.0 + 30.0) / 3.0, (10.0 + 20.0) / 3.0
    assert mean.cabinet[0, :2] == pytest.approx([drawn, returned])
    assert mean.predicted_power == pytest.approx([20.0])
    # 5 % of the power of each sample, over the time up to it
    assert mean.deviation[0, [LOSS_GRID, FORM]] == pytest.approx([4.0, (3.0 + 1.0 + 1.0) / 3.0])


@given(
    st.lists(st.tuples(st.integers(1, 60), st.sampled_from(list(Phase))), min_size=2, max_size=60),
    st.lists(st.integers(1, 60), max_size=20),
)
def test_no_other_phase_held_longer_however_the_input_is_cut(samples, cuts):
    stamp = np.cumsum([step for step, _ in samples])
    phase = [value for _, value in samples]
    found = phases(stamp, phase)
    assert phases(stamp, phase, cuts) == found
    numbers = list(dict.fromkeys((stamp // 100).tolist()))
    for number, shown in zip(numbers, found, strict=False):
        held = dict.fromkeys(Phase, 0)
        rows = [k for k in range(len(samples)) if stamp[k] // 100 == number]
        for k in rows:
            known = k > 0 and (phase[k] == U or phase[k - 1] != U)
            held[phase[k]] += int(stamp[k] - stamp[k - 1]) if known else 0
        assert held[Phase(shown)] == max(held.values())
        assert shown in [phase[k] for k in rows]
