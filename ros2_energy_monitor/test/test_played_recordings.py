# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""A recording that is played is counted apart: no register, history or learned figure takes it."""

from __future__ import annotations

from collections import Counter
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from rclpy.node import Node
from ros2_energy_msgs.msg import EnergyRegisters, JointTorque
from ros2_energy_msgs.srv import CloseInterval, OpenInterval

from robot_energy.accounting.account import EnergyAccount
from robot_energy.bag import BagReader
from robot_energy.bag.reader import TimeRange
from robot_energy.messages.fields import RECORDING
from robot_energy.model import load
from robot_energy.store.account_store import load_account
from robot_energy_history.database import open_reader
from ros2_energy_monitor.base.played_recording import Change, PlayedRecording
from ros2_energy_monitor.base.publishers import reliable
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.energy_recorder import EnergyRecorder
from ros2_energy_monitor.nodes.player import Player
from ros2_energy_monitor.nodes.power_monitor import PowerMonitor
from ros2_energy_monitor.nodes.torque_monitor import TorqueMonitor

RATE = 8.0
STATES = "/joint_states"
QUICK = {"take_period": 0.2, "write_period": 1.0, "look_period": 1.0, "min_free": 0}


def play(bench: Any, bag: Path, name: str, begin: float, end: float) -> int:
    """Play a part of a bag from a node of its own; return how many joint states it has sent."""
    node = bench.add(Node, name)
    player = Player(node, BagReader(bag), RATE, [STATES], part=TimeRange(begin, end))
    bench.spin_until(player.heard, "the monitor")

    def pause(seconds: float) -> bool:
        bench.executor.spin_once(timeout_sec=seconds)
        return True

    player.play(pause)
    sent = player.played.total()
    bench.spin_until(lambda: node.count_subscribers(STATES), "the monitor")
    return sent


def counted(account: EnergyAccount) -> tuple[int, int]:
    """Energy from the grid and observed time. [uJ], [ns]"""
    totals = account.totals()
    return totals.cabinet_energy_microjoule["grid_import"], totals.observed_ns


def on_disk(folder: Path, node: str) -> tuple[int, int]:
    account = EnergyAccount(6)
    store = load_account(account, load("kr16"), folder, node=node)
    store.open()
    found = counted(account)
    store.close()
    return found


class Feeder:
    """Plays parts of a bag one after the other, each from a node that ends."""

    def __init__(self, bench: Any, bag: Path, monitor: Any) -> None:
        self._bench, self._bag, self._monitor = bench, bag, monitor
        self._sent = 0

    def __call__(self, name: str, begin: float, end: float) -> None:
        self._sent += play(self._bench, self._bag, name, begin, end)
        rejections = self._monitor.ingest.rejections
        self._bench.spin_until(lambda: rejections.received == self._sent, "all joint states")
        node = next(node for node in self._bench.nodes if node.get_name() == name)
        self._bench.remove(node)
        met = self._monitor._played
        self._bench.spin_until(lambda: not any(now for _, now in met.met), "its end")


@pytest.mark.parametrize("name", ["player", "rosbag2_player"])
def test_it_is_counted_apart_and_the_registers_go_on(
    bench: Any, recording: Path, tmp_path: Path, name: str
) -> None:
    monitor = bench.add(EnergyMonitor, model="kr16", state_folder=str(tmp_path), learning="observe")
    account = monitor.account
    registers = bench.latest(EnergyRegisters, "energy/registers")
    diagnosed = bench.diagnosed()
    feed = Feeder(bench, recording, monitor)

    feed("driver", 0.0, 2.0)
    bench.spin_until(lambda: registers() and registers().persisted, "registers on disk")
    monitor._flush()
    robot = counted(account)
    learned = monitor._condition._learner.state()
    assert robot[0] > 1e6
    played = []
    for _ in range(2):
        feed(name, 0.0, 3.0)
        monitor._flush()
        played.append(counted(account))
        bench.spin_until(lambda: registers().header.frame_id == RECORDING, "registers of it")
        assert not registers().persisted
        diagnosed.wait(
            "energy_monitor: registers", f"/{name} plays a recording: its energy is counted"
        )
    assert played[0] == played[1] != robot  # each time from zero
    assert played[0][0] > 1.2 * robot[0]

    feed("driver", 4.0, 5.0)
    bench.spin_until(lambda: registers().persisted and not registers().header.frame_id, "its own")
    monitor._flush()
    after = counted(account)
    assert robot[0] < after[0] < 2.0 * robot[0]
    assert after[1] == pytest.approx(robot[1] + 1e9, abs=2e7)
    assert account.registers.time.gap_ns == pytest.approx(2e9, abs=2e7)  # none of it is lost time
    assert monitor._condition._learner.state().friction == learned.friction
    diagnosed.wait("energy_monitor: registers", "all is well")
    monitor.close()
    last = counted(account)
    bench.remove(monitor)
    assert on_disk(tmp_path, "/energy_monitor") == last


def test_what_ends_in_a_recording_keeps_the_registers(
    bench: Any, recording: Path, tmp_path: Path
) -> None:
    monitor = bench.add(EnergyMonitor, model="kr16", state_folder=str(tmp_path))
    feed = Feeder(bench, recording, monitor)
    feed("driver", 0.0, 1.0)
    monitor._flush()
    robot = counted(monitor.account)
    feed("player", 0.0, 2.0)
    monitor.close()
    bench.remove(monitor)
    assert on_disk(tmp_path, "/energy_monitor") == robot


def test_three_nodes_pass_it_on(bench: Any, recording: Path, tmp_path: Path) -> None:
    torques = bench.add(TorqueMonitor, model="kr16")
    power = bench.add(PowerMonitor, model="kr16", state_folder=str(tmp_path))
    frames = bench.inbox(JointTorque, "energy/joint_torque")
    feed = Feeder(bench, recording, torques)
    store = power.checkpoints.store
    feed("driver", 0.0, 1.0)
    bench.spin_until(lambda: power.account.end_ns, "power")
    feed("player", 0.0, 2.0)
    bench.spin_until(lambda: store.is_aside, "the recording")
    robot = store._aside.totals.observed_ns
    assert robot == pytest.approx(1e9, abs=2e7)
    feed("driver", 2.0, 3.0)
    bench.spin_until(lambda: not store.is_aside, "the robot")
    bench.spin_until(
        lambda: power.account.totals().observed_ns > robot + 0.7e9, "the rest of the robot's"
    )
    power.close()
    bench.remove(power)
    assert on_disk(tmp_path, "/power_monitor")[1] == pytest.approx(2e9, abs=4e7)
    assert frames.drain() is not None


def test_the_history_takes_neither_energy_nor_jobs(
    bench: Any, recording: Path, tmp_path: Path
) -> None:
    monitor = bench.add(EnergyMonitor, model="kr16", state_folder="none")
    recorder = bench.add(EnergyRecorder, folder=str(tmp_path / "h"), **QUICK)

    def ask(kind: Any, name: str) -> None:
        bench.spin_until(lambda: monitor.account.end_ns is not None, "samples")
        client = bench.tester.create_client(kind, f"/energy_monitor/{name}")
        bench.spin_until(client.service_is_ready, name)
        answer = client.call_async(kind.Request(name="part 7"))
        bench.spin_until(answer.done, name)
        assert answer.result().success, answer.result().message

    def rows(table: str) -> int:
        with closing(open_reader(tmp_path / "h")) as connection:
            return connection.execute(f"SELECT count(*) FROM {table}").fetchone()[0]

    feed = Feeder(bench, recording, monitor)
    feed("player", 0.0, 2.0)
    ask(OpenInterval, "open_interval")
    feed("player", 0.0, 2.0)  # a new one: the job of the first is gone
    ask(OpenInterval, "open_interval")
    ask(CloseInterval, "close_interval")
    robot = recorder._robots["robot"]
    asked = robot._asked
    bench.spin_until(lambda: robot._asked > asked, "a list of jobs")
    bench.spin_until(lambda: robot.played > 2, "registers of recordings")
    recorder.trigger_deactivate()
    assert (rows("slot15"), rows("job")) == (0, 0)


def test_registers_in_a_bag_are_not_recorded(bench: Any, tmp_path: Path) -> None:
    recorder = bench.add(EnergyRecorder, folder=str(tmp_path), **QUICK)
    node = bench.add(Node, "rosbag2_player")
    publisher = node.create_publisher(EnergyRegisters, "/energy/registers", reliable(10))
    bench.spin_until(publisher.get_subscription_count, "the recorder")
    message = EnergyRegisters(model_id="m1", observed_ns=10**9, predicted_import_microjoule=10**8)
    message.header.stamp.sec = message.energy_start.sec = 1_700_000_000
    publisher.publish(message)
    bench.spin_until(lambda: recorder._robots["robot"].played == 1, "the message")
    assert not recorder.store.waiting


class Endpoints:
    """Publishers of an inbox as the middleware and the graph know them at an instant."""

    def __init__(self) -> None:
        self.ever, self.now = 0, 0
        self.names = Counter[str]()
        self.topic_publishers = self

    def met(self) -> tuple[int, int]:
        return self.ever, self.now

    def look(self, *, now: bool) -> None:
        assert now


def test_what_is_not_named_yet_waits() -> None:
    inbox: Any = Endpoints()
    played = PlayedRecording([inbox])
    for ever, now, names, change, players in (
        (0, 0, [], Change.NONE, ()),
        (1, 1, [], Change.UNKNOWN, ()),
        (1, 1, ["/cell/rosbag2_player"], Change.RECORDING, ("/cell/rosbag2_player",)),
        (1, 0, ["/cell/rosbag2_player"], Change.UNKNOWN, ("/cell/rosbag2_player",)),
        (1, 0, [], Change.NONE, ("/cell/rosbag2_player",)),  # it has ended, and can be read
        (2, 1, ["/player"], Change.RECORDING, ("/player",)),
        (3, 2, ["/driver", "/player"], Change.RECORDING, ("/player",)),  # nothing is its alone
        (3, 1, ["/driver"], Change.MIXED, ()),
        (4, 2, ["/driver", "/gripper"], Change.NONE, ()),
        (5, 1, ["/player"], Change.RECORDING, ("/player",)),
        (5, 0, [], Change.NONE, ("/player",)),
        (6, 1, ["/driver"], Change.ROBOT, ()),
    ):
        inbox.ever, inbox.now, inbox.names = ever, now, Counter(names)
        met = [inbox.met()]
        found = Change.NONE if met == played.met else played.look(met)
        assert (found, played.players) == (change, players)
