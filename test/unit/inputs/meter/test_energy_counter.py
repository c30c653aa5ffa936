"""Counters: what is counted, what is held, what is a reset. Energies worked out by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_energy.accounting.comparison import Comparison
from robot_energy.accounting.power_curve import MeterCurve
from robot_energy.inputs.meter.energy_counter import EnergyCounterDecoder
from robot_energy.timeline.blocks import MeterBlock, MeterLocation, MeterMeaning
from robot_energy.timeline.pieces import NO_PIECES, CoveredPieces

SECOND = 10**9
WATT_HOUR = 3600.0


def pieces_of(counter: EnergyCounterDecoder, stamp_s, energy) -> CoveredPieces:
    stamp = np.rint(np.asarray(stamp_s) * 1e9).astype(np.int64)
    return counter.step(stamp, np.asarray(energy, dtype=float))


def energy_of(pieces: CoveredPieces) -> float:
    return float((pieces.start_power * (pieces.end_ns - pieces.stamp_ns)).sum() * 1e-9)


def counter(max_gap=2.0, max_power=1e6, wraps_at=None) -> EnergyCounterDecoder:
    return EnergyCounterDecoder(round(max_gap * SECOND), max_power, wraps_at)


def readings(energy, max_power=1e6, wraps_at=None, spacing=1.0):
    """The counter after readings at equal distances, and its pieces."""
    found = counter(max_power=max_power, wraps_at=wraps_at)
    return found, pieces_of(found, spacing * np.arange(len(energy)), energy)


def test_the_first_reading_is_only_a_base():
    _, pieces = readings([3.4e9, 3.4e9 + 50, 3.4e9 + 150])
    assert energy_of(pieces) == pytest.approx(150.0)
    assert pieces.start_power.tolist() == [50.0, 100.0]


@pytest.mark.parametrize("wrong", [0.0, 70.0, -5.0])
def test_one_low_reading_is_held_and_the_recovery_is_no_spike(wrong):
    found, pieces = readings([100.0, 110.0, wrong, 130.0, 140.0])
    assert energy_of(pieces) == pytest.approx(40.0)
    assert pieces.start_power.tolist() == [10.0, 10.0, 10.0]
    assert (found.low, found.resets) == (1, 0)


def test_a_reading_that_is_no_number_is_bridged():
    curve = MeterCurve(2.0)
    (pieces,) = curve.step(block(np.arange(4.0), [100.0, 110.0, np.nan, 130.0]))
    assert energy_of(pieces) == pytest.approx(30.0)
    assert curve.rejections.rejected == {"meter_not_finite": 1}


def test_a_confirmed_fall_is_a_reset_with_its_time_and_nothing_across():
    # 100 .. 130 J in 3 s, reset at 4 s, then 5 J each second: 5 10 15 20 25 30 35
    after = 5.0 * np.arange(1, 8)
    found, pieces = readings([100.0, 110.0, 120.0, 130.0, *after])
    # confirmed by the first reading 5 s after the fall (at 9 s, 30 J); 35 J one second on
    assert energy_of(pieces) == pytest.approx(30.0 + 5.0)
    assert pieces.end_ns.tolist() == [SECOND, 2 * SECOND, 3 * SECOND, 10 * SECOND]
    assert (found.resets, found.reset_ns, found.low) == (1, 4 * SECOND, 5)


def test_a_meter_stuck_at_zero_for_a_minute_is_no_reset_and_its_return_no_spike():
    found, pieces = readings([1e9, 1e9 + 100, *[0.0] * 60, 1e9 + 6200, 1e9 + 6300])
    assert found.resets == 0
    assert energy_of(pieces) == pytest.approx(200.0)  # the minute itself was not seen
    assert found.low == 60


def test_a_slow_fall_is_neither_energy_nor_a_reset():
    falling = 1000.0 - 0.5 * np.arange(30)
    found, pieces = readings([990.0, *falling])
    assert energy_of(pieces) == pytest.approx(10.0)
    assert (found.resets, found.low) == (0, 29)


def test_jitter_of_the_last_digit_counts_each_joule_once():
    energy = np.array([0.0, 10, 9, 20, 19, 30, 29, 40])
    _, pieces = readings(energy)
    assert energy_of(pieces) == pytest.approx(40.0)


def test_a_counter_that_wraps_continues_exactly():
    # steps of 10 J; 2000 wraps to 0: the energy of 21 steps, 210 J, in 21 s
    true = 1895.0 + 10.0 * np.arange(22)
    found, pieces = readings(true % 2000.0, wraps_at=2000.0)
    assert (found.wraps, found.resets) == (1, 0)
    assert energy_of(pieces) == pytest.approx(210.0)
    assert int((pieces.end_ns - pieces.stamp_ns).sum()) == 21 * SECOND
    plain, lost = readings(true % 2000.0)
    assert (plain.wraps, plain.resets) == (0, 1)
    assert energy_of(lost) < 160.0


def test_a_glitch_near_the_end_is_no_wrap():
    found, pieces = readings([1900.0, 1910.0, 3.0, 1930.0, 1940.0], wraps_at=2000.0)
    assert (found.wraps, found.resets) == (0, 0)
    assert energy_of(pieces) == pytest.approx(40.0)


def test_a_reset_of_a_counter_that_could_wrap_is_a_reset():
    found, pieces = readings([500.0, 510.0, *(10.0 * np.arange(8))], wraps_at=2000.0)
    assert (found.wraps, found.resets) == (0, 1)
    assert energy_of(pieces) == pytest.approx(10.0 + 20.0)


def test_a_step_of_absurd_power_is_refused():
    found, pieces = readings([0.0, 100.0, 9e6, 300.0, 400.0], max_power=5000.0)
    assert (found.high, found.resets) == (1, 0)
    assert energy_of(pieces) == pytest.approx(400.0)


def test_an_absurd_step_that_stays_is_a_reset():
    after = 9e6 + 100.0 * np.arange(8)
    found, pieces = readings([0.0, 100.0, *after], max_power=5000.0)
    assert (found.resets, found.reset_ns) == (1, 2 * SECOND)
    assert energy_of(pieces) == pytest.approx(100.0 + 200.0)


def test_a_meter_that_starts_with_zeros_gives_no_lifetime_value():
    _, pieces = readings([0.0, 0.0, 4e5, 4e5 + 100, 4e5 + 200])
    assert energy_of(pieces) == pytest.approx(200.0)
    _, pieces = readings([0.0, 3.4e9, 3.4e9 + 100])
    assert energy_of(pieces) == pytest.approx(100.0)


def test_a_coarse_counter_gives_its_mean_power_between_changes():
    # 400 W read each second in steps of 10 Wh, which come every 90 s
    stamp = np.arange(400)
    count = np.floor(400.0 * stamp / (10 * WATT_HOUR)) * 10 * WATT_HOUR
    pieces = pieces_of(counter(), stamp, count)
    assert pieces.start_power.tolist() == pytest.approx([400.0] * 3)
    assert pieces.stamp_ns.tolist() == [90 * SECOND, 180 * SECOND, 270 * SECOND]
    assert energy_of(pieces) == pytest.approx(count[-1] - 10 * WATT_HOUR)  # from the first change


@pytest.mark.parametrize("cut", range(1, 7))
def test_a_coarse_counter_may_be_cut_anywhere(cut):
    found = counter()
    stamp, count = np.arange(8.0), np.array([0.0, 0, 36e3, 36e3, 36e3, 72e3, 72e3, 72e3])
    pieces = pieces_of(found, stamp[:cut], count[:cut])
    pieces = CoveredPieces.concatenate([pieces, pieces_of(found, stamp[cut:], count[cut:])])
    assert pieces.stamp_ns.tolist() == [2 * SECOND]
    assert pieces.start_power.tolist() == [12e3]


def test_a_jump_that_time_would_explain_later_is_not_counted():
    # 20 kJ at once at 5 kW: 5 s later the old count could have got there, but did not
    after = 20_100.0 + 100.0 * np.arange(9)
    found, pieces = readings([0.0, 100.0, *after], max_power=5000.0)
    assert energy_of(pieces) == pytest.approx(100.0 + 300.0)
    assert found.resets == 1


def test_a_wrap_behind_a_silence_is_not_counted_across():
    energy = [1980.0, 1990.0, 50.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0]
    stamp = [0.0, 1.0, 11.0, *np.arange(12.0, 19.0)]
    found = counter(wraps_at=2000.0)
    pieces = pieces_of(found, stamp, energy)
    assert energy_of(pieces) == pytest.approx(10.0 + 10.0)
    assert (found.wraps, found.resets) == (1, 0)


def test_a_silence_is_not_bridged_and_its_energy_not_counted():
    found = counter(max_gap=2.0)
    pieces = pieces_of(found, [0.0, 1.0, 11.0, 12.0], [0.0, 10.0, 500.0, 510.0])
    assert energy_of(pieces) == pytest.approx(20.0)
    assert pieces.end_ns.tolist() == [SECOND, 12 * SECOND]


def test_a_low_reading_after_a_silence_is_held_too():
    found = counter()
    energy = [9e4, 9e4 + 10, 0.0, 9.1e4, 9.1e4 + 10]
    pieces = pieces_of(found, [0.0, 1.0, 60.0, 61.0, 62.0], energy)
    assert energy_of(pieces) == pytest.approx(20.0)
    assert found.resets == 0


def block(stamp_s, energy):
    size = len(stamp_s)
    return MeterBlock(
        np.rint(np.asarray(stamp_s) * 1e9).astype(np.int64),
        np.full(size, np.nan),
        np.asarray(energy, dtype=float),
        np.full(size, np.nan),
        MeterMeaning.CUMULATIVE,
        MeterLocation.GRID,
    )


def test_a_new_epoch_starts_a_new_count():
    curve = MeterCurve(2.0)
    pieces = curve.step(block([10.0, 11.0, 5.0, 6.0], [100.0, 110.0, 100.0, 110.0]))
    assert [energy_of(part) for part in pieces] == pytest.approx([10.0, 10.0])
    assert curve.counter.resets == 0
    assert curve.rejections.received == curve.rejections.accepted == 4


events = st.lists(
    st.sampled_from(["on", "on", "on", "on", "still", "glitch", "nan", "reset", "spike", "gap"]),
    min_size=1,
    max_size=60,
)


def story(parts, seed):
    """Readings of a counter with faults, about 1 s apart."""
    rng = np.random.default_rng(seed)
    now, count, stamps, energy = 100.0, 1800.0, [], []
    for part in parts:
        now += 4.0 if part == "gap" else rng.uniform(0.3, 1.5)
        count = 0.0 if part == "reset" else count + (0 if part == "still" else rng.integers(1, 60))
        if count > 2000:
            count -= 2000
        wrong = {"glitch": rng.uniform(0, 50), "nan": np.nan, "spike": 1e9}
        stamps.append(now)
        energy.append(wrong.get(part, count))
    return block(stamps, energy)


@given(
    parts=events,
    seed=st.integers(0, 2**16),
    cuts=st.lists(st.integers(0, 60), max_size=10),
    wraps=st.booleans(),
)
def test_counting_does_not_depend_on_the_cutting_and_every_reading_is_accounted_for(
    parts, seed, cuts, wraps
):
    readings = story(parts, seed)

    def run(bounds):
        curve = MeterCurve(2.0, 5000.0, 2000.0 if wraps else None)
        parts = []
        for start, stop in zip([0, *bounds], [*bounds, len(readings)], strict=True):
            if stop > start:
                parts += curve.step(readings[slice(start, stop)])
            assert curve.rejections.balanced
        pieces = NO_PIECES
        for part in parts:
            pieces = CoveredPieces.concatenate([pieces, part])
        count = curve.counter
        return curve, pieces, (count.resets, count.reset_ns, count.wraps, count.low, count.high)

    whole, pieces, state = run([])
    cut, others, other_state = run(sorted(min(c, len(readings)) for c in cuts))
    for name in ("stamp_ns", "end_ns", "start_power", "end_power"):
        np.testing.assert_array_equal(getattr(pieces, name), getattr(others, name))
    assert state == other_state
    assert whole.rejections == cut.rejections
    assert (whole.newest_ns, whole.spacing_ns, whole.gaps) == (
        cut.newest_ns,
        cut.spacing_ns,
        cut.gaps,
    )
    assert (pieces.start_power >= 0).all()
    assert (pieces.start_power <= 5000.0 * (1 + 1e-12)).all()
    assert (np.diff(pieces.stamp_ns) > 0).all()
    assert (pieces.stamp_ns[1:] >= pieces.end_ns[:-1]).all()


def test_a_counter_is_compared_over_what_it_covers():
    comparison = Comparison()
    comparison.measure(block(np.arange(5.0), [100.0, 130.0, 0.0, 190.0, 220.0]))
    comparison.predict(np.arange(0, 5 * SECOND, SECOND), np.zeros(5, dtype=np.int64), np.ones(5))
    assert comparison.measured_energy == pytest.approx(120.0)
    assert comparison.predicted_energy == pytest.approx(4.0)
    assert comparison.compared_ns == 4 * SECOND
