# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""A bag played to the monitors: every message once, in order, at the pace asked for."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import termios
import time
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from mcap.writer import Writer
from rclpy.node import Node
from ros2_energy_msgs.msg import PowerState
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from robot_energy.bag import BagReader, BagWriter
from robot_energy.bag.reader import TimeRange
from robot_energy.foundation.errors import (
    BagError,
    MessageTypeError,
    MissingTopicError,
)
from ros2_energy_monitor.base.message_classes import message_class
from ros2_energy_monitor.base.playback_clock import PlaybackClock
from ros2_energy_monitor.executables import EXECUTABLES
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.player import Player

RATE = 8.0
FLOAT = "std_msgs/msg/Float64"
PAYLOAD = "ros2_energy_msgs/msg/Payload"
STATES = ["/joint_states"]


def spinning(bench, goes_on=lambda: True):
    """A pause that executes the nodes of the bench."""

    def pause(seconds: float) -> bool:
        bench.executor.spin_once(timeout_sec=seconds)
        return goes_on()

    return pause


def play(bench, bag: Path, topics=None) -> tuple[Player, float]:
    lines: list[str] = []
    player = Player(bench.tester, BagReader(bag), RATE, topics, report=lines.append)
    bench.spin_until(player.heard, "a subscriber")
    begin = time.monotonic()
    player.play(spinning(bench))
    assert [int(line.split("%")[0]) // 10 for line in lines] == list(range(1, 11))
    return player, time.monotonic() - begin


def test_every_message_once_byte_for_byte_and_in_order(bench, recording, messages):
    inbox = bench.inbox(JointState, "/joint_states")
    player, lasted = play(bench, recording)
    taken: list[bytes] = []

    def all_taken() -> bool:
        batch = inbox.drain()
        taken.extend(batch.row(index) for index in range(0 if batch is None else len(batch)))
        return len(taken) >= len(messages["/joint_states"])

    bench.spin_until(all_taken, "all joint states")
    assert taken == messages["/joint_states"]
    assert player.played == {topic: len(rows) for topic, rows in messages.items()}
    assert lasted > 0.9 * 8.0 / RATE  # never faster than asked for


def states_in(part: TimeRange, bag: Path) -> int:
    reader = BagReader(bag)
    spans = {topic: part.span(reader) for topic in STATES}
    return sum(len(found[topic]) for found in reader.parts(STATES, spans) for topic in found)


def monitored(bench, bag: Path, times: int):
    """What a monitor counts in the first 2 s of a recording in a loop, and states of one more."""
    node = bench.add(EnergyMonitor, model="kr16", state_folder="none")
    part = TimeRange(end=2.0)
    player = Player(bench.tester, BagReader(bag), RATE, STATES, part=part)
    bench.spin_until(player.heard, "the monitor")
    wanted = times * states_in(part, bag)
    player.play(spinning(bench, lambda: player.played.total() < wanted), loop=times > 1)
    sent = player.played.total()
    assert wanted <= sent <= wanted + 20  # it stops in its next pause
    bench.spin_until(lambda: node.ingest.rejections.received == sent, "all joint states")
    node.close()
    registers = node.account.registers
    bench.remove(node)
    return registers, sent - wanted


def test_a_loop_counts_every_turn_and_nothing_across(bench, recording):
    (once, _), (thrice, more) = (monitored(bench, recording, times) for times in (1, 3))
    assert (once.time.gap_ns, once.time.jumps) == (0, 0)
    # where the pause comes late, states of a fourth turn are in it; one alone does not make a turn
    jumps, observed_ns = thrice.time.jumps, thrice.time.observed_ns - 3 * once.time.observed_ns
    assert thrice.time.gap_ns == 0
    assert jumps == 2 or (jumps == 3 and more > 1)
    assert 0 <= observed_ns <= max(more - 1, 0) * 10_000_000
    energies = once.microjoule[:12]  # without the squares of standard deviations
    assert energies[0] > 1e6
    if not observed_ns:
        assert thrice.microjoule[:12] == pytest.approx(3 * energies, abs=3)


def test_a_part_is_played(bench, recording):
    inbox = bench.inbox(JointState, "/joint_states")
    part = TimeRange(1.0, -6.0)
    reader = BagReader(recording)
    player = Player(bench.tester, reader, RATE, STATES, part=part)
    bench.spin_until(player.heard, "a subscriber")
    player.play(spinning(bench))
    assert 240 < player.played["/joint_states"] == states_in(part, recording) < 260
    bench.spin_until(lambda: inbox.drain() is not None, "joint states")
    with pytest.raises(BagError, match="a start before the end"):
        Player(bench.tester, reader, RATE, part=TimeRange(3.0, 2.0))


def test_the_clock_is_that_of_the_recording(bench, recording):
    times: list[int] = []
    bench.tester.create_subscription(
        Clock, "/clock", lambda m: times.append(m.clock.sec * 10**9 + m.clock.nanosec), 100
    )
    reader = BagReader(recording)
    part = TimeRange(1.0, 3.0)
    player = Player(bench.tester, reader, RATE, STATES, part=part, clock_rate=200.0)
    bench.spin_until(lambda: player.clock._publisher.get_subscription_count(), "a subscriber")
    bench.inbox(JointState, "/joint_states")
    bench.spin_until(player.heard, "a subscriber")
    player.play(spinning(bench))
    player.clock.pause(True)
    bench.spin_until(lambda: times and times[-1] == player.clock.now_ns, "the time it stands at")
    first, last = part.span(reader)
    assert times == sorted(times)
    assert first <= times[0] < first + 10**9
    assert last - 10**8 < times[-1]  # that of the last message or later


def test_a_bag_with_a_clock_has_one_clock(bench, tmp_path):
    reader = odd_bag(tmp_path, {"/clock": FLOAT, "/plain": FLOAT})
    player = Player(bench.tester, reader, 1.0, clock_rate=40.0)
    assert player.topics == ["/plain"]
    assert "Leave out --clock" in player.left_out[0]


def call(bench, name: str) -> str:
    client = bench.tester.create_client(Trigger, f"/tester/{name}")
    bench.spin_until(client.service_is_ready, name)
    future = client.call_async(Trigger.Request())
    bench.spin_until(future.done, f"the answer of {name}")
    assert future.result().success
    return future.result().message


def test_it_stands_still_and_goes_on(bench, recording):
    bench.inbox(JointState, "/joint_states")
    lines: list[str] = []
    part = TimeRange(end=1.0)
    reader = BagReader(recording)
    player = Player(bench.tester, reader, RATE, STATES, part=part, paused=True, report=lines.append)
    bench.spin_until(player.heard, "a subscriber")
    looks = iter(range(5))
    player.play(spinning(bench, lambda: next(looks, None) is not None))
    assert player.played.total() == 0
    for name, answer in (
        ("pause", "paused"), ("toggle_paused", "plays"), ("resume", "plays"), ("pause", "paused"),
        ("resume", "plays"),
    ):  # fmt: skip
        assert call(bench, name) == answer
    assert lines == ["goes on", "paused", "goes on"]
    player.play(spinning(bench))
    assert player.played.total() == states_in(part, recording)


def test_time_stands_still_in_a_pause(bench):
    clock = PlaybackClock(bench.tester, 1000.0)
    clock.begin(10**18)
    bench.spin_until(lambda: clock.now_ns > 10**18, "time")
    assert clock.left(10**18 + 10**15) < 1000.0
    clock.pause(True)
    stands = clock.now_ns
    assert clock.left(10**18 + 10**15) == float("inf")
    assert clock.now_ns == stands
    clock.pause(False)
    bench.spin_until(lambda: clock.now_ns > stands, "time")


def test_the_space_key_pauses_in_a_terminal(bench):
    clock = PlaybackClock(bench.tester, 1.0)
    keyboard, terminal = pty.openpty()
    before = termios.tcgetattr(terminal)
    with clock.space_key(terminal) as has_key:
        assert has_key
        os.write(keyboard, b"x y")  # without a new line
        bench.spin_until(lambda: clock.paused, "a pause")
        os.write(keyboard, b" ")
        bench.spin_until(lambda: not clock.paused, "its end")
    assert termios.tcgetattr(terminal) == before
    with Path(os.devnull).open() as none, clock.space_key(none.fileno()) as has_key:
        assert not has_key
    os.close(keyboard)
    os.close(terminal)


def test_what_cannot_be_played_is_left_out_or_refused(bench, tmp_path):
    with BagWriter(tmp_path / "odd") as bag:
        bag.add_topic("/joint_states", "sensor_msgs/msg/JointState")
        bag.write("/joint_states", np.array([10**18]), [bytes(64)])
    reader = BagReader(tmp_path / "odd")
    with pytest.raises(MissingTopicError, match="no /torque"):
        Player(bench.tester, reader, 1.0, ["/torque"])


def odd_bag(folder: Path, topics: dict[str, str], text: str = "float64 data") -> BagReader:
    """A bag with one message of each topic and of a type that the library need not know."""
    path = folder / "odd.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        for topic, msgtype in topics.items():
            schema = writer.register_schema(msgtype, "ros2msg", text.encode())
            channel = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channel, 10**18, bytes(12), 10**18)
        writer.finish()
    return BagReader(path)


ILLEGAL = {
    "/a b": FLOAT, "/" + "x" * 300: FLOAT, "/a//b": FLOAT, "/\x1b[2J": FLOAT, "/{node}": FLOAT,
    "~/a": FLOAT, "/": FLOAT, "/plain": FLOAT, "plain": FLOAT, "/os": ".os/msg/T",
    "/none": "/msg/T", "/up": "../x/msg/T", "/small": "os/msg/system", "/absent": "os/msg/System",
    "/line": f"{FLOAT}\n",
}  # fmt: skip


def test_illegal_topics_and_types_are_left_out_with_a_sentence_each(bench, tmp_path):
    reader = odd_bag(tmp_path, ILLEGAL)
    player = Player(bench.tester, reader, 1.0)
    assert player.topics == ["/plain"]
    assert len(player.left_out) == len(ILLEGAL) - 1
    assert not [line for line in player.left_out if not line.isprintable()]


def test_outputs_that_a_monitor_publishes_as_well_are_left_out(bench, tmp_path):
    """As where all topics were recorded, and are played to monitors."""
    outputs = {"/power": "ros2_energy_msgs/msg/PowerState", "/plain": FLOAT}
    with BagWriter(tmp_path / "own") as bag:
        for topic, msgtype in outputs.items():
            bag.add_topic(topic, msgtype)
            bag.write(topic, np.array([10**18]), [bytes(12)])
    bag, lines = BagReader(tmp_path / "own"), []
    players = [
        Player(bench.tester, bag, 1.0, topics, report=lines.append) for topics in (None, ["/power"])
    ]
    players[0].leave_out_outputs()
    assert players[0].topics == ["/plain", "/power"]
    monitor = bench.add(Node, "monitor")
    monitor.create_publisher(PowerState, "/power", 10)
    bench.spin_until(lambda: bench.tester.count_publishers("/power") == 3, "the monitor")
    for player in players:
        player.leave_out_outputs()
    assert [player.topics for player in players] == [["/plain"], ["/power"]]
    assert lines == ["left out: /power, which monitor publishes (--topics plays it)"]
    with BagWriter(tmp_path / "outputs") as bag:
        bag.add_topic("/power", outputs["/power"])
        bag.write("/power", np.array([10**18]), [bytes(12)])
    player = Player(bench.tester, BagReader(tmp_path / "outputs"), 1.0)
    with pytest.raises(MissingTopicError, match="nothing but what monitors that run publish"):
        player.leave_out_outputs()


def test_messages_of_another_definition_are_left_out(bench, tmp_path):
    """Their bytes would be read wrongly by whoever has the installed definition."""
    (tmp_path / "other").mkdir()
    reader = odd_bag(tmp_path / "other", {"/payload": PAYLOAD, "/plain": FLOAT}, "float64 mass")
    with pytest.raises(MissingTopicError, match=r"of another release.*robot-energy replay"):
        Player(bench.tester, reader, 1.0)


def test_a_bag_of_which_nothing_can_be_played_is_refused(bench, child_environment, tmp_path):
    reader = odd_bag(tmp_path, {"/os": ".os/msg/T"})
    with pytest.raises(MissingTopicError, match="nothing of"):
        Player(bench.tester, reader, 1.0)
    done = run(child_environment, "player", str(reader.path))
    assert done.returncode == 2
    assert len(done.stdout.splitlines()) == 1
    assert "Traceback" not in done.stderr


def test_a_bag_is_played_to_other_topics(loopback_bench, child_environment, tmp_path):
    reader = odd_bag(tmp_path, {"/plain": FLOAT})
    loopback_bench.tester.create_subscription(Float64, "/cell/plain", lambda _: None, 10)
    words = ["player", str(reader.path), "--clock", "--ros-args", "-r", "/plain:=/cell/plain"]
    done = run(child_environment, *words)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1].split() == ["1", "/plain"]


PLAY = """
import sys
import rclpy
from robot_energy.bag import BagReader
from ros2_energy_monitor.nodes.player import Player
assert sys.path[0] == ""
rclpy.init()
print(*Player(rclpy.create_node("player"), BagReader(sys.argv[1]), 1.0).topics)
assert hasattr(sys.modules["nav_msgs.msg"].Goals, "get_fields_and_field_types")
"""


def test_a_bag_imports_nothing_from_the_working_folder(child_environment, tmp_path):
    """Neither a module that is none of the index nor one that has the name of one that is."""
    for name in ("evil_msgs", "nav_msgs"):
        (tmp_path / name / "msg").mkdir(parents=True)
        (tmp_path / name / "__init__.py").write_text(f"open('{name}_ran', 'w')\n")
        (tmp_path / name / "msg" / "__init__.py").write_text("class Goals: pass\n")
    topics = {"/a": "evil_msgs/msg/Goals", "/b": "nav_msgs/msg/Goals", "/c": "x/msg/T"}
    text = "std_msgs/Header header\ngeometry_msgs/PoseStamped[] goals"
    reader = odd_bag(tmp_path, topics, text)
    done = subprocess.run(
        [sys.executable, "-c", PLAY, str(reader.path)], cwd=tmp_path, env=child_environment,
        capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["/b"]
    assert list(tmp_path.glob("*_ran")) == []


def test_a_module_of_another_place_is_not_taken_for_the_installed_one(monkeypatch, tmp_path):
    decoy = ModuleType("stereo_msgs")
    decoy.__file__ = str(tmp_path / "stereo_msgs" / "__init__.py")
    monkeypatch.setitem(sys.modules, "stereo_msgs", decoy)
    with pytest.raises(MessageTypeError, match="for the messages of stereo_msgs"):
        message_class("stereo_msgs/msg/DisparityImage")
    assert message_class("sensor_msgs/msg/JointState") is JointState


def run(environment, module: str, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "ros2_energy_monitor", module, *words],
        env=environment, capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip


def test_commands_refuse_in_one_sentence(monkeypatch, capfd, tmp_path):
    """In this process, whose handlers of signals stay."""
    monkeypatch.setattr(signal, "signal", lambda number, handler: None)

    def said(name: str, *words: str) -> str:
        monkeypatch.setattr(sys, "argv", [name, *words])
        try:
            code = import_module(EXECUTABLES[name]).main()
        except SystemExit as stop:
            code = stop.code
        assert code == 2
        return "".join(capfd.readouterr())

    assert len(said("player", str(tmp_path / "none")).splitlines()) == 1
    for given in ("0", "fast"):
        words = f"--rate: is {given}; expected a finite number > 0"
        assert words in said("player", "bag", "--rate", given)
