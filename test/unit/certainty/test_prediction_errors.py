"""RMS errors of power and torque against numbers worked out reading by reading."""

import numpy as np
import pytest

import robots
from robot_energy.certainty.prediction_errors import PowerErrorSums
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.timeline.blocks import EffortMeaning, PowerBlock, Quality
from robot_energy.timeline.pieces import NO_INTERVALS, Compared
from robot_energy_identify.results.evaluation import TorqueErrorSums

RNG = np.random.default_rng(5)


def pieces(readings=200):
    """Readings cut into one to four pieces each."""
    counts = RNG.integers(1, 5, readings)
    stamp = np.repeat(np.cumsum(RNG.integers(1, 9, readings)) * 10**7, counts)
    seconds = RNG.integers(1, 10**8, len(stamp))
    measured, predicted = RNG.normal(50.0, 20.0, (2, len(stamp)))
    return Compared(stamp, seconds, measured, predicted, predicted)


def by_hand(part):
    """sqrt of the mean square of (predicted - measured) / time, weighted by time."""
    squares, measured, total = 0.0, 0.0, 0.0
    for stamp in np.unique(part.stamp_ns):
        rows = part.stamp_ns == stamp
        time = part.duration_ns[rows].sum() * 1e-9
        squares += ((part.predicted[rows].sum() - part.measured[rows].sum()) / time) ** 2 * time
        measured += (part.measured[rows].sum() / time) ** 2 * time
        total += time
    return np.sqrt(squares / total), np.sqrt(measured / total)


@pytest.mark.parametrize("cuts", [0, 1, 7, 300])
def test_power_error_is_that_of_each_reading_in_any_cutting(cuts):
    whole, sums = pieces(), PowerErrorSums()
    edges = np.sort(RNG.integers(0, len(whole), cuts))
    for rows in np.split(np.arange(len(whole)), edges):
        sums.step(whole[rows])
    assert (sums.rms, sums.measured_rms) == pytest.approx(by_hand(whole), rel=1e-12)
    uncut = PowerErrorSums()
    uncut.step(whole)
    assert (sums.rms, sums.measured_rms) == (uncut.rms, uncut.measured_rms)  # to the bit


def test_power_errors_of_two_recordings_are_those_of_all_their_readings():
    parts, sums = (pieces(), pieces()), (PowerErrorSums(), PowerErrorSums())
    for part, one in zip(parts, sums, strict=True):
        one.step(part)
    alone = sums[1].rms
    sums[0].add(sums[1])
    later = Compared(
        parts[1].stamp_ns + parts[0].stamp_ns[-1] + 1, *(getattr(parts[1], name) for name in
        ("duration_ns", "measured", "predicted", "drawn")),
    )  # fmt: skip
    assert sums[0].rms == pytest.approx(by_hand(Compared.concatenate([parts[0], later]))[0])
    assert sums[1].rms == alone


def test_without_a_reading_nothing_is_known():
    sums = PowerErrorSums()
    sums.step(NO_INTERVALS)
    assert np.isnan([sums.rms, sums.measured_rms]).all()


def test_torque_error_of_the_wheel_by_hand():
    """Turning at 3 rad/s for 1 s, then at rest: the motor turns with 1.1 N m, 2 are measured."""
    stamp = np.arange(201) / 100
    speed = np.where(stamp < 1.0, 3.0, 0.0)[:, None]
    position = np.minimum(3.0 * stamp, 3.0)[:, None]
    block = robots.joint_block(stamp, position, speed, effort=speed * 0 + 2.0)
    block.joint_effort[50] = np.nan
    model = robots.one_wheel()
    pipeline = EnergyPipeline(model, Settings(effort=EffortMeaning.MOTOR_TORQUE))
    sums = TorqueErrorSums(model)
    parts = [out.power for out in (pipeline.step(block), pipeline.flush()) if out.power is not None]
    for part in parts:
        sums.step(part)
    power = PowerBlock.concatenate(parts)
    known = np.isfinite(power.motor_torque_measured[:, 0])
    known &= power.quality & (Quality.ACCELERATION_INCOMPLETE | Quality.AFTER_GAP) == 0
    assert sums.samples[0, 0] == known.sum() < 200
    turning = known & (power.motor_velocity[:, 0] > 0)
    torque = power.motor_torque[turning, 0]
    assert sums.samples[1, 0] == turning.sum() <= 100
    assert np.median(torque) == pytest.approx(1.1)
    assert sums.rms[1, 0] == pytest.approx(np.sqrt(np.mean((torque - 2.0) ** 2)))
    assert sums.relative[1, 0] == pytest.approx(sums.rms[1, 0] / 2.0)
    assert sums.of_nothing.rms[:, 0] == pytest.approx(2.0)
    assert sums.of_nothing.relative[:2, 0] == pytest.approx(1.0)
    assert sums.relative_of_all[:2] == pytest.approx(sums.relative[:2, 0])
