# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What the robot carries is set while it runs, kept for those who come late, or refused."""

from __future__ import annotations

import pytest
from geometry_msgs.msg import Vector3
from ros2_energy_msgs.msg import Payload
from ros2_energy_msgs.srv import SetPayload
from sensor_msgs.msg import JointState

from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.model import load
from robot_energy.model.payload import payload
from robot_energy.pipeline import EnergyPipeline
from ros2_energy_monitor.base.publishers import latched
from ros2_energy_monitor.base.settings import settings_of
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.torque_monitor import TorqueMonitor


def ask(bench, node: str, **request) -> SetPayload.Response:
    client = bench.tester.create_client(SetPayload, f"{node}/set_payload")
    bench.spin_until(client.service_is_ready, "the service")
    future = client.call_async(bench.payload(**request))
    bench.spin_until(future.done, "the answer")
    bench.tester.destroy_client(client)
    return future.result()


def test_a_payload_changes_the_energy_from_its_stamp_on(bench, messages):
    rows = messages["/joint_states"][:400]
    node = bench.add(EnergyMonitor, model="kr16")
    publisher = bench.publisher(JointState, "joint_states")
    for row in rows[:200]:
        publisher.publish(row)
    bench.spin_until(lambda: node.ingest.rejections.accepted == 200, "joint states")
    answer = ask(bench, "energy_monitor", link="link_6", m=8.0)
    assert answer.success, answer.message
    assert answer.valid_from.sec // 10**6 == 1700
    assert "from 2023-11-14 22:13:2" in answer.message
    for row in rows[200:]:
        publisher.publish(row)
    bench.spin_until(lambda: node.ingest.rejections.accepted == 400, "joint states")
    node.close()

    model = load("kr16")
    energies = []
    for mass in (0.0, 8.0):
        expected = EnergyPipeline(model, settings_of(node.parameters))
        ingest = JointStateIngest(model.joint_names)
        for part in (rows[:200], rows[200:]):
            batch = RawBatch.from_messages(
                "/joint_states", "sensor_msgs/msg/JointState", [0] * len(part), part
            )
            expected.step(ingest.step(batch))
            if mass:
                expected.torque.set_payload(payload("link_6", mass), None)
        expected.flush()
        energies.append(expected.account.registers.microjoule.tolist())
    assert node.account.registers.microjoule.tolist() == energies[1]
    assert energies[0] != energies[1]


def stage_of(node):
    return node.stage if isinstance(node, TorqueMonitor) else node._pipeline.torque


@pytest.mark.parametrize("monitor", [TorqueMonitor, EnergyMonitor])
def test_an_accepted_payload_is_kept_for_those_who_come_late(bench, monitor):
    node = bench.add(monitor, model="kr16")
    body = {"ixx": 0.05, "ixy": 0.001, "ixz": 0.002, "iyy": 0.06, "iyz": 0.003, "izz": 0.07}
    request = {"link": "tool0", "m": 5.0, "com": Vector3(z=0.1), **body}
    assert ask(bench, node.get_name(), **request).success
    received: list[Payload] = []
    bench.tester.create_subscription(
        Payload, "energy/payload", lambda message: received.append(message), latched(10)
    )
    (message,) = bench.spin_until(lambda: received, "the payload")
    assert (message.inertia.m, message.inertia.com.z) == (5.0, 0.1)
    assert {name: getattr(message.inertia, name) for name in body} == body
    carried = next(body for body in stage_of(node).next_payload if body.link == "tool0")
    assert carried.tensor.tolist() == [
        [0.05, 0.001, 0.002],
        [0.001, 0.06, 0.003],
        [0.002, 0.003, 0.07],
    ]
    assert message.model_id == node.model.model_id
    assert message.header.frame_id == "tool0"  # the frame in which the body is given


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"link": "hand"}, "the link 'hand'"),
        ({"link": "tool0", "m": -1.0}, "mass"),
        ({"link": "tool0", "m": float("nan")}, "mass"),
        ({"link": "tool0", "ixx": 1.0, "iyy": 1e-6, "izz": 1e-6}, "inertia"),
    ],
)
def test_an_impossible_payload_is_refused_in_one_sentence(bench, request_, words):
    node = bench.add(TorqueMonitor, model="kr16")
    received: list[Payload] = []
    bench.tester.create_subscription(
        Payload, "energy/payload", lambda message: received.append(message), latched(10)
    )
    answer = ask(bench, "torque_monitor", **request_)
    assert not answer.success
    assert words in answer.message
    assert "\n" not in answer.message
    assert not received
    assert node.stage.coming_payloads == ()
