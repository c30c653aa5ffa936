"""Friction that follows the gear: against an integration, a wrong start, restarts, wear."""

import numpy as np
import pytest

import robots
from robot_energy.certainty.deviation import TEMPERATURE
from robot_energy.condition.thermal_state import AMBIENT, GEAR, ThermalState
from robot_energy.model.schema import TemperatureSettings
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.timeline.blocks import (
    EffortMeaning,
    Learning,
    MeterBlock,
    MeterLocation,
    MeterMeaning,
    PowerBlock,
    Quality,
    TemperatureBlock,
)
from warm_wheel import (
    AIR,
    CAPACITY,
    COULOMB,
    MOTOR,
    SPEED,
    TO_AIR,
    TO_MOTOR,
    S,
    integrated,
    readings,
    turning,
    viscous,
    wheel,
)

WORKED = 45.0  # degC of a motor that has worked: its gear may be warmer or colder


def played(pipeline, block, temperatures, cut=None, meter=None):
    parts = []
    for first in range(0, len(block), cut or len(block)):
        part = block[slice(first, first + (cut or len(block)))]
        until = int(part.stamp_ns[-1])
        after = int(part.stamp_ns[0]) - 1 if first else 0
        due = (temperatures.stamp_ns <= until) & (temperatures.stamp_ns > after)
        if cut is None:
            due[:] = True
        given = temperatures[due] if due.any() else None
        parts.append(pipeline.step(part, given, meter if first == 0 else None).power)
    parts.append(pipeline.flush().power)
    return PowerBlock.concatenate([part for part in parts if part is not None])


def test_friction_follows_the_gear_that_its_own_heat_warms():
    power = played(EnergyPipeline(wheel()), turning(1800.0), readings(1800))
    expected = integrated(1800.0, MOTOR, MOTOR)
    fitted = viscous(expected)
    at = np.array([0, 5, 600, 1800, 3590])
    # a window of 10 s late at most: the gear rises by up to 0.9 K in it
    np.testing.assert_allclose(power.viscous[at, 0], fitted[at], rtol=0.045)
    assert power.viscous[3590, 0] == pytest.approx(fitted[3590], rel=2e-3)
    assert expected[3590] > MOTOR + 20.0
    assert (power.motor_temperature_degc == MOTOR).all()


def test_without_a_gear_it_follows_the_motor():
    power = played(EnergyPipeline(wheel(gear=False)), turning(60.0), readings(60))
    np.testing.assert_allclose(power.viscous[2:, 0], viscous(MOTOR))


@pytest.mark.parametrize("cut", [1, 7, 61])
def test_any_cutting_gives_the_same_bits(cut):
    block, degc = turning(120.0), readings(120)
    whole = played(EnergyPipeline(wheel()), block, degc)
    parts = played(EnergyPipeline(wheel()), block, degc, cut=cut)
    np.testing.assert_array_equal(whole.viscous, parts.viscous)
    np.testing.assert_array_equal(whole.grid_power, parts.grid_power)


def test_a_thermometer_that_reads_too_high_shifts_its_gear_and_no_deviation():
    offset, model = 5.0, wheel()
    gear = model.joints[0].gear
    found = []
    for shift in (0.0, offset):
        own = gear.model_copy(update={"ambient_offset": shift or None})
        state = ThermalState([None], [own], model.temperature)
        for _ in range(60):
            state.work(np.zeros(1), np.array([500.0]))
            state.take_sensed(np.array([MOTOR + shift]), np.array([True]))
            if not state.begun.any():
                state.begin_gears(np.array([True]), state.x[:, 0].copy())
        state.cool(1800 * S)
        found.append((state.x[0, GEAR], state.std(GEAR)[0]))
    (degc, std), (high, high_std) = found
    assert AIR < degc < MOTOR + 20.0
    assert high - degc == pytest.approx(offset, rel=1e-9)
    assert high_std == pytest.approx(std, rel=1e-9)


def test_a_temperature_corrects_by_its_share_of_what_is_not_known():
    """5 K of the motor and 3 K of the air, together 34 K^2, against a thermometer of 4 K^2."""
    model = wheel()
    state = ThermalState(
        [None] * 2, [model.joints[0].gear] * 2, TemperatureSettings(fallback_degc=22.0)
    )
    before, other = state.x[0].copy(), state.covariance[1].copy()
    state.correct(0, before[:1] + 19.0, np.array([4.0, np.inf]))
    assert state.x[0, 0] - before[0] == pytest.approx(19.0 * 34.0 / 38.0)
    assert state.x[0, AMBIENT] - before[AMBIENT] == pytest.approx(19.0 * 9.0 / 38.0)
    assert state.std(0)[0] ** 2 == pytest.approx(34.0 * 4.0 / 38.0)
    assert state.std(AMBIENT)[0] ** 2 == pytest.approx(9.0 - 9.0**2 / 38.0)
    np.testing.assert_array_equal(state.covariance[1], other)


def test_the_range_of_the_law_is_that_of_the_gear():
    pipeline = EnergyPipeline(wheel(hottest=60.0))
    power = played(pipeline, turning(3600.0), readings(3600, 45.0))
    beyond = (power.quality & np.uint32(Quality.EXTRAPOLATED)) > 0
    assert not beyond[:20].any()  # the gear begins at 45 degC
    assert beyond[-1]
    assert pipeline.condition.thermal.friction_degc[0] > 60.0


def torque_of(degc):
    return COULOMB + viscous(degc) * SPEED


def test_measured_torque_corrects_a_wrong_start():
    truth = integrated(1200.0, MOTOR, MOTOR + 8.0)
    settings = Settings(effort=EffortMeaning.MOTOR_TORQUE)
    block = turning(1200.0, effort=torque_of(truth))
    blind = played(EnergyPipeline(wheel()), block, readings(1200))
    determined = played(EnergyPipeline(wheel(), settings), block, readings(1200))
    true = viscous(truth)[: len(block)]
    off = [abs(power.viscous[:, 0] / true - 1.0) for power in (blind, determined)]
    at = 2 * 300
    assert off[0][at] > 0.06
    assert off[1][at] < 0.5 * off[0][at]


def _meter(stamp_ns, power):
    unknown = np.full(len(stamp_ns), np.nan)
    kind = MeterMeaning.INSTANTANEOUS, MeterLocation.GRID
    return MeterBlock(stamp_ns, power, unknown, unknown, *kind)


@pytest.mark.parametrize("learning", [Learning.OFF, Learning.OBSERVE])
@pytest.mark.parametrize("cut", [None, 61])
def test_a_prediction_has_not_seen_the_meter_that_it_is_compared_with(learning, cut):
    """The meter reads a fifth too much, and the whole fifth is the error that is shown."""
    block, degc = turning(1200.0), readings(1200, WORKED)
    alone = played(EnergyPipeline(wheel(), Settings(learning=learning)), block, degc)
    meter = _meter(alone.stamp_ns, 1.2 * alone.grid_power)
    pipeline = EnergyPipeline(wheel(), Settings(learning=learning))
    pipeline.account.measure(meter)
    read = played(pipeline, block, degc, cut, meter)
    for name in ("grid_power", "viscous", "quality"):
        np.testing.assert_array_equal(getattr(read, name), getattr(alone, name))
    assert not (read.quality & np.uint32(Quality.LEARNED)).any()


@pytest.mark.long
def test_friction_that_stays_high_is_not_taken_for_a_cold_gear():
    """Wear of 15 %: once the start is forgotten, the temperature stays that of the figures."""
    truth = integrated(3 * 3600.0, MOTOR, MOTOR)
    settings = Settings(effort=EffortMeaning.MOTOR_TORQUE)
    worn = turning(3 * 3600.0, effort=1.15 * torque_of(truth))
    pipeline = EnergyPipeline(wheel(), settings)
    played(pipeline, worn, readings(3 * 3600))
    assert pipeline.condition.thermal.friction_degc[0] == pytest.approx(truth[-1], abs=1.0)


def test_a_restart_goes_on_where_it_was():
    first = EnergyPipeline(wheel())
    played(first, turning(1800.0), readings(1800))
    record = first.condition.thermal.state()
    warm = first.condition.thermal.friction_degc[0]
    again = EnergyPipeline(wheel())
    again.condition.thermal.restore(type(record).from_json(record.to_json()))
    later = turning(30.0, start=1910.0)
    power = played(again, later, readings(30, start=1910))
    assert power.viscous[0, 0] == pytest.approx(viscous(warm), rel=0.02)
    rested = EnergyPipeline(wheel())
    rested.condition.thermal.restore(record)
    hours = turning(30.0, start=1900.0 + 6 * 3600.0)
    played(rested, hours, readings(30, 20.0, start=1900 + 6 * 3600))
    assert rested.condition.thermal.friction_degc[0] < AIR + 3.0
    assert rested.condition.thermal.friction_std[0] < 3.0  # the air may have changed by 2.4 K


def test_a_gear_that_was_not_known_before_a_restart_begins_at_its_motor():
    """No temperature was read for a minute; after the restart the motor has 60 degC."""
    blind = EnergyPipeline(wheel())
    blind.step(turning(60.0))
    blind.flush()
    record = blind.condition.thermal.state()
    again, fresh = EnergyPipeline(wheel()), EnergyPipeline(wheel())
    again.condition.thermal.restore(type(record).from_json(record.to_json()))
    for pipeline in (again, fresh):
        played(pipeline, turning(15.0, start=170.0), readings(15, 60.0, start=170))
    kept, new = again.condition.thermal, fresh.condition.thermal
    assert kept.friction_degc[0] == pytest.approx(new.friction_degc[0], abs=0.1)
    assert kept.friction_std[0] == pytest.approx(new.friction_std[0], rel=0.05)


@pytest.mark.parametrize("off", [0.0, 25.0])
def test_after_a_restart_the_deviation_goes_on_unless_a_motor_is_elsewhere(off):
    first, again = EnergyPipeline(wheel(std=0.0)), EnergyPipeline(wheel(std=0.0))
    played(first, turning(1800.0), readings(1800, WORKED))
    kept = first.condition.thermal.friction_std[0]
    again.condition.thermal.restore(first.condition.thermal.state())
    played(again, turning(15.0, start=1905.0), readings(15, WORKED + off, start=1905))
    now = again.condition.thermal.friction_std[0]
    assert now == pytest.approx(np.hypot(kept, 0.3 * off), rel=0.05)


def test_a_wider_start_widens_the_deviation():
    model = wheel(std=0.0)
    cold, warm = EnergyPipeline(model), EnergyPipeline(model)
    played(cold, turning(15.0), readings(15, AIR))
    played(warm, turning(15.0), readings(15, AIR + 25.0))
    assert warm.condition.thermal.friction_std[0] > 3.0 * cold.condition.thermal.friction_std[0]


def test_before_a_gear_has_begun_its_unknown_temperature_is_in_the_deviation():
    block, degc = turning(8.0), readings(8)
    known = played(EnergyPipeline(wheel(gear=False)), block, degc)
    first = played(EnergyPipeline(wheel()), block, degc)
    assert (first.viscous == known.viscous).all()
    apart, alone = (np.asarray(power.deviation)[2:, TEMPERATURE] for power in (first, known))
    assert (alone == 0.0).all()
    spread = 0.5 * (viscous(AIR - 5.0) - viscous(AIR + 5.0)) / viscous(AIR)  # of an earlier run
    assert apart == pytest.approx(spread * viscous(MOTOR) * SPEED**2, rel=0.03)


def _shoulder(seconds, gear, motor=WORKED, torque=None, factor=1.0, read=None):
    """Power of an arm whose shoulder turns and has no gear, but its elbow may have one."""
    data = robots.two_link_data()
    for figure in ("a", "b"):
        data["joints"][0]["friction"]["viscous"][figure]["value"] *= factor
    if gear:
        data["joints"][1]["gear"] = wheel().joints[0].gear.model_dump()
    ambient = {**robots.figure(AIR), "std": 0.5}
    model = robots.two_link(
        joints=data["joints"], temperature={"fallback_degc": AIR, "ambient_degc": ambient}
    )
    stamp = np.arange(100.0, 100.0 + seconds, 0.5)
    velocity = np.column_stack([np.ones(len(stamp)), np.zeros(len(stamp))])
    block = robots.joint_block(
        stamp, velocity * stamp[:, None], velocity, np.zeros_like(velocity), torque
    )
    at = np.arange(100, 100 + (read or seconds))
    degc = TemperatureBlock(at * S, np.tile(motor + 0.1 * (at % 2), (2, 1)).T)  # is not stuck
    effort = EffortMeaning.NONE if torque is None else EffortMeaning.MOTOR_TORQUE
    return played(EnergyPipeline(model, Settings(effort=effort)), block, degc)


def _shoulder_law(degc):
    return 1e-4 + 1e-3 * np.exp(-degc / 20.0)


def _spread(power):
    return np.asarray(power.deviation)[:, TEMPERATURE]


def test_a_joint_whose_gear_no_recording_shows_has_the_deviation_of_its_start():
    """It is as wide as of joints whose gear is known, and fades with the slowest of these."""
    geared, without = (_shoulder(1200, gear) for gear in (True, False))
    assert (geared.viscous == without.viscous).all()  # its friction is still that of the motor
    assert (_spread(without) == 0.0).all()
    spread, law = _spread(geared), _shoulder_law
    start = 1.0 + 0.3 * (WORKED - AIR)
    time = CAPACITY / (TO_MOTOR + TO_AIR)
    for at in (11.0, 600.0, 1150.0):
        off = start * np.exp(-(at // 10.0 - 1.0) * 10.0 / time)
        expected = 0.5 * (law(WORKED - off) - law(WORKED + off)) * 100.0**2
        assert spread[round(at / 0.5)] == pytest.approx(expected, rel=0.02)


def test_a_cold_joint_whose_gear_no_recording_shows_is_as_warm_as_its_motor():
    warm, cold = (_spread(_shoulder(20, True, motor))[-1] for motor in (WORKED, AIR))
    assert 0.0 < cold < 0.4 * warm


def test_torque_corrects_a_joint_whose_gear_no_recording_shows():
    """The oil of the shoulder is 8 K warmer than its motor, and stays so."""
    factor = 50.0  # much friction
    blind = _shoulder(1200, True, factor=factor)
    true = factor * _shoulder_law(WORKED + 8.0)
    less = true - factor * _shoulder_law(WORKED)
    given = {"torque": blind.motor_torque + np.array([less * 100.0, 0.0])}
    corrected = _shoulder(1200, True, factor=factor, **given)
    assert 0.0 < corrected.viscous[1200, 0] - true < -0.5 * less  # after ten minutes
    assert _spread(corrected)[1200] < 0.8 * _spread(blind)[1200]
    without = _shoulder(1200, False, factor=factor, **given)
    assert (without.viscous == blind.viscous).all()


def test_a_corrected_joint_falls_back_where_its_thermometer_is_silent():
    """Its gear is known as a difference from its motor, and of the motor nothing is known."""
    blind = _shoulder(1200, True, read=300)
    warmer = (_shoulder_law(WORKED + 8.0) - _shoulder_law(WORKED)) * 100.0
    given = {"torque": blind.motor_torque + np.array([warmer, 0.0])}
    power = _shoulder(1200, True, read=300, **given)
    assert power.viscous[500, 0] != blind.viscous[500, 0]  # corrected while the motor is read
    assert np.isnan(power.motor_temperature_degc[-1, 0])
    assert power.viscous[-1, 0] == blind.viscous[-1, 0]
