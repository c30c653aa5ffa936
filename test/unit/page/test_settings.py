"""Prices by the time of use, and settings that are refused with their reason."""

from datetime import datetime
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_energy.foundation.errors import PageError
from robot_energy_report.page.settings import CostCounter, PageSettings, load_settings

BERLIN = ZoneInfo("Europe/Berlin")
DAY_AND_NIGHT = PageSettings.model_validate(
    {
        "price_per_kwh": 0.2,
        "timezone": "Europe/Berlin",
        "time_of_use": [
            {"days": ["sat", "sun"], "begin": "00:00", "end": "24:00", "price_per_kwh": 0.1},
            {"days": ["fri"], "begin": "22:00", "end": "02:00", "price_per_kwh": 0.15},
            {"begin": "06:00", "end": "20:00", "price_per_kwh": 0.3},
        ],
    }
)


def ns(*when):
    return round(datetime(*when, tzinfo=BERLIN).timestamp()) * 1_000_000_000


@pytest.mark.parametrize(
    ("when", "price"),
    [
        ((2026, 11, 18, 5, 59), 0.2),  # Wednesday
        ((2026, 11, 18, 6, 0), 0.3),
        ((2026, 11, 18, 19, 59), 0.3),
        ((2026, 11, 18, 20, 0), 0.2),
        ((2026, 11, 20, 22, 0), 0.15),  # Friday
        ((2026, 11, 21, 1, 59), 0.1),  # Saturday: the first period that holds
        ((2026, 7, 15, 6, 0), 0.3),  # daylight saving
    ],
)
def test_the_first_period_that_holds_sets_the_price(when, price):
    assert DAY_AND_NIGHT.price_at(ns(*when)) == price


def test_a_period_over_midnight_belongs_to_the_day_it_begins():
    night = PageSettings.model_validate(
        {"price_per_kwh": 1.0, "time_of_use": [
            {"days": ["fri"], "begin": "22:00", "end": "02:00", "price_per_kwh": 0.5}]}
    )  # fmt: skip
    utc = ZoneInfo("UTC")
    at = [datetime(2026, 11, day, 1, tzinfo=utc).timestamp() for day in (20, 21)]
    assert [night.price_at(round(second) * 10**9) for second in at] == [1.0, 0.5]


@pytest.mark.parametrize(
    ("begin", "end", "mean"),
    [
        ((2026, 11, 18, 5, 0), (2026, 11, 18, 7, 0), 0.25),  # half at 0.2, half at 0.3
        ((2026, 11, 18, 5, 45), (2026, 11, 18, 6, 45), 0.275),
        ((2026, 11, 18, 7, 10), (2026, 11, 18, 7, 20), 0.3),
        ((2026, 11, 18, 0, 0), (2026, 11, 19, 0, 0), (10 * 0.2 + 14 * 0.3) / 24),
        ((2026, 11, 20, 21, 0), (2026, 11, 21, 1, 0), (0.2 + 2 * 0.15 + 0.1) / 4),
        ((2026, 3, 29, 0, 0), (2026, 3, 30, 0, 0), 0.1),  # 23 hours, a Sunday
        ((2026, 11, 18, 6, 0), (2026, 11, 18, 6, 0), 0.3),
    ],
)
def test_a_mean_price_shares_by_time(begin, end, mean):
    assert DAY_AND_NIGHT.mean_price(ns(*begin), ns(*end)) == pytest.approx(mean, rel=1e-12)


def test_prices_change_at_minutes_of_a_zone_with_odd_hours():
    delhi = PageSettings.model_validate(
        {"price_per_kwh": 1.0, "timezone": "Asia/Kolkata", "time_of_use": [
            {"begin": "10:10", "end": "10:40", "price_per_kwh": 3.0}]}
    )  # fmt: skip
    begin = round(datetime(2026, 11, 18, 4, 30, tzinfo=ZoneInfo("UTC")).timestamp()) * 10**9
    assert delhi.mean_price(begin, begin + 3_600_000_000_000) == pytest.approx(2.0)


@given(st.lists(st.floats(0.0, 3.6e7), min_size=1, max_size=20))
def test_energy_is_priced_when_it_is_used(increments):
    counter, energy, stamp = CostCounter(DAY_AND_NIGHT), 5e8, ns(2026, 11, 18, 0, 30)
    counter.add(0, stamp, energy)
    expected = 0.0
    for number, increment in enumerate(increments):
        energy += increment
        begin = stamp + number * 3_600_000_000_000
        counter.add(0, begin + 3_600_000_000_000, energy)
        expected += increment / 3.6e6 * DAY_AND_NIGHT.price_at(begin + 1_800_000_000_000)
    assert counter.cost == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_a_reset_begins_the_cost_again_and_one_price_prices_all():
    counter = CostCounter(DAY_AND_NIGHT)
    start = ns(2026, 11, 18, 0, 30)
    counter.add(1, start, 0.0)
    counter.add(1, start + 10**9, 3.6e6)
    assert counter.cost == pytest.approx(0.2)
    counter.add(2, start + 2 * 10**9, 100.0)
    assert counter.cost == 0.0
    flat = CostCounter(PageSettings(price_per_kwh=0.25))
    flat.add(1, start, 7.2e6)
    assert flat.cost == pytest.approx(0.5)
    assert CostCounter(PageSettings()).cost is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("price_per_kwh: -1", "price_per_kwh"),
        ("price: 1", "price"),
        ("timezone: Mars/Olympus", "time zone"),
        ("time_of_use: [{begin: '25:00', end: '02:00', price_per_kwh: 1}]", "begin"),
        ("time_of_use: [{begin: '01:00', end: '02:00', price_per_kwh: 1}]", "price_per_kwh"),
        ("currency: *a", "alias"),
        ("co2_kg_per_kwh: .nan", "co2_kg_per_kwh"),
        ("[1, 2]", "mapping"),
    ],
)
def test_what_cannot_be_used_is_refused_with_its_key(tmp_path, text, words):
    path = tmp_path / "page.yaml"
    path.write_text(text)
    with pytest.raises(PageError, match=words):
        load_settings(str(path))


def test_no_file_gives_the_defaults():
    assert load_settings("") == PageSettings()
