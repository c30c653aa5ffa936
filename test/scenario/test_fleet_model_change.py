"""A robot of a fleet gets another model: wear is found as before, what stands by is named once."""

import numpy as np
import polars as pl
import pytest
from fleet_study import tables_of

from fleets import exact, fleet
from robot_energy.foundation.units import HOUR_NS
from robot_energy_fleet.bag_joints import MEASURED, UPPER, gram_of
from robot_energy_fleet.report import fleet_report

DAY_NS = 24 * HOUR_NS
DAYS, WORN_FROM = 60, 30
AXIS = "joint_a3"
SCATTER = 0.01  # of the friction of a bag [-]


def days(model_of_day, wear, more=None):
    """One bag a day of one robot, of which friction of an axis rises by `wear`.

    Args:
        model_of_day: Name, friction of the axis over that of the first model, and begin of the
            names of joints, by day.
        wear: More friction from `WORN_FROM` on. [-]
        more: Other values of the rows of joints.
    """
    whole, random = fleet(1, faults=False, days=1, cycles=6), np.random.default_rng(0)
    key = whole.runs.filter(pl.col("robot") == "robot-01").sort("start_ns")["key"][0]
    rows = {
        name: [exact(row) for row in table.filter(pl.col("key") == key).to_dicts()]
        for name, table in vars(whole).items()
    }
    run, *_ = rows["runs"]
    for day in range(DAYS):
        name, ratio, prefix = model_of_day(day)
        later = day * DAY_NS
        own = {"key": str(day), "bag": str(day), "model_id": name}
        spans = {end: run[end] + later for end in ("start_ns", "end_ns")}
        joints = []
        for row in rows["joints"]:
            factor = (1.0 + wear * (day >= WORN_FROM)) / ratio if row["joint"] == AXIS else 1.0
            factor *= 1.0 + SCATTER * random.standard_normal()
            gram = gram_of(np.array([row["friction_sums"]]))[0]
            gram[MEASURED, :] *= factor
            gram[:, MEASURED] *= factor
            stamps = [stamp_ns + later for stamp_ns in row["wear_stamp_ns"]]
            joints.append(
                row
                | {
                    "key": own["key"],
                    "joint": prefix + row["joint"],
                    "friction_sums": gram[UPPER].tolist(),
                    "wear_stamp_ns": stamps,
                    "wear_excess": [factor - 1.0] * len(stamps),
                    "wear_variance": [SCATTER**2] * len(stamps),
                }
                | (more or {})
            )
        hours = [
            row | {"key": own["key"], "hour_ns": row["hour_ns"] + later} for row in rows["hours"]
        ]
        yield {"runs": [run | own | spans], "hours": hours, "joints": joints}


def found(model_of_day, wear, more=None):
    report = fleet_report(tables_of(days(model_of_day, wear, more)), "fleet")
    return [(one.kind, one.subject, round(one.size, 1)) for one in report.findings]


@pytest.mark.parametrize(
    ("ratio", "prefix"),
    [(0.8, ""), (1.0, "other_"), (1.1, ""), (1.2, "other_"), (1.3, "")],
)
def test_wear_before_a_model_changed_is_found(ratio, prefix):
    """Whatever the new model says of friction, and however it names its joints."""

    def model(day):
        return ("new", ratio, prefix) if day >= 45 else ("old", 1.0, "")

    assert found(model, 0.2) == [("wear", AXIS, 0.2)]
    assert found(model, 0.0) == []


def test_wear_under_one_model_is_found():
    assert found(lambda _: ("old", 1.0, ""), 0.2) == [("wear", AXIS, 0.2)]
    assert found(lambda _: ("old", 1.0, ""), 0.0) == []


def test_bags_with_too_little_motion_each_do_not_end_the_report():
    assert found(lambda _: ("old", 1.0, ""), 0.2, {"friction_rows": 50}) == []


def bags_of(robot, model_of_day, standing):
    """Eight days of an hour each, with a job whose energy is `standing` too much."""
    for day in range(8):
        key, start_ns = f"{robot}-{day}", day * DAY_NS
        span = {"key": key, "robot": robot, "start_ns": start_ns, "end_ns": start_ns + HOUR_NS}
        standby = 3600.0 if standing else float(3 * int(robot[1:]) + day)
        run = {"bag": key, "model_id": model_of_day(day), "reason": "", "problems": [],
               "observed_time": 3600.0, "grid_energy": 1e6, "brake_energy": 0.0}  # fmt: skip
        hour = {"key": key, "robot": robot, "hour_ns": start_ns, "observed_time": 3600.0,
                "motion_time": 3600.0 - standby, "grid_energy": 1e6, "standby_time": standby,
                "standby_energy": 100.0 * standby}  # fmt: skip
        energy = 1000.0 * (1.5 if standing else 1.0 + 0.001 * ((3 * int(robot[1:]) + day) % 7))
        job = {"name": "pick", "observed_time": 10.0, "gap_time": 0.0, "grid_energy": energy,
               "predicted_return_energy": 0.0}  # fmt: skip
        rows = {"runs": span | run, "hours": hour, "jobs": span | job}
        yield {name: [exact(row)] for name, row in rows.items()}


@pytest.mark.parametrize("change", [4, 99])
def test_what_has_nothing_to_do_with_the_model_is_said_once(change):
    def model(day):
        return "new" if day >= change else "old"

    bags = [bag for number in range(6) for bag in bags_of(f"r{number}", model, number == 5)]
    report = fleet_report(tables_of(bags), "fleet")
    kinds = [(one.robot, one.kind, one.subject) for one in report.findings]
    assert kinds == [("r5", "standby", ""), ("r5", "energy", "pick")]
