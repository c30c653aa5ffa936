# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Last part of the demonstration: replay of bags, with and without temperature."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console as Terminal

from robot_energy.foundation.errors import BagError
from robot_energy.foundation.units import JOULE_PER_WH
from robot_energy.model import RobotModel, load
from robot_energy.physics.friction import with_fixed_friction
from robot_energy.replay.bag_replay import Replay, replay
from robot_energy_report.printing import table
from ros2_energy_monitor.demo.demo_identification import bundled

COLD_DEGC, WARM_DEGC = 22.0, 60.0  # where a fixed model would have been identified
BAGS = {"drawn_test_cold": WARM_DEGC, "drawn_test_warm": COLD_DEGC}  # the fixed model in its figure


@dataclass(frozen=True)
class Row:
    """One bag.

    Attributes:
        measured: Energy by the meter. [J]
        aware: Predicted with friction that follows the temperature. [J]
        fixed: Predicted with friction of one temperature, by that temperature. [J by degC]
    """

    bag: str
    measured: float
    aware: float
    fixed: dict[float, float]
    figure: Path


def show_bags(bags: Path, out: Path, model_name: str) -> list[Row]:
    """Return one row per bundled bag, after printing the table and writing the figures.

    Args:
        model_name: Model of the robot in the bags: a name or a file.
    """
    model = load(model_name)
    out.mkdir(parents=True, exist_ok=True)
    rows = [_row(path, model, out) for path in bundled(bags, BAGS)]
    table(
        Terminal(),
        "Energy from the grid, held-out bags of the virtual rig",
        ("bag", "measured [Wh]", "friction", "predicted [Wh]", "error"),
        [
            (
                row.bag,
                f"{row.measured / JOULE_PER_WH:.2f}",
                kind,
                f"{energy / JOULE_PER_WH:.2f}",
                f"{100.0 * (energy / row.measured - 1.0):+.1f} %",
            )
            for row in rows
            for kind, energy in (
                ("follows temperature", row.aware),
                *((f"fixed at {degc:g} degC", energy) for degc, energy in row.fixed.items()),
            )
        ],
    )
    for row in rows:
        print(f"figure: {row.figure}", flush=True)
    return rows


def _row(bag: Path, model: RobotModel, out: Path) -> Row:
    # Matplotlib is slow to import and of no use to the live part.
    from robot_energy_report.replay_figures import power_and_energy
    from robot_energy_report.series import compared_series

    first = replay(bag, model, keep_curves=True)
    fixed = {
        degc: replay(bag, with_fixed_friction(model, degc), keep_curves=True)
        for degc in (COLD_DEGC, WARM_DEGC)
    }
    shown = BAGS[bag.name]
    aware = compared_series(first, "predicted, friction follows temperature")
    other = compared_series(fixed[shown], f"predicted, friction fixed at {shown:g} degC", "fixed")
    if aware is None or other is None:
        raise BagError(f"{bag} has no meter reading to compare with", "a recording with a meter")
    figure = out / f"{bag.name}.png"
    power_and_energy(
        [*aware, other[1]], figure, f"{bag.name}: virtual rig, drawn plant of the KR 16 class"
    )
    return Row(
        bag.name,
        first.account.comparison.measured_energy,
        _predicted(first),
        {degc: _predicted(result) for degc, result in fixed.items()},
        figure,
    )


def _predicted(result: Replay) -> float:
    return result.account.comparison.predicted_energy
