# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Ports of the middleware that a killed process left half made."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from rclpy.node import Node

from robot_energy.foundation.errors import ParameterError
from ros2_energy_monitor.base import run_node as shell
from ros2_energy_monitor.base import shared_memory
from ros2_energy_monitor.base.shared_memory import clear_ports

READY, RAW = b"\2" + bytes(99), bytes(100)
STARTED = "is monitored"


def test_what_is_in_use_is_left_alone_at_once(tmp_path: Path) -> None:
    (tmp_path / "fastrtps_port7000").write_bytes(READY)
    (tmp_path / "fastrtps_port7000_el").write_bytes(b"")
    (tmp_path / "fastrtps_0123456789abcdef").write_bytes(RAW)
    (tmp_path / "sem.fastrtps_port7000_mutex").write_bytes(RAW)
    (tmp_path / "other").write_bytes(RAW)
    assert clear_ports(tmp_path, orphaned=1e9) == []
    assert len(list(tmp_path.iterdir())) == 5


def test_what_only_has_the_name_of_a_port_is_neither_waited_for_nor_touched(tmp_path: Path) -> None:
    ports = [tmp_path / f"fastrtps_port{number}" for number in range(7000, 7004)]
    (tmp_path / "half_made").write_bytes(RAW)
    os.mkfifo(ports[0])
    ports[1].symlink_to("half_made")
    ports[2].symlink_to("/dev/zero")
    ports[3].mkdir()
    assert clear_ports(tmp_path, orphaned=0.0) == []
    assert all(os.path.lexists(port) for port in ports)


@pytest.mark.parametrize("content", [RAW, b"\1" + bytes(99), b""])
def test_what_nobody_finishes_is_removed_and_said(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "fastrtps_port7000").write_bytes(READY)
    (tmp_path / "fastrtps_port7001").write_bytes(content)
    (sentence,) = clear_ports(tmp_path, orphaned=0.1)
    assert "fastrtps_port7001" in sentence
    assert "was removed" in sentence
    assert [path.name for path in tmp_path.iterdir()] == ["fastrtps_port7000"]


def test_a_port_that_is_being_made_is_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "fastrtps_port7001"
    path.write_bytes(RAW)
    maker = threading.Timer(0.2, path.write_bytes, [READY])
    maker.start()
    assert clear_ports(tmp_path, orphaned=60.0) == []
    maker.join()
    assert path.exists()


def test_a_port_that_is_being_made_is_not_removed_with_an_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its maker would keep the file, and whoever comes next would make another one."""
    old, new = (tmp_path / f"fastrtps_port{number}" for number in (7001, 7002))
    old.write_bytes(RAW)
    now = [0.0]

    def sleep(pause: float) -> None:
        if new.exists():
            new.write_bytes(READY)
        elif now[0] + pause >= shared_memory.ORPHANED:  # the last look at the old one
            new.write_bytes(RAW)
        now[0] += pause

    monkeypatch.setattr(shared_memory.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(shared_memory.time, "sleep", sleep)
    (sentence,) = clear_ports(tmp_path)
    assert "7001" in sentence
    assert [path.name for path in tmp_path.iterdir()] == [new.name]


def test_what_cannot_be_removed_is_said_with_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "fastrtps_port7001").write_bytes(RAW)

    def refuse(path: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(shared_memory.os, "unlink", refuse)
    (sentence,) = clear_ports(tmp_path, orphaned=0.0)
    assert "sudo rm" in sentence
    assert clear_ports(tmp_path / "none") == []


def test_what_was_found_is_logged_before_the_node_is_made(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def make_node(context: object) -> Node:
        raise ParameterError("a later complaint")

    monkeypatch.setattr(shell, "clear_ports", lambda: ["a port was removed"])
    monkeypatch.setattr(shell.signal, "signal", lambda number, handler: None)
    assert shell.run(make_node, []) == shell.EXIT_BAD_SETUP
    output = capfd.readouterr().err
    assert 0 < output.index("a port was removed") < output.index("a later complaint")


@pytest.mark.skipif(not os.access("/dev/shm", os.W_OK), reason="no shared memory here")
def test_a_monitor_starts_next_to_a_port_left_half_made(child_environment: dict[str, str]) -> None:
    """With the real middleware, which would wait without end."""
    ports = {n: Path(f"/dev/shm/fastrtps_port{7400 + 250 * n + 11}") for n in range(80, 101)}
    domain, port = next((n, path) for n, path in ports.items() if not path.exists())
    environment = {
        **child_environment,
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    del environment["FASTRTPS_DEFAULT_PROFILES_FILE"]
    port.write_bytes(RAW)
    monitor = subprocess.Popen(
        [
            *(sys.executable, "-m", "ros2_energy_monitor", "energy_monitor"),
            *("--ros-args", "-p", "model:=kr16"),
        ],
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert monitor.stderr is not None
    guard = threading.Timer(120.0, monitor.kill)
    guard.start()
    try:
        lines = []
        for line in monitor.stderr:
            lines.append(line)
            if STARTED in line:
                break
        text = "".join(lines)
        assert STARTED in text  # whoever removed the port: monitors of others look as well
    finally:
        guard.cancel()
        monitor.kill()
        monitor.wait()
        monitor.stderr.close()
        port.unlink(missing_ok=True)
