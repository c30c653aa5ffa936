"""Motor temperatures from losses: against an integration, with and without sensors."""

from itertools import pairwise

import numpy as np
import pytest

import robots
from robot_energy.certainty.deviation import CABINET_DEVIATIONS
from robot_energy.condition.thermal_observer import ThermalObserver
from robot_energy.foundation.errors import StateFileError
from robot_energy.model.joint import JointFriction
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.timeline.blocks import EffortMeaning, PowerBlock, Quality, TemperatureBlock
from robots import figure

S = 10**9
CAPACITY, CONDUCTANCE = 400.0, 0.5  # J/K and W/K: time constant 800 s
AIR = 15.0
LAW = {
    "law": "exponential",
    "a": figure(0.01),
    "b": figure(0.06),
    "c": figure(25.0),
    "fitted_degc": [10.0, 90.0],
    "std": 5e-4,
}


def wheel(law=None, thermal=True, ambient=AIR, **changes):
    """The wheel with a thermal network: 40 rad/s at the motor take some tens of watts."""
    joint = {
        "name": "axle",
        "gear_ratio": figure(10.0),
        "rotor_inertia": figure(0.01),
        "friction": {"coulomb": figure(0.2), "viscous": law or LAW},
    }
    if thermal:
        joint["thermal"] = {
            "capacity": figure(CAPACITY),
            "conductance": figure(CONDUCTANCE),
            "std": 0.5,
            **changes,
        }
    temperature = {
        "fallback_degc": 40.0,
        "stale_after": 30.0,
        "ambient_degc": {**figure(ambient), "std": 2.0},
    }
    return robots.one_wheel(joints=[joint], temperature=temperature)


def turning(seconds=3600.0, period=0.5, effort=None, start=100.0):
    stamp = np.arange(start, start + seconds, period)
    position = (4.0 * (stamp - 100.0))[:, None]
    velocity = np.full((len(stamp), 1), 4.0)
    torque = None if effort is None else np.full((len(stamp), 1), effort)
    return robots.joint_block(stamp, position, velocity, np.zeros_like(velocity), torque)


def played(model, block, readings=None, cuts=(), meaning=EffortMeaning.NONE):
    pipeline = EnergyPipeline(model, Settings(effort=meaning))
    bounds = [0, *sorted(cuts), len(block)]
    parts = []
    for number, (start, stop) in enumerate(pairwise(bounds)):
        given = readings if number == 0 else None
        if stop > start:
            parts.append(pipeline.step(block[slice(start, stop)], given).power)
        elif given is not None:
            pipeline.step(None, given)
    parts.append(pipeline.flush().power)
    return pipeline, PowerBlock.concatenate([part for part in parts if part is not None])


def integrated(seconds, step=1.0, ambient=AIR):
    """Temperature by Euler's rule: 0.2 N m and fv(T) at 40 rad/s, one node."""
    degc = [ambient]
    for _ in np.arange(0.0, seconds, step):
        now = degc[-1]
        power = 0.2 * 40.0 + (0.01 + 0.06 * np.exp(-now / 25.0)) * 1600.0
        degc.append(now + step * (power - CONDUCTANCE * (now - ambient)) / CAPACITY)
    return np.array(degc)


def test_without_a_sensor_it_follows_the_losses_from_the_air_on():
    pipeline, power = played(wheel(), turning())
    expected = integrated(3600.0)
    degc = power.motor_temperature_degc[:, 0]
    at = np.array([600, 1800, 3590])
    assert degc[0] == AIR
    np.testing.assert_allclose(degc[2 * at], expected[at], atol=0.7)  # the last window's heat
    assert expected[-1] > 50.0
    assert (power.quality & np.uint32(Quality.TEMPERATURE_ESTIMATED) > 0).all()
    assert pipeline.power.fallback_use.sentence(None) == ""
    assert pipeline.condition.thermal.std[0] < 10.0


def test_its_deviation_widens_that_of_the_friction():
    model = wheel()
    pipeline, blind = played(model, turning(seconds=400.0))
    readings = TemperatureBlock(
        (np.arange(100, 500) * S).astype(np.int64), blind.motor_temperature_degc[::2][:400]
    )
    _, seen = played(model, turning(seconds=400.0), readings)
    assert (seen.quality[4:] & np.uint32(Quality.TEMPERATURE_ESTIMATED) == 0).all()
    np.testing.assert_allclose(seen.grid_power[-1], blind.grid_power[-1], rtol=0.02)
    degc, std = pipeline.condition.thermal.degc[0], pipeline.condition.thermal.std[0]
    ends = np.array([degc - std, degc + std])
    spread = 0.5 * abs(np.diff(0.06 * np.exp(-ends / 25.0))[0])
    column = CABINET_DEVIATIONS.index("temperature")
    now, then = blind.deviation[-1:], seen.deviation[-1:]
    assert now.values[now.row, column] == pytest.approx(spread * 40.0**2, rel=1e-6)
    assert then.values[then.row, column] == 0.0


def test_models_without_a_network_are_as_before():
    _, power = played(wheel(thermal=False), turning(seconds=60.0))
    assert np.isnan(power.motor_temperature_degc).all()
    assert not (power.quality & np.uint32(Quality.TEMPERATURE_ESTIMATED)).any()


@pytest.mark.parametrize("seed", range(4))
def test_any_cutting_gives_the_same(seed):
    rng = np.random.default_rng(seed)
    block = turning(seconds=300.0, effort=2.0)
    block.joint_effort[rng.random(len(block)) < 0.3] = np.nan
    stamp = block.stamp_ns
    gap, jump = sorted(rng.integers(50, len(block) - 50, 2))
    stamp[gap:] += 95 * S
    block.segment[gap:] += 1
    stamp[jump:] -= 40 * S
    block.segment[jump:] += 1
    times = np.array([110, 111, 112, 113])
    readings = TemperatureBlock(times * S, np.array([[16.0], [16.5], [17.0], [17.5]]))
    meaning = EffortMeaning.MOTOR_TORQUE
    _, whole = played(wheel(), block, readings, (), meaning)
    cuts = rng.integers(1, len(block), 40).tolist()
    _, cut = played(wheel(), block, readings, cuts, meaning)
    for name in ("motor_temperature_degc", "viscous", "grid_power", "quality"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(cut, name), err_msg=name)
    estimated = whole.quality & np.uint32(Quality.TEMPERATURE_ESTIMATED) > 0
    assert estimated.any()
    assert not estimated.all()


def test_a_sensor_that_fails_leaves_what_it_has_taught():
    """The air is 12 K warmer than the model file says; readings for 20 min say so."""
    seconds = 3600.0
    truth = integrated(seconds, ambient=AIR + 12.0)
    times = np.arange(0, 1200, 5)
    readings = TemperatureBlock((100 + times) * S, truth[times][:, None].round(1))
    block = turning(seconds)
    _, taught = played(wheel(), block, readings)
    _, blind = played(wheel(), block)
    errors = [
        np.abs(power.motor_temperature_degc[2 * 2400 :, 0] - truth[2400:3600:1].repeat(2)).mean()
        for power in (taught, blind)
    ]
    assert errors[0] < 0.35 * errors[1]


def test_friction_corrects_where_torque_is_measured():
    """The motor is in truth at 28 degC, as after work that nobody has seen."""
    viscous = 0.01 + 0.06 * np.exp(-28.0 / 25.0)
    block = turning(seconds=1800.0, effort=0.2 + viscous * 40.0)
    model = wheel(capacity=figure(1e5), conductance=figure(1.0))  # nothing warms by itself
    _, corrected = played(model, block, meaning=EffortMeaning.MOTOR_TORQUE)
    _, open_loop = played(model, block)
    start, end = open_loop.motor_temperature_degc[[0, -1], 0]
    assert end - start < 3.0
    assert corrected.motor_temperature_degc[-1, 0] > start + 3.0


def test_friction_corrects_by_its_power_of_the_speed():
    """A motor as warm as the model says, friction by the root of the speed: nothing to correct."""
    model = wheel(capacity=figure(1e5), conductance=figure(1.0))
    friction = model.joints[0].friction
    bent = {"exponent": figure(0.5), "velocity": figure(10.0)}
    entry = JointFriction.model_validate({**friction.model_dump(), "viscous_exponent": bent})
    model = model.changed(joints=[model.joints[0].model_copy(update={"friction": entry})])
    viscous = 0.01 + 0.06 * np.exp(-AIR / 25.0)
    turned = 10.0 * np.sqrt(40.0 / 10.0)  # rad/s, for a speed of 40 rad/s
    block = turning(seconds=1800.0, effort=0.2 + viscous * turned)
    _, corrected = played(model, block, meaning=EffortMeaning.MOTOR_TORQUE)
    assert corrected.motor_temperature_degc[-1, 0] == pytest.approx(AIR, abs=0.5)


def test_a_collision_is_no_temperature():
    block = turning(seconds=600.0, effort=40.0)
    model = wheel()
    _, hit = played(model, block, meaning=EffortMeaning.MOTOR_TORQUE)
    _, free = played(model, block)
    np.testing.assert_array_equal(hit.motor_temperature_degc, free.motor_temperature_degc)


def test_a_stuck_reading_is_replaced():
    """A light motor that must warm fast, and a reading that never changes."""
    block = turning(seconds=3900.0)
    readings = TemperatureBlock(
        (np.arange(100, 4000, 10) * S).astype(np.int64), np.full((390, 1), 20.0)
    )
    _, power = played(wheel(), block, readings)
    stuck = power.quality & np.uint32(Quality.TEMPERATURE_STUCK) > 0
    estimated = power.quality & np.uint32(Quality.TEMPERATURE_ESTIMATED) > 0
    assert stuck[-1]
    assert estimated[-1]
    assert (power.motor_temperature_degc[~estimated] == 20.0).all()
    assert power.motor_temperature_degc[-1, 0] > 25.0


def test_a_restart_goes_on_and_has_cooled_meanwhile():
    model = wheel()
    pipeline, _ = played(model, turning(seconds=2400.0))
    record = pipeline.condition.thermal.state()
    assert record is not None
    warm = pipeline.condition.thermal.degc[0]
    for pause, expected in ((0.0, warm), (800.0, AIR + (warm - AIR) * np.exp(-1.0))):
        again = EnergyPipeline(model)
        again.condition.thermal.restore(type(record).from_json(record.to_json()))
        start = record.end_ns / S + pause + 0.5
        again.step(turning(seconds=5.0, start=start))
        assert again.condition.thermal.degc[0] == pytest.approx(expected, abs=1.5)
    with pytest.raises(StateFileError, match="temperatures of model"):
        ThermalObserver(wheel(ambient=16.0)).restore(record)
