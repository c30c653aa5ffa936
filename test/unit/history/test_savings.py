"""Savings against a baseline: equal to a solution by hand, and within their bands."""

from dataclasses import replace
from datetime import date, timedelta

import numpy as np
import pytest

from histories import DAY, HOUR, MINUTE, START, Robot
from refusals import refused
from robot_energy.foundation.errors import HistoryError
from robot_energy_history.database import JOB_COLUMNS
from robot_energy_history.savings import compare, fit_baseline, history_savings, savings_by_robot
from robot_energy_history.store import HistoryStore

FIRST = date(2026, 1, 1)


def test_a_line_is_found_as_by_hand():
    """Parts 0, 1, 2 .. and energies on a line but for +-1 kWh in turn: normal equations by hand."""
    parts = np.arange(20.0)
    energy = 5.0 + 2.0 * parts + np.where(parts % 2, 1.0, -1.0)
    found = fit_baseline(energy, {"parts": parts, "shift": np.full(20, 3.0)})
    assert found.left_out == ("shift",)
    mean, square = parts.mean(), ((parts - parts.mean()) ** 2).sum()
    slope = ((parts - mean) * energy).sum() / square
    assert found.values == pytest.approx([energy.mean() - slope * mean, slope])
    residual = energy - energy.mean() - slope * (parts - mean)
    deviation = np.sqrt((residual**2).sum() / 18)
    assert found.deviation == pytest.approx(deviation)
    assert found.cv_rmse == pytest.approx(deviation / energy.mean())
    assert found.likeness == 0.0  # +1, -1 in turn: unlike, which makes no band smaller
    days = compare(found, np.array([20.0, 22.0]), {"parts": np.array([10.0, 30.0]),
                                                   "shift": np.full(2, 3.0)})  # fmt: skip
    at = found.values[0] + found.values[1] * np.array([10.0, 30.0])
    assert days.saved == pytest.approx(np.cumsum(at - [20.0, 22.0]))
    assert days.outside == 1
    # Variance of one new day: s^2 (1 + 1/n + (x - mean)^2 / square); Student's t of 18, 90 %.
    one = deviation * np.sqrt(1 + 1 / 20 + (10 - mean) ** 2 / square)
    assert days.band[0] == pytest.approx(1.7341 * one, rel=1e-4)


def test_likeness_from_day_to_day_widens_the_band():
    draw = np.random.default_rng(3)
    noise = draw.normal(0, 1, 400)
    for place in range(1, 400):
        noise[place] += 0.6 * noise[place - 1]
    found = fit_baseline(100.0 + noise, {})
    assert found.likeness == pytest.approx(0.6, abs=0.1)
    assert found.growth == pytest.approx(4.0, rel=0.35)
    alone = compare(replace(found, likeness=0.0, days=10**6), np.full(9, 100.0), {}).band
    alike = compare(replace(found, days=10**6), np.full(9, 100.0), {}).band
    assert alike == pytest.approx(np.sqrt(found.growth) * alone, rel=1e-3)


@pytest.mark.parametrize("saving", [0.05, 0.0])
def test_of_many_drawn_months_nine_of_ten_bands_hold_the_truth(saving):
    """The long form, with more kinds of days: test/soak/savings_of_months.py."""
    draw, held, claimed = np.random.default_rng(9), 0, 0
    for _ in range(400):
        parts = draw.integers(0, 600, 90).astype(float)
        truth = 6.0 + 0.02 * parts
        energy = truth * (1 + 0.02 * draw.normal(size=90))
        found = compare(
            fit_baseline(energy[:60], {"parts": parts[:60]}),
            energy[60:] * (1 - saving),
            {"parts": parts[60:]},
        )
        held += abs(found.saved[-1] - saving * truth[60:].sum()) <= found.band[-1]
        claimed += found.claimed
    assert 0.85 <= held / 400 <= 0.95
    assert claimed >= 390 if saving else claimed <= 2


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """60 days of a robot: parts at 1 kWh each, 5 kWh besides; from day 40 on 10 % less."""
    folder = tmp_path_factory.mktemp("history")
    store, robot, draw, number = HistoryStore(folder), Robot(), np.random.default_rng(1), 0
    store.open()
    for day in range(60):
        parts = int(draw.integers(2, 20))
        kwh = (5.0 + parts + 0.1 * draw.normal()) * (0.9 if day >= 40 else 1.0)
        hours = 24 if day != 30 else 12
        for _ in range(hours * 4):
            robot.advance(HOUR // 4, round(kwh * 1000 / hours))
            store.add("a", [robot.read(robot.now)])
        if day == 30:
            robot.advance(14 * HOUR, 500)  # the recorder was off, into the next day
            store.add("a", [robot.read(robot.now)])
            robot.advance(10 * HOUR, 500)
            store.add("a", [robot.read(robot.now)])
            robot.now = START + (day + 1) * DAY
        for _ in range(parts):
            number += 1
            job = dict.fromkeys(JOB_COLUMNS, 0) | {"id": number, "name": f"p{number % 3}"}
            store.add_jobs("a", [job | {"start": START + day * DAY + number,
                                        "stop": START + day * DAY + HOUR}])  # fmt: skip
        assert store.write(robot.now), store.trouble
    store.close()
    return folder


def test_a_saving_of_a_recorded_robot(folder):
    spans = (FIRST, FIRST + timedelta(days=40)), (FIRST + timedelta(days=40), "2026-03-02")
    found = history_savings(folder, "a", *spans)
    assert found.baseline.values == pytest.approx([5.0, 1.0], rel=0.03)
    assert found.baseline.cv_rmse < 0.03
    assert found.claimed
    truth = float(found["energy"].sum()) / 9
    assert abs(found.saved - truth) <= found.band
    assert found.band < 0.1 * truth
    assert found["parts"].sum() > 100
    assert any("left out" in note for note in found.notes)
    assert found.baseline.days == 38
    assert found.trend.mean == pytest.approx(found["energy"].sum() / found["parts"].sum())
    everyone, failed = savings_by_robot(folder, *spans)
    assert failed == {}
    assert everyone["a"].saved == found.saved
    assert everyone["a"].notes == found.notes
    ambient = {FIRST + timedelta(days=day): 20.0 + day % 7 for day in range(60) if day != 50}
    more = history_savings(folder, "a", *spans, further={"ambient": ambient})
    assert more.baseline.names == ("constant", "parts", "ambient")
    assert len(more) == len(found) - 1
    metered = history_savings(folder, "a", *spans, measured=True)
    assert metered.saved == pytest.approx(found.saved, rel=1e-6)


def test_what_cannot_be_compared_is_refused(folder):
    month = (FIRST, FIRST + timedelta(days=40))
    with refused(HistoryError, found="weather", expected="parts"):
        history_savings(folder, "a", month, month, drivers=["weather"])
    later = (FIRST + timedelta(days=40), "2026-03-02")
    with refused(HistoryError, found="baseline of 3 days", remedy="longer"):
        history_savings(folder, "a", (FIRST, FIRST + timedelta(days=3)), later)
    with refused(HistoryError, found="in the baseline as well"):
        history_savings(folder, "a", month, (FIRST + timedelta(days=39), "2026-03-02"))
    with refused(HistoryError, found="no reported day"):
        history_savings(folder, "a", month, ("2026-05-01", "2026-06-01"))


def test_the_trend_of_the_energy_per_part_is_the_line_through_it(tmp_path):
    """5 parts a day, of 1 kWh at first and 1 % of that more each day, but for 0.1 kWh in turn."""
    store, robot = HistoryStore(tmp_path), Robot()
    store.open()
    for day in range(41):
        kwh = 5.0 * (1 + 0.01 * max(0, day - 20)) + (0.1 if day % 2 else -0.1)
        robot.advance(HOUR // 4, round(kwh * 4000))
        store.add("a", [robot.read(robot.now)])
        robot.step_clock(DAY - HOUR // 4)
        for number in range(5):
            stop = START + day * DAY + HOUR
            job = dict.fromkeys(JOB_COLUMNS, 0) | {"id": number, "name": "p", "stop": stop}
            store.add_jobs("a", [job | {"start": stop - MINUTE}])
        assert store.write(robot.now), store.trouble
    store.close()
    days = [FIRST + timedelta(days=one) for one in (0, 20, 41)]
    found = history_savings(tmp_path, "a", (days[0], days[1]), (days[1], days[2]), ())
    energy = found["energy"] / found["parts"]
    x = np.arange(21.0)
    slope, offset = np.polyfit(x, energy, 1)
    trend = found.trend
    assert trend.mean == pytest.approx(energy.mean())
    assert trend.change == pytest.approx(20 * slope / energy.mean())
    assert trend.change == pytest.approx(0.2 / 1.1, abs=0.01)
    # Half width of the slope: s / sqrt(sum of squares), Student's t of 19 degrees, 90 %.
    scatter = np.sqrt(((energy - offset - slope * x) ** 2).sum() / 19)
    half = 1.7291 * scatter / np.sqrt(((x - 10) ** 2).sum())
    assert trend.band == pytest.approx(20 * half / energy.mean(), rel=1e-3)
    few = history_savings(tmp_path, "a", (days[0], days[1]), (days[1], days[1] + timedelta(5)), ())
    assert few.trend is None
