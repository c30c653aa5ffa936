"""Messages lost in transport are counted by the numbers of their publishers."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_msgs.msg import JointState

from ros2_energy_monitor.drain import Inbox
from ros2_energy_monitor.publishers import best_effort, reliable
from ros2_energy_monitor.sequences import Sequences


def one() -> tuple[int, int]:
    return 1, 1


@given(
    arrived=st.lists(st.integers(1, 400), min_size=1, unique=True).map(sorted),
    cuts=st.lists(st.integers(0, 400)),
)
@settings(deadline=None)
def test_one_publisher_is_counted_exactly_however_it_is_cut(arrived, cuts):
    sequences = Sequences(one)
    bounds = [0, *sorted(cut for cut in cuts if cut < len(arrived)), len(arrived)]
    for start, stop in pairwise(bounds):
        sequences.step(arrived[start:stop])
    assert arrived[-1] - arrived[0] + 1 == len(arrived) + sequences.lost


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=300))
@settings(deadline=None)
def test_two_publishers_are_counted_exactly_once_both_are_heard_again(events):
    """Each event is a message of one of two publishers that arrives or not."""
    sequences = Sequences(lambda: (2, 2))
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
    sequences = Sequences(lambda: (met[0], met[1]))
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
