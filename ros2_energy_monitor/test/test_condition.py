# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Learned figures and wear on the topic, in /diagnostics, on disk; live equals replay."""

from __future__ import annotations

from importlib.resources import files
from itertools import pairwise

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from ros2_energy_msgs.msg import FrictionCondition, WearAlarm

from robot_energy.condition.drift import Drift, FrictionChange
from robot_energy.foundation.errors import ParameterError
from robot_energy.pipeline import EnergyPipeline
from robot_energy.timeline.blocks import Learning
from robot_energy_rig import VirtualRig, load_profile
from robot_energy_studies.learning_study import joint_block, work
from ros2_energy_monitor.base.publishers import latched
from ros2_energy_monitor.base.settings import settings_of
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.power_monitor import PowerMonitor

EFFORT = {"joint_states.effort_meaning": "motor_torque"}
SINCE_NS = 1_700_000_000 * 10**9


@pytest.fixture
def output():
    """A minute of a rig at work."""
    profile = load_profile("kr16")
    return VirtualRig(profile, work(profile, 1), seed=1, rate_hz=50.0).step(6000)


def fed(node, output) -> None:
    """Feed the node's pipeline tick by tick."""
    joints = joint_block(output.joints)
    for start, stop in pairwise(range(0, len(joints) + 1, 20)):
        part = joints[slice(start, stop)]
        first, last = part.stamp_ns[0] - 10**9 // 50, part.stamp_ns[-1]
        rest = [
            block[(block.stamp_ns > first) & (block.stamp_ns <= last)]
            for block in (output.temperatures, output.meter)
        ]
        node._pipeline.step(part, *(block if len(block) else None for block in rest))
        node._condition.report()


def topic(bench):
    received: list[FrictionCondition] = []
    bench.tester.create_subscription(
        FrictionCondition, "energy/condition", received.append, latched(1)
    )
    return received


def test_learned_figures_are_published_and_equal_those_of_a_replay(bench, output):
    node = bench.add(EnergyMonitor, model="kr16", state_folder="", learning="apply", **EFFORT)
    fed(node, output)
    node._condition._publish()
    received = topic(bench)
    message = bench.spin_until(lambda: received and received[-1], "energy/condition")
    assert message.learning == "apply"
    assert message.in_use
    assert [joint.name for joint in message.joints] == list(node.model.joint_names)
    assert all(joint.valid and 0.7 < joint.multiplier < 1.5 for joint in message.joints)
    assert len(message.joints[0].bucket_multiplier) == len(message.bucket_speed) * len(
        message.bucket_temperature_degc
    )
    whole = EnergyPipeline(node.model, settings_of(node.parameters))
    whole.step(joint_block(output.joints), output.temperatures, output.meter)
    assert whole.condition.state() == node._pipeline.condition.state()


def test_wear_warns_in_diagnostics_and_on_the_topic(bench):
    node = bench.add(EnergyMonitor, model="kr16", state_folder="", **EFFORT)
    test = node._pipeline.condition.wear.joints[1]
    test.changes = [FrictionChange(SINCE_NS, 1.0, 1.0, 0.14)]
    test.drift = Drift(0.15, 0.01, SINCE_NS, 1.0, False)
    node._condition._publish()
    received = topic(bench)
    message = bench.spin_until(lambda: received and received[-1], "energy/condition")
    (alarm,) = message.alarms
    assert (alarm.joint, alarm.kind, alarm.change) == ("joint_a2", WearAlarm.ROSE, 0.15)
    assert alarm.since.sec == 1_700_000_000
    found = node._condition.findings()
    assert found.level == DiagnosticStatus.WARN
    assert "friction of joint_a2 rose" in found.message
    test.drift = Drift(-0.08, 0.01, SINCE_NS, 1.0, True)
    found = node._condition.findings()
    assert found.level == DiagnosticStatus.OK
    assert "as after re-greasing" in found.message


def test_the_temperature_of_a_gear_is_in_the_diagnostics(bench, output, tmp_path):
    """Of a joint whose model has a gear, and of no other; it lies between air and warm oil."""
    models = files("robot_energy") / "models"
    data = yaml.safe_load((models / "kr16.yaml").read_text())
    sizes = {"capacity": 4000.0, "motor_conductance": 2.0, "ambient_conductance": 2.0}
    data["joints"][1]["gear"] = {
        name: {"value": value, "tag": "assumed"} for name, value in sizes.items()
    }
    (tmp_path / "kr16.urdf").write_bytes((models / "kr16.urdf").read_bytes())
    path = tmp_path / "geared.yaml"
    path.write_text(yaml.safe_dump(data))
    node = bench.add(EnergyMonitor, model=str(path), state_folder="", **EFFORT)
    fed(node, output)
    values = node._condition.findings().values
    assert [name for name in values if name.startswith("gear_degc")] == ["gear_degc_joint_a2"]
    assert 0.0 < values["gear_degc_joint_a2"] < 80.0
    assert values["gear_std_k_joint_a2"] > 0.0


def test_what_was_learned_survives_the_node(bench, output, tmp_path):
    folder = str(tmp_path)
    node = bench.add(EnergyMonitor, model="kr16", state_folder=folder, **EFFORT)
    fed(node, output)
    kept = node._pipeline.condition.friction.filtered
    bench.remove(node)
    node = bench.add(EnergyMonitor, model="kr16", state_folder=folder, **EFFORT)
    np.testing.assert_array_equal(node._pipeline.condition.friction.filtered, kept)


@pytest.mark.parametrize("word", ["off", False])  # YAML reads off as false
@pytest.mark.parametrize("node_type", [EnergyMonitor, PowerMonitor])
def test_learning_can_be_switched_off(bench, node_type, word):
    node = bench.add(node_type, model="kr16", state_folder="", learning=word)
    assert node._condition._publisher is None
    assert node._condition.findings().values["learning"] == Learning.OFF


def test_an_unknown_word_is_refused(bench):
    with pytest.raises(ParameterError, match="one of off, observe, apply"):
        bench.add(PowerMonitor, model="kr16", state_folder="", learning="always")
