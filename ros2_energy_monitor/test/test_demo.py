# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The demonstration ends by itself, draws its figures and leaves no process behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from robot_energy.model import load
from ros2_energy_monitor.demo import demo as demonstration

BAGS = Path(__file__).parents[2] / "bags"
LIMIT = 900.0  # s, on a machine that does much else


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


def test_the_demo_identifies_the_model_of_its_bags(recording, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(demonstration, "TRAINING", (recording.name,))
    file = demonstration.identify_plant(recording.parent, tmp_path)
    assert f"Identify: robot-energy identify all {recording} --model" in capsys.readouterr().out
    assert load(file).provenance.bags[0].startswith(f"{recording.name} sha256:")


@pytest.mark.parametrize("model", ["kr16", pytest.param("", marks=pytest.mark.long)])
def test_demo_runs_through(child_environment, tmp_path, model):
    """With a model that is there, and with the one that it identifies."""
    out = tmp_path / "out"
    words = ["--seconds=2", f"--bags={BAGS}", f"--out={out}", f"--model={model}"]
    process = demo(child_environment, *words)
    try:
        output, _ = process.communicate(timeout=LIMIT)
    finally:
        process.kill()
    assert process.returncode == 0, output
    assert "Wh measured" in output
    assert ("Identify: robot-energy identify all" in output) == (not model)
    assert (out / "identified.yaml").exists() == (not model)
    for name in ("drawn_test_cold", "drawn_test_warm"):
        assert name in output
        assert (out / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    page = (out / "energy_page.html").read_text()
    assert "<!DOCTYPE html>" in page
    assert "joint_a1" in page
    assert "Energy page while it runs: http://127.0.0.1:" in output
    assert not processes_of_session(process.pid)


@pytest.mark.long
def test_interrupted_demo_leaves_nothing_running(child_environment, tmp_path):
    process = demo(child_environment, "--seconds=60", "--model=kr16", f"--out={tmp_path}")
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


OF_NODES = """
import os, pathlib, signal, sys
from ros2_energy_monitor.demo.node_processes import NodeProcesses
with NodeProcesses(pathlib.Path(sys.argv[1]), dict(os.environ)) as nodes:
    nodes.start("console")
    print("started", flush=True)
    signal.pause()
"""


def test_killed_demo_takes_its_nodes_along(child_environment, tmp_path):
    """As all its nodes: one, without the demonstration around it."""
    process = subprocess.Popen(
        [sys.executable, "-c", OF_NODES, str(tmp_path)],
        env=child_environment,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "started\n"
    assert len(processes_of_session(process.pid)) == 2
    process.kill()
    process.communicate(timeout=LIMIT)
    limit = time.monotonic() + LIMIT
    while processes_of_session(process.pid):
        assert time.monotonic() < limit, "the node outlived what started it"
        time.sleep(0.05)


def test_missing_bags_are_explained(child_environment, tmp_path):
    process = demo(child_environment, "--seconds=0", f"--bags={tmp_path}", f"--out={tmp_path}")
    output, _ = process.communicate(timeout=LIMIT)
    assert process.returncode == 2
    assert output.startswith("the bag drawn_train_cold is not in")
    assert len(output.splitlines()) == 1
