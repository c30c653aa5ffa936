import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_energy.model import load
from robot_energy.model.figure import Figure
from robot_energy.model.schema import Cabinet
from robot_energy.physics.drives_and_cabinet import CabinetStage, FanStage
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


def cabinet_with_fan(hysteresis=None, **known):
    fan = {"power": figure(30.0), "on_above_degc": {**figure(45.0), **known}}
    fan["hysteresis"] = hysteresis or figure(5.0)
    return Cabinet.model_validate(
        {"loss_grid": figure(250.0), "loss_dc": figure(150.0), "fan": fan}
    )


def test_a_fan_starts_above_its_temperature_and_stops_below_the_hysteresis_however_it_is_cut():
    """42 degC at first lies between 40 and 45 degC: half of 30 W. Cold motors change nothing."""
    warmest = np.array([42.0, 39.0, 45.0, 45.5, 41.0, np.nan, 40.0, 42.0])
    degc = np.column_stack([warmest, np.where(np.isnan(warmest), np.nan, 20.0)])
    expected = [15.0, 0.0, 0.0, 30.0, 30.0, 30.0, 0.0, 0.0]
    cabinet = cabinet_with_fan()
    assert FanStage(cabinet).step(degc).tolist() == expected
    stage = FanStage(cabinet)
    parts = [stage.step(degc[first:last]) for first, last in ((0, 1), (1, 4), (4, 5), (5, 8))]
    assert np.concatenate(parts).tolist() == expected
    now = np.arange(8)
    balance = CabinetStage(cabinet).step(
        now, np.zeros(8, int), np.full(8, -400.0), np.array(expected)
    )
    np.testing.assert_allclose(
        balance.grid_power, 250.0 + np.array(expected)
    )  # while it brakes, too
    np.testing.assert_allclose(balance.brake_power, 250.0)


def test_within_its_deviation_a_fan_counts_by_the_probability_that_it_runs():
    """Uniform from 45 - 3 to 45 + 3 K: 43.5 degC are warmer than a quarter of it."""
    stage = FanStage(cabinet_with_fan(std=3.0 / np.sqrt(3.0)))
    warmest = np.array([30.0, 43.5, 42.0, 46.5, 50.0, 42.5, 41.5, 30.0])
    expected = [0.0, 7.5, 7.5, 22.5, 30.0, 27.5, 22.5, 0.0]
    np.testing.assert_allclose(stage.step(warmest[:, None]), expected, atol=1e-12)


def test_at_the_first_temperature_half_of_the_fans_between_stop_and_start_run():
    """It stops uniformly from 37 to 43 and starts from 42 to 48 degC, 5 K above.

    At 42 degC 5/6 have not stopped and none has started: 5/12 of 30 W run.
    """
    stage = FanStage(cabinet_with_fan(std=3.0 / np.sqrt(3.0)))
    unknown = np.full((1, 1), np.nan)
    np.testing.assert_allclose(stage.step(unknown), 15.0)
    np.testing.assert_allclose(stage.step(np.array([[42.0], [42.0], [43.5]])), [12.5, 12.5, 12.5])


def test_up_to_the_begin_of_a_recording_without_it_a_fan_does_not_run_at_first():
    """At 42 degC none runs. From 42.5 degC on half between stop and start run: 1/2 (11/12 + 1/12).

    Later it stays as it was between the two, wherever recordings began.
    """
    cabinet = cabinet_with_fan(std=3.0 / np.sqrt(3.0))
    begins = Figure(value=42.0, tag="identified")
    fan = cabinet.fan.model_copy(update={"begins_off_to_degc": begins})
    known = cabinet.model_copy(update={"fan": fan})
    for degc, of_known, of_unknown in ((42.0, 0.0, 12.5), (42.5, 15.0, 15.0), (30.0, 0.0, 0.0)):
        assert FanStage(known).step(np.array([[degc]])) == pytest.approx(of_known)
        assert FanStage(cabinet).step(np.array([[degc]])) == pytest.approx(of_unknown)
    stage = FanStage(known)
    np.testing.assert_allclose(stage.step(np.array([[42.0]])), [0.0])
    np.testing.assert_allclose(stage.powers, [[0.0], [12.5]])  # the second without that begin
    np.testing.assert_allclose(stage.step(np.array([[42.0], [50.0], [42.0]])), [0.0, 30.0, 25.0])
    np.testing.assert_allclose(stage.powers, [[0.0, 30.0, 25.0], [12.5, 30.0, 25.0]])
    without = cabinet.fan.model_dump_json()
    assert "begins_off" not in without
    assert "begins_off" in fan.model_dump_json()


def test_the_warmest_motor_is_that_of_the_highest_reading_less_what_its_thermometer_is_off():
    """Readings of 45.5 and 46 degC are 44 and 46.5 degC; temperatures that are assumed stay."""
    cabinet = cabinet_with_fan()
    fan = cabinet.fan.model_copy(update={"thermometers": (1.5, -0.5)})
    known = cabinet.model_copy(update={"fan": fan})
    for degc, by_readings, assumed in (
        ([39.0, 39.0], 0.0, 0.0),
        ([45.5, 44.0], 15.0, 30.0),  # 44 and 44.5 degC
        ([45.5, np.nan], 15.0, 30.0),
        ([44.0, 45.0], 30.0, 15.0),  # 42.5 and 45.5 degC
    ):
        row = np.array([degc])
        assert FanStage(known).step(row) == pytest.approx(by_readings)
        assert FanStage(known, assumed=True).step(row) == pytest.approx(assumed)
    assert "thermometers" not in cabinet.fan.model_dump_json()


def test_what_a_meter_shows_counts_where_the_temperature_leaves_it_open():
    """At 42 degC 5/12 run without the begins of recordings, and 0 with them.

    Of odds of 3 the first are believed to (3 - 1) / (3 + 1), which is 5/24, and 15/34 run.
    """
    cabinet = cabinet_with_fan(std=3.0 / np.sqrt(3.0))
    begins = Figure(value=42.0, tag="identified")
    fan = cabinet.fan.model_copy(update={"begins_off_to_degc": begins})
    stage = FanStage(cabinet.model_copy(update={"fan": fan}))
    stage.odds = 3.0
    np.testing.assert_allclose(stage.step(np.array([[42.0]])), [30.0 * 15.0 / 34.0])
    np.testing.assert_allclose(stage.powers, [[30.0 * 15.0 / 34.0], [30.0 * 15.0 / 22.0]])
    np.testing.assert_allclose(stage.step(np.array([[50.0], [30.0]])), [30.0, 0.0])
    stage.odds = 1.0
    np.testing.assert_allclose(stage.step(np.array([[50.0], [42.0]])), [30.0, 25.0])


def test_a_meter_that_says_nothing_leaves_the_fan_as_it_was():
    """A recording that began at 42 degC without the fan counts until a meter says the contrary."""
    cabinet = cabinet_with_fan(std=3.0 / np.sqrt(3.0))
    begins = Figure(value=42.0, tag="identified")
    fan = cabinet.fan.model_copy(update={"begins_off_to_degc": begins})
    stage, powers = FanStage(cabinet.model_copy(update={"fan": fan})), []
    for odds in (1.0 - 1e-9, 1.0, 1.0 + 1e-9, np.exp(20.0)):
        stage.odds = odds
        stage.step(np.array([[42.0]]))
        powers.append(stage.powers[:, 0])
    np.testing.assert_allclose(powers[:3], [[0.0, 12.5]] * 3, atol=1e-7)
    np.testing.assert_allclose(powers[3], [30.0, 30.0], atol=1e-6)


def test_above_its_start_a_fan_runs_even_if_its_hysteresis_is_smaller_than_the_deviation_of_that():
    """It stops uniformly from 44 - 3.5 to 44 + 3.5 degC, which 45.1 degC does not exclude."""
    stage = FanStage(cabinet_with_fan({**figure(1.0), "std": 2.0}))
    assert stage.step(np.array([[30.0], [45.1], [45.0]])).tolist()[:2] == [0.0, 30.0]


def test_a_fan_without_any_temperature_counts_half():
    assert FanStage(cabinet_with_fan()).step(np.full((2, 3), np.nan)).tolist() == [15.0, 15.0]


def test_a_cabinet_without_a_fan_keeps_its_identity():
    assert "fan" not in load("kr16").model_dump_json()
    assert FanStage(load("kr16").cabinet).step(np.full((2, 6), 90.0)) == 0.0
