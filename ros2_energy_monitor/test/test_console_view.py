# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The live table: rows that add up, one sign, whole at every width."""

import io
import math
import subprocess
import sys

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rich.console import Console
from ros2_energy_msgs.msg import EnergyRegisters, JointPower, PowerState

from ros2_energy_monitor.nodes.console import PARTS, ConsoleView


def state(**changes):
    parts = {
        "rigid_power": -116.4,
        "friction_power": 677.5,
        "drive_loss": 0.4,
        "loss_dc": 150.0,
        "loss_grid": 250.0,
        "brake_power": 22.6,
        "capacitor_power": -0.7,
    }
    period = changes.pop("period", 1.0)
    parts |= changes
    joint = JointPower(name="joint_a1", drive_power=12345.6, friction_power=1.0, coulomb=0.5)
    return PowerState(
        predicted_grid_power=sum(parts.values()),
        measured_power=1150.0,
        predicted_power_at_meter=983.0,
        residual_power=-167.0,
        period=period,
        coverage=1.0,
        joints=[joint],
        **parts,
    )


def words(board, width=200):
    """Words of every line, cut at the edge of the terminal as a live display cuts."""
    console = Console(file=io.StringIO(), width=width)
    lines = console.render_lines(board.table(0.0, width), pad=False)
    return ["".join(part.text for part in line).split() for line in lines]


@pytest.fixture
def board():
    board = ConsoleView()
    board.take_power(state(), 0.0)
    board.registers = EnergyRegisters(
        predicted_energy_at_meter=6.78 * 3600.0, measured_energy=6.98 * 3600.0
    )
    return board


@pytest.mark.parametrize("rigid", [-116.4, 0.0, 1234.5, -0.2])
def test_the_parts_shown_sum_to_the_power_shown(rigid):
    board = ConsoleView()
    board.take_power(state(rigid_power=rigid), 0.0)
    shown, head = words(board)[5], words(board)[3]
    assert head[-len(PARTS) :] == list(PARTS)
    predicted, *parts = (int(word) for word in shown[2:])
    assert sum(parts) == predicted
    assert parts[0] == pytest.approx(rigid, abs=1.0)
    assert parts[3] == 400


def test_a_part_that_is_not_modelled_is_a_dash_and_no_term_of_the_sum():
    board = ConsoleView()
    whole = state(drive_loss=0.0, capacitor_power=0.0)
    whole.drive_loss = whole.capacitor_power = math.nan
    board.take_power(whole, 0.0)
    predicted, *parts = words(board)[5][2:]
    assert [parts[PARTS.index(name)] for name in ("drives", "capacitor")] == ["-", "-"]
    assert sum(int(part) for part in parts if part != "-") == int(predicted)


def test_parts_and_whole_are_of_the_same_instant_whatever_the_smoothing(board):
    for number in range(20):
        message = state(rigid_power=1000.0 * math.sin(number))
        message.period = 0.02
        board.take_power(message, 0.0)
        predicted, *parts = (int(word) for word in words(board)[5][2:])
        assert sum(parts) == predicted


def test_errors_are_predicted_minus_measured_in_watts_joules_and_per_cent(board):
    rows = {" ".join(row[:2]): row[2:] for row in words(board) if row[1:2] in (["[W]"], ["[Wh]"])}
    assert rows["energy [Wh]"] == ["6.78", "6.98", "-0.20", "-2.9", "%"]
    assert ["power", "[W]", "983", "1150", "-167", "-14.5", "%"] in words(board)
    assert "predicted 983 W, measured 1150 W (-14.5 %)" in board.line(0.0)
    assert "6.78 Wh predicted, 6.98 Wh measured (-2.9 %)" in board.line(0.0)


def test_the_error_of_the_whole_is_one_line(board):
    board.registers.comparison_time = 40.2
    expected = "at the meter over 40 s: 6.78 Wh predicted, 6.98 Wh measured (-2.9 %)"
    assert board.energy_error() == f"Live part, {expected}"
    board.registers.measured_energy = math.nan
    assert board.energy_error() == "no energy was compared with a meter"


def test_in_the_first_seconds_no_error_of_the_energy_is_shown(board):
    """A monitor sends no predicted energy at the meter while the lag of the meter matters."""
    board.registers.predicted_energy_at_meter = math.nan
    rows = {" ".join(row[:2]): row[2:] for row in words(board) if row[1:2] == ["[Wh]"]}
    assert rows["energy [Wh]"] == ["-", "6.98", "-", "-"]
    assert board.energy_error().endswith("- Wh predicted, 6.98 Wh measured (-)")


def test_without_a_meter_nothing_is_compared():
    board = ConsoleView()
    nothing = state()
    nothing.measured_power = nothing.predicted_power_at_meter = nothing.residual_power = math.nan
    board.take_power(nothing, 0.0)
    board.registers = EnergyRegisters(predicted_energy_at_meter=math.nan, measured_energy=math.nan)
    assert ["power", "[W]", "-", "-", "-", "-"] in words(board)
    assert "measured" not in board.line(0.0)


def test_before_the_first_power_a_healthy_start_is_no_trouble():
    """What monitors miss in their first seconds is shown only when no power follows."""
    board = ConsoleView()
    assert board.line(100.0) == "waiting for the first power state"
    assert "no monitor was found yet: start one" in board.line(106.0)
    name, text = "energy_monitor: joint states", "start the driver: no joint state"
    status = DiagnosticStatus(name=name, message=text, level=DiagnosticStatus.ERROR)
    board.take_diagnostics(DiagnosticArray(status=[status]))
    assert board.line(106.0) == f"no power state yet; {name}: {text}"
    board.take_power(state(), 107.0)
    assert board.line(107.0).startswith("from the grid")


def test_what_was_counted_is_shown_while_the_robot_is_off(board):
    off = ConsoleView()
    off.registers = board.registers
    off.registers.observed_time = 60.0
    off.registers.predicted_import_energy = 7.5 * 3600.0
    off.registers.predicted_return_energy = 0.5 * 3600.0
    totals = (
        "counted 7.00 Wh from the grid, at the meter 6.78 Wh predicted, 6.98 Wh measured (-2.9 %)"
    )
    assert off.line(100.0) == f"waiting for the first power state; {totals}"
    status = DiagnosticStatus(name="energy_monitor: node", message="all is well")
    off.take_diagnostics(DiagnosticArray(status=[status]))
    assert off.line(106.0) == f"no power state yet; {totals}; all is well"
    assert totals in " ".join(word for row in words(off, 200) for word in row)
    off.registers.measured_energy = math.nan
    assert off.line(106.0) == "no power state yet; counted 7.00 Wh from the grid; all is well"


@pytest.mark.parametrize(("period", "late"), [(0.04, 2.1), (10.0, 30.1)])
def test_powers_that_are_old_are_not_shown(board, period, late):
    """Neither as those of now nor next to words that say so; slow powers have more time."""
    board.take_power(state(period=period), 0.0)
    assert "friction" in board.line(late - 0.2)
    board.registers.observed_time = 60.0
    board.registers.predicted_import_energy = 7.5 * 3600.0
    assert board.line(late).startswith(f"no power state for {late:.0f} s; counted 7.50 Wh")
    assert "friction" not in board.line(late)
    text = " ".join(str(part) for part in board.table(late, 200).renderables)
    assert text == board.line(late)
    board.take_power(state(period=period), late)
    assert board.line(late).startswith("from the grid")


def test_registers_that_observed_no_time_are_no_result(board):
    board = ConsoleView()
    board.registers = EnergyRegisters(measured_energy=math.nan)
    assert board.line(0.0) == "waiting for the first power state; nothing counted yet"


def test_no_figure_is_cut_at_any_width(board):
    def figures(parts):
        return {part for part in parts if any(letter.isdigit() for letter in part)}

    table = figures(word for row in words(board) for word in row)
    line = figures(board.line(0.0).split())
    for width in range(20, 201):
        shown = figures(word for row in words(board, width) for word in row)
        assert shown == table if width >= 40 else shown in (table, line), width


def test_the_console_imports_no_state_of_the_page():
    code = "import sys, ros2_energy_monitor.nodes.console; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "robot_energy_report.page.stale" in run.stdout.split()
    assert "robot_energy_report.page.robot_state" not in run.stdout.split()
