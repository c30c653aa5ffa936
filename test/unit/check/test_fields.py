"""Fields that are not of one instant, stand still or have no sign are named."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mistakes import Change, rewrite, scaled
from places import ROOT
from refusals import refused
from robot_energy.foundation.errors import ImplausibleIdentificationError
from robot_energy.model import load
from robot_energy.timeline.blocks import (
    EffortMeaning,
    Float,
    Int,
    MeterBlock,
    MeterLocation,
    MeterMeaning,
    TorqueBlock,
)
from robot_energy_identify.check import check
from robot_energy_identify.check.effort import check_effort
from robot_energy_identify.check.evidence import Remarks, evidence_of
from robot_energy_identify.check.field_lag import field_lag
from robot_energy_identify.check.finding import PARAMETERS
from robot_energy_identify.check.meter import check_meter, readings_once
from robot_energy_identify.data.recordings import read_recording
from robot_energy_identify.refused_recordings import _evidence_of, on_one_clock, refuse_motion
from sound_recordings import read_with

SOUND = ROOT / "bags/kr16_cold"
SECONDS, RATE = 20.0, 250
MODEL, MOTOR_TORQUE = load("kr16"), EffortMeaning.MOTOR_TORQUE
JOINT = 1
TIME = np.arange(2000) * 0.01  # s
FRO = np.sin(2.0 * np.pi * TIME / 3.0 + 0.1)  # rad/s and N m: to and fro
POSITIONS = "velocity_source: positions"


def late(field: str, seconds: float) -> Change:
    seen: list[Any] = []

    def change(message: Any) -> None:
        seen.append(getattr(message, field).copy())
        setattr(message, field, seen[max(0, len(seen) - 1 - round(seconds * RATE))])

    return change


def filtered(field: str, seconds: float) -> Change:
    state: list[Any] = []

    def change(message: Any) -> None:
        values = getattr(message, field)
        before = state[-1] if state else values
        state[:] = [before + (values - before) / (1.0 + seconds * RATE)]
        setattr(message, field, state[0].copy())

    return change


def held(field: str, begin: float, end: float) -> Change:
    seen: list[float] = []

    def change(message: Any) -> None:
        values = getattr(message, field).copy()
        seen.append(float(values[JOINT]))
        if begin * RATE < len(seen) < end * RATE:
            values[JOINT] = seen[round(begin * RATE)]
            setattr(message, field, values)

    return change


def unsigned(message: Any) -> None:
    message.effort = np.abs(message.effort)


CASES = {
    "velocities filtered": ("velocity_late", filtered("velocity", 0.05), POSITIONS),
    "velocity held": ("velocity_apart", held("velocity", 5.0, 12.0), POSITIONS),
    "position held": ("position_held", held("position", 5.0, 12.0), "leave this recording out"),
    "effort late": ("effort_late", late("effort", 0.2), "of one instant"),
    "effort held": ("effort_held", held("effort", 5.0, 12.0), "leave this recording out"),
    "effort without a sign": ("effort_unsigned", unsigned, "with its sign"),
}


@pytest.mark.parametrize("name", CASES)
def test_a_field_that_is_off_is_named_alone_and_refused(name, tmp_path):
    cause, change, remedy = CASES[name]
    bag = rewrite(SOUND, tmp_path / "bag", change, None, SECONDS)
    (found,) = check(bag, MODEL, MOTOR_TORQUE).errors
    assert found.cause == cause
    assert remedy in found.remedy
    if found.remedy_in == PARAMETERS:
        mended = check(bag, MODEL, MOTOR_TORQUE, read_with(found.remedy, tmp_path / "x.yaml"))
        assert not mended.errors
    with refused(ImplausibleIdentificationError, found=found.sentence, remedy=remedy[1:]):
        refuse_motion(read_recording(bag, MODEL, MOTOR_TORQUE), MOTOR_TORQUE)


@pytest.mark.parametrize("field", ["effort", "velocity"])
def test_a_little_late_is_as_drivers_are(field, tmp_path):
    bag = rewrite(SOUND, tmp_path / "bag", late(field, 0.016), None, SECONDS)
    assert refuse_motion(read_recording(bag, MODEL, MOTOR_TORQUE), MOTOR_TORQUE) == ()


def test_an_effort_of_0_throughout_is_that_of_a_joint_without_one(tmp_path):
    bag = rewrite(SOUND, tmp_path / "bag", scaled(("effort",), 0.0, [JOINT]), None, SECONDS)
    assert refuse_motion(read_recording(bag, MODEL, MOTOR_TORQUE), MOTOR_TORQUE) == ()


def swinging(turns: Float, effort: Float, segment: Int | None = None) -> TorqueBlock:
    """Two joints for 20 s at 100 Hz, whose bodies need torque of both signs.

    Args:
        turns: Velocity of the second, as its first turns to and fro, shape (N,). [rad/s]
        effort: Torque measured of the second, shape (N,). [N m]
        segment: Of each sample, with gaps of 3 s.
    """
    none = np.zeros((len(TIME), 2))
    velocity = np.stack([FRO, turns], axis=1)
    rigid = np.stack([FRO, FRO], axis=1)
    measured = np.stack([FRO + 0.2 * np.sign(FRO), effort], axis=1)
    numbers = np.zeros(len(TIME), dtype=np.int64) if segment is None else segment
    return TorqueBlock(
        ((TIME + 3.0 * numbers) * 1e9).astype(np.int64), numbers,
        np.zeros(len(TIME), dtype=np.uint32), none, velocity, none, none, velocity, rigid, measured,
        np.zeros(len(TIME)),
    )  # fmt: skip


def causes(torque: TorqueBlock) -> list[str]:
    return [one.cause for one in check_effort(("one", "two"), torque)]


def test_friction_holds_a_joint_that_stands_at_an_effort_of_one_sign_or_of_one_value():
    """Its velocity has noise; brakes take all torque, and a driver rounds."""
    noise = 4e-3 * np.random.default_rng(0).normal(size=len(TIME))
    slow = 0.15 + 0.15 * np.sin(2.0 * np.pi * TIME / 8.0)
    for effort in (0.3 + noise, np.round(slow, 1), np.where(TIME < 5.0, FRO, 0.0)):
        turns = np.where((effort == FRO) & (TIME < 5.0), FRO, noise)
        assert causes(swinging(turns, effort)) == []


def test_an_effort_has_one_sign_where_a_joint_turns_one_way():
    assert causes(swinging(1.0 + 0.5 * FRO, FRO + 1.2)) == []
    for turns in (FRO, -FRO):  # behind a gear of either sign
        assert causes(swinging(turns, np.abs(FRO) + 0.2)) == ["effort_unsigned"]


def test_a_velocity_that_is_missing_hides_no_effort_of_one_sign():
    turns = np.where(TIME == TIME[7], np.nan, FRO)
    assert causes(swinging(turns, np.abs(FRO) + 0.2)) == ["effort_unsigned"]


@pytest.mark.parametrize("missing", [slice(100, 101), slice(None, None, 50)])
def test_a_message_without_effort_makes_no_effort_of_a_joint_without_one(missing):
    effort = np.zeros(len(TIME))
    effort[missing] = np.nan
    assert causes(swinging(FRO, effort)) == []


def test_an_effort_is_held_in_a_joint_that_moves_and_not_across_gaps():
    held = np.where((TIME > 5.0) & (TIME < 9.0), FRO[500], FRO)
    assert causes(swinging(FRO, held)) == ["effort_held"]
    parts = (TIME / 1.5).astype(np.int64)
    assert causes(swinging(FRO, held, parts)) == []


@pytest.mark.parametrize("cause", ["effort_held", "effort_late", "effort_unsigned"])
def test_shaft_powers_of_an_effort_that_is_wrong_are_not_held_against_the_meter(cause, tmp_path):
    bag = rewrite(SOUND, tmp_path / "bag", scaled(("effort",), 10.0), None, SECONDS)
    part = read_recording(bag, MODEL, MOTOR_TORQUE)
    evidence = evidence_of(MODEL, MOTOR_TORQUE, part.torque, part.power, part.meter, Remarks())
    found, without = check_meter(evidence)[0], check_meter(evidence, [cause])[0]
    assert "shafts_exceed_meter" in {one.cause for one in found}
    assert "shafts_exceed_meter" not in {one.cause for one in without}


@pytest.mark.parametrize("lag", [0.0, 0.3, -0.3])
def test_a_lag_counts_neither_sign_nor_scale_nor_what_does_not_move(lag):
    time = np.arange(3000) * 0.01
    moves = np.sin(time) + np.sin(2.7 * time)
    still = np.random.default_rng(0).normal(size=len(time))
    joints = [(moves[:, None], -5.0 * np.interp(time - lag, time, moves)), (still[:, None], still)]
    noise = np.random.default_rng(1).normal(size=len(time))
    joints.append((noise[:, None], np.zeros(len(time))))
    assert field_lag(time, joints[:1] + joints[2:], 0.05) == pytest.approx(lag, abs=0.02)
    assert field_lag(time[:500], [(one[:500], two[:500]) for one, two in joints], 0.05) == 0.0
    assert field_lag(time, joints[:1], 0.5) == 0.0


@pytest.mark.parametrize("times", [1, 2, 5])
def test_readings_that_are_repeated_count_once(times, tmp_path):
    seen: list[float] = []

    def repeated(message: Any) -> None:
        seen.append(message.power)
        message.power = seen[(len(seen) - 1) // times * times]

    bag = rewrite(SOUND, tmp_path / "bag", None, repeated)
    (part,), notes = on_one_clock([read_recording(bag, MODEL, EffortMeaning.NONE)])
    found = [one.sentence for one in check(bag, MODEL).findings if one.cause == "meter_held"]
    assert part.meter is not None
    if times == 1:
        assert not found
        assert not notes
        assert len(part.meter) == len(seen)
        return
    assert f"every 0.1 s, but change every {times / 10} s" in found[0]
    assert notes[0].startswith(f"bag: {found[0]}, so each counted once")
    assert part.meter.power == pytest.approx(seen[times::times], rel=1e-12)
    assert part.meter.interval == pytest.approx(np.full(len(part.meter), times / 10))
    assert part.compared[0].measured.sum() == pytest.approx(
        np.sum(part.meter.power) * times / 10, rel=0.05
    )


@pytest.mark.parametrize(("offset", "factor"), [(1e6, 1.0), (0.0, 1.0 / 3600.0)])
def test_a_counter_that_jumps_has_no_other_unit_and_no_other_sign(offset, factor, tmp_path):
    """By 1 MJ, or from J to Wh: what its decoder leaves out does not count as power."""
    total: list[float] = [0.0]

    def counted(message: Any) -> None:
        total.append(total[-1] + message.power * message.interval)
        message.meaning, message.power, message.interval = 3, np.nan, np.nan
        message.energy = total[-1] if len(total) < 150 else factor * total[-1] + offset

    bag = rewrite(SOUND, tmp_path / "bag", None, counted)
    found = {one.cause for one in check(bag, MODEL).findings}
    assert not found & {"meter_sign", "meter_unit", "meter_exceeds"}


def means(power: Float, step_ns: int) -> MeterBlock:
    """Means of 0.1 s."""
    interval, none = np.full(len(power), 0.1), np.full(len(power), np.nan)
    place = MeterMeaning.MEAN_OVER_INTERVAL, MeterLocation.GRID
    return MeterBlock(step_ns * np.arange(len(power)), power, none, interval, *place)


def test_each_reading_counts_once_where_a_table_repeats_it_12_or_13_times():
    """And a value that the meter itself gives twice counts twice."""
    runs = np.tile([12, 13, 12], 20)
    runs[30] = 25
    values = 3.0 * np.random.default_rng(0).permutation(len(runs)) + 100.0
    once, said = readings_once(means(np.repeat(values, runs), 8_000_000))
    assert "every 0.008 s, but change every 0.096 s" in said
    assert once.power.tolist() == np.insert(values, 30, values[30])[1:].tolist()
    assert once.interval.min() > 0.095
    assert once.interval.max() < 0.105


@pytest.mark.parametrize(("rate", "resolution", "height"), [(50, 1.0, 10.0), (125, 10.0, 200.0)])
def test_readings_that_follow_slow_power_by_steps_of_the_meter_are_not_repeated(
    rate: int, resolution: float, height: float
) -> None:
    time = np.arange(60 * rate) / rate
    waves = np.sin(0.5 * np.pi * time) + 0.3 * np.sin(1.15 * np.pi * time)
    ramp = np.abs((time / 4.0) % 2.0 - 1.0)
    for power in (300.0 + height * waves, 300.0 + height * ramp):
        meter = means(resolution * np.round(power / resolution), 10**9 // rate)
        assert readings_once(meter)[0] is meter


def test_an_idle_robot_does_not_decide_what_is_repeated() -> None:
    """Power that goes to and fro by 1 W every 0.5 s, and fresh readings of motion at last."""
    idle = 250.0 + np.arange(2000) // 5 % 2
    moves = np.random.default_rng(0).permutation(40) * 20.0 + 300.0
    meter = means(np.append(idle, moves), 100_000_000)
    assert readings_once(meter)[0] is meter
    meter = means(np.append(idle, np.repeat(moves, 3)), 100_000_000)
    assert "change every 0.3 s" in readings_once(meter)[1]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("count", [0, 1])
def test_a_counter_of_one_reading_has_no_power(count: int) -> None:
    total = np.arange(count) * 10.0
    none = np.full(count, np.nan)
    read = read_recording(SOUND, MODEL, EffortMeaning.NONE)
    place = MeterMeaning.CUMULATIVE, MeterLocation.GRID
    meter = MeterBlock(read.torque.stamp_ns[1000 : 1000 + count], none, total, none, *place)
    evidence = _evidence_of(replace(read, meter=meter), EffortMeaning.NONE)
    assert check_meter(evidence) == ([], "0 readings have a prediction; 20 are needed")
