"""Which readings of a temperature are believed."""

import numpy as np
import pytest

from robot_energy.inputs.temperatures.filter import ReadingStatus, TemperatureFilter

S = 10**9
A, STEP, BAD, OLD, NONE = (
    ReadingStatus.ACCEPTED,
    ReadingStatus.STEP,
    ReadingStatus.IMPLAUSIBLE,
    ReadingStatus.OLDER,
    ReadingStatus.NOT_GIVEN,
)


def judged(values, stamps=None):
    """Verdict on each reading of one motor, one a second unless stamps [s] are given."""
    judge = TemperatureFilter(1)
    stamps = range(100, 100 + len(values)) if stamps is None else stamps
    return [
        ReadingStatus(int(judge.take(int(at * S), np.array([value]))[0]))
        for at, value in zip(stamps, values, strict=True)
    ], judge


@pytest.mark.parametrize(
    ("values", "verdicts", "last"),
    [
        ([20.0, 21.0, 22.0], [A, A, A], 22.0),
        ([20.0, 26.9, 33.8], [A, A, A], 33.8),  # 5 K/s and 2 K
        ([20.0, 20.0, 60.0, 20.0, 21.0], [A, A, STEP, A, A], 21.0),  # one outlier is held
        ([20.0, 20.0, 60.0, 60.0, 20.0], [A, A, STEP, STEP, A], 20.0),  # two as well
        ([20.0, 20.0, 60.0, 60.5, 61.0], [A, A, STEP, STEP, A], 61.0),  # the third confirms
        ([20.0, 20.0, 60.0, 20.0, 60.0, 20.0, 60.0], [A, A, STEP, A, STEP, A, STEP], 20.0),
        ([20.0, 20.0, 60.0, 90.0, 60.0], [A, A, STEP, STEP, STEP], 20.0),  # that disagree
        ([150.0, 20.0, 21.0, 22.0], [A, STEP, A, A], 22.0),  # a wild first sample
        ([150.0, 20.0, 150.0, 150.0], [A, STEP, A, A], 150.0),  # or a wild second one
        ([20.0, 999.0, -273.15, 21.0], [A, BAD, BAD, A], 21.0),  # error codes, no sensor
        ([318.0, 319.0], [BAD, BAD], np.nan),  # kelvin
        ([-40.0, -38.0], [A, A], -38.0),
        ([20.0, np.nan, 21.0], [A, NONE, A], 21.0),
    ],
)
def test_verdicts(values, verdicts, last):
    found, judge = judged(values)
    assert found == verdicts
    np.testing.assert_array_equal(judge.temperature_degc, [last])
    assert judge.doubted[0] == (verdicts[-1] in (STEP, BAD))


def test_a_step_over_a_long_silence_is_no_step():
    assert judged([20.0, 60.0], [100, 110])[0] == [A, A]
    assert judged([20.0, 60.0], [100, 107])[0] == [A, STEP]


def test_late_readings_are_older_and_a_jump_is_an_epoch():
    found, judge = judged([20.0, 21.0, 21.0, 60.0], [100, 100.9, 100.2, 50])
    assert found == [A, A, OLD, A]
    np.testing.assert_array_equal(judge.stamp_ns, [50 * S])


def test_motors_are_judged_one_by_one():
    judge = TemperatureFilter(2)
    judge.take(100 * S, np.array([20.0, 50.0]))
    assert judge.take(101 * S, np.array([80.0, 51.0])).tolist() == [STEP, A]
    np.testing.assert_array_equal(judge.temperature_degc, [20.0, 51.0])
    assert judge.doubted.tolist() == [True, False]
