# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The robot's description: awaited, refused, adopted once, or compared with the model's."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from rclpy.lifecycle import TransitionCallbackReturn
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from robot_energy.foundation.errors import RobotDescriptionError, UrdfAwaitedError
from robot_energy.model import load, save
from ros2_energy_monitor.base.entities import EntitySnapshot
from ros2_energy_monitor.base.publishers import latched
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.friction_monitor import FrictionMonitor
from ros2_energy_monitor.nodes.power_monitor import PowerMonitor
from ros2_energy_monitor.nodes.torque_monitor import TorqueMonitor

NAME = "energy_monitor: node"
KR16 = load("kr16").urdf_xml


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """The KR 16 model, its URDF left to the robot."""
    path = tmp_path / "robot.yaml"
    save(load("kr16"), path)
    document = yaml.safe_load(path.read_text())
    document["urdf"] = {"topic": "robot_description"}
    path.write_text(yaml.safe_dump(document))
    return path


@pytest.fixture
def describe(bench):
    publisher = bench.tester.create_publisher(String, "robot_description", latched(1))
    return lambda text: publisher.publish(String(data=text))


def test_a_replay_says_that_the_urdf_is_missing(model):
    with pytest.raises(UrdfAwaitedError, match=r"from the topic 'robot_description'.*urdf\.path"):
        load(model)


@pytest.mark.parametrize("monitor", [TorqueMonitor, FrictionMonitor, PowerMonitor, EnergyMonitor])
def test_a_monitor_waits_and_starts_by_itself(bench, model, describe, monitor):
    node = bench.add(monitor, model=str(model))
    assert (node.state, node.active) == ("inactive", False)
    describe(KR16)
    bench.spin_until(lambda: node.active, "the description")
    assert node.state == "active"
    assert node.model.model_id == load(model, KR16).model_id


def test_what_is_awaited_and_refused_is_said(bench, model, describe):
    node = bench.add(EnergyMonitor, model=str(model))
    size = len(EntitySnapshot(node))
    diagnosed = bench.diagnosed()
    diagnosed.wait(NAME, "waiting for a robot description on /robot_description")
    describe("garbage")
    status = diagnosed.wait(NAME, "the robot description on /robot_description is refused")
    assert "not well-formed" in status.message
    assert node.trigger_activate() == TransitionCallbackReturn.FAILURE
    assert node.state == "inactive"
    describe(load("ur3e").urdf_xml)  # good, but of another robot
    diagnosed.wait(NAME, "no joint 'joint_a1'")
    assert len(EntitySnapshot(node)) == size
    describe(KR16)
    diagnosed.wait(NAME, "all is well")
    assert node.active


class Fussy(EnergyMonitor):
    """A monitor that cannot use a description after all."""

    fussy = True

    def set_up(self) -> None:
        super().set_up()
        if self.fussy:
            raise RobotDescriptionError("nobody likes it")


def test_a_description_that_cannot_be_adopted_leaves_nothing_behind(bench, model, describe):
    node = bench.add(Fussy, model=str(model))
    size = len(EntitySnapshot(node))
    diagnosed = bench.diagnosed()
    describe(KR16)
    diagnosed.wait(NAME, "nobody likes it")
    assert len(EntitySnapshot(node)) == size
    assert not node.ready
    node.fussy = False
    describe(KR16 + " ")
    bench.spin_until(lambda: node.active, "the next description")


def test_later_descriptions_change_nothing(bench, model, describe, messages):
    node = bench.add(EnergyMonitor, model=str(model))
    diagnosed = bench.diagnosed()
    describe(KR16)
    bench.spin_until(lambda: node.active, "the description")
    identity = node.model.model_id
    describe("<robot/>")
    diagnosed.wait(NAME, "is refused")
    heavy = KR16.replace('<mass value="', '<mass value="1')
    describe(heavy)
    diagnosed.wait(NAME, "is ignored until cleanup and configure")
    publisher = bench.publisher(JointState, "joint_states")
    for message in messages["/joint_states"][:100]:
        publisher.publish(message)
    bench.spin_until(lambda: node.ingest.rejections.accepted == 100, "joint states")
    assert node.model.model_id == identity
    describe(KR16)
    diagnosed.wait(NAME, "all is well")
    describe(heavy)
    diagnosed.wait(NAME, "is ignored until cleanup and configure")
    node.trigger_deactivate()
    node.trigger_cleanup()
    node.trigger_configure()
    bench.spin_until(lambda: node.ready, "the description")
    assert node.model.model_id != identity
    assert not node.active  # whoever configures by hand activates by hand
    assert node.trigger_activate() == TransitionCallbackReturn.SUCCESS


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (KR16, "all is well"),
        (load("ur3e").urdf_xml, "is not of the modelled robot: it has no moving joint joint_a1"),
        ("garbage", "it cannot be read"),
    ],
)
def test_a_model_with_its_own_urdf_is_compared(bench, describe, text, words):
    node = bench.add(EnergyMonitor, model="kr16")
    diagnosed = bench.diagnosed()
    describe(text)
    diagnosed.wait(NAME, words)
    assert node.active
    assert node.model.model_id == load("kr16").model_id
