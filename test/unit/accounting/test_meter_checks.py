from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from robot_energy.accounting.comparison import Comparison
from robot_energy.accounting.meter_checks import MeterDiagnostics
from robot_energy.accounting.meter_response import NewestMinute
from robot_energy.timeline.blocks import MeterBlock, MeterLocation, MeterMeaning
from robot_energy.timeline.pieces import Compared

SECOND = 10**9


class Bench:
    """A meter at 1 Hz next to a prediction at 10 Hz, both of constant power."""

    def __init__(self, unit="", meaning=MeterMeaning.INSTANTANEOUS, **options):
        self.comparison = Comparison(**options)
        self.judgement = MeterDiagnostics(unit)
        self.meaning = meaning
        self.now = 1000.0

    def run(self, seconds, measured, predicted=100.0, offset=0.0, spacing=1, meter=True):
        for index in range(int(seconds)):
            if meter and index % spacing == 0:
                self.comparison.measure(self._reading(self.now + offset, measured))
            stamp = self.now + 0.1 * np.arange(10)
            self.comparison.predict(
                np.rint(stamp * 1e9).astype(np.int64),
                np.zeros(10, dtype=np.int64),
                np.full(10, predicted),
            )
            self.now += 1.0
        return self.judgement.findings(self.comparison)

    def _reading(self, stamp, value):
        none = np.array([np.nan])
        cumulative = self.meaning is MeterMeaning.CUMULATIVE
        number = np.array([value * (self.now - 1000.0) if cumulative else value])
        return MeterBlock(
            np.array([round(stamp * 1e9)]),
            none if cumulative else number,
            number if cumulative else none,
            none,
            self.meaning,
            MeterLocation.GRID,
        )


def test_a_meter_that_agrees_gives_no_finding():
    bench = Bench()
    assert bench.run(120, 103.0) == []
    assert bench.comparison.minute.residual_share == pytest.approx(-3 / 103)  # predicted too little
    assert bench.comparison.minute.time == pytest.approx(60, abs=1.1)


def test_the_residual_is_that_of_the_newest_minute():
    bench = Bench()
    bench.run(200, 300.0)
    bench.run(62, 100.0)
    assert bench.comparison.minute.residual_share == pytest.approx(0.0, abs=0.02)
    bench = Bench()
    assert np.isnan(bench.comparison.minute.residual_share)


@pytest.mark.parametrize(
    ("measured", "unit", "meaning", "asked"),
    [
        (130_000.0, "", MeterMeaning.INSTANTANEOUS, "is its unit mW?"),
        (0.08, "", MeterMeaning.INSTANTANEOUS, "is its unit kW?"),
        (0.13, "kW", MeterMeaning.INSTANTANEOUS, ""),  # a thousandth, and no smaller unit known
        (0.0011, "mW", MeterMeaning.INSTANTANEOUS, ""),
        (100.0 / 3600, "J", MeterMeaning.CUMULATIVE, "is its unit Wh?"),
        (100.0 * 3600, "Wh", MeterMeaning.CUMULATIVE, "is its unit J?"),
        (0.1, "Wh", MeterMeaning.CUMULATIVE, "is its unit kWh?"),
        (0.1, "J", MeterMeaning.CUMULATIVE, "is its unit kJ?"),
        (40.0, "", MeterMeaning.INSTANTANEOUS, ""),  # a bad model is not a wrong unit
        (300.0, "", MeterMeaning.INSTANTANEOUS, ""),
        (-90.0, "", MeterMeaning.INSTANTANEOUS, "is its sign load_negative?"),
    ],
)
def test_a_factor_that_only_a_unit_explains_is_asked_about_and_never_applied(
    measured, unit, meaning, asked
):
    bench = Bench(unit, meaning)
    found = bench.run(60, measured)
    if asked:
        assert len(found) == 1
        assert found[0].endswith(asked)
    else:
        assert found == []
    assert bench.comparison.measured_energy == pytest.approx(measured * 59, rel=0.03)


@pytest.mark.parametrize(
    ("measured", "unit", "meaning", "seconds", "asked"),
    [
        (100_000.0, "", MeterMeaning.INSTANTANEOUS, 7, ""),
        (100_000.0, "", MeterMeaning.INSTANTANEOUS, 10, "is its unit mW?"),
        (0.1, "", MeterMeaning.INSTANTANEOUS, 10, "is its unit kW?"),
        (100.0 / 3600, "J", MeterMeaning.CUMULATIVE, 12, "is its unit Wh?"),
        (-90.0, "", MeterMeaning.INSTANTANEOUS, 10, "is its sign load_negative?"),
        (360.0, "kJ", MeterMeaning.CUMULATIVE, 20, ""),  # Wh, but a bad model may be that wrong
    ],
)
def test_within_ten_seconds_a_thousandth_or_a_turned_sign_is_named_and_no_less(
    measured, unit, meaning, seconds, asked
):
    found = Bench(unit, meaning).run(seconds, measured)
    assert [sentence.endswith(asked) for sentence in found] == ([True] if asked else [])


@pytest.mark.parametrize(
    ("before", "after", "asked"),
    [(100.0, 0.1, ["kW"]), (100.0, 100_000.0, ["mW"]), (0.0, 0.1, ["kW"]), (100.0, 33.0, [])],
)
def test_a_unit_that_changes_is_named_before_the_minute_is_over(before, after, asked):
    """As a meter that is replaced or set up again while the robot runs."""
    bench = Bench()
    assert bench.run(60, before) == []
    assert [sentence.split("unit ")[1] for sentence in bench.run(12, after)] == [
        f"{unit}?" for unit in asked
    ]


def test_a_short_stretch_of_turned_sign_is_no_finding_where_both_ways_occur():
    bench = Bench()
    bench.run(2, -150.0, predicted=-20.0)
    assert bench.run(10, -90.0) == []


@pytest.mark.parametrize("offset", [-3600.0, -183.0, 3600.0])
def test_a_meter_of_another_clock_is_named_with_the_offset(offset):
    bench = Bench()
    found = bench.run(90, 100.0, offset=offset)
    assert bench.comparison.compared_ns == 0
    assert len(found) == 1
    number = float(found[0].split("stamp_offset to ")[1])
    assert number == pytest.approx(-offset, abs=2.0)
    way = "ahead of" if offset > 0 else "behind"
    assert way in found[0]


def test_a_meter_a_little_from_the_future_is_named_although_something_is_compared():
    bench = Bench()
    found = bench.run(90, 100.0, offset=30.0)
    assert bench.comparison.compared_ns > 0
    assert "30.1 s ahead of" in found[0] or "29.1 s ahead of" in found[0]


def test_a_meter_slower_than_what_is_bridged_is_named():
    bench = Bench(max_gap=2.0)
    (found,) = bench.run(61, 100.0, spacing=5)
    assert "are 5.0 s apart" in found
    assert "meter_max_gap" in found


def test_a_counter_that_stands_still_is_named():
    bench = Bench(meaning=MeterMeaning.CUMULATIVE)
    (found,) = bench.run(40, 0.0)
    assert "has not moved for 39 s" in found


def test_a_meter_that_fell_silent_is_left_to_the_watch_of_its_topic():
    bench = Bench()
    bench.run(60, 100.0)
    assert bench.run(60, 100.0, meter=False) == []


@pytest.mark.parametrize(
    ("fed_back", "predicted", "found"), [(50.0, 0.0, True), (1.0, 0.0, False), (50.0, -40.0, False)]
)
def test_energy_fed_back_that_the_model_cannot_predict_is_named(fed_back, predicted, found):
    bench = Bench()
    bench.run(60, 100.0)
    bench.run(30, -fed_back, predicted)
    findings = bench.run(90, 100.0)  # it is said after the minute too
    assert ["regeneration_efficiency" in sentence for sentence in findings] == [True] * found


@given(
    size=st.integers(1, 60), seed=st.integers(0, 999), cuts=st.lists(st.integers(0, 60), max_size=6)
)
def test_the_residual_does_not_depend_on_the_cutting(size, seed, cuts):
    rng = np.random.default_rng(seed)
    available = np.sort(rng.integers(0, 200 * SECOND, size))
    duration, (measured, drawn) = rng.integers(1, SECOND, size), rng.normal(50.0, 30.0, (2, size))
    compared = Compared(available, duration, measured, drawn, drawn)

    def run(bounds):
        minute = cut(NewestMinute(), compared, bounds)
        return minute.time, minute.residual_share

    assert run([]) == run(sorted(min(at, size) for at in cuts))


def cut(minute, compared, bounds):
    """The same minute, after intervals in pieces that are counted one by one."""
    for start, stop in pairwise([0, *bounds, len(compared)]):
        minute.take(compared[start:stop])
        assert minute.time >= 0.0
    return minute


@given(seed=st.integers(0, 999), cuts=st.lists(st.integers(0, 600), max_size=6))
@example(seed=0, cuts=list(range(600)))
def test_readings_that_stay_the_same_do_not_depend_on_the_cutting(seed, cuts):
    """Runs of equal readings, as long as a sentence needs and nearly; the last one goes on."""
    rng = np.random.default_rng(seed)
    lengths = rng.choice([3, 79, 80, 160], 8)
    power = np.repeat(rng.normal(50.0, 30.0, 8), lengths)[:600]
    size = len(power)
    seconds = rng.choice([0.1, 0.1 / 3], size)
    energies = rng.choice([20.0, 30.02], size) * seconds  # at VARIES of its mean, nearly
    compared = Compared(
        SECOND * np.arange(size), np.rint(seconds * SECOND).astype(np.int64), power * seconds,
        energies, energies,
    )  # fmt: skip

    def run(bounds):
        still = cut(NewestMinute(), compared, bounds).still
        return still.longest, still.open

    assert run([]) == run(sorted(min(at, size) for at in cuts))
