"""How fast a learner learns and when wear is found, on the virtual rig; exit code 1 if missed.

Usage: ``python test/bench/condition.py [--quick]``; whole: about 20 minutes.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import median

import numpy as np
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent.parent))

from robot_energy.timeline.blocks import Learning
from robot_energy_rig import RigConfig, load_profile, random_profile
from robot_energy_studies.learning_study import Shift, detection, learning_study
from wear_study import FoundRow, SimulatedRow, meter_only, simulated

LAST = 10  # minutes over which the error at the end is taken
PLANTS = (("kr16", 623), ("irb4600", 624), ("kr16", 625), ("kr16", 626))
CHANGING = (("kr16", 640), ("irb4600", 641), ("kr16", 642), ("kr16", 643))
CHANGES = (2.0, 48.0)  # h with one program, at least and at most
METER_PLANT = 401

Goals = dict[str, bool]  # which were reached


def learner(quick: bool) -> tuple[Table, Goals]:
    """Error against the meter, minute by minute."""
    table = Table(title="Learner: friction 30 % and constant losses 15 % off, cold to warm")
    for heading in ("plant", "learns from", "first minute", "last ten", "worst of them", "at end"):
        table.add_column(heading)
    reached = True
    plants = {"kr16": load_profile("kr16"), "irb4600": load_profile("irb4600")}
    if not quick:
        plants |= {f"kr16, drawn {n}": random_profile("kr16", n) for n in (3, 7)}
    for name, profile in plants.items():
        for with_torque in (True, False):
            for hard in (False,) if quick else (False, True):
                config = RigConfig.hard() if hard else None
                minutes = 15 if quick else 30
                rows, _ = learning_study(
                    profile, Learning.APPLY, with_torque, minutes, config=config
                )
                errors = [row.error for row in rows]
                last = float(np.mean(errors[-LAST:]))
                reached &= abs(last) < 0.03
                table.add_row(
                    name + (", hard" if hard else ""),
                    "torque and meter" if with_torque else "meter",
                    f"{100 * errors[0]:+.1f} %",
                    f"{100 * last:+.2f} %",
                    f"{100 * max(map(abs, errors[-LAST:])):.2f} %",
                    f"{rows[-1].degc:.0f} degC",
                )
    return table, {"within 3 % of the meter in 30 min of work": reached}


def wear(quick: bool) -> tuple[Table, Goals]:
    """Time until wear of one axis is found, computed through on the rig."""
    table = Table(title="Wear of one axis: +15 % at once; 15 to 60 degC, payloads change")
    for heading in ("plant", "axis", "found after", "in motion", "axes named", "size stated"):
        table.add_column(heading)
    reached = True
    cases = [("kr16", load_profile("kr16"), False, 1)]
    if not quick:
        cases += [("drawn 3, hard", random_profile("kr16", 3), True, 1)]
    for name, profile, hard, joint in cases:
        row = detection(Shift(profile, hard=hard), joint, 0.15, 8.0, 1.2)
        reached &= row.motion <= 1.0 and row.named == (joint,)
        table.add_row(
            name,
            f"A{joint + 1}",
            "not found" if math.isnan(row.found) else f"{60 * row.found:.0f} min",
            f"{60 * row.motion:.0f} min",
            _axes(row.named),
            f"{100 * row.size:+.1f} +- {100 * row.std:.1f} %",
        )
    return table, {"rig: +15 % of one axis within one hour of its motion, no other axis": reached}


def one_program(quick: bool) -> tuple[Table, Goals]:
    """Alarms without wear and delays with it, on simulated days of plants drawn for this alone."""
    plants = PLANTS[:1] if quick else PLANTS
    rows, table = _days("one program", plants, 12 if quick else 25, None)
    slow = [found for row in rows for found in row.slow]
    return table, {
        **_at_once("one program", rows, 1.0),
        "one program: +5 % in 100 h within a day, 95 %": _mostly(slow, 24.0, 0.95),
    }


def changing(quick: bool) -> tuple[Table, Goals]:
    """The same with programs that change: motions, range, speed and payloads."""
    plants = CHANGING[:1] if quick else CHANGING
    rows, table = _days("programs change", plants, 8 if quick else 20, CHANGES)
    return table, _at_once("programs change", rows, 0.9)


def _at_once(name: str, rows: list[SimulatedRow], share: float) -> Goals:
    hours, alarms = sum(row.hours for row in rows), sum(len(row.alarms) for row in rows)
    found = [found for row in rows for found in (*row.steps, *row.falls)]
    steps = f"{name}: +15 %, and -15 % said as a fall, within one hour, {100 * share:.0f} %"
    return {
        f"{name}: at most one false alarm in 1,000 h": alarms <= max(1.0, hours / 1000.0),
        steps: _mostly(found, 1.0, share),
    }


def _mostly(found: list[FoundRow], limit: float, share: float) -> bool:
    return len(_late(found, limit)) <= (1.0 - share) * len(found)


def _days(
    name: str,
    plants: Sequence[tuple[str, int]],
    days: int,
    changes: tuple[float, float] | None,
) -> tuple[list[SimulatedRow], Table]:
    title = f"Simulated days, {name}: 15 to 60 degC, payloads, collisions; h of motion of an axis"
    table = Table(title=title)
    headings = ("plant", "hours", "in motion", "false alarms", "+15 %", "-15 %", "+5 % in 100 h")
    for heading in headings:
        table.add_column(heading)
    rows = [simulated(random_profile(*plant), plant[1], days, changes=changes) for plant in plants]
    for (body, seed), row in zip(plants, rows, strict=True):
        table.add_row(f"{body}, drawn {seed}", *_figures([row]))
    table.add_row("all", *_figures(rows))
    return rows, table


def _figures(rows: list[SimulatedRow]) -> list[str]:
    """Columns of one or more plants."""
    alarms = [f"A{axis + 1} at {hour:.0f} h" for row in rows for axis, hour in row.alarms]
    return [
        f"{sum(row.hours for row in rows):.0f}",
        f"{sum(row.motion for row in rows):.0f}",
        ", ".join(alarms) or "0",
        _delays([found for row in rows for found in row.steps], 1.0),
        _delays([found for row in rows for found in row.falls], 1.0),
        _delays([found for row in rows for found in row.slow], 24.0),
    ]


def _delays(found: Sequence[FoundRow], limit: float) -> str:
    """Median and longest time until a change was found, and how many took longer than wanted."""
    if not found:
        return "-"
    hours = [math.inf if math.isnan(row.motion) else row.motion for row in found]
    shown = [f"{hour:.2g} h" for hour in (median(hours), max(hours))]
    return f"{shown[0]}, worst {shown[1]}; late: {len(_late(found, limit))} of {len(found)}"


def _late(found: Sequence[FoundRow], limit: float) -> list[FoundRow]:
    return [row for row in found if not row.motion <= limit]


def _axes(joints: Sequence[int]) -> str:
    return ", ".join(f"A{joint + 1}" for joint in joints) or "none"


def meter(quick: bool) -> tuple[Table, Goals]:
    """Wear as a power meter alone sees it, after four days without."""
    days = 6 if quick else 10
    table = Table(title=f"Power meter alone, {days} days, +15 % after 4 days; h until it is said")
    for heading in ("plant", "all axes", "the axis with most friction", "without wear"):
        table.add_column(heading)
    profile = random_profile("kr16", METER_PLANT)
    every = tuple(range(profile.n_joints))
    cases = (every,) if quick else (every, (0,), ())
    said = [meter_only(profile, METER_PLANT, days, joints) for joints in cases]
    shown = [", ".join(f"{hour:.0f} h" for hour in hours) or "none" for hours in said]
    table.add_row(f"kr16, drawn {METER_PLANT}", *shown)
    false = [hour for hours in said[:2] for hour in hours if hour < 0] + [*sum(said[2:], ())]
    return table, {"power meter alone: no alarm without wear": not false}


def main() -> int:
    """Run all studies and print their tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="few plants, short: shows that it runs, judges little"
    )
    quick = parser.parse_args().quick
    console, missed = Console(width=140), 0
    for study in (learner, wear, one_program, changing, meter):
        table, goals = study(quick)
        console.print(table)
        for goal, reached in goals.items():
            missed += not reached
            console.print(f"  {'met   ' if reached else 'MISSED'} {goal}", highlight=False)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
