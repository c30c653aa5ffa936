"""Energy at the price of the time of use: equal to a sum by hand over days of 23 and 25 hours."""

from datetime import UTC, datetime
from fractions import Fraction
from itertools import permutations
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from histories import DAY, HOUR, MINUTE, SECOND, Robot
from refusals import refused
from robot_energy.foundation.errors import HistoryError
from robot_energy_history.api import history
from robot_energy_history.store import HistoryStore
from robot_energy_history.tariffs import (
    MICROJOULE_PER_KWH,
    Tariff,
    add_tariffs,
    load_tariffs,
    stored_tariffs,
)
from robot_energy_history.use import QuarterUse, _priced

BERLIN = ZoneInfo("Europe/Berlin")
IMPORT = "predicted_import_microjoule"
TARIFFS = """
tariffs:
  - begin: 2026-01-01
    timezone: Europe/Berlin
    price_per_kwh: 0.31
    time_of_use:
      - {begin: "22:00", end: "06:30", price_per_kwh: 0.17}
    co2_kg_per_kwh: 0.4
    shifts: ["06:00", "14:00", "22:00"]
  - begin: 2026-04-10
    timezone: Europe/Berlin
    price_per_kwh: 0.5
    shifts: ["06:00", "14:00", "22:00"]
"""


def ns(*when, zone=BERLIN):
    return int(datetime(*when, tzinfo=zone).timestamp()) * SECOND


def recorded(folder, start, quarters):
    """A robot that is read every quarter of an hour; what it used in each."""
    store, robot = HistoryStore(folder), Robot(now=start, start=start)
    store.open()
    used = {}
    for _ in range(quarters):
        before, begin = robot.values[IMPORT], robot.now
        robot.advance(15 * MINUTE, standby=len(used) % 3 == 0)
        used[begin] = robot.values[IMPORT] - before
        store.add("a", [robot.read(robot.now)])
        if len(used) % 100 == 0:
            assert store.write(robot.now)
    assert store.write(robot.now)
    return store, used


def by_hand(used, start, stop):
    cost = Fraction(0)
    for begin, energy in used.items():
        if start <= begin < stop:
            local = datetime.fromtimestamp(begin / SECOND, UTC).astimezone(BERLIN)
            clock = (local.hour, local.minute)
            price = Fraction(17 if clock >= (22, 0) or clock < (6, 30) else 31, 100)
            if local.date() >= datetime(2026, 4, 10).date():
                price = Fraction(1, 2)
            cost += energy * price
    return float(cost / 3_600_000_000_000)


@pytest.mark.parametrize(
    ("first", "days", "hours"),
    [((2026, 3, 1), 31, 743), ((2026, 10, 1), 31, 745), ((2026, 4, 1), 30, 720)],
)
def test_a_month_costs_what_a_sum_by_hand_says(tmp_path, first, days, hours):
    path = tmp_path / "tariffs.yaml"
    path.write_text(TARIFFS)
    start = ns(*first)
    store, used = recorded(tmp_path / "h", start, hours * 4)
    add_tariffs(store.folder, load_tariffs(str(path)), 0)
    store.close()
    stop = start + hours * HOUR
    month = history(tmp_path / "h", start, stop, "month", timezone="Europe/Berlin")
    assert month["cost"].tolist() == pytest.approx([by_hand(used, start, stop)], rel=1e-12)
    assert month["priced_microjoule"].tolist() == month[IMPORT].tolist() == [sum(used.values())]
    each = history(tmp_path / "h", start, stop, "day", timezone="Europe/Berlin")
    assert len(each) == days
    longest = {
        (int(b) - int(a)) // HOUR for a, b in zip(each.stamp_ns, each["stop_ns"], strict=True)
    }
    assert longest == {24, 24 + hours - days * 24}
    for begin, end, cost in zip(each.stamp_ns, each["stop_ns"], each["cost"], strict=True):
        assert cost == pytest.approx(by_hand(used, begin, end), rel=1e-12)


@pytest.mark.parametrize(("first", "hours"), [((2026, 3, 1), 743), ((2026, 10, 1), 745)])
def test_shifts_and_standby_are_what_a_sum_by_hand_says(tmp_path, first, hours):
    """Over both changes of summer time; every third quarter hour is standby."""
    path, start = tmp_path / "tariffs.yaml", ns(*first)
    path.write_text(TARIFFS)
    store, used = recorded(tmp_path / "h", start, hours * 4)
    add_tariffs(store.folder, load_tariffs(str(path)), 0)
    store.write(start + (hours + 48) * HOUR)  # the first days are rolled up, the others are not
    store.close()
    stop = start + hours * HOUR
    shifts, rests, costs = {}, {"night": 0, "weekend": 0}, {"night": Fraction(0), "weekend": 0}
    for place, (begin, energy) in enumerate(used.items()):
        local = datetime.fromtimestamp(begin / SECOND, UTC).astimezone(BERLIN)
        shift = {0: "22:00", 1: "06:00", 2: "14:00"}[(local.hour + 2) // 8 % 3]
        shifts[shift] = shifts.get(shift, 0) + energy
        clock = (local.hour, local.minute)
        night = clock >= (22, 0) or clock < (6, 0)
        price = 50 if first[1] > 4 else 17 if night or clock < (6, 30) else 31
        rest = "weekend" if local.weekday() > 4 else "night" if night else ""
        if rest and place % 3 == 0:
            rests[rest] += energy
            costs[rest] += Fraction(price, 100) * energy
    for resolution in ("month", "day"):
        asked = (tmp_path / "h", start, stop, resolution)
        month = history(*asked, timezone="Europe/Berlin")
        for rest, energy in rests.items():
            assert month[f"standby_{rest}_microjoule"].sum() == energy
            cost = float(costs[rest] / 3_600_000_000_000)
            assert month[f"standby_{rest}_cost"].sum() == pytest.approx(cost, rel=1e-12)
        by_shift = history(*asked, timezone="Europe/Berlin", by_shift=True)
        for shift, energy in shifts.items():
            assert by_shift[IMPORT][by_shift["shift"] == shift].sum() == energy
        assert by_shift["cost"].sum() == pytest.approx(month["cost"].sum(), rel=1e-12)
        assert by_shift["standby_microjoule"].sum() == month["standby_microjoule"].sum()
    with refused(HistoryError, expected="by_joint or by_shift"):
        history(*asked, by_shift=True, by_joint=True)


def test_energy_of_one_price_is_multiplied_by_it_once():
    """Rounded once, so that night, weekend and the rest cost as much in any order."""
    energy, price = [4_134_767_232_379, 7_104_857_072_657, 1_407_866_726_139], 0.31
    uses = [QuarterUse(price, 0.4, "", rest) for rest in ("night", "weekend", "")]
    sums = {use: np.array([[own, own]]) for use, own in zip(uses, energy, strict=True)}
    for order in permutations(sums):
        found = _priced({use: sums[use] for use in order}, 1)
        assert found["cost"][0] == sum(energy) / MICROJOULE_PER_KWH * price
        assert found["co2_kg"][0] == sum(energy) / MICROJOULE_PER_KWH * 0.4


def test_a_shift_that_nobody_named_is_refused(tmp_path):
    recorded(tmp_path, ns(2026, 3, 1), 1)[0].close()
    with refused(HistoryError, expected="tariff with shifts", remedy="tariff --add"):
        history(tmp_path, "2026-03-01", "2026-03-02", by_shift=True)


def test_zones_off_by_a_half_hour_have_whole_days(tmp_path):
    zone = ZoneInfo("Asia/Kolkata")
    start = ns(2026, 5, 1, zone=zone)
    store, used = recorded(tmp_path, start, 48 * 4)
    store.close()
    days = history(tmp_path, start, start + 2 * DAY, "day", timezone="Asia/Kolkata")
    values = list(used.values())
    assert days[IMPORT].tolist() == [sum(values[:96]), sum(values[96:])]


def test_energy_whose_time_is_not_known_has_no_price(tmp_path):
    start = ns(2026, 3, 1)
    store, used = recorded(tmp_path, start, 4)
    robot = Robot(now=start, start=start)
    for _ in range(4):
        robot.advance(15 * MINUTE)
    robot.advance(8 * HOUR)  # not recorded, over the change of prices at 6:30
    store.add("a", [robot.read(robot.now)])
    assert store.write(robot.now)
    tariff = Tariff.model_validate(
        {"begin": datetime(2026, 1, 1).date(), "timezone": "Europe/Berlin", "price_per_kwh": 0.31,
         "time_of_use": ({"begin": "22:00", "end": "06:30", "price_per_kwh": 0.17},)}
    )  # fmt: skip
    add_tariffs(tmp_path, [tariff], 0)
    store.close()
    day = history(tmp_path, start, start + DAY, "day", timezone="Europe/Berlin")
    assert day[IMPORT].tolist() == [robot.values[IMPORT]]
    assert day["priced_microjoule"].tolist() == [sum(used.values())]


def test_a_span_over_midnight_costs_something_in_the_month_alone(tmp_path):
    """20 hours from 18:00 on that nobody recorded, at one price."""
    start = ns(2026, 3, 3, 18)
    store, robot = HistoryStore(tmp_path), Robot(now=start, start=start)
    store.open()
    for hours in (1, 20):
        robot.advance(hours * HOUR, 1000)
        store.add("a", [robot.read(robot.now)])
        assert store.write(robot.now)
    store.close()
    flat = Tariff(begin=datetime(2026, 1, 1).date(), price_per_kwh=0.5, timezone="Europe/Berlin")
    add_tariffs(tmp_path, [flat], 0)
    days = history(tmp_path, "2026-03-03", "2026-03-05", "day", timezone="Europe/Berlin")
    assert days["cost"].tolist() == [0.5]
    month = history(tmp_path, "2026-03-01", "2026-04-01", "month", timezone="Europe/Berlin")
    assert month["cost"].tolist() == [21 * 0.5]


def test_a_tariff_of_the_same_day_takes_the_place_and_the_earlier_one_is_kept(tmp_path):
    store, _ = recorded(tmp_path, ns(2026, 3, 1), 1)
    for price in (0.1, 0.2):
        one = Tariff(begin=datetime(2026, 1, 1).date(), price_per_kwh=price)
        add_tariffs(tmp_path, [one], 0)
    store.close()
    assert [one.price_per_kwh for one in stored_tariffs(tmp_path)] == [0.2]
    path = tmp_path / "tariffs.jsonl"
    assert len(path.read_text().splitlines()) == 2
    assert path.stat().st_mode & 0o077 == 0
    with path.open("a") as file:
        file.write('0 {"begin": "2026-0')  # a crash within a line
    assert [one.price_per_kwh for one in stored_tariffs(tmp_path)] == [0.2]
    add_tariffs(tmp_path, [Tariff(begin=datetime(2026, 1, 1).date(), price_per_kwh=0.3)], 0)
    assert [one.price_per_kwh for one in stored_tariffs(tmp_path)] == [0.3]
    path.write_text("rubbish\n")
    with refused(HistoryError, found="tariffs.jsonl", remedy="move it away"):
        stored_tariffs(tmp_path)


def test_costs_in_two_currencies_are_not_added_up(tmp_path):
    recorded(tmp_path, ns(2026, 3, 1), 1)[0].close()

    def tariff(day: int, currency: str, price: float | None = 0.3) -> Tariff:
        begin = datetime(2026, 1, day).date()
        return Tariff(begin=begin, currency=currency, price_per_kwh=price)

    add_tariffs(tmp_path, [tariff(1, "EUR"), tariff(2, "CHF", None)], 0)
    again = {"found": "CHF and EUR", "expected": "one currency", "remedy": "with the same begin"}
    with refused(HistoryError, **again):
        add_tariffs(tmp_path, [tariff(3, "CHF")], 0)
    path = tmp_path / "tariffs.jsonl"
    both = path.read_text() + f"0 {tariff(3, 'CHF').model_dump_json()}\n"  # as it was added before
    path.write_text(both)
    with refused(HistoryError, **again):
        history(tmp_path, "2026-03-01", "2026-03-02")
    add_tariffs(tmp_path, [tariff(1, "CHF"), tariff(3, "CHF")], 0)  # which takes the place
    assert [one.currency for one in stored_tariffs(tmp_path)] == ["CHF"] * 3


@pytest.mark.parametrize(
    ("change", "expected"),
    [(('"06:30"', '"06:40"'), "quarter"), (("Europe/Berlin", "Europe/Berln"), "Europe/Berlin"),
     (("2026-01-01", "yesterday"), "")],
)  # fmt: skip
def test_a_tariff_that_cannot_be_used_is_refused(tmp_path, change, expected):
    path = tmp_path / "tariffs.yaml"
    path.write_text(TARIFFS.replace(*change))
    with pytest.raises(HistoryError) as error:
        load_tariffs(str(path))
    assert expected in str(error.value)


def test_what_was_asked_for_is_refused_with_what_there_is(tmp_path):
    start = ns(2026, 3, 1)
    recorded(tmp_path / "h", start, 1)[0].close()
    with refused(HistoryError, expected="history.sqlite", remedy="energy_recorder"):
        history(tmp_path, start, start + DAY)
    with refused(HistoryError, found="no robot 'b'", expected="a"):
        history(tmp_path / "h", start, start + DAY, robots=["b"])
    with refused(HistoryError, found="Mars", expected="time zone"):
        history(tmp_path / "h", start, start + DAY, timezone="Mars/Base")
    with refused(HistoryError, expected="start before its stop"):
        history(tmp_path / "h", "2026-03-02", "2026-03-01")
    with refused(HistoryError, found="tomorrow"):
        history(tmp_path / "h", "tomorrow", "2026-03-01")
    with refused(HistoryError, found="parts of a minute", remedy="coarser"):
        history(tmp_path / "h", "2020-01-01", "2026-03-01", "minute")
    one = history(tmp_path / "h", "2026-03-01", "2026-03-02", timezone="Europe/Berlin")
    assert one.stamp_ns.tolist() == [start]
    assert one.to_polars()["time"][0] == datetime.fromtimestamp(start / SECOND, UTC)


def test_tariffs_that_may_not_be_read_are_not_to_be_moved_away(tmp_path, monkeypatch):
    def denied(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("robot_energy_history.tariffs.read_regular", denied)
    with refused(HistoryError, expected="access rights") as caught:
        stored_tariffs(tmp_path)
    assert not caught.value.remedy
