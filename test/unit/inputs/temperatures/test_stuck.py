"""A temperature that stands still is called stuck only when nothing else explains it."""

import math

import numpy as np
import pytest

import robots
from robot_energy.inputs.temperatures.stuck import StuckTemperatureDetector
from robot_energy.pipeline import EnergyPipeline
from robot_energy.timeline.blocks import FrictionBlock, PowerBlock, Quality, TemperatureBlock

S = 10**9
MASS = 8.0  # kg, of the wheel; its capacity 8 * 900 J/K, its conductance that over an hour
CAPACITY = MASS * 900.0
CONDUCTANCE = CAPACITY / 3600.0


def watched(power, degc, seconds, period=1.0, start=100.0):
    """First instant at which the wheel's reading is called stuck [s], or None.

    Args:
        power: Loss over time [s]. [W]
        degc: Reading over time [s]. [degC]
    """
    watch = StuckTemperatureDetector(robots.one_wheel())
    time = np.arange(0.0, seconds, period)
    stamp = np.rint((start + time) * S).astype(np.int64)
    loss = np.array([[power(t)] for t in time], dtype=float)
    reading = np.array([[degc(t)] for t in time], dtype=float)
    marks = watch.step(stamp, np.zeros(len(time), dtype=np.int64), loss, reading)
    return None if marks is None else float(time[np.argmax(marks)])


def test_a_motor_that_heats_is_expected_to_warm_within_the_time_of_the_formula():
    # x(t) = (P - G 5) / G (1 - exp(-t / 3600 s)) reaches 2 K; then the window of 10 s ends
    power = 100.0
    final = power / CONDUCTANCE - 5.0
    expected = -3600.0 * math.log(1.0 - 2.0 / final)
    found = watched(lambda t: power, lambda t: 20.0, 1200.0)
    assert found == pytest.approx(expected, abs=20.0)


@pytest.mark.parametrize(
    ("power", "degc"),
    [
        (lambda t: 0.0, lambda t: 20.0),  # idle
        (lambda t: math.nan, lambda t: 20.0),  # nothing known
        (lambda t: 9.0, lambda t: 20.0),  # less than leaves to surroundings 5 K colder
        (lambda t: 13.9, lambda t: 20.0),  # warms by less than 2 K in all
        (lambda t: 100.0, lambda t: math.nan),  # no reading
        (lambda t: 100.0, lambda t: 20.0 + t // 120),  # steps of 1 K, slowly
        (lambda t: 100.0, lambda t: 20.0 + 0.1 * (t // 60 % 2)),  # the sensor is alive
        (lambda t: 100.0, lambda t: 65.0),  # in equilibrium for all that is known
    ],
)
def test_what_is_not_stuck(power, degc):
    assert watched(power, degc, 5 * 3600.0, period=5.0) is None


def test_a_cold_idle_robot_with_whole_degrees_is_not_stuck_after_an_hour():
    stamp = np.arange(100.0, 3700.0, 1.0)
    still = np.zeros((len(stamp), 2))
    degc = np.full((len(stamp), 2), 4.0)
    pipeline = EnergyPipeline(robots.two_link())
    pipeline.step(
        robots.joint_block(stamp, still, still),
        TemperatureBlock((stamp * S).astype(np.int64), degc),
    )
    pipeline.flush()
    assert pipeline.account.counts.samples == 3600
    assert pipeline.account.counts.quality[Quality.TEMPERATURE_STUCK] == 0
    assert pipeline.power.watch.rise.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("ambient", [10.0, 20.0, 35.0])
def test_a_warm_robot_met_in_equilibrium_is_not_stuck(ambient):
    # a lumped motor of half the assumed capacity and conductance, its reading rounded
    conductance, warm = 0.5 * CONDUCTANCE, 30.0
    power = conductance * warm
    assert watched(lambda t: power, lambda t: round(ambient + warm), 6 * 3600.0, 5.0) is None


def test_a_change_clears_it():
    watch = StuckTemperatureDetector(robots.one_wheel())
    time = np.arange(0, 1200)
    loss = np.full((1200, 1), 100.0)
    degc = np.where(time < 1000, 20.0, 21.0)[:, None]
    marks = watch.step((100 + time) * S, np.zeros(1200, dtype=np.int64), loss, degc)
    assert marks is not None
    assert marks[999]
    assert not marks[1010:1150].any()  # the window in which it changed ends


def test_no_heat_counts_across_a_gap():
    watch = StuckTemperatureDetector(robots.one_wheel())
    stamp = np.array([100, 101, 5000, 5001]) * S
    loss, degc = np.full((4, 1), 100.0), np.full((4, 1), 20.0)
    watch.step(stamp, np.array([0, 0, 1, 1]), loss, degc)
    watch.step(np.array([5010 * S]), np.array([1]), loss[:1], degc[:1])
    assert watch.rise[0] < 0.1


def test_the_reading_stays_in_use_and_is_flagged():
    # the wheel at 40 rad/s (motor): 0.9 N m and more, some 50 W; the reading never changes
    stamp = np.arange(100.0, 4000.0, 0.5)
    velocity = np.full((len(stamp), 1), 4.0)
    position = (4.0 * (stamp - 100.0))[:, None]
    readings = TemperatureBlock(
        (np.arange(100, 4000, 10) * S).astype(np.int64), np.full((390, 1), 20.0)
    )
    pipeline = EnergyPipeline(robots.one_wheel())
    block = pipeline.step(robots.joint_block(stamp, position, velocity), readings)
    assert isinstance(block.friction, FrictionBlock)
    assert block.power is not None
    stuck = (block.power.quality & np.uint32(Quality.TEMPERATURE_STUCK)) > 0
    assert stuck[-1]
    assert not stuck[: len(stuck) // 15].any()
    assert (block.power.motor_temperature_degc == 20.0).all()
    assert pipeline.account.counts.quality[Quality.TEMPERATURE_STUCK] == int(stuck.sum())


def test_the_same_samples_are_flagged_however_they_are_cut():
    """Windows end within blocks and between them; the reading changes once it was stuck."""
    stamp = np.arange(100.0, 4000.0, 0.5)
    velocity = np.full((len(stamp), 1), 4.0)
    position = (4.0 * (stamp - 100.0))[:, None]
    said = np.where(np.arange(390) < 300, 20.0, 40.0)[:, None]
    readings = TemperatureBlock((np.arange(100, 4000, 10) * S).astype(np.int64), said)
    found = []
    for size in (len(stamp), 7):
        pipeline = EnergyPipeline(robots.one_wheel())
        pipeline.step(temperatures=readings)
        outputs = [
            pipeline.step(robots.joint_block(stamp[rows], position[rows], velocity[rows]))
            for rows in (slice(row, row + size) for row in range(0, len(stamp), size))
        ]
        powers = [output.power for output in (*outputs, pipeline.flush()) if output.power]
        found.append(PowerBlock.concatenate(powers).quality & np.uint32(Quality.TEMPERATURE_STUCK))
    whole, cut = found
    assert 0 < np.count_nonzero(whole) < len(whole)
    assert not whole[-1]  # it has changed
    np.testing.assert_array_equal(whole, cut)
