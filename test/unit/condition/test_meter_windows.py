import numpy as np
import pytest

from robot_energy.accounting.power_curve import MeterCurve
from robot_energy.condition.meter_fit import MeterWindows
from robot_energy.timeline.blocks import MeterBlock, MeterLocation, MeterMeaning

NEVER = 10**18


def means(stamps, power, interval=0.1) -> MeterBlock:
    """Readings that are means over the interval before them."""
    size = len(stamps)
    return MeterBlock(
        np.rint(np.asarray(stamps) * 1e9).astype(np.int64),
        np.full(size, power),
        np.full(size, np.nan),
        np.full(size, interval),
        MeterMeaning.MEAN_OVER_INTERVAL,
        MeterLocation.GRID,
    )


def fed(windows, start, stop, until=NEVER, segment=0):
    """Feed a predicted power that rises as t and one of 3 W, at 100 Hz."""
    time = np.arange(round(start * 100), round(stop * 100)) / 100
    power = np.stack([time, np.full(len(time), 3.0)], axis=1)
    parts = np.full(len(time), segment)
    return list(windows.step(np.rint(time * 1e9).astype(np.int64), parts, power, until))


def test_energies_are_those_of_the_very_same_time():
    windows = MeterWindows(2, MeterCurve(2.0))
    windows.measure(means(np.arange(1, 121) / 10 + 0.03, 50.0))
    found = fed(windows, 0.0, 12.0)
    assert [round(w.duration, 3) for w in found] == [5.0, 5.0]
    first = found[0]  # from 0.03 to 5.03 s
    assert first.measured == pytest.approx(250.0)
    assert first.energies[0] == pytest.approx((5.03**2 - 0.03**2) / 2, abs=1e-4)
    assert first.energies[1] == pytest.approx(15.0)


def test_what_the_meter_says_late_counts_in_its_own_time():
    windows, late = MeterWindows(2, MeterCurve(2.0)), MeterWindows(2, MeterCurve(2.0))
    readings = means(np.arange(1, 121) / 10, 50.0)
    windows.measure(readings)
    expected = fed(windows, 0.0, 12.0)
    assert fed(late, 0.0, 12.0) == []
    late.measure(readings)
    found = fed(late, 12.0, 12.5)
    assert [w.stamp_ns for w in found] == [w.stamp_ns for w in expected]
    np.testing.assert_allclose(found[0].energies, expected[0].energies)


@pytest.mark.parametrize("missing", ["readings", "samples"])
def test_no_window_spans_a_hole(missing):
    windows = MeterWindows(2, MeterCurve(2.0))
    stamps = np.arange(1, 201) / 10
    if missing == "readings":
        stamps = stamps[(stamps < 7) | (stamps > 10)]
    windows.measure(means(stamps, 50.0))
    if missing == "readings":
        found = fed(windows, 0.0, 20.0)
    else:
        found = fed(windows, 0.0, 7.0) + fed(windows, 10.0, 20.0, segment=1)
    for window in found:
        start = window.stamp_ns * 1e-9 - window.duration
        assert not (start < 8.0 < window.stamp_ns * 1e-9 - 0.1)
        assert window.energies[1] == pytest.approx(3.0 * window.duration)
    assert len(found) >= 2


def test_pieces_wait_for_the_time_given():
    windows = MeterWindows(2, MeterCurve(2.0))
    windows.measure(means(np.arange(1, 121) / 10, 50.0))
    assert fed(windows, 0.0, 12.0, until=4_900_000_000) == []
    assert len(fed(windows, 12.0, 12.1, until=NEVER)) == 2


def test_samples_that_are_no_numbers_make_a_hole():
    windows = MeterWindows(2, MeterCurve(2.0))
    windows.measure(means(np.arange(1, 121) / 10, 50.0))
    time = np.arange(0, 100) / 100
    power = np.full((100, 2), np.nan)
    assert not list(windows.step((time * 1e9).astype(np.int64), np.zeros(100), power, NEVER))
    assert len(fed(windows, 1.0, 12.0)) == 2
