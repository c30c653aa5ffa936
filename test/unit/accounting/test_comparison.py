import numpy as np
import pytest

from robot_energy.accounting.comparison import Comparison
from robot_energy.timeline.blocks import MeterBlock, MeterLocation, MeterMeaning

SECOND = 10**9


def meter(stamp_s, value, meaning=MeterMeaning.INSTANTANEOUS, interval=np.nan):
    size = len(stamp_s)
    cumulative = meaning is MeterMeaning.CUMULATIVE
    return MeterBlock(
        stamp_ns=np.rint(np.asarray(stamp_s) * 1e9).astype(np.int64),
        power=np.full(size, np.nan) if cumulative else np.asarray(value, dtype=float),
        energy=np.asarray(value, dtype=float) if cumulative else np.full(size, np.nan),
        interval=np.full(size, interval),
        meaning=meaning,
        location=MeterLocation.GRID,
    )


def predict(comparison, stamp_s, power, segment=None):
    stamp = np.rint(np.asarray(stamp_s) * 1e9).astype(np.int64)
    segment = np.zeros(len(stamp), dtype=np.int64) if segment is None else np.asarray(segment)
    return comparison.predict(stamp, segment, np.asarray(power, dtype=float))


def test_both_are_integrated_over_what_both_cover():
    # predicted 10 t on 0..4 s; meter 100 W on 1..3 s: 200 J next to 5 (9 - 1) = 40 J
    comparison = Comparison()
    comparison.measure(meter([1.0, 2.0, 3.0], [100.0] * 3))
    predict(comparison, np.arange(5.0), 10 * np.arange(5.0))
    assert comparison.measured_energy == pytest.approx(200.0)
    assert comparison.predicted_energy == pytest.approx(40.0)
    assert comparison.compared_ns == 2 * SECOND


def test_breakpoints_of_either_curve_are_met_between_the_others_samples():
    # meter jumps 0 -> 60 W between 1.5 and 1.5 s + 1 ns of a prediction sampled each second
    comparison = Comparison()
    comparison.measure(meter([0.5, 1.5, 2.5], [0.0, 0.0, 60.0]))
    predict(comparison, [0.0, 1.0, 2.0, 3.0], [0.0, 10.0, 10.0, 0.0])
    assert comparison.measured_energy == pytest.approx(30.0)
    # predicted from 0.5 to 2.5 s: 3.75 + 10 + 3.75
    assert comparison.predicted_energy == pytest.approx(3.75 + 10.0 + 3.75)


def test_mean_over_interval_is_a_step_that_ends_at_the_stamp():
    comparison = Comparison()
    comparison.measure(meter([1.0, 2.0], [5.0, 7.0], MeterMeaning.MEAN_OVER_INTERVAL, interval=1.0))
    predict(comparison, [0.0, 0.5, 2.0], [1.0, 1.0, 1.0])
    assert comparison.measured_energy == pytest.approx(12.0)
    assert comparison.compared_ns == 2 * SECOND


def test_a_hole_in_the_meter_is_not_compared():
    comparison = Comparison(max_gap=2.0)
    comparison.measure(meter([0.0, 1.0, 9.0, 10.0], [10.0] * 4))
    predict(comparison, np.arange(11.0), np.ones(11))
    assert comparison.compared_ns == 2 * SECOND
    assert comparison.measured_energy == pytest.approx(20.0)


def test_a_hole_in_the_prediction_is_not_compared():
    comparison = Comparison()
    comparison.measure(meter(np.arange(11.0), [10.0] * 11))
    predict(comparison, [0.0, 1.0, 8.0, 10.0], np.ones(4), segment=[0, 0, 1, 1])
    assert comparison.compared_ns == 3 * SECOND
    comparison = Comparison()
    comparison.measure(meter(np.arange(4.0), [10.0] * 4))
    predict(comparison, np.arange(4.0), [1.0, np.nan, 1.0, 1.0])
    assert comparison.compared_ns == SECOND


def test_bad_readings_are_counted_by_reason():
    comparison = Comparison()
    comparison.measure(meter([1.0, 2.0, 2.0, 1.5, 3.0], [1.0, np.nan, 1.0, 1.0, 1.0]))
    curve = comparison.curve
    assert curve.rejections.rejected == {"meter_not_finite": 1, "meter_not_newer": 1}
    assert curve.rejections.received == curve.rejections.accepted + sum(
        curve.rejections.rejected.values()
    )


def test_meter_may_arrive_late():
    early, late = Comparison(), Comparison()
    readings = meter(np.arange(6.0), np.arange(6.0))
    early.measure(readings)
    predict(early, np.arange(6.0), np.ones(6))
    predict(late, np.arange(6.0), np.ones(6))
    late.measure(readings)
    predict(late, [6.0], [1.0])
    assert late.measured_energy == early.measured_energy == pytest.approx(12.5)


def test_looped_recording_counts_twice_and_nothing_in_between():
    comparison = Comparison()
    for _ in range(2):
        comparison.measure(meter(np.arange(5.0), [10.0] * 5))
        predict(comparison, np.arange(5.0), np.ones(5))
    assert comparison.compared_ns == 8 * SECOND
    assert comparison.measured_energy == pytest.approx(80.0)


def test_overlapping_intervals_of_a_mean_count_once_and_never_rewrite_the_past():
    # each reading says it covers 1.5 s, but they come every second: 6 J, then 8 J, then 2 J
    stamps, values = [1.5, 2.5, 3.5], [4.0, 8.0, 2.0]
    options = (MeterMeaning.MEAN_OVER_INTERVAL, 1.5)
    whole, stepwise = Comparison(), Comparison()
    whole.measure(meter(stamps, values, *options))
    predict(whole, np.arange(5.0), np.ones(5))
    for index in range(5):
        if index < 3:
            part = slice(index, index + 1)
            stepwise.measure(meter(stamps[part], values[part], *options))
        predict(stepwise, [float(index)], [1.0])
    assert whole.compared_ns == stepwise.compared_ns == 3.5 * SECOND
    assert whole.measured_energy == pytest.approx(6.0 + 8.0 + 2.0)
    assert stepwise.measured_energy == whole.measured_energy


def test_a_meter_whose_clock_alone_jumps_back_is_compared_again_after_a_while():
    comparison = Comparison()
    comparison.measure(meter(np.arange(100.0, 105.0), [10.0] * 5))
    comparison.measure(meter(np.arange(90.0, 130.0), [10.0] * 40))
    predict(comparison, np.arange(100.0, 111.0), np.ones(11))
    assert comparison.compared_ns == 4 * SECOND
    predict(comparison, np.arange(111.0, 130.0), np.ones(19), segment=np.zeros(19))
    predict(comparison, np.arange(130.0, 132.0), np.ones(2), segment=np.zeros(2))
    assert comparison.compared_ns > 10 * SECOND
