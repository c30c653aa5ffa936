import math
from dataclasses import replace
from fractions import Fraction

import numpy as np

from accounts import SECOND, power_block
from robot_energy.accounting.exact_sum import ExactSum
from robot_energy.accounting.registers import Coverage, Registers
from robot_energy.timeline.blocks import HeldRows


def integrate(stamp_s, power, segment=None):
    stamp = np.rint(np.asarray(stamp_s) * 1e9).astype(np.int64)
    registers = Registers(2)
    block = power_block(stamp, np.asarray(power, dtype=float), 0 if segment is None else segment)
    return registers, registers.step(block)[0]


def test_constant_power_for_an_hour():
    # failure 9 of every meter: 33.5 W for one hour are 33.5 Wh, on arrival, not on change
    total = ExactSum(1)
    _, intervals = integrate(np.arange(3601.0), np.full(3601, 33.5))
    total.add(intervals.energy[:, :1])
    assert total.microjoule[0] == 33.5 * 3600 * 1e6


def test_trapezoid_by_hand():
    _, intervals = integrate([0.0, 1.0, 3.0], [0.0, 10.0, 20.0])
    np.testing.assert_allclose(intervals.energy[:, 0], [0.0, 5.0, 30.0])


def test_gap_and_nan_are_time_without_energy():
    registers, intervals = integrate(
        [0.0, 1.0, 5.0, 6.0, 7.0, 8.0], [10, 10, 10, 10, np.nan, 10], segment=[0, 0, 1, 1, 1, 1]
    )
    np.testing.assert_allclose(intervals.energy[:, 0], [0, 10, 0, 10, 0, 0])
    time = registers.time
    assert (time.observed_ns, time.gap_ns, time.gap_count) == (2 * 10**9, 6 * 10**9, 2)
    assert time.span_ns == 8 * 10**9


def test_no_energy_and_no_time_across_a_backward_jump():
    registers, intervals = integrate([10.0, 11.0, 2.0, 3.0], [7.0] * 4, segment=[0, 0, 1, 1])
    np.testing.assert_allclose(intervals.energy[:, 0], [0, 7, 0, 7])
    assert registers.time.jumps == 1
    assert registers.time.span_ns == 2 * 10**9


def test_sum_is_exact_to_the_microjoule_over_a_million_odd_steps():
    rng = np.random.default_rng(5)
    energy = rng.uniform(-1.0, 3.0, (1_000_000, 1)) * 1e-3
    total = ExactSum(1)
    total.add(energy)
    exact = Fraction(math.fsum(energy[:, 0])) * 10**6  # fsum rounds once, 1e-13 J
    assert total.microjoule[0] == int(exact // 1)


def test_sum_does_not_depend_on_the_cutting():
    energy = np.random.default_rng(6).normal(size=(10_000, 3))
    whole, cut = ExactSum(3), ExactSum(3)
    whole.add(energy)
    for part in np.array_split(energy, 137):
        cut.add(part)
    np.testing.assert_array_equal(whole.microjoule, cut.microjoule)


def test_a_month_of_constant_milliseconds_stays_exact():
    # 87.123 W at 1 kHz: the increments are equal, so any rounding bias would add up
    total = ExactSum(1)
    increments = 1 << 16
    for _ in range(64):
        total.add(np.full((increments, 1), 0.087123))
    exact = Fraction(0.087123) * increments * 64 * 10**6
    assert abs(int(total.microjoule[0]) - exact) <= 1


def test_short_blocks_wait_and_are_taken_back():
    energy = np.random.default_rng(5).normal(scale=3.0, size=(2000, 3))
    whole, short, taken_back = ExactSum(3), ExactSum(3), ExactSum(3)
    whole.add(energy)
    for row, each in enumerate(energy):
        short.add(each[None, :])
        taken_back.add(each[None, :])
        if row % 700 == 0:
            assert short.microjoule[0] == np.rint(energy[: row + 1, 0].sum() * 1e6 - 0.5)  # read
        if row % 300 == 299:  # before and after what waits was added
            undo = taken_back.mark()
            taken_back.add(energy[:row])
            assert taken_back.joule[1] != short.joule[1]
            undo()
    for each in (short, taken_back):
        np.testing.assert_array_equal(each.microjoule, whole.microjoule)
        np.testing.assert_array_equal(each.remainder, whole.remainder)


def test_deviations_are_integrated_up_to_the_newest_sample():
    """Computed at 0 and 1 s, then held: 2 to 4 W over a second, and 4 W for two more."""
    registers = Registers(2)
    values = np.broadcast_to([[2.0], [4.0]], (2, registers.deviation.size))
    held = HeldRows(values, np.array([0, 1, 1, 1]), np.array([True, True, False, False]))
    block = power_block(np.arange(4) * SECOND, np.full(4, 100.0))
    registers.step(replace(block, deviation=held))
    np.testing.assert_allclose(registers.deviation, 3.0 + 8.0)


def test_time_around_the_samples_is_a_gap_at_the_end_that_has_it():
    time = Coverage(start_ns=5, end_ns=9)
    time.count(4, 0, 0, 0)
    time.surround(3, 0)
    assert (time.start_ns, time.end_ns, time.span_ns) == (2, 9, 7)
    assert (time.gap_ns, time.gap_count) == (3, 1)
