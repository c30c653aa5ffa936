"""What is said about an input: loss, quality of service, type, publishers."""

from __future__ import annotations

import os
import time

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.context import Context
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from ros2_energy_msgs.msg import JointFriction, JointTorque
from sensor_msgs.msg import JointState, Temperature

from robot_energy.ingest import Accounting
from ros2_energy_monitor.drain import Inbox
from ros2_energy_monitor.findings import Findings
from ros2_energy_monitor.input_watch import InputWatch
from ros2_energy_monitor.publishers import best_effort, latched, reliable
from ros2_energy_monitor.torque_monitor import TorqueMonitor

NAME = "torque_monitor: joint states"
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
    watch = InputWatch("joint state", inbox, Accounting(), 1.0)
    watch.judge(Findings("before"))  # has looked at the graph: the event must tell it to look
    offered = QoSProfile(depth=5, reliability=reliability, durability=durability)
    publisher = bench.tester.create_publisher(JointState, "states", offered)
    if not reason:
        bench.spin_until(lambda: inbox.publishers, "the publisher")
        publisher.publish(JointState())
        bench.spin_until(inbox.drain, "a message")
    else:
        bench.spin_until(lambda: inbox.misfits, "the event")
    found = Findings("joint states")
    watch.judge(found)
    sentence = f"the quality of service of /states from /tester does not fit: {reason}"
    assert (sentence in found.message) is bool(reason)
    assert (found.level == DiagnosticStatus.ERROR) is bool(reason)


def test_a_topic_of_another_type_is_named(bench, monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    contexts = [Context(), Context()]
    nodes = []
    for number, context in enumerate(contexts):
        rclpy.init(
            args=[],
            context=context,
            signal_handler_options=SignalHandlerOptions.NO,
            domain_id=102 + os.getpid() % 100,
        )
        nodes.append(rclpy.create_node(f"node_{number}", context=context))
    inbox = Inbox(nodes[0], JointState, "states", best_effort(5))
    publisher = nodes[1].create_publisher(Temperature, "states", 5)
    bench.spin_until(lambda: nodes[0].count_publishers("states"), "the publisher")
    watch = InputWatch("joint state", inbox, Accounting(), 1.0)

    def judged() -> Findings:
        found = Findings("joint states")
        watch.judge(found)
        return found

    words = "publishes /states as sensor_msgs/msg/Temperature, not sensor_msgs/msg/JointState"
    assert words in judged().message
    assert judged().level == DiagnosticStatus.ERROR
    bench.spin_until(lambda: f"/node_1 {words}" in judged().message, "the name of the node")
    nodes[1].destroy_publisher(publisher)
    for node, context in zip(nodes, contexts, strict=True):
        node.destroy_node()
        context.try_shutdown()


def test_loss_is_counted_and_told(bench):
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
    diagnosed.wait(NAME, "no joint state for")  # told once
    assert "lost" not in diagnosed[NAME].message


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
        inbox.suppliers.look()
    assert asked == [steady, steady + 5, steady + 10]


def test_all_findings_stand_in_one_sentence_the_worst_first():
    found = Findings("all")
    found.add(DiagnosticStatus.WARN, "this is odd")
    found.add(DiagnosticStatus.ERROR, "that is wrong")
    found.add(DiagnosticStatus.STALE, "it is old")
    assert found.message == "that is wrong; it is old; this is odd"
    assert found.level == DiagnosticStatus.ERROR
    assert len(found) == 3
    assert (Findings("none").message, Findings("none").level) == (
        "all is well",
        DiagnosticStatus.OK,
    )


def test_friction_that_is_kept_is_not_subscribed_anew(bench):
    inbox = Inbox(bench.tester, JointFriction, "friction", latched(5))
    bench.tester.create_publisher(JointFriction, "friction", latched(5))
    bench.spin_until(lambda: inbox.publishers, "the publisher")
    inbox.revive()
    assert inbox.renewals == 0
