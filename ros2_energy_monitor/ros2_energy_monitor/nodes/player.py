# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Plays a bag to the monitors at any pace, where there is no `ros2 bag play`.

Messages go out byte for byte, with the stamps they were recorded with. Topics other than joint
states go out a little earlier than they are due: at many times the speed of nature the ticks of the
nodes, which know no such speed, would otherwise bring temperatures and readings late.
"""

from __future__ import annotations

import argparse
import heapq
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.utilities import remove_ros_args
from rclpy.validate_full_topic_name import validate_full_topic_name

from robot_energy.bag import BagReader
from robot_energy.bag.cdr.types import differs
from robot_energy.bag.mcap_records import LogTimes
from robot_energy.bag.reader import TimeRange
from robot_energy.foundation.errors import BagError, MissingTopicError, RobotEnergyError
from robot_energy.foundation.shown_text import shown, shown_lines
from robot_energy.foundation.units import SECOND_NS
from robot_energy.inputs.joint_states.joint_states import JOINT_STATE
from ros2_energy_monitor.base.message_classes import message_class
from ros2_energy_monitor.base.message_definitions import definitions_of
from ros2_energy_monitor.base.playback_clock import CLOCK_RATE, CLOCK_TOPIC, PlaybackClock
from ros2_energy_monitor.base.publishers import reliable
from ros2_energy_monitor.base.run_node import StopSignal, ros
from ros2_energy_monitor.base.shared_memory import clear_ports

DEPTH = 5000  # messages that a subscriber may lag behind
LEAD = 0.5  # s of the clock by which slow topics are early, at most ...
MAX_LEAD = 5.0  # s of the recording: from 10 s on a stream counts as having another clock
MATCHING = 10.0  # s until every topic that has a subscriber has met it
LISTENING = 1.0  # s after the first subscriber, for the others
REPORTS = 10  # lines about the progress
MAX_SENTENCES = 20  # about topics left out
OUTPUTS = {  # of monitors
    f"ros2_energy_msgs/msg/{name}"
    for name in (
        "PowerState", "EnergyRegisters", "JointTorque", "JointFriction", "FrictionCondition",
    )
}  # fmt: skip
LOOKING = 0.05  # s until keys and services are looked at where no message is awaited


class Player:
    """Publishes what a bag holds, or a part and topics of it.

    Args:
        rate: Times the speed of nature, > 0. [-]
        clock_rate: How often ``/clock`` is published; 0 for never. [1/s]

    Attributes:
        left_out: Why topics are not played, one sentence each.
    """

    def __init__(
        self,
        node: Node,
        bag: BagReader,
        rate: float,
        topics: Sequence[str] | None = None,
        *,
        part: TimeRange | None = None,
        clock_rate: float = 0.0,
        paused: bool = False,
        report: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.left_out: list[str] = []
        self.played: Counter[str] = Counter()
        self._node, self._bag, self._rate, self._report = node, bag, rate, report
        self._span: LogTimes | None = part.span(bag) if part else None
        self.clock = PlaybackClock(node, rate, clock_rate, paused=paused, report=report)
        self._publishes_clock = clock_rate > 0.0
        self._publishers: dict[str, Any] = {}
        self._all = topics is None
        for topic in bag.topics if topics is None else topics:
            info = bag.topics.get(topic)
            if info is None:
                raise MissingTopicError(
                    f"{bag.path} has no {topic}", f"one of {', '.join(bag.topics) or 'none'}"
                )
            try:
                self._publish(topic, info.msgtype)
            except RobotEnergyError as error:
                self.left_out.append(f"left out: {shown(topic)}: {error}")
        if not self._publishers:
            raise MissingTopicError(
                f"nothing of {bag.path} can be played",
                "topics with legal names and installed messages",
                "; ".join(self.left_out),
            )

    def _publish(self, topic: str, msgtype: str) -> None:
        """Make the publisher of one topic."""
        name = _full(topic)
        if name == CLOCK_TOPIC and self._publishes_clock:
            raise BagError(
                "--clock publishes it", "one clock", "leave out --clock to play this one"
            )
        try:
            validate_full_topic_name(name)
        except (NameValidationException, TypeError) as error:  # TypeError: no Unicode
            what = str(error).splitlines()[0].rstrip(":")
            raise BagError("no topic can have this name", remedy=what) from error
        if name in {_full(other) for other in self._publishers}:
            raise BagError(f"another topic is played as {name}", "each topic once")
        kind = message_class(msgtype)
        recorded = self._bag.typestore
        if msgtype in recorded.fielddefs and differs(recorded, definitions_of(kind)):
            raise BagError(
                f"the bag has {msgtype} of another release",
                "the definition that is installed",
                "replay it with robot-energy replay, which reads it by the bag's definition",
            )
        try:
            self._publishers[topic] = self._node.create_publisher(kind, name, reliable(DEPTH))
        except rclpy_implementation.RCLError as error:
            raise BagError(f"ROS refuses it ({str(error).splitlines()[0]})") from error

    @property
    def topics(self) -> list[str]:
        """The topics that are played, as the bag names them."""
        return list(self._publishers)

    def heard(self) -> list[str]:
        """Return the topics that somebody listens to."""
        return [
            topic
            for topic, publisher in self._publishers.items()
            if publisher.get_subscription_count()
        ]

    def leave_out_outputs(self) -> None:
        """Leave out what a monitor publishes as well, unless topics were named."""
        for topic, publisher in list(self._publishers.items()):
            if not self._all or self._bag.topics[topic].msgtype not in OUTPUTS:
                continue
            found = self._node.get_publishers_info_by_topic(publisher.topic_name)
            others = {one.node_name for one in found} - {self._node.get_name()}
            if others:
                self._node.destroy_publisher(self._publishers.pop(topic))
                names = " and ".join(sorted(others))
                self._report(
                    f"left out: {shown(topic)}, which {names} publishes (--topics plays it)"
                )
        if not self._publishers:
            raise MissingTopicError(
                f"{self._bag.path} holds nothing but what monitors that run publish",
                "joint states",
                "name topics with --topics to play them as well",
            )

    def play(self, pause: Callable[[float], bool], *, loop: bool = False) -> None:
        """Publish all of it, once or for ever.

        Args:
            pause: Waits [s] and returns whether to go on.
        """
        while self._play_once(pause) and loop:
            self._report("begins again")

    def _play_once(self, pause: Callable[[float], bool]) -> bool:
        """Publish all of it once; return whether to go on."""
        first, reported, looked = None, 0, time.monotonic()
        end_ns = (self._span[1] if self._span else self._bag.end_ns) or 0
        for due_ns, topic, message in self._messages():
            if first is None:
                first = due_ns
                self.clock.begin(first)
            while (left := self.clock.left(due_ns)) > 0 or time.monotonic() - looked > LOOKING:
                if not pause(max(0.0, min(left, LOOKING))):
                    return False
                looked = time.monotonic()
            self._publishers[topic].publish(message)
            self.played[topic] += 1
            played = due_ns - first
            share = played / (end_ns - first) if end_ns > first else 0.0
            if share * REPORTS >= reported + 1:
                reported = int(share * REPORTS)
                self._report(f"{share:4.0%} played, {played / SECOND_NS:.1f} s of the recording")
        return first is not None

    def _messages(self) -> Iterator[tuple[int, str, bytes]]:
        """All messages in the order in which they are due; the bag is never held whole."""
        early = round(min(LEAD * self._rate, MAX_LEAD) * SECOND_NS)

        def stream(topic: str) -> Iterator[tuple[int, str, bytes]]:
            lead = 0 if self._bag.topics[topic].msgtype == JOINT_STATE else early
            for part in self._bag.parts([topic], {topic: self._span} if self._span else None):
                batch = part[topic]
                for index, logged in enumerate(batch.log_time_ns.tolist()):
                    yield logged - lead, topic, batch.row(index)

        yield from heapq.merge(*map(stream, self._publishers), key=lambda entry: entry[0])


def _full(topic: str) -> str:
    return topic if topic.startswith("/") else f"/{topic}"


def main(args: Sequence[str] | None = None) -> int:
    """Play a bag.

    Returns:
        Exit code: 0; 1 if nobody listens; 2 if the bag cannot be played; 130 if interrupted.
    """
    parser = argparse.ArgumentParser(
        prog="player",
        description="Play a bag to the monitors. Options are called as those of `ros2 bag play`.",
        epilog="Services ~/pause, ~/resume, ~/toggle_paused, or the space key in a terminal. To "
        "another topic: --ros-args -r /joint_states:=/cell1/joint_states",
    )
    parser.add_argument("bag", help="MCAP file, or rosbag2 folder")
    parser.add_argument(
        *("-r", "--rate"), type=_positive, default=1.0, help="times the speed of nature"
    )
    parser.add_argument("--topics", nargs="+", metavar="TOPIC", help="only these")
    parser.add_argument("-l", "--loop", action="store_true", help="begin again at the end")
    parser.add_argument(
        *("--start", "--start-offset"), type=float, metavar="S",
        help="play from here on: seconds after its start, negative: before its end",
    )  # fmt: skip
    parser.add_argument(
        "--end", type=float, metavar="S", help="play up to here, counted in the same way"
    )
    parser.add_argument(
        "--clock", type=_positive, nargs="?", const=CLOCK_RATE, default=0.0, metavar="HZ",
        help=f"rate at which /clock is published [1/s] ({CLOCK_RATE:g} where no number follows), "
        "for nodes with use_sim_time",
    )  # fmt: skip
    parser.add_argument(
        "-p", "--start-paused", action="store_true", help="wait at the first message until resumed"
    )
    words = list(sys.argv[1:] if args is None else args)
    options = parser.parse_args(remove_ros_args([parser.prog, *words])[1:])
    stop = StopSignal()
    try:
        bag = BagReader(options.bag)
        with ros(words) as context:
            for sentence in clear_ports():
                print(sentence, flush=True)
            node = rclpy.create_node("player", context=context)
            return _play(bag, options, node, stop)
    except RobotEnergyError as error:
        print(f"player: {error}", flush=True)
        return 2


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"is {text}; expected a finite number > 0")
    return value


@contextmanager
def pausing(node: Node, stop: StopSignal) -> Iterator[Callable[[float], bool]]:
    """Execute a node in the pauses of a program that has something else to do.

    Yields:
        Waits some seconds; returns whether to go on.
    """
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)

    def pause(seconds: float) -> bool:
        end, left = time.monotonic() + seconds, seconds
        while not stop.received:
            executor.spin_once(timeout_sec=max(0.0, min(left, 0.2)))
            if (left := end - time.monotonic()) <= 0:
                break
        return not stop.received

    try:
        yield pause
    finally:
        executor.shutdown()
        node.destroy_node()


def _play(bag: BagReader, options: argparse.Namespace, node: Node, stop: StopSignal) -> int:
    with pausing(node, stop) as pause:
        player = Player(
            node,
            bag,
            options.rate,
            options.topics,
            part=TimeRange(options.start, options.end),
            clock_rate=options.clock,
            paused=options.start_paused,
            report=lambda text: print(text, flush=True),
        )
        for sentence in player.left_out[:MAX_SENTENCES]:
            print(sentence, flush=True)
        limit = time.monotonic() + MATCHING
        while not player.heard() and time.monotonic() < limit and pause(0.05):
            pass
        if not player.heard() and not stop.received:
            print(shown_lines(f"no node subscribes to {', '.join(player.topics)}"), flush=True)
            return 1
        with player.clock.space_key(sys.stdin.fileno() if sys.stdin else -1) as has_key:
            if has_key:
                print("the space key pauses", flush=True)
            if pause(LISTENING):
                player.leave_out_outputs()
                player.play(pause, loop=options.loop)
        for topic, count in player.played.items():
            print(f"{count:8d} {shown(topic)}", flush=True)
        pause(LEAD)  # until what was sent last has been taken
        return 130 if stop.received else 0


if __name__ == "__main__":
    raise SystemExit(main())
