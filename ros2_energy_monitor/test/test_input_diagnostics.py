# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What is said about an input: loss, quality of service, type, publishers."""

from __future__ import annotations

import time
from functools import partial

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.context import Context
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from ros2_energy_msgs.msg import JointFriction, JointTorque, MotorTemperatures
from sensor_msgs.msg import JointState, Temperature

from robot_energy.bag.cdr import Encoder, RawBatch, stamp_columns
from robot_energy.inputs.joint_states.joint_states import JOINT_STATE, JointStateIngest
from robot_energy.inputs.rejection_log import RejectionLog
from ros2_energy_monitor.base.inbox import Inbox
from ros2_energy_monitor.base.publishers import best_effort, latched, reliable
from ros2_energy_monitor.diagnostics.energy import _clock
from ros2_energy_monitor.diagnostics.inputs import ABSENT_REPORTS, InputWatch, accounting
from ros2_energy_monitor.diagnostics.reporter import ERROR, WARN, StatusBuilder, _text
from ros2_energy_monitor.nodes.friction_monitor import FrictionMonitor
from ros2_energy_monitor.nodes.torque_monitor import TorqueMonitor

NAME = "torque_monitor: joint states"
JOINTS = [f"joint_a{axis}" for axis in range(1, 7)]
RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
VOLATILE, KEPT = DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL
NO_RELIABLE = "best effort publisher and reliable subscription"
NO_KEPT = "volatile publisher and transient local subscription"
# What is asked for, what is offered, and why that does not fit.
PAIRS = [
    (best_effort(5), RELIABLE, VOLATILE, ""),
    (best_effort(5), RELIABLE, KEPT, ""),
    (best_effort(5), BEST_EFFORT, VOLATILE, ""),
    (reliable(5), RELIABLE, VOLATILE, ""),
    (reliable(5), BEST_EFFORT, VOLATILE, NO_RELIABLE),
    (latched(5), RELIABLE, KEPT, ""),
    (latched(5), RELIABLE, VOLATILE, NO_KEPT),
    (latched(5), BEST_EFFORT, VOLATILE, f"{NO_RELIABLE}, {NO_KEPT}"),
]


@pytest.mark.parametrize(("asked", "reliability", "durability", "reason"), PAIRS)
def test_quality_of_service_that_does_not_fit_is_named(
    bench, asked, reliability, durability, reason
):
    inbox = Inbox(bench.tester, JointState, "states", asked)
    watch = InputWatch("joint state", inbox, RejectionLog(), lambda: 1.0)
    watch.check(StatusBuilder("before"))  # has looked at the graph: the event must make it look
    offered = QoSProfile(depth=5, reliability=reliability, durability=durability)
    publisher = bench.tester.create_publisher(JointState, "states", offered)
    if not reason:
        bench.spin_until(lambda: inbox.publishers, "the publisher")
        publisher.publish(JointState())
        bench.spin_until(inbox.drain, "a message")
    else:
        bench.spin_until(lambda: inbox.mismatches, "the event")
    found = StatusBuilder("joint states")
    watch.check(found)
    sentence = f"the quality of service of /states from /tester does not fit: {reason}"
    assert (sentence in found.message) is bool(reason)
    assert (found.level == DiagnosticStatus.ERROR) is bool(reason)


def test_a_topic_of_another_type_is_named(bench, monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    contexts = [Context(), Context()]
    nodes = []
    for number, context in enumerate(contexts):
        rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
        nodes.append(rclpy.create_node(f"node_{number}", context=context))
    inbox = Inbox(nodes[0], JointState, "states", best_effort(5))
    publisher = nodes[1].create_publisher(Temperature, "states", 5)
    bench.spin_until(lambda: nodes[0].count_publishers("states"), "the publisher")
    watch = InputWatch("joint state", inbox, RejectionLog(), lambda: 1.0)

    def judged() -> StatusBuilder:
        found = StatusBuilder("joint states")
        watch.check(found)
        return found

    words = "publishes /states as sensor_msgs/msg/Temperature, not sensor_msgs/msg/JointState"
    assert words in judged().message
    assert judged().level == DiagnosticStatus.ERROR
    bench.spin_until(lambda: f"/node_1 {words}" in judged().message, "the name of the node")
    nodes[1].destroy_publisher(publisher)
    for node, context in zip(nodes, contexts, strict=True):
        node.destroy_node()
        context.try_shutdown()


@pytest.mark.parametrize(
    ("ahead", "level", "words"),
    [(3600.0, DiagnosticStatus.WARN, "3600.0 s ahead"), (-3600.0, DiagnosticStatus.OK, "3600.0 s "
      "behind"), (1.0, DiagnosticStatus.OK, "")],
)  # fmt: skip
def test_joint_states_of_another_clock_are_said(ahead, level, words):
    """Also where there is no meter and no thermometer to compare with."""
    ingest = JointStateIngest(("a",))
    encoder = Encoder(JOINT_STATE, {"name": ("a",)}, {"position": 1, "velocity": 1, "effort": 0})
    stamp = 10**18 + np.arange(10) * 10**7
    zero = {"position": np.zeros((10, 1)), "velocity": np.zeros((10, 1))}
    columns = stamp_columns(stamp) | zero | {"effort": np.zeros((10, 0))}
    rows = encoder.encode(columns, 10)
    offset = np.arange(10) * rows.shape[1]
    length = np.full(10, rows.shape[1])
    received = stamp - round(ahead * 1e9)
    ingest.step(RawBatch("/states", JOINT_STATE, received, rows.ravel(), offset, length))
    found = StatusBuilder("joint states")
    _clock(found, ingest.lag_ns)
    assert found.level == level
    text = found.message
    assert words in text
    assert ("stamp_source to receive" in text) == (level == DiagnosticStatus.WARN)
    assert found.values["stamps_ahead_s"] == pytest.approx(ahead, abs=0.1)


def test_loss_is_counted_and_said(bench):
    node = bench.add(TorqueMonitor, model="kr16", joint_state_depth=5)
    diagnosed = bench.diagnosed()
    publisher = bench.publisher(JointState, "joint_states")
    publisher.publish(JointState())
    bench.spin_until(lambda: node.joint_states.received, "the first message")
    for _ in range(100):
        publisher.publish(JointState())
    status = diagnosed.wait(NAME, "messages on /joint_states were lost in transport")
    values = diagnosed.values(status)
    assert values["received"] + values["lost_in_transport"] == 101
    assert values["lost_in_transport"] >= 80
    diagnosed.wait_anew(NAME, "no joint state for")  # said once
    assert "lost" not in diagnosed[NAME].message


def test_messages_of_other_joints_are_no_fault_next_to_those_of_the_model(bench):
    """As of a gripper, whose broadcaster publishes on the topic of the arm."""
    inbox, log = Inbox(bench.tester, JointState, "states", best_effort(5)), RejectionLog()
    watch = InputWatch("joint state", inbox, log, lambda: 1.0, needed=False)

    def findings(accepted: int, **rejected: int) -> StatusBuilder:
        log.received += accepted + sum(rejected.values())
        for reason, count in rejected.items():
            log.reject(reason, count)
        found = StatusBuilder("joint states")
        watch.check(found)
        return found

    assert len(findings(5, unknown_joint=5)) == 0
    assert "all 5 messages on /states rejected" in findings(0, unknown_joint=5).message
    assert "1 of 10 messages" in findings(4, unknown_joint=5, not_finite=1).message


def test_several_publishers_are_named(bench):
    bench.tester.create_publisher(JointState, "joint_states", 5)
    for _ in range(2):
        bench.nodes[0].create_publisher(JointState, "joint_states", 5)
    bench.add(TorqueMonitor, model="kr16")
    diagnosed = bench.diagnosed()
    status = diagnosed.wait(NAME, "no joint state has arrived")
    values = diagnosed.values(status)
    assert values["publisher./tester"] == values["input_publishers"] == 3


def test_the_graph_is_asked_at_most_every_five_seconds(bench, monkeypatch):
    inbox = Inbox(bench.tester, JointTorque, "torques", reliable(5))
    asked = []
    real = bench.tester.get_publishers_info_by_topic
    monkeypatch.setattr(
        bench.tester,
        "get_publishers_info_by_topic",
        lambda topic: asked.append(time.monotonic()) or real(topic),
    )
    steady = time.monotonic()
    for second in range(12):
        monkeypatch.setattr(time, "monotonic", lambda second=second: steady + second)
        inbox.topic_publishers.look()
    assert asked == [steady, steady + 5, steady + 10]


def test_all_findings_stand_in_one_sentence_the_worst_first():
    found = StatusBuilder("all")
    found.add(DiagnosticStatus.WARN, "this is odd")
    found.add(DiagnosticStatus.ERROR, "that is wrong")
    found.add(DiagnosticStatus.STALE, "it is old")
    assert found.message == "that is wrong; it is old; this is odd"
    assert found.level == DiagnosticStatus.ERROR
    assert len(found) == 3
    assert (StatusBuilder("none").message, StatusBuilder("none").level) == (
        "all is well",
        DiagnosticStatus.OK,
    )


def test_an_absent_input_that_is_not_needed_is_a_note_and_once_in_the_log(bench):
    inbox = Inbox(bench.tester, JointState, "cell1/meter", best_effort(5))
    watch = InputWatch("meter reading", inbox, RejectionLog(), lambda: 1.0, needed=False)
    sentence = "no publisher on /cell1/meter: prediction only"
    for number in range(1, ABSENT_REPORTS + 3):
        found = StatusBuilder("energy")
        watch.check(found)
        assert (found.level, found.message) == (DiagnosticStatus.OK, sentence)
        assert (len(found), found.values["input_publishers"]) == (0, 0)
        assert found.remarks == ([sentence] if number >= ABSENT_REPORTS else [])
    bench.tester.create_publisher(JointState, "cell1/meter", best_effort(5))
    bench.spin_until(lambda: inbox.publishers, "the publisher")
    found = StatusBuilder("energy")
    watch.check(found)
    assert found.message.startswith("no meter reading has arrived on /cell1/meter, which has 1 pub")
    assert found.level == DiagnosticStatus.OK
    found.add(DiagnosticStatus.WARN, "this is odd")
    assert found.message == "this is odd"


def test_friction_that_is_kept_is_not_subscribed_again(bench):
    inbox = Inbox(bench.tester, JointFriction, "friction", latched(5))
    bench.tester.create_publisher(JointFriction, "friction", latched(5))
    bench.spin_until(lambda: inbox.publishers, "the publisher")
    inbox.resubscribe_if_silent()
    assert inbox.renewals == 0


def test_the_counts_that_are_published_add_up():
    account = RejectionLog(received=7, accepted=3, waiting=2)
    account.reject("duplicate_stamp", 2)
    values = accounting(account, "states.")
    assert values.pop("states.received") == sum(values.values()) == 7
    assert values["states.waiting"] == 2


def test_a_temperature_topic_without_publisher_is_named_as_it_is_resolved(bench):
    sources = {
        "temperature_sources": ["arm", "wrist"],
        "arm.topic": "arm",
        "wrist.topic": "wrist/degc",
        "wrist.joints": ["joint_a6"],
        "arm.joints": JOINTS[:5],
    }
    node = bench.add(partial(FrictionMonitor, namespace="cell"), model="kr16", **sources)
    diagnosed, name = bench.diagnosed(), "cell/friction_monitor: motor temperatures"
    diagnosed.wait(name, "no motor temperature has arrived on /cell/arm, /cell/wrist/degc")
    publisher = bench.publisher(MotorTemperatures, "cell/arm")
    message = MotorTemperatures(joint_names=JOINTS[:5], temperature_degc=[30.0] * 5)
    message.header.stamp.sec = 1_700_000_000
    publisher.publish(message)
    status = diagnosed.wait(name, "no motor temperature of joint_a6 on /cell/wrist/degc")
    assert status.level == DiagnosticStatus.WARN
    assert node.get_namespace() == "/cell"


def test_what_to_do_stands_within_what_is_shown_of_a_text():
    """`ros2 topic echo` cuts texts beyond 128 characters."""
    found = StatusBuilder("inputs")
    found.add(WARN, "x" * 500, "check the network")
    found.add(ERROR, "y" * 500, "start the driver or set joint_states.topics")
    assert found.message[:128].startswith("start the driver or set joint_states.topics: yyy")


@pytest.mark.parametrize("value", [154_104_832.5, 1.5e6, 0.25, 12_345.678])
def test_numbers_of_people_have_no_exponent(value):
    assert "e" not in _text(value)
    assert float(_text(value)) == pytest.approx(value, rel=1e-5)
