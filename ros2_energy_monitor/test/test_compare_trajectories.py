# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The service that compares trajectories: each as predicted alone, and what is certain."""

from __future__ import annotations

import math

import pytest
from builtin_interfaces.msg import Duration
from ros2_energy_msgs.srv import CompareTrajectories, PredictTrajectory
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from robot_energy.model import load
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor

pytestmark = pytest.mark.usefixtures("kept_process")
JOINTS = list(load("kr16").joint_names)
WARM = {"joint_names": JOINTS, "motor_temperature_degc": [40.0] * 6}


def move(seconds, to=0.5, joint_names=JOINTS) -> JointTrajectory:
    """From rest to rest of all joints but the wrist's range."""
    rows = [0.0, 0.5 * to, to]
    times = [0.0, 0.5 * seconds, seconds]
    points = [
        JointTrajectoryPoint(
            positions=[row * (0.2 if number else 1.0) for number in range(len(joint_names))],
            time_from_start=Duration(sec=int(at), nanosec=round(at % 1.0 * 1e9)),
        )
        for row, at in zip(rows, times, strict=True)
    ]
    for point in points:
        point.positions[1] -= 1.2  # upper arm up: within the range of the KR 16 class
        point.positions[2] += 1.2
    return JointTrajectory(joint_names=joint_names, points=points)


@pytest.fixture
def ask(bench):
    bench.add(EnergyMonitor, model="kr16", state_folder="")
    kinds = {CompareTrajectories: "compare", PredictTrajectory: "predict"}
    clients = {
        kind: bench.tester.create_client(kind, f"energy_monitor/{verb}_traject{end}")
        for (kind, verb), end in zip(kinds.items(), ("ories", "ory"), strict=True)
    }

    def call(kind=CompareTrajectories, **request):
        client = clients[kind]
        bench.spin_until(client.service_is_ready, "the service")
        future = client.call_async(kind.Request(**request))
        bench.spin_until(future.done, "the answer")
        return future.result()

    return call


def test_each_candidate_has_the_energy_of_its_own_prediction(ask):
    motions = [move(2.0), move(4.0), move(9.0)]
    answer = ask(trajectories=motions, **WARM)
    assert answer.success, answer.message
    alone = [
        ask(PredictTrajectory, trajectory=one, motor_temperature_degc=[40.0] * 6) for one in motions
    ]
    for candidate, one in zip(answer.candidates, alone, strict=True):
        net = one.predicted_import_energy - one.predicted_return_energy
        assert candidate.predicted_energy == pytest.approx(net, rel=1e-12)
        assert candidate.predicted_energy_band == pytest.approx(one.predicted_energy_band)
        assert candidate.predicted_peak_power == one.predicted_peak_power
    energies = [one.predicted_energy for one in answer.candidates]
    assert answer.cheapest == energies.index(min(energies))
    best, second = sorted(energies)[:2]
    assert answer.advantage == pytest.approx(second - best)
    assert answer.candidates[answer.cheapest].more_energy == 0.0


@pytest.mark.long
def test_errors_that_candidates_share_cancel(ask):
    answer = ask(trajectories=[move(4.0), move(4.0), move(4.2)], **WARM)
    first, same, other = answer.candidates
    assert abs(first.more_energy - same.more_energy) < 1e-9
    apart = abs(other.more_energy_band - first.more_energy_band)
    assert apart < 0.2 * other.predicted_energy_band
    assert not ask(trajectories=[move(4.0), move(4.0)], **WARM).advantage_certain
    far = ask(trajectories=[move(4.0), move(40.0)], **WARM)
    assert far.advantage_certain
    assert far.cheapest == 0


def test_bad_candidates_say_what_is_wrong_and_the_others_are_compared(ask):
    bad = [
        JointTrajectory(),
        move(4.0, joint_names=JOINTS[:-1]),
        move(0.05),  # far beyond the speed limits
        move(4.0),
    ]
    answer = ask(trajectories=bad, **WARM)
    assert answer.success
    assert [one.feasible for one in answer.candidates] == [False, False, False, True]
    assert answer.cheapest == 3
    assert math.isnan(answer.advantage)
    assert "trajectory 0 has 0 points" in answer.candidates[0].message
    assert "lacks" in answer.candidates[1].message
    assert "speed limit" in answer.candidates[2].message
    assert math.isnan(answer.candidates[0].predicted_energy)
    # both services say alike of a motion that it is impossible
    fast = ask(trajectories=[move(0.05)], **WARM).candidates[0]
    alone = ask(PredictTrajectory, trajectory=move(0.05), motor_temperature_degc=[40.0] * 6)
    assert alone.success
    assert "speed limit at 0.0" in alone.message
    assert "the robot cannot make this motion" in alone.message
    assert alone.message == fast.message


def test_over_the_same_time_waiting_counts_and_a_peak_limit_excludes(ask):
    motions = [move(3.0), move(6.0)]
    bare = ask(trajectories=motions, **WARM)
    same = ask(trajectories=motions, cycle_time=6.0, **WARM)
    assert same.candidates[0].duration == pytest.approx(6.0)
    assert same.candidates[0].predicted_energy > bare.candidates[0].predicted_energy
    assert same.candidates[1].predicted_energy == pytest.approx(bare.candidates[1].predicted_energy)
    short = ask(trajectories=motions, cycle_time=5.0, **WARM)
    assert not short.candidates[1].feasible
    assert "cycle time" in short.candidates[1].message
    free = ask(trajectories=[move(2.0), move(8.0)], **WARM)
    limit = 0.5 * sum(one.predicted_peak_power for one in free.candidates)
    answer = ask(trajectories=[move(2.0), move(8.0)], peak_limit=limit, **WARM)
    assert [one.feasible for one in answer.candidates] == [False, True]
    assert "peak power" in answer.candidates[0].message


REFUSED = [
    {"trajectories": []},
    {"trajectories": [move(2.0)] * 101},
    {"trajectories": [move(2.0)], "joint_names": ["stranger"],
     "motor_temperature_degc": [20.0]},
    {"trajectories": [move(2.0)], "joint_names": JOINTS},
    {"trajectories": [move(2.0)], "cycle_time": math.nan},
    {"trajectories": [JointTrajectory()]},
]  # fmt: skip


def test_what_cannot_be_compared_is_refused(ask):
    for request in REFUSED:
        answer = ask(**request)
        assert not answer.success
        assert answer.cheapest == -1
        assert math.isnan(answer.advantage)
        assert "expected" in answer.message
