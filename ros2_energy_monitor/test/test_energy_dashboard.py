# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The dashboard with real monitors of the virtual robot, as a browser and as programs see it."""

from __future__ import annotations

import itertools
import json
import math
import socket
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from ros2_energy_msgs.msg import EnergyRegisters
from sensor_msgs.msg import JointState

from robot_energy.foundation.errors import PageError, ParameterError
from robot_energy_history.store import HistoryStore
from robot_energy_report.page import web_app
from ros2_energy_monitor.base.publishers import best_effort
from ros2_energy_monitor.demo.node_processes import NodeProcesses
from ros2_energy_monitor.nodes.console import Console
from ros2_energy_monitor.nodes.energy_dashboard import EnergyDashboard
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.virtual_robot import VirtualRobot

sys.path.append(str(Path(__file__).resolve().parents[2] / "test"))
from chromium import Browser, browser, needs_browser
from histories import Robot

TOKEN = "0123456789abcdef0123"
PATIENCE = 120.0  # s, on a machine that does much else
STATUS = "document.getElementById('status').textContent"
READY = f"{STATUS} === 'live' && document.querySelector('#flow rect')"
DASH = "\u2013"
NO_POWER = f"document.getElementById('power').textContent === '{DASH} W'"
STALE = (  # after how long is tested with a clock of its own, in test_robot_state.py
    f"{STATUS}.startsWith('stale') && {NO_POWER} "
    "&& document.querySelector('#joints tbody td') && [...document.querySelectorAll("
    f"'#joints tbody td')].every(cell => cell.textContent === '{DASH}') "
    "&& document.getElementById('alarms').textContent.includes('What to do')"
)
RESTARTS = (
    "ERR_CONNECTION_REFUSED", "ERR_INCOMPLETE_CHUNKED", "ERR_CONNECTION_RESET",
    "ERR_EMPTY_RESPONSE",
)  # fmt: skip


@pytest.fixture
def token_file(tmp_path: Path) -> str:
    path = tmp_path / "token"
    path.write_text(TOKEN)
    path.chmod(0o600)
    return str(path)


class Answers:
    """Requests from a thread, while the nodes run in the thread of the test."""

    def __init__(self, bench: Any, url: str) -> None:
        self._bench, self._url = bench, url

    def __call__(self, path: str, wish: Any = None) -> Any:
        found: list[bytes] = []

        def ask() -> None:
            body = None if wish is None else json.dumps(wish).encode()
            given = {"Authorization": f"Bearer {TOKEN}"}
            request = urllib.request.Request(self._url + path, body, given)
            with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
                found.append(answer.read())

        thread = threading.Thread(target=ask)
        thread.start()
        self._bench.spin_until(lambda: not thread.is_alive(), path)
        assert found, path
        return json.loads(found[0]) if path.startswith("api") else found[0].decode()

    def robot(self, name: str = "robot") -> dict[str, Any]:
        robots = self("api/state")["robots"]
        return next((one for one in robots if one["name"] == name), {})


def test_the_history_that_is_recorded_is_shown(bench: Any, tmp_path: Path) -> None:
    store, robot = HistoryStore(tmp_path / "history"), Robot()
    store.open()
    store.add("left", [robot.minute(1000)])
    assert store.write(robot.now), store.trouble
    store.close()
    page = bench.add(EnergyDashboard, port=0, history_folder=str(store.folder))
    ask = Answers(bench, page.server.url)
    found = ask("api/history?period=year&at=2026-01-01")
    assert found["known"] == ["left"]
    assert found["total"]["energy"] == pytest.approx(60_000.0)
    none = bench.add(EnergyDashboard, port=0, history_folder="none")
    assert Answers(bench, none.server.url)("api/state")["recorded"] is False


def test_figures_job_intervals_and_reset(
    bench: Any, token_file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(web_app, "PATIENCE", PATIENCE)
    bench.add(VirtualRobot)
    bench.add(EnergyMonitor, model="kr16")
    page = bench.add(EnergyDashboard, port=0, allow_control=True, token_file=token_file)
    ask = Answers(bench, page.server.url)
    bench.spin_until(
        lambda: page.hub.robots.get("robot") and page.hub.robots["robot"].registers, "registers"
    )

    def fresh() -> dict[str, Any]:
        """The robot, unless figures have not come or are stale as the machine is busy."""
        robot = ask.robot()
        sources = [joint["temperature_source"] for joint in robot["joints"]]
        return robot if sources[:1] == ["MEASURED"] and not robot["power"]["stale"] else {}

    robot = bench.spin_until(fresh, "degC")
    assert robot["power"]["predicted_grid_power"] > 100.0
    assert [joint["name"] for joint in robot["joints"]] == [f"joint_a{n}" for n in range(1, 7)]
    bench.spin_until(
        lambda: "energy_monitor: energy" in {one["name"] for one in ask.robot()["findings"]},
        "a finding of the diagnostics",
    )
    answer = ask("api/control", {"robot": "robot", "action": "open_interval", "text": "part 7"})
    assert answer["done"], answer
    bench.spin_until(lambda: (ask.robot()["intervals"] or [{}])[0].get("is_open"), "open interval")
    answer = ask("api/control", {"robot": "robot", "action": "close_interval", "text": "part 7"})
    assert answer["done"], answer
    job = bench.spin_until(lambda: ask.robot()["headline"]["job"], "closed interval")
    assert job["name"] == "part 7"
    answer = ask("api/control", {"robot": "robot", "action": "close_interval", "text": "part 7"})
    assert not answer["done"]
    start = ask.robot()["registers"]["energy_start"]
    answer = ask("api/control", {"robot": "robot", "action": "reset_registers", "text": "shift"})
    assert answer["done"], answer
    bench.spin_until(lambda: ask.robot()["registers"]["energy_start"] > start, "the reset")
    assert "robot_energy_joules_total{part=" in ask("metrics")


def not_finite(number: int) -> JointState:
    return joint_state(number, math.nan)


def one_stamp(number: int) -> JointState:
    return joint_state(0, 0.001 * number)


def joint_state(number: int, position: float) -> JointState:
    message = JointState(name=[f"joint_a{axis}" for axis in range(1, 7)])
    message.header.stamp.sec = 1_700_000_000 + number // 100
    message.header.stamp.nanosec = number % 100 * 10_000_000
    message.position, message.velocity = [position] * 6, [0.1] * 6
    return message


@pytest.mark.parametrize(
    ("sample", "reason"),
    [(not_finite, "as not_finite"), (one_stamp, "the stamp of the one before")],
)
def test_joint_states_without_a_usable_sample_are_dashes_with_the_reason(
    bench: Any, sample: Callable[[int], JointState], reason: str
) -> None:
    """No figure is shown as zero, by page, metrics and console."""
    bench.add(EnergyMonitor, model="kr16")
    page, console = bench.add(EnergyDashboard, port=0), bench.add(Console)
    publisher = bench.publisher(JointState, "joint_states")
    numbers = itertools.count()
    ask = Answers(bench, page.server.url)

    def alarms() -> str:
        for _ in range(20):
            publisher.publish(sample(next(numbers)))
        return " ".join(one["message"] for one in ask.robot().get("alarms", ()))

    bench.spin_until(lambda: reason in alarms(), reason)
    robot = ask.robot()
    assert robot["headline"]["energy"] is None
    assert robot["power"]["stale"]
    assert robot["power"].get("predicted_grid_power") is None
    for part in ("energy_flow", "flow", "means", "phases"):
        assert not robot[part], part
    assert "robot_energy_joules_total{" not in ask("metrics")
    bench.spin_until(lambda: reason in console.board.line(math.inf), "the reason on the console")
    assert " 0 W" not in console.board.line(math.inf)
    assert " 0.00 Wh" not in console.board.line(math.inf)


def test_robots_of_several_namespaces_share_a_page(bench: Any) -> None:
    for name in ("left", "right"):
        rename = ["--ros-args", "-r", f"__ns:=/{name}"]
        bench.add(VirtualRobot_in(rename))
        bench.add(EnergyMonitor_in(rename), model="kr16", state_folder="")
    page = bench.add(EnergyDashboard, port=0)
    bench.spin_until(
        lambda: len(page.hub.robots) == 2 and all(r.registers for r in page.hub.robots.values()),
        "two robots",
    )
    assert set(page.hub.robots) == {"left", "right"}
    ask = Answers(bench, page.server.url)
    bench.spin_until(lambda: ask.robot("left").get("findings"), "findings of the left robot")
    assert all(one["name"].startswith("left/") for one in ask.robot("left")["findings"])


def VirtualRobot_in(arguments: list[str]) -> Any:
    return lambda **options: VirtualRobot(cli_args=arguments, **options)


def EnergyMonitor_in(arguments: list[str]) -> Any:
    return lambda **options: EnergyMonitor(cli_args=arguments, **options)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"address": "0.0.0.0"}, "it has no token"),
        ({"allow_control": True}, "it has no token"),
        ({"page_settings": "/nowhere.yaml"}, "nowhere.yaml"),
        ({"port": 70_000}, "port"),
    ],
)
def test_an_unsafe_page_is_refused(bench: Any, parameters: dict[str, Any], words: str) -> None:
    with pytest.raises((PageError, ParameterError), match=words):
        bench.add(EnergyDashboard, **({"port": 0} | parameters))


@contextmanager
def live(folder: Path, environment: dict[str, str], port: int) -> Iterator[NodeProcesses]:
    with NodeProcesses(folder, environment) as nodes:
        nodes.start("virtual_robot")
        nodes.start("energy_monitor", model="kr16")
        nodes.start("energy_dashboard", port=port)
        yield nodes


def shown_registers(window: Browser) -> tuple[float, dict[str, list[str]]]:
    """Time and table of the registers, of one instant."""
    return window.run(
        "return [+document.getElementById('registers').dataset.time, Object.fromEntries("
        "[...document.querySelectorAll('#registers tbody tr')].map(r => "
        "[r.cells[0].textContent, r.cells[2].dataset.value]))]"
    )


@pytest.mark.long
@needs_browser
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_the_page_in_two_browsers(
    loopback_bench: Any,
    child_environment: dict[str, str],
    tmp_path: Path,
    free_port: Callable[[], int],
) -> None:
    port = free_port()
    seen: dict[float, EnergyRegisters] = {}

    def take(message: EnergyRegisters) -> None:
        stamp = message.header.stamp
        seen[round(stamp.sec + 1e-9 * stamp.nanosec, 5)] = message

    loopback_bench.tester.create_subscription(
        EnergyRegisters, "energy/registers", take, best_effort(100)
    )
    url = f"http://127.0.0.1:{port}/"
    environment = child_environment | {"ROS_HOME": str(tmp_path / "ros")}
    with live(tmp_path, environment, port) as nodes, browser() as one, browser() as two:
        for window in (one, two):
            open_when_served(window, url)
            window.wait(READY, "live figures")
        assert all(name.startswith(url) for name in one.requests())

        def equal() -> bool:
            at, table = shown_registers(one)
            message = seen.get(round(at, 5))
            if message is None or not table["at the meter, measured"]:  # nothing compared yet
                return False
            shown = float(table["from the grid, predicted"])
            assert shown == message.predicted_import_energy
            assert float(table["at the meter, measured"]) == message.measured_energy
            assert float(table["brake resistor"]) == message.brake_energy
            assert float(table["observed"]) == message.observed_time
            return True

        loopback_bench.spin_until(equal, "a register message that the page shows")
        for node in one.flow_nodes():
            assert not node["inner"] or node["into"] == node["out"], node

        nodes.stop("energy_monitor")
        for window in (one, two):
            window.wait(STALE, "the word stale, no figures, and what to do")
        nodes.start("energy_monitor", model="kr16")
        one.wait(READY, "figures after a restart of the monitor")

        nodes.stop("energy_dashboard")
        two.wait(f"{STATUS}.startsWith('no connection') && {NO_POWER}", "no connection, no power")
        nodes.start("energy_dashboard", port=port)
        for window in (one, two):
            window.wait(READY, "figures after a restart of the dashboard")
            window.wait("document.querySelector('#lines path')", "the lines")
        assert one.faults() == []
        said = one.complaints()
        bad = [line for line in said if not any(word in line for word in RESTARTS)]
        assert bad == []


def open_when_served(window: Browser, url: str) -> None:
    """Open the page as soon as something listens."""
    from selenium.common.exceptions import WebDriverException

    def opened() -> bool:
        try:
            window.open(url)
        except WebDriverException:
            return False
        return True

    limit = time.monotonic() + PATIENCE
    while not opened():
        assert time.monotonic() < limit, f"nothing listens at {url}"


@needs_browser
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_buttons_ask_for_the_token(
    child_environment: dict[str, str],
    tmp_path: Path,
    free_port: Callable[[], int],
    token_file: str,
) -> None:
    port = free_port()
    url = f"http://127.0.0.1:{port}/"
    environment = child_environment | {"ROS_HOME": str(tmp_path / "ros")}
    with NodeProcesses(tmp_path, environment) as nodes, browser() as window:
        nodes.start("virtual_robot")
        nodes.start("energy_monitor", model="kr16")
        nodes.start("energy_dashboard", port=port, allow_control=True, token_file=token_file)
        open_when_served(window, url)
        window.wait(READY, "live figures")
        window.driver.find_element("id", "job-name").send_keys("part 8")
        window.click("[data-action=open_interval]")
        window.wait("!document.getElementById('access').hidden", "the question for the token")
        window.driver.find_element("id", "token").send_keys(TOKEN)
        window.click("#access button")
        window.wait(
            "document.getElementById('intervals').textContent.includes('part 8 (open)')", "job"
        )
        window.click("[data-action=close_interval]")
        window.wait(
            "document.getElementById('job-note').textContent.startsWith('part 8')", "closed job"
        )


def test_no_register_is_lost_while_200_clients_hang(bench: Any) -> None:
    count, hung = 1500, 200
    monitor = bench.add(EnergyMonitor, model="kr16", state_folder="")
    page = bench.add(EnergyDashboard, port=0)
    where = ("127.0.0.1", int(page.server.url.rstrip("/").rpartition(":")[2]))
    asked = (b"GET /api/state HT", b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n", b"")
    with ExitStack() as open_:
        for number in range(hung):
            client = open_.enter_context(socket.create_connection(where, timeout=PATIENCE))
            with suppress(ConnectionError):  # more than the page takes are closed at once
                client.sendall(asked[number % len(asked)])
        publisher = bench.publisher(JointState, "joint_states")
        message = JointState(name=[f"joint_a{n}" for n in range(1, 7)])
        for number in range(count):
            stamp_ns = 1_000_000_000_000_000_000 + number * 4_000_000
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
            message.position = [0.2 * math.sin(0.004 * number * (axis + 1)) for axis in range(6)]
            publisher.publish(message)
            if number % 50 == 49:  # no more than the inbox holds
                bench.spin_until(
                    lambda sent=number + 1: monitor.inputs[0][1].received >= sent, "joint states"
                )
        bench.spin_until(
            lambda: (monitor.account.end_ns or 0) > stamp_ns - 500_000_000, "the last sample"
        )
        observed, account = monitor.account.registers.time, monitor.inputs[0][1]
        assert (account.received, account.accepted, dict(account.rejected)) == (count, count, {})
        assert observed.gap_ns == 0
        assert observed.observed_ns == observed.span_ns

        def shown() -> dict[str, Any]:
            return page.hub.robots["robot"].registers or {} if page.hub.robots else {}

        energy = monitor.account.registers.cabinet("grid_import")
        assert energy > 0.0
        bench.spin_until(
            lambda: (
                shown().get("predicted_import_energy")
                == monitor.account.registers.cabinet("grid_import")
            ),
            "the registers of the monitor on the page",
        )
        assert Answers(bench, page.server.url).robot()["registers"]["gap_count"] == 0
