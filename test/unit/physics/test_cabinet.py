import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_energy.model.schema import Cabinet
from robot_energy.physics.cabinet import CabinetStage
from robots import figure


def step(bus, period=1.0, segment=None, **extra):
    bus = np.asarray(bus, dtype=float)
    cabinet = Cabinet.model_validate(
        {"loss_grid": figure(250.0), "loss_dc": figure(150.0), **extra}
    )
    stamp = np.rint(np.arange(len(bus)) * period * 1e9).astype(np.int64)
    segment = np.zeros(len(bus), dtype=np.int64) if segment is None else np.asarray(segment)
    return CabinetStage(cabinet).step(stamp, segment, bus)


def test_both_branches_of_paper_a():
    # motoring 1000 W; generating -100 W is eaten by the DC losses; -400 W reaches the brake
    balance = step([1000.0, -100.0, -150.0, -400.0, 0.0])
    np.testing.assert_allclose(balance.grid_power, [1400.0, 300.0, 250.0, 250.0, 400.0])
    np.testing.assert_allclose(balance.brake_power, [0.0, 0.0, 0.0, 250.0, 0.0])


def test_regenerative_supply_returns_its_share():
    balance = step([-1150.0], regeneration_efficiency=figure(0.9))
    assert balance.grid_power[0] == pytest.approx(250.0 - 900.0)
    assert balance.loss_grid[0] == pytest.approx(250.0 + 100.0)
    assert balance.brake_power[0] == 0.0


CAPACITOR = {
    "capacitance": figure(2e-3),
    "nominal_voltage": figure(560.0),
    "chopper_voltage": figure(700.0),
}  # swing 0.5 * 2e-3 * (490000 - 313600) = 176.4 J


def test_capacitor_takes_excess_first_and_gives_it_back_first():
    # demand: 0, -100, -100 (76.4 J left), +50, +300 J per second
    balance = step([-150.0, -250.0, -250.0, -100.0, 150.0], capacitor=CAPACITOR)
    np.testing.assert_allclose(balance.capacitor_power, [0, 100, 76.4, -50, -126.4], rtol=1e-12)
    np.testing.assert_allclose(balance.brake_power, [0, 0, 23.6, 0, 0], atol=1e-9)
    np.testing.assert_allclose(balance.grid_power - 250, [0, 0, 0, 0, 300 - 126.4], atol=1e-9)


def test_capacitor_starts_empty_in_a_new_segment():
    balance = step([-150.0, -250.0, -50.0, -50.0], segment=[0, 0, 1, 1], capacitor=CAPACITOR)
    np.testing.assert_allclose(balance.capacitor_power, [0, 100, 0, 0])


def test_nan_stays_nan():
    balance = step([np.nan, 0.0])
    assert np.isnan(balance.grid_power[0])
    assert balance.grid_power[1] == pytest.approx(400.0)


def plain_recursion(stamp, segment, demand, swing):
    """The capacitor sample by sample, nothing skipped. [W]"""
    stored, flow = 0.0, np.zeros(len(demand))
    for k in range(len(demand)):
        if k == 0 or segment[k] != segment[k - 1]:
            stored = 0.0
        elif np.isfinite(demand[k]):
            duration = (stamp[k] - stamp[k - 1]) * 1e-9
            after = min(max(stored - demand[k] * duration, 0.0), swing)
            flow[k], stored = (after - stored) / duration, after
    return flow


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.lists(st.integers(1, 40), min_size=1, max_size=6))
def test_capacitor_is_the_plain_recursion_however_the_input_is_cut(seed, cuts):
    random = np.random.default_rng(seed)
    count = sum(cuts)
    bus = np.cumsum(random.normal(0.0, 4000.0, count))
    bus[random.random(count) < 0.05] = np.nan
    stamp = np.cumsum(random.integers(1, 9_000_000, count))
    segment = np.cumsum(random.random(count) < 0.05)
    cabinet = Cabinet.model_validate(
        {"loss_grid": figure(250.0), "loss_dc": figure(150.0), "capacitor": CAPACITOR}
    )
    stage, flow, first = CabinetStage(cabinet), [], 0
    for cut in cuts:
        rows = slice(first, first + cut)
        flow.append(stage.step(stamp[rows], segment[rows], bus[rows]).capacitor_power)
        first += cut
    expected = plain_recursion(stamp, segment, bus + 150.0, 176.4)
    np.testing.assert_allclose(np.concatenate(flow), expected, rtol=1e-9, atol=1e-6)
