"""Savings and learned friction on the page are those of the library; what cannot be is said."""

import json
from datetime import date

import pytest

from histories import DAY, START, record_days
from refusals import refused
from robot_energy.foundation.errors import HistoryError
from robot_energy_history.savings import history_savings
from robot_energy_report.page.history_view import (
    HistoryView,
    friction_answer,
    savings_answer,
)

NOW = START + 95 * DAY
MARCH = {"period": ["month"], "at": ["2026-03-05"], "timezone": ["UTC"]}
BASELINE = {"baseline_start": ["2026-01-01"], "baseline_stop": ["2026-03-01"], "driver": ["parts"]}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("savings") / "history"
    record_days(folder, {"cell1/a": 0.06, "cell1/b": 0.0})
    return folder


def compared(folder, robots=(), now=NOW, **asked):
    given = {**MARCH, **BASELINE, **asked}
    view = HistoryView(folder)
    wish = view.wish({**given, "robot": list(robots)}, now)
    answer = savings_answer(folder, wish, given, now)
    json.dumps(answer, allow_nan=False)
    return answer


def test_savings_of_the_page_are_those_of_the_library(folder):
    answer = compared(folder, ["cell1/a"])
    found = history_savings(
        folder, "cell1/a", ("2026-01-01", "2026-03-01"), ("2026-03-01", "2026-04-01")
    )
    (row,) = answer["rows"]
    assert row["claimed"]
    assert row["saved"] == pytest.approx(3.6e6 * found.saved)
    assert row["band"] == pytest.approx(3.6e6 * found.band)
    assert row["cv_rmse"] == found.baseline.cv_rmse
    one = answer["one"]
    assert [day["saved"] / 3.6e6 for day in one["days"]] == pytest.approx(found["saved"].tolist())
    assert one["days"][0]["name"] == "Sunday 2026-03-01"
    assert one["days"][0]["zoom"] == {"period": "day", "at": "2026-03-01T00:00+00:00"}
    most = max(abs(found["energy"] - found["expected"]))
    worst = one["deviations"][0]
    assert abs(worst["energy"] - worst["expected"]) == pytest.approx(3.6e6 * most)
    assert abs(worst["deviation"]) == pytest.approx(most / found.baseline.deviation)
    assert {term["name"] for term in one["terms"]} == {"constant", "parts"}


def test_of_several_robots_the_surest_change_is_first(folder):
    answer = compared(folder)
    assert [row["robot"] for row in answer["rows"]] == ["cell1/a", "cell1/b"]
    assert [row["claimed"] for row in answer["rows"]] == [True, False]
    assert answer["one"] is None
    assert answer["reported"] == "2026-03-01 to 2026-03-31"
    few = compared(folder, baseline_start=["2026-02-25"])
    assert few["rows"] == []
    assert [row["robot"] for row in few["left_out"]] == ["cell1/a", "cell1/b"]
    assert "at least 9 days" in few["left_out"][0]["why"]


def test_a_month_that_goes_on_is_compared_up_to_the_last_day_that_is_over(folder):
    answer = compared(folder, ["cell1/a"], now=START + 69 * DAY + 5 * 3600 * 10**9)
    assert answer["reported"] == "2026-03-01 to 2026-03-10"
    assert len(answer["one"]["days"]) == 10


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"baseline_start": [""]}, "time"), ({"driver": ["__class__"]}, "driver"),
        ({"baseline_stop": ["2026-03-02"]}, "holds days"), ({"period": ["hour"]}, "whole days"),
        ({"baseline_start": ["2026-05-01"], "baseline_stop": ["2026-04-01"]}, "1 to 1200"),
        ({"baseline_start": ["2010-01-01"]}, "1 to 1200"), ({"at": ["2026-07-01"]}, "whole days"),
    ],
)  # fmt: skip
def test_what_cannot_be_compared_is_refused(folder, asked, said):
    with pytest.raises(HistoryError, match=said):
        compared(folder, **asked)


def test_learned_friction_has_a_row_of_each_model_and_the_largest_change_first(folder):
    view = HistoryView(folder)
    wish = view.wish({**MARCH, "period": ["year"], "robot": ["cell1/a"]}, NOW)
    answer = friction_answer(folder, wish.robots, wish.period)
    json.dumps(answer, allow_nan=False)
    assert len(answer["parts"]) == 12
    rows = {(row["joint"], row["model"]): row for row in answer["rows"]}
    first = rows["elbow", "m1"]
    assert first["values"][0] == pytest.approx(1 + 0.002 * 15)  # mean of 31 days
    assert first["values"][2:] == [None] * 10
    assert first["days"] == 45
    assert answer["rows"][0]["joint"] == "elbow"
    assert rows["wrist", "m2"]["last"] == 1.0
    with refused(HistoryError, found="no robot 'c'"):
        friction_answer(folder, ["c"], wish.period)
    empty = view.wish({"period": ["day"], "at": [str(date(2020, 1, 1))]}, NOW)
    assert friction_answer(folder, (), empty.period)["rows"] == []
