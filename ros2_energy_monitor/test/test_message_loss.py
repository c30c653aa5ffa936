# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Messages lost in transport are counted by the numbers of their publishers."""

from __future__ import annotations

import random
from collections import deque
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_msgs.msg import JointState

from ros2_energy_monitor.base.inbox import Inbox, MessageLossCounter
from ros2_energy_monitor.base.publishers import best_effort, reliable


def one() -> tuple[int, int]:
    return 1, 1


@given(
    arrived=st.lists(st.integers(1, 400), min_size=1, unique=True).map(sorted),
    cuts=st.lists(st.integers(0, 400)),
)
@settings(deadline=None)
def test_one_publisher_is_counted_exactly_however_it_is_cut(arrived, cuts):
    sequences = MessageLossCounter(one)
    bounds = [0, *sorted(cut for cut in cuts if cut < len(arrived)), len(arrived)]
    for start, stop in pairwise(bounds):
        sequences.step(arrived[start:stop])
    assert arrived[-1] - arrived[0] + 1 == len(arrived) + sequences.lost


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=300))
@settings(deadline=None)
def test_two_publishers_are_counted_exactly_once_both_are_heard_again(events):
    """Each event is a message of one of two publishers that arrives or not."""
    sequences = MessageLossCounter(lambda: (2, 2))
    number = {False: 0, True: 5000}  # the second one was met late
    arrived = lost = 0
    first, second = [(False, True), (True, True)], [(False, True), (True, True)]
    for publisher, arrives in [*first, *events, *second, *second]:
        number[publisher] += 1
        lost += not arrives
        if arrives:
            arrived += 1
            sequences.step([number[publisher]])
    assert sequences.lost == lost


def test_a_restarted_publisher_loses_nothing():
    met = [1, 1]
    sequences = MessageLossCounter(lambda: (met[0], met[1]))
    sequences.step([7, 8, 9])
    met[0] = 2
    sequences.step([1, 2])  # starts again, and is heard from its first message on
    sequences.step([3, 5])
    assert sequences.lost == 1
    met[0] = 3
    sequences.step([900])  # another one that was met late
    sequences.step([901, 903])
    assert sequences.lost == 2


@pytest.mark.parametrize("direct", [True, False])
def test_published_is_received_plus_lost(bench, direct):
    inbox = Inbox(bench.tester, JointState, "states", best_effort(7), direct=direct)
    assert inbox.direct is direct
    publisher = bench.publisher(JointState, "states")
    published = 0

    def burst(size: int) -> None:
        nonlocal published
        for _ in range(size):
            publisher.publish(JointState())
        published += size

    burst(1)
    bench.spin_until(lambda: inbox.drain() or inbox.received, "the first message")
    for size in (3, 50, 7, 8, 1, 400, 2):
        burst(size)
        reached = inbox.received + inbox.lost
        bench.spin_until(
            lambda reached=reached: inbox.drain() or inbox.received + inbox.lost > reached, "more"
        )
    bench.spin_until(
        lambda: inbox.drain() or inbox.received + inbox.lost == published, "all accounted for"
    )
    assert inbox.lost > 400
    assert inbox.overflows > 2 or not direct


def test_two_publishers_and_a_new_one_lose_nothing(bench):
    inbox = Inbox(bench.tester, JointState, "states", reliable(1000))
    publishers = [bench.publisher(JointState, "states") for _ in range(2)]
    sent = 0
    for number in range(60):
        if number == 30:
            bench.tester.destroy_publisher(publishers.pop(0))
            publishers.append(bench.publisher(JointState, "states"))
        for publisher in publishers[: 1 + number % 2]:
            publisher.publish(JointState())
            sent += 1
        if number % 7 == 0:
            inbox.drain()
    bench.spin_until(lambda: inbox.drain() or inbox.received == sent, "all messages")
    assert inbox.lost == 0


def test_what_passed_before_a_renewal_is_counted_as_lost(bench):
    inbox = Inbox(bench.tester, JointState, "states", best_effort(100))
    publisher = bench.publisher(JointState, "states")
    publisher.publish(JointState())
    bench.spin_until(lambda: inbox.drain() or inbox.received == 1, "the first message")
    for _ in range(5):
        publisher.publish(JointState())  # waits in the queue that goes away
    inbox.renew()
    bench.spin_until(lambda: inbox.publishers, "the publisher")
    publisher.publish(JointState())
    bench.spin_until(lambda: inbox.drain() or inbox.received == 2, "the last message")
    assert (inbox.lost, inbox.renewals) == (5, 1)


def test_a_queue_that_overflows_and_a_publisher_that_leaves_are_counted_exactly():
    """Two publishers of very different numbers share a queue of ten; then one of them leaves."""
    met = [2, 2]
    sequences = MessageLossCounter(lambda: (met[0], met[1]))
    number, lost = {"old": 100_000, "new": 0}, 0
    for drain in range(50):
        here = ["old", "new"] if drain < 25 else ["new"]
        if drain == 24:
            met[1] = 1  # noticed while messages of both still wait
        published = []
        for _ in range(20):
            for name in here:
                number[name] += 1
                published.append(number[name])
        kept = published if drain in (0, 49) else published[-10:]
        lost += len(published) - len(kept)
        sequences.step(kept)
    assert sequences.lost == lost


class Course:
    """Publishers that share a queue: random loss, overflow, one joins and one leaves.

    The truth counts what is missing between the first and last message of each that arrived.
    """

    def __init__(self, seed: int) -> None:
        self.draw = random.Random(seed)
        self.numbers: dict[int, int] = {}  # of those that are here
        self.ever = 0
        self.arrived: dict[int, list[int]] = {}
        self.depth = self.draw.choice([5, 50, 500])
        self.loss = self.draw.choice([0.0, 0.01, 0.3])
        self.queue: deque[tuple[int, int]] = deque(maxlen=self.depth)
        self.counter = MessageLossCounter(lambda: (self.ever, len(self.numbers)))

    def join(self, number: int) -> None:
        self.ever += 1
        self.numbers[self.ever] = number

    def publish(self, which: int, loss: float) -> None:
        self.numbers[which] += 1
        if self.draw.random() >= loss:
            self.queue.append((which, self.numbers[which]))

    def drain(self) -> None:
        for which, number in self.queue:
            self.arrived.setdefault(which, []).append(number)
        self.counter.step([number for _, number in self.queue])
        self.queue.clear()

    def run(self) -> tuple[int, int]:
        """Lost messages: counted and true."""
        self.join(0)
        if self.draw.random() < 0.8:
            self.join(self.draw.choice([0, 0, 5000, 100_000]))
        leaves = self.draw.randrange(20, 60)
        for turn in range(100):
            for _ in range(self.draw.randrange(200)):
                self.publish(self.draw.choice(list(self.numbers)), self.loss)
            if turn == leaves and len(self.numbers) > 1:
                del self.numbers[self.draw.choice(list(self.numbers))]
            if turn == leaves + 15 and self.draw.random() < 0.5:
                self.join(self.draw.choice([0, 7000]))
            self.drain()
        for _ in range(3):
            for which in self.numbers:
                self.publish(which, 0.0)
            self.drain()
        true = sum(seen[-1] - seen[0] + 1 - len(seen) for seen in self.arrived.values())
        return self.counter.lost, true


def test_random_courses_are_never_counted_above_the_truth_and_little_below():
    """Whoever joins, leaves, loses and overflows: five in six courses are exact."""
    results = [Course(seed).run() for seed in range(200)]
    assert [(found, true) for found, true in results if found > true] == []
    assert [(found, true) for found, true in results if found < 0.95 * true] == []
    assert sum(found == true for found, true in results) > 5 / 6 * len(results)


@given(
    st.lists(st.tuples(st.integers(1, 40), st.integers(0, 30)), min_size=2, max_size=60),
    st.integers(0, 59),
    st.integers(50, 100_000),
)
@settings(deadline=None)
def test_what_leaves_is_never_counted_again_and_again(drains, leaves, ahead):
    """However a queue overflows and one of two publishers leaves: no loss beyond what was sent."""
    met = [2, 2]
    sequences = MessageLossCounter(lambda: (met[0], met[1]))
    number, sent = [ahead, 0], 0
    for drain, (size, kept) in enumerate(drains):
        met[1] = 1 if drain >= leaves else 2
        published = []
        for _ in range(size):
            for which in (0, 1) if drain <= leaves else (1,):
                number[which] += 1
                published.append(number[which])
        sent += len(published)
        sequences.step(published[-kept:] if kept else [])
    assert sequences.lost <= sent + ahead
