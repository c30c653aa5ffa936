# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Nodes as processes: they start, end cleanly when asked to, and refuse in one sentence."""

from __future__ import annotations

import importlib
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from ros2_energy_monitor.__main__ import main as run_executable
from ros2_energy_monitor.base.run_node import STOP_SIGNALS
from ros2_energy_monitor.executables import EXECUTABLES

LIMIT = 120.0  # s; then the process is killed and the test fails
MONITORS = ["torque_monitor", "friction_monitor", "power_monitor", "energy_monitor"]


def command(name: str, *parameters: str) -> list[str]:
    options = [word for parameter in parameters for word in ("-p", parameter)]
    arguments = ["--ros-args", *options] if options else []
    return [sys.executable, "-m", "ros2_energy_monitor", name, *arguments]


@pytest.fixture
def start(child_environment) -> Iterator:
    running: list[subprocess.Popen[str]] = []

    def start_one(*words: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            command(*words),
            env=child_environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        running.append(process)
        return process

    yield start_one
    for process in running:
        process.kill()
        process.communicate()


def read_until(process: subprocess.Popen[str], words: str) -> None:
    assert process.stdout is not None
    for line in process.stdout:
        if words in line:
            return
    pytest.fail(f"the process ended without saying '{words}'")


@pytest.mark.parametrize(
    ("name", "number"),
    list(zip(MONITORS, [*STOP_SIGNALS, signal.SIGINT], strict=True)),
)
def test_a_signal_ends_a_monitor_cleanly(start, name, number):
    process = start(name, "model:=kr16")
    read_until(process, "is monitored")
    process.send_signal(number)
    output, _ = process.communicate(timeout=LIMIT)
    assert process.returncode == 0, output
    assert "Traceback" not in output


@pytest.mark.parametrize("name", [*MONITORS, "virtual_robot", "console"])
def test_help_says_what_a_node_does_and_starts_nothing(name, monkeypatch, capsys):
    monkeypatch.setattr("ros2_energy_monitor.__main__.end_at_once", str)  # signals of the tests
    for script, words in (
        ([f"/install/lib/ros2_energy_monitor/{name}"], "ros2 run"),
        (["__main__.py", name], "python -m"),
    ):
        monkeypatch.setattr(sys, "argv", [*script, "--help"])
        assert run_executable() == 0
        output = capsys.readouterr().out
        assert f"usage: {words} ros2_energy_monitor {name} --ros-args" in output
        assert output.splitlines()[0].endswith(".")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_no_signal_is_lost_while_modules_load(monkeypatch, tmp_path: Path, number):
    """An import that catches KeyboardInterrupt, as some libraries do, must not keep the node."""
    (tmp_path / "slow_to_import.py").write_text(
        "import os\n"
        "try:\n"
        f"    os.kill(os.getpid(), {int(number)})\n"
        "except KeyboardInterrupt:\n"
        "    pass\n"
        "def main():\n"
        "    return 7\n"
    )
    program = (
        "import sys, ros2_energy_monitor.__main__ as start\n"
        "start.EXECUTABLES['slow'] = 'slow_to_import'\n"
        "sys.argv = ['slow']\n"
        "raise SystemExit(start.main())\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    begun = [sys.executable, "-c", program]
    ended = subprocess.run(begun, timeout=LIMIT, stderr=subprocess.PIPE, text=True)
    assert ended.returncode == 128 + number
    assert ended.stderr == f"slow: interrupted ({number.name})\n"


@pytest.mark.parametrize("name", ["energy_monitor", "virtual_robot"])
def test_many_signals_end_a_node_as_cleanly_as_one(start, name):
    process = start(name, *(["model:=kr16"] if name == "energy_monitor" else []))
    read_until(process, "is monitored" if name == "energy_monitor" else "virtual rig plays")
    while process.poll() is None:
        for number in (signal.SIGINT, signal.SIGTERM):
            process.send_signal(number)
        time.sleep(0.002)  # between signals, not for a condition
    output, _ = process.communicate(timeout=LIMIT)
    assert process.returncode == 0, output
    assert "Traceback" not in output


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        (
            ("model:=kr16", "tick_rat:=20.0", "strict_parameters:=true"),
            "torque_monitor has no parameter 'tick_rat'; did you mean 'tick_rate'?",
        ),
        ((), "torque_monitor was started without its parameter 'model'"),
        (("model:=kr17",), "the model file 'kr17' cannot be read"),
        (("model:=kr16", "tick_rate:=-1.0"), "parameter 'tick_rate' of torque_monitor is -1.0"),
    ],
)
def test_a_wrong_start_says_so_in_one_line(parameters, words, monkeypatch, capfd):
    """In this process, whose handlers of signals stay."""
    monkeypatch.setattr(signal, "signal", lambda number, handler: None)
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    monkeypatch.setattr(sys, "argv", command("torque_monitor", *parameters)[2:])
    assert importlib.import_module(EXECUTABLES["torque_monitor"]).main() == 2
    output = "".join(capfd.readouterr())
    assert words in output
    assert len(output.splitlines()) == 1, output


def test_a_managed_node_ends_when_it_is_shut_down(start, child_environment):
    process = start("torque_monitor", "model:=kr16")
    read_until(process, "is monitored")
    code = (
        "import rclpy\n"
        "from lifecycle_msgs.msg import Transition\n"
        "from lifecycle_msgs.srv import ChangeState\n"
        "rclpy.init()\n"
        "node = rclpy.create_node('manager')\n"
        "client = node.create_client(ChangeState, '/torque_monitor/change_state')\n"
        "assert client.wait_for_service(100)\n"
        "shutdown = Transition(id=Transition.TRANSITION_ACTIVE_SHUTDOWN)\n"
        "future = client.call_async(ChangeState.Request(transition=shutdown))\n"
        "rclpy.spin_until_future_complete(node, future, timeout_sec=100)\n"
        "assert future.result().success\n"
    )
    manager = subprocess.run(
        [sys.executable, "-c", code],
        env=child_environment,
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )
    assert manager.returncode == 0, manager.stderr
    output, _ = process.communicate(timeout=LIMIT)
    assert process.returncode == 0, output
    assert "Traceback" not in output


def test_a_broken_model_file_is_named(start, tmp_path: Path):
    broken = tmp_path / "robot.yaml"
    broken.write_text("schema_version: 1\njoints: []\n")
    process = start("energy_monitor", f"model:={broken}")
    output, _ = process.communicate(timeout=LIMIT)
    assert process.returncode == 2, output
    assert str(broken) in output
    assert len(output.splitlines()) == 1, output


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("-p", "model"), "expected -p NAME:=VALUE"),
        (("--params-file", "tab.yaml"), "and below that the parameters, with spaces and no tabs"),
    ],
)
def test_wrong_ros_arguments_are_refused(child_environment, tmp_path: Path, given, words):
    (tmp_path / "tab.yaml").write_text("/**:\n  ros__parameters:\n\tmodel: kr16\n")
    result = subprocess.run(
        [sys.executable, "-m", "ros2_energy_monitor", "torque_monitor", "--ros-args", *given],
        env=child_environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )
    assert result.returncode == 2, result.stderr
    assert "ROS could not be started" in result.stderr
    assert words in result.stderr
    assert "Traceback" not in result.stderr


def test_console_prints_lines_without_a_terminal(start):
    robot = start("virtual_robot")
    monitor = start("energy_monitor", "model:=kr16")
    console = start("console", "line_period:=0.5")
    assert console.stdout is not None
    for line in console.stdout:
        if re.search(r"predicted \d+ W, measured \d+ W.* Wh predicted, .* Wh measured", line):
            break
    else:
        pytest.fail("the console ended")
    for process in (console, monitor, robot):
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=LIMIT)
        assert process.returncode == 0
