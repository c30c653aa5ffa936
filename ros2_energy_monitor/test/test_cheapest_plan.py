# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The example that asks for the cheapest plan runs with a real node, and takes MoveIt's forms."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "src/examples/planning/cheapest_plan.py"


@pytest.fixture
def example():
    spec = importlib.util.spec_from_file_location("cheapest_plan", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_example_runs_and_names_the_cheapest(loopback_bench, child_environment):
    loopback_bench.add(EnergyMonitor, model="kr16", state_folder="")
    run = subprocess.Popen(
        [sys.executable, str(EXAMPLE)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=child_environment,
    )  # fmt: skip
    loopback_bench.spin_until(lambda: run.poll() is not None, "the example to end")
    out, errors = run.communicate()
    assert run.returncode == 0, errors
    assert "is the cheapest of" in out
    assert out.count("from the grid in 6 s") == 3


def test_plans_of_moveit_are_taken_apart(example):
    """Fields as moveit_msgs has them; the package itself is optional."""
    motion = example.move(example.KR16, 2.0)
    robot = SimpleNamespace(joint_trajectory=motion)
    response = SimpleNamespace(trajectory=robot)
    display = SimpleNamespace(trajectory=[robot, robot])
    assert example.joint_trajectories(motion) == [motion]
    assert example.joint_trajectories(robot) == [motion]
    assert example.joint_trajectories(response) == [motion]
    assert example.joint_trajectories(display) == [motion, motion]
    with pytest.raises(TypeError, match="SimpleNamespace is not a plan"):
        example.joint_trajectories(SimpleNamespace())
