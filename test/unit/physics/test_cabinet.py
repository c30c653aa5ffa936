import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_energy.model import load
from robot_energy.model.figure import Figure, PositiveFigure
from robot_energy.model.schema import Cabinet, CabinetFan
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


def fan_model():
    figure = {"tag": "assumed"}
    fan = CabinetFan(
        power=PositiveFigure(value=30.0, **figure),
        on_degc=Figure(value=45.0, **figure),
        off_degc=Figure(value=40.0, **figure),
    )
    loss = PositiveFigure(value=100.0, tag="assumed")
    return Cabinet(loss_grid=loss, loss_dc=loss, fan=fan)


def test_a_fan_starts_and_stops_by_the_warmest_motor_however_it_is_cut():
    """42 degC at first is between both: half of it, with as much deviation."""
    warmest = np.array([42.0, 42.0, 39.0, 44.0, 45.0, 41.0, np.nan, 39.9, 42.0])
    degc = np.column_stack([warmest, np.full(9, 20.0)])
    degc[6] = np.nan
    share = np.array([0.5, 0.5, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0])
    stamp, segment = np.arange(9, dtype=np.int64), np.zeros(9, dtype=np.int64)
    bus = np.full(9, 50.0)
    whole = CabinetStage(fan_model()).step(stamp, segment, bus, degc)
    np.testing.assert_array_equal(whole.loss_grid, 100.0 + 30.0 * share)
    np.testing.assert_array_equal(whole.grid_power, 250.0 + 30.0 * share)
    np.testing.assert_array_equal(whole.unsure_power, np.where(share == 0.5, 15.0, 0.0))
    stage, parts = CabinetStage(fan_model()), []
    for cut in (slice(0, 1), slice(1, 4), slice(4, 7), slice(7, 9)):
        parts.append(stage.step(stamp[cut], segment[cut], bus[cut], degc[cut]).grid_power)
    np.testing.assert_array_equal(np.concatenate(parts), whole.grid_power)


def test_a_fan_without_any_temperature_counts_half():
    now = np.zeros(2, dtype=np.int64)
    balance = CabinetStage(fan_model()).step(now, now, np.full(2, 50.0))
    assert balance.grid_power.tolist() == [265.0, 265.0]
    assert balance.unsure_power.tolist() == [15.0, 15.0]


def test_a_cabinet_without_a_fan_keeps_its_identity():
    assert "fan" not in load("kr16").model_dump_json()
