# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Names and reasons of others in the table, the log and the diagnostics of the nodes."""

from __future__ import annotations

import math
import unicodedata
from types import SimpleNamespace
from typing import Any, cast

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rich.console import Console
from ros2_energy_msgs.msg import EnergyRegisters, JointFriction, JointPower, PowerState
from ros2_energy_msgs.srv import OpenInterval

from ros2_energy_monitor.diagnostics.reporter import WARN, Reporter, StatusBuilder
from ros2_energy_monitor.nodes.console import MAX_STATUSES, ConsoleView
from ros2_energy_monitor.services.registers import RegisterServices

NASTY = "a\x1b[2J\x1b]0;owned\x07\r\n[INFO] forged\x9b31m\u202e\u2028[red]"


def unsafe(text: str) -> set[str]:
    kinds = {"Cc", "Cf", "Cs", "Zl", "Zp"}
    return {c for c in text if c != "\n" and unicodedata.category(c) in kinds}


def drawn(board: ConsoleView, now: float = 0.0) -> str:
    """The table as plain text."""
    console = Console(width=200, no_color=True, force_terminal=False)
    with console.capture() as capture:
        console.print(board.table(now, 200))
    return capture.get()


def status(name: str, message: str) -> DiagnosticStatus:
    return DiagnosticStatus(level=DiagnosticStatus.WARN, name=name, message=message)


def test_the_console_shows_names_of_others_without_what_acts_on_a_terminal():
    board = ConsoleView()
    board.take_power(PowerState(joints=[JointPower(name=NASTY)]), 0.0)
    board.registers = EnergyRegisters()
    board.take_diagnostics(DiagnosticArray(status=[status(f"{NASTY}_monitor: x", NASTY)]))
    for text in (board.line(0.0), drawn(board)):
        assert not unsafe(text)
    assert "\n" not in board.line(0.0)
    assert "\\x1b[2J" in drawn(board)
    assert "[red]" in drawn(board)  # no markup either


@pytest.mark.parametrize(
    "power",
    [PowerState(phase=200), PowerState(joints=[JointPower(name="b", drive_power=math.inf)])],
)
def test_the_console_survives_messages_that_no_monitor_sends(power):
    board = ConsoleView()
    board.friction = JointFriction(joint_names=["a", "b"], motor_temperature_degc=[40.0])
    board.take_power(power, 0.0)
    assert board.line(0.0)
    assert drawn(board)


def test_the_console_remembers_no_end_of_names():
    board = ConsoleView()
    for number in range(10 * MAX_STATUSES):
        board.take_power(PowerState(joints=[JointPower(name=f"joint_{number}")]), 0.0)
        entry = status(f"n{number}_monitor: x", "")
        board.take_diagnostics(DiagnosticArray(status=[entry]))
    assert len(board._powers) < 20
    assert len(board._status) == MAX_STATUSES


def test_diagnostics_and_log_quote_names_safely(bench, capfd):
    diagnosed = bench.latest(DiagnosticArray, "/diagnostics")
    found = StatusBuilder("names", {f"age.{NASTY}": 1.0}, [f"ignored '{NASTY}'"])
    found.add(WARN, f"no '{NASTY}'")
    reporter = Reporter(bench.tester)

    def published() -> bool:
        reporter.publish([found], "")
        return diagnosed() is not None

    bench.spin_until(published, "the diagnostics")
    (shown,) = diagnosed().status
    assert not unsafe(shown.message + "".join(value.key for value in shown.values))
    assert not unsafe(capfd.readouterr().err)


def test_an_interval_name_forges_no_line_of_the_log(bench, capfd, monkeypatch):
    store = SimpleNamespace(require=lambda: None)
    checkpoints = SimpleNamespace(store=store, when_kept=lambda answer: answer(True))
    account = SimpleNamespace()
    guard = SimpleNamespace(callback=lambda _, run: run)
    monkeypatch.setattr(bench.tester, "guard", guard, raising=False)
    services = RegisterServices(
        bench.tester,
        cast("Any", account),
        cast("Any", checkpoints),
        cast("Any", None),
        lambda: None,
    )
    response = OpenInterval.Response()
    services._change(lambda *_: f"interval 1 '{NASTY}' is open", None, response)
    services._send(lambda *_: None, "open_interval", response, None)
    assert response.message.startswith("interval 1 'a\\x1b[2J")
    assert not unsafe(response.message + capfd.readouterr().err)
    assert "\n" not in response.message
