# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Messages come one at a time, evenly spaced: counted by ticks of a simulated clock."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.foundation.errors import ParameterError
from robot_energy_rig.record import RigEncoder
from ros2_energy_monitor.base.node_parameters import RobotParameters
from ros2_energy_monitor.base.publishers import PacedPublisher
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.virtual_robot import VirtualRobot, make_rig

START_NS = 1_700_000_000 * 10**9
SECOND_NS = 10**9
SETTLED = 4.0  # after this only steadiness counts [s]


class Sent:
    """Stands where the middleware takes messages: notes in which tick each went out."""

    def __init__(self) -> None:
        self.tick = 0
        self.ticks: list[int] = []

    def publish(self, message) -> None:
        self.ticks.append(self.tick)


def received(rate: float, seconds: float, jitter: float) -> tuple[np.ndarray, np.ndarray]:
    """Messages of the rig at a rate, and when each arrives after a jitter. [ns]"""
    rig = make_rig(RobotParameters(rate=rate), START_NS)
    joints = rig.step(round(rate * seconds)).joints
    late = np.random.default_rng(4).uniform(0.0, jitter, len(joints)) * SECOND_NS
    return RigEncoder(rig.joint_names).joint_states(joints), np.sort(joints.stamp_ns + late)


@pytest.mark.parametrize(
    ("tick_rate", "power_rate", "rate", "jitter"),
    [
        (25.0, 25.0, 250.0, 0.0), (25.0, 25.0, 250.0, 0.01), (25.0, 25.0, 125.0, 0.03),
        (25.0, 5.0, 250.0, 0.03), (50.0, 12.5, 500.0, 0.01), (25.0, 25.0 / 3.0, 100.0, 0.02),
    ],
)  # fmt: skip
def test_power_comes_every_so_many_ticks_and_never_in_pairs(
    bench, tick_rate, power_rate, rate, jitter
):
    """Joint states arrive late by up to a tick at random; the ticks are those of the node."""
    parameters = {"tick_rate": tick_rate, "power_rate": power_rate, "state_folder": ""}
    node = bench.add(EnergyMonitor, model="kr16", **parameters)
    rows, arrival = received(rate, 12.0, jitter)
    sent = Sent()
    node._power._publisher._publisher = sent
    waiting: list[tuple[int, bytes]] = []

    def drain(inboxes):
        if node.joint_states not in inboxes or not waiting:
            return []
        times, batch = zip(*waiting, strict=True)
        waiting.clear()
        kind = "sensor_msgs/msg/JointState"
        return [RawBatch.from_messages("/joint_states", kind, times, batch)]

    node.drain = drain
    bounds = START_NS + np.arange(1, int(11 * tick_rate)) * round(SECOND_NS / tick_rate)
    before = 0
    for sent.tick, bound in enumerate(bounds):
        count = int(np.searchsorted(arrival, bound))
        times = arrival[before:count].astype(int).tolist()
        waiting += zip(times, (row.tobytes() for row in rows[before:count]), strict=True)
        node._tick()
        before = count
    steps = np.diff([tick for tick in sent.ticks if tick > SETTLED * tick_rate])
    assert Counter(steps.tolist()) == {round(tick_rate / power_rate): len(steps)}
    assert len(steps) > 6 * power_rate


@pytest.mark.parametrize(
    ("power_rate", "nearest"),
    [(50.0, "such as 12.5 or 25"), (10.0, "8.33333 or 12.5"), (24.0, "12.5 or 25")],
)
def test_a_rate_that_ticks_cannot_give_is_refused_with_the_nearest(bench, power_rate, nearest):
    with pytest.raises(ParameterError) as caught:
        bench.add(EnergyMonitor, model="kr16", tick_rate=25.0, power_rate=power_rate)
    assert f"power_rate is {power_rate:g} at a tick_rate of 25" in str(caught.value)
    assert nearest in str(caught.value)


def test_bursts_go_out_one_by_one_and_an_excess_at_once():
    sent = Sent()
    paced = PacedPublisher(sent, ticks=1, max_waiting=2)
    for sent.tick, count in enumerate([3, 0, 0, 1, 0, 2, 0, 9, 0, 0]):
        paced.add(np.zeros((count, 4), np.uint8))
        paced.tick()
    assert sent.ticks == [0, 1, 2, 3, 5, 6, *[7] * 7, 8, 9]


def test_a_flush_leaves_nothing_behind():
    sent = Sent()
    paced = PacedPublisher(sent, ticks=5, max_waiting=2)
    paced.add(np.zeros((4, 4), np.uint8))
    paced.tick()
    paced.flush()
    assert len(sent.ticks) == 4


def test_the_virtual_robot_sends_one_joint_state_a_period(bench):
    """Ticks of 20 ms compute five samples each; each goes out alone, 4 ms after the last."""
    robot = bench.add(VirtualRobot)
    for timer in list(robot.timers):
        timer.cancel()
    sent = Sent()
    robot._joints._publisher._publisher = sent
    robot._joints._rows.clear()
    robot.rig = make_rig(robot.parameters, START_NS)
    robot.get_clock = lambda: Clock(START_NS + (sent.tick + 1) * 4_000_000)
    for sent.tick in range(500):
        if sent.tick % 5 == 4:
            robot.tick()
        robot._joints.tick()
    assert Counter(np.diff(sent.ticks).tolist()) == {1: len(sent.ticks) - 1}
    assert len(sent.ticks) > 490


class Clock:
    """The clock of a node, at one instant."""

    def __init__(self, now_ns: int) -> None:
        self.nanoseconds = now_ns

    def now(self) -> Clock:
        return self
