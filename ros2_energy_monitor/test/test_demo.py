"""The demonstration ends by itself, draws its figures and leaves no process behind."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from robot_energy.rig.record import record
from ros2_energy_monitor.base.parameters import RobotParameters
from ros2_energy_monitor.nodes.virtual_robot import make_rig

LIMIT = 180.0  # s


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Short stand-ins for the bundled bags."""
    folder = tmp_path_factory.mktemp("bundled")
    for name, degc in (("kr16_cold", 20.0), ("kr16_warm", 60.0)):
        rig = make_rig(RobotParameters(start_temperature_degc=degc), 1_700_000_000 * 10**9)
        record(rig, 10.0, folder / name)
    return folder


def demo(child_environment, *options: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "ros2_energy_monitor", "demo", *options],
        env=child_environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def processes_of_session(session: int) -> list[str]:
    found = []
    for entry in Path("/proc").iterdir():
        try:
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if entry.name.isdigit() and int(fields[3]) == session and fields[0] != "Z":
            found.append(entry.name)
    return found


def test_demo_runs_through(child_environment, bags, tmp_path):
    out = tmp_path / "out"
    process = demo(child_environment, "--seconds=2", f"--bags={bags}", f"--out={out}")
    try:
        output, _ = process.communicate(timeout=LIMIT)
    finally:
        process.kill()
    assert process.returncode == 0, output
    assert "Wh measured" in output
    assert "kr16_warm" in output
    for name in ("kr16_cold", "kr16_warm"):
        assert (out / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    page = (out / "energy_page.html").read_text()
    assert "<!DOCTYPE html>" in page
    assert "joint_a1" in page
    if shutil.which("chromium"):
        assert (out / "energy_page.png").read_bytes().startswith(b"\x89PNG")
    assert "Energy page while it runs: http://127.0.0.1:" in output
    assert not processes_of_session(process.pid)


def test_interrupted_demo_leaves_nothing_running(child_environment, bags, tmp_path):
    process = demo(child_environment, "--seconds=60", f"--bags={bags}", f"--out={tmp_path}")
    assert process.stdout is not None
    try:
        for line in process.stdout:
            if line.startswith("from the grid"):
                break
        assert len(processes_of_session(process.pid)) == 6
        os.killpg(process.pid, signal.SIGINT)
        output, _ = process.communicate(timeout=LIMIT)
    finally:
        process.kill()
    assert process.returncode == 130, output
    assert "Traceback" not in output
    assert not processes_of_session(process.pid)


def test_killed_demo_takes_its_nodes_along(child_environment, tmp_path):
    process = demo(child_environment, "--seconds=60", f"--out={tmp_path}")
    assert process.stdout is not None
    for line in process.stdout:
        if line.startswith("from the grid"):
            break
    process.kill()
    process.communicate(timeout=LIMIT)
    limit = time.monotonic() + LIMIT
    while processes_of_session(process.pid):
        assert time.monotonic() < limit, "nodes outlived the demonstration"
        time.sleep(0.05)


def test_missing_bags_are_explained(child_environment, tmp_path):
    process = demo(child_environment, "--seconds=0", f"--bags={tmp_path}", f"--out={tmp_path}")
    output, _ = process.communicate(timeout=LIMIT)
    assert process.returncode == 2
    assert output.startswith("the bag kr16_cold is not in")
    assert len(output.splitlines()) == 1
