# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""`ros2 param set` and `load`: what can change, when, and what is said otherwise."""

from __future__ import annotations

import pytest
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from robot_energy.foundation.errors import ParameterError
from ros2_energy_monitor.base.parameter_changes import AT_ONCE, AT_START
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.torque_monitor import TorqueMonitor


def set_parameters(bench, node, kind=SetParameters, **values):
    """Call the service that `ros2 param set` and `load` call, and return its results."""
    service = "set_parameters_atomically" if kind is SetParametersAtomically else "set_parameters"
    client = bench.tester.create_client(kind, f"{node.get_name()}/{service}")
    bench.spin_until(client.service_is_ready, service)
    messages = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    future = client.call_async(kind.Request(parameters=messages))
    bench.spin_until(future.done, "an answer")
    bench.tester.destroy_client(client)
    result = future.result()
    return [result.result] if kind is SetParametersAtomically else result.results


def test_all_that_configure_reads_can_be_set_before_it(bench):
    node = bench.add(EnergyMonitor, model="kr16", autostart=False)
    values = {
        "model": "ur5e", "tick_rate": 40.0, "power_rate": 10.0, "meter.topic": "mains",
        "joint_states.topics": ["arm"], "joint_states.effort_meaning": "joint_torque",
    }  # fmt: skip
    results = set_parameters(bench, node, **values)
    assert [result.reason for result in results] == [""] * len(values)
    node.trigger_configure()
    node.trigger_activate()
    assert node.model.robot.type == "Universal Robots UR5e"
    assert node.joint_states.topic == "/arm"
    assert node.readings[0].topic == "/mains"
    assert node.parameters.power_rate == 10.0
    assert node.active


def test_what_is_set_while_inactive_counts_from_activate_on(bench):
    node = bench.add(TorqueMonitor, model="kr16")
    node.trigger_deactivate()
    assert set_parameters(bench, node, model="ur5e")[0].successful
    assert node.model.robot.type == "KR 16 class"
    node.trigger_activate()
    assert node.active
    assert node.model.robot.type == "Universal Robots UR5e"


def test_values_that_do_not_fit_together_keep_the_node_inactive_and_can_be_mended(bench, capfd):
    """Each for itself is in its range, so that their order in a file does not matter."""
    node = bench.add(EnergyMonitor, model="kr16")
    node.trigger_deactivate()
    assert set_parameters(bench, node, tick_rate=40.0)[0].successful
    node.trigger_activate()
    assert not node.active
    assert node.state == "inactive"
    assert "power_rate is 25 at a tick_rate of 40" in capfd.readouterr().err
    assert set_parameters(bench, node, power_rate=20.0)[0].successful
    node.trigger_activate()
    assert node.active
    assert node.parameters.power_rate == 20.0


def test_while_active_only_what_leaves_the_registers_as_they_are(bench):
    node = bench.add(EnergyMonitor, model="kr16")
    refused = {"model": "ur5e", "meter.scale": 2.0, "tick_rate": 50.0, "state_folder": ""}
    for result in set_parameters(bench, node, **refused):
        assert not result.successful
        assert "energy_monitor is active" in result.reason
        assert "Deactivate the node, set it and activate again" in result.reason
    values = {"input_timeout": 7.0, "resubscribe_after": 33.0, "checkpoint_period": 0.5}
    assert set(values) == set(AT_ONCE)
    assert all(result.successful for result in set_parameters(bench, node, **values))
    assert node.parameters.input_timeout == 7.0
    assert node.joint_states._revival._after == 33.0
    assert node.checkpoints._timer.timer_period_ns == 500_000_000
    assert node.get_parameter("model").value == "kr16"


def test_a_new_silence_counts_at_once(bench):
    bench.add(TorqueMonitor, model="kr16", input_timeout=3600.0)
    node, diagnosed = bench.nodes[-1], bench.diagnosed()
    name = "torque_monitor: joint states"
    bench.publisher(JointState, "joint_states").publish(JointState())
    bench.spin_until(lambda: node.joint_states.received, "a message")
    set_parameters(bench, node, input_timeout=0.05)
    diagnosed.wait(name, "no joint state for ")


@pytest.mark.parametrize("active", [True, False])
def test_wrong_values_are_refused_in_every_state(bench, active):
    node = bench.add(EnergyMonitor, model="kr16", autostart=active)
    values = {
        "input_timeout": -1.0,
        "joint_states.effort_meaning": "torque",
        "joint_states.effort.sign": [2.0],
    }
    refused = set_parameters(bench, node, **values)
    assert not any(one.successful for one in refused)
    assert "one of none, motor_current" in refused[1].reason
    assert "is [2.0]; expected a list of numbers from -1.0 to 1.0" in refused[2].reason


@pytest.mark.parametrize("name", AT_START)
def test_what_is_read_at_the_start_is_read_only(bench, name):
    node = bench.add(TorqueMonitor, model="kr16", autostart=False)
    assert node.describe_parameter(name).read_only
    (result,) = set_parameters(bench, node, **{name: True})
    assert not result.successful
    assert "read-only" in result.reason


def test_sources_can_be_named_and_then_described(bench):
    """Parameters of a new source are there once it is named."""
    node = bench.add(EnergyMonitor, model="kr16", autostart=False)
    assert set_parameters(bench, node, temperature_sources=["arm"])[0].successful
    assert set_parameters(bench, node, **{"arm.topic": "degc"})[0].successful
    node.trigger_configure()
    assert [inbox.topic for inbox in node.temperatures] == ["/degc"]


def test_values_set_together_are_taken_or_refused_together(bench):
    node = bench.add(TorqueMonitor, model="kr16")
    values = {"input_timeout": 9.0, "model": "ur5e"}
    (result,) = set_parameters(bench, node, SetParametersAtomically, **values)
    assert not result.successful
    assert node.parameters.input_timeout == 1.0


@pytest.mark.parametrize("given", [{}, {"model": ""}], ids=str)
def test_a_node_without_model_waits_for_one_where_a_manager_starts_it(bench, capfd, given):
    node = bench.add(TorqueMonitor, autostart=False, **given)
    node.trigger_configure()
    assert node.state == "unconfigured"
    assert "without its parameter 'model'; expected" in capfd.readouterr().err
    assert set_parameters(bench, node, model="kr16")[0].successful
    node.trigger_configure()
    assert node.state == "inactive"


def test_a_wrong_model_is_said_by_configure_and_can_be_corrected(bench, capfd):
    node = bench.add(TorqueMonitor, model="kr17", autostart=False)
    node.trigger_configure()
    assert "the model file 'kr17' cannot be read" in capfd.readouterr().err
    assert set_parameters(bench, node, model="kr16")[0].successful
    node.trigger_configure()
    assert node.state == "inactive"


def test_a_start_with_values_that_do_not_fit_is_refused(bench):
    with pytest.raises(ParameterError, match="power_rate"):
        bench.add(EnergyMonitor, model="kr16", autostart=False, power_rate=24.0)
