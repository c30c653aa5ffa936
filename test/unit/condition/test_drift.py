"""Records whose law, load and wear are known: found, sized, and no other effect taken for it."""

from copy import deepcopy
from functools import cache
from itertools import islice

import numpy as np
import pytest

from robot_energy.condition import wear_records
from robot_energy.condition.baseline import BRIEF_HOURS, Contrasts
from robot_energy.condition.drift import MAX_RECORDS, DriftTest
from robot_energy.condition.joint_friction import SPEED_BUCKETS
from robot_energy.condition.record import ContrastEntry
from robot_energy.condition.wear_records import (
    DEGC_BUCKETS,
    FEATURES,
    OWN,
    RECORD_TIME,
    WearRecord,
    degc_shares,
    features_of,
)

HOUR_NS = 3_600_000_000_000


def record(number, excess, degc=35.0, load=1.0, difference=0.0, scatter=0.05):
    """Five minutes of motion at one speed."""
    speed = np.eye(SPEED_BUCKETS)[2]
    features = features_of(
        degc_shares(np.array(degc)), speed, [load, difference, scatter, 0.0, 0.0, 0.0]
    )
    hours = number / 12
    return WearRecord(round(hours * HOUR_NS), hours, RECORD_TIME, excess, 0.003**2, features)


def series(count, wear=lambda hours: 0.0, seed=0, first=0):
    """A swing of 15 to 60 degC once in 12 h of motion; the law of the model is wrong with it."""
    rng = np.random.default_rng(seed)
    for number in range(first, first + count):
        hours = number / 12
        degc = 37.5 + 22.5 * np.sin(2 * np.pi * hours / 12)
        law = 0.2 - 0.004 * (degc - 37.5)
        yield record(number, law + np.log1p(wear(hours)) + 0.003 * rng.standard_normal(), degc=degc)


BEGIN = 360  # records of 30 h, with which most series begin


def outcome(records, begun=None) -> tuple[DriftTest, list[float]]:
    test, found = begun or (DriftTest(), [])
    for each in records:
        if test.step(each):
            found.append(each.hours)
    return test, found


@cache
def beginning():
    return outcome(series(BEGIN))


def outcome_later(records) -> tuple[DriftTest, list[float]]:
    """The same of records that begin as `series` does, whose beginning is worked out once."""
    return outcome(islice(records, BEGIN, None), deepcopy(beginning()))


def step(size, count=700):
    return series(count, lambda hours: size * (hours >= 40.0))


@cache
def outcome_of_step(size) -> tuple[DriftTest, list[float]]:
    return outcome_later(step(size))


def test_a_wrong_law_and_a_swing_of_temperature_are_no_wear():
    """And the records stay few and lose no time."""
    test, found = outcome_later(series(1000))
    assert found == []
    assert len(test.records) <= MAX_RECORDS
    assert sum(each.time for each in test.records) == pytest.approx(1000 * RECORD_TIME)
    assert [each.hours for each in test.records] == sorted(each.hours for each in test.records)


@pytest.mark.parametrize("size", [0.15, -0.2])
def test_a_step_is_found_within_an_hour_of_motion_with_its_size_and_time(size):
    test, found = outcome_of_step(size)
    assert 40.0 <= found[0] < 41.0
    assert test.drift.size == pytest.approx(size, abs=0.02)
    assert test.drift.std < 0.02
    assert test.drift.since_ns == pytest.approx(40 * HOUR_NS, abs=2 * HOUR_NS)
    assert test.drift.sure > 0.999
    assert test.drift.fell is (size < 0)


def test_slow_wear_is_found_and_followed():
    test, found = outcome_later(series(720, lambda hours: 0.003 * max(hours - 30.0, 0.0)))
    assert 30.0 < found[0] < 45.0
    assert test.drift.size == pytest.approx(0.003 * 30.0, abs=0.02)
    assert not test.drift.fell


@pytest.mark.long
def test_five_percent_in_a_hundred_hours_is_found_within_a_day_of_motion():
    """The size stated is that of the whole rise so far."""
    test, found = outcome(series(12 * 85, lambda hours: 0.0005 * max(hours - 60.0, 0.0)))
    assert 60.0 < found[0] < 84.0
    assert test.changes[0].ramp
    assert test.changes[0].hours == pytest.approx(60.0, abs=6.0)
    assert test.drift.size == pytest.approx(0.0005 * 25.0, abs=0.004)


@pytest.mark.long
def test_slow_wear_is_found_within_a_day_where_records_scatter():
    """By 1.4 % and nothing that lasts: the mean of hours is known well."""
    rng = np.random.default_rng(2)
    noise = 0.014
    found = outcome(
        each._replace(excess=each.excess + noise * rng.standard_normal(), variance=noise**2)
        for each in series(12 * 80, lambda hours: 0.0005 * max(hours - 48.0, 0.0))
    )[1]
    assert 48.0 < found[0] < 72.0


def test_a_steep_slope_is_no_payload():
    """Every half hour another payload moves friction by up to 60 %, by one slope, known soon."""
    rng, speed, test = np.random.default_rng(3), np.eye(SPEED_BUCKETS)[2], DriftTest()
    for number, each in enumerate(series(12 * 6)):
        if number % 6 == 0:
            off = rng.uniform(-0.1, 0.1)
        more = [1.0, off, 0.05, 0.0, 0.0, 0.0]
        other = features_of(np.array(each.features[:DEGC_BUCKETS]), speed, more)
        test.step(each._replace(excess=each.excess - 6.0 * off, features=other))
    assert test.contrasts.payload < 0.0031**2


def test_a_ramp_needs_a_reference_before_it():
    """A rise of 5 % over the first 15 h of motion may be a reference that settles: no alarm."""
    found = outcome(series(12 * 20, lambda hours: 0.05 * min(hours / 15.0, 1.0)))[1]
    assert found == []


def test_what_lasts_half_an_hour_is_no_wear():
    """A payload that is like no other moves friction by 1.2 % for six records, once in 20 h."""
    records = [
        each._replace(excess=each.excess + 0.012 * (number % 240 >= 234))
        for number, each in enumerate(series(740))
    ]
    assert outcome(records)[1] == []


def test_after_re_greasing_friction_has_fallen():
    def wear(hours):
        return 0.15 if 30.0 <= hours < 50.0 else 0.0

    test, found = outcome_later(series(740, wear))
    assert 30.0 < found[0] < 31.0
    assert any(50.0 < hours < 51.0 for hours in found)
    assert test.drift.fell
    assert abs(test.drift.size) < 0.02
    assert test.drift.since_ns == pytest.approx(50 * HOUR_NS, abs=2 * HOUR_NS)


def test_a_payload_that_the_model_lacks_is_no_wear():
    rng = np.random.default_rng(1)
    records = []
    for each in series(600):
        if 20.0 <= each.hours % 40.0:
            degc, speed = each.features[:DEGC_BUCKETS], np.eye(SPEED_BUCKETS)[2]
            more = [1.6, 0.15, 0.12, 0.0, 0.0, 0.0]  # load, difference of directions, scatter
            other = features_of(np.array(degc), speed, more)
            records.append(each._replace(excess=each.excess + 0.03, features=other))
        else:
            records.append(each._replace(excess=each.excess + 0.001 * rng.standard_normal()))
    assert outcome(records)[1] == []


def test_records_that_are_no_numbers_are_counted():
    test, found = outcome([*series(30), record(30, np.nan), record(31, np.inf)])
    assert (test.refused, found) == (2, [])
    assert sum(each.time for each in test.records) == 30 * RECORD_TIME


def test_it_continues_as_if_nothing_had_happened():
    whole, _ = outcome_of_step(0.15)
    before, _ = outcome_later(step(0.15, 500))
    again = DriftTest()
    contrasts = Contrasts.restored(ContrastEntry.of(before.contrasts))
    again.restore(before.records, before.changes, contrasts, before.programs)
    assert again.drift == before.drift
    for each in list(step(0.15))[500:]:
        again.step(each)
    assert again.records == whole.records
    assert again.drift == whole.drift


def programs_in_turn(hours_each, shown, hours=52.0, rise=0.15):
    """Four programs in turn, each with a level of its own, and more friction from 50 h on."""
    rng = np.random.default_rng(4)
    level, work = rng.normal(0.0, 0.03, 4), rng.dirichlet(np.ones(SPEED_BUCKETS), 4)
    for number in range(round(12 * hours)):
        now = int(number / 12 / hours_each) % 4
        excess = level[now] + np.log1p(rise * (number >= 600)) + 0.003 * rng.standard_normal()
        yield record(number, excess)._replace(work=tuple(work[now]) if shown else ())


@pytest.mark.long
def test_another_program_is_no_wear_but_wear_is_found_in_it():
    """A large step counts at once; without the programs, their levels are taken for wear."""
    found = outcome(programs_in_turn(9.0, True, 64.0))[1]
    assert len(found) == 1
    assert 50.0 < found[0] < 51.0
    assert outcome(programs_in_turn(9.0, False))[1][0] < 50.0


def test_a_smaller_step_counts_once_it_has_lasted():
    found = outcome(programs_in_turn(9.0, True, 64.0, 0.07))[1]
    assert len(found) == 1
    assert 55.5 < found[0] < 62.0


@pytest.mark.long
def test_scatter_is_separated_from_what_lasts_half_an_hour():
    """Of pairs of records: scatter falls with their length, a payload does not."""
    rng = np.random.default_rng(5)
    for scattered, lasting in ((0.014, 0.0), (0.003, 0.014)):
        test, level = DriftTest(), 0.0
        stay = np.exp(-RECORD_TIME / 3600.0 / BRIEF_HOURS)
        for each in series(12 * 60):
            level = stay * level + lasting * np.sqrt(1.0 - stay**2) * rng.standard_normal()
            excess = each.excess + level + scattered * rng.standard_normal()
            test.step(each._replace(excess=excess, variance=0.005**2))
        assert np.sqrt(test.contrasts.payload) == pytest.approx(lasting, abs=0.004)


def test_a_new_program_alone_is_no_wear():
    """It has 2.7 times the friction of those before, for ten hours; nothing else changed."""
    work = np.random.default_rng(4).dirichlet(np.ones(SPEED_BUCKETS), 3)
    records = [
        each._replace(
            excess=each.excess + 1.0 * (each.hours >= 40.0),
            work=tuple(work[2 if each.hours >= 40.0 else int(each.hours / 5.0) % 2]),
        )
        for each in series(600)
    ]
    assert outcome(records)[1] == []


def test_levels_of_programs_survive_merging_and_a_restart():
    """The level of each program against that of the first, from records long merged."""
    test = outcome(programs_in_turn(3.0, True, 48.0))[0]
    level = np.random.default_rng(4).normal(0.0, 0.03, 4)
    columns = [FEATURES + OWN * number for number in range(3)]
    found = test.contrasts.baseline().mean[columns]
    np.testing.assert_allclose(found, level[1:] - level[0], atol=0.002)
    kept = Contrasts.restored(ContrastEntry.of(test.contrasts))
    np.testing.assert_array_equal(kept.baseline().mean, test.contrasts.baseline().mean)


def test_a_program_that_is_forgotten_takes_no_level_along(monkeypatch):
    """Five programs in turn, and room for two: old ones are forgotten, and nothing is found."""
    monkeypatch.setattr(wear_records, "MAX_PROGRAMS", 2)
    assert outcome(programs_in_turn(3.0, True, 48.0))[1] == []


def test_a_record_between_two_programs_is_dropped():
    one, between, other = (0.1, 0.2, 0.3, 0.4), (0.2, 0.2, 0.3, 0.3), (0.3, 0.2, 0.3, 0.2)
    seen = wear_records.ProgramTable()
    works = (one, one, between, other, other, other, one)
    found = [seen.step(record(0, 0.0)._replace(work=work))[0] for work in works]
    assert [row is None for row in found] == [False, False, True, True, False, False, False]
    assert [len(row.program) for row in found if row] == [0, 0, OWN, OWN, 0]
