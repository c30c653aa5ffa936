# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The virtual robot publishes what a robot with thermometers and a meter would."""

from __future__ import annotations

import numpy as np
import pytest
from ros2_energy_msgs.msg import MotorTemperatures, PowerReading
from sensor_msgs.msg import JointState
from std_msgs.msg import UInt8

from robot_energy.foundation.errors import RigError
from robot_energy_rig.record import PUMP_OFF, LoadPlayer, auxiliary_loads
from ros2_energy_monitor.base.node_parameters import RobotParameters
from ros2_energy_monitor.base.publishers import best_effort
from ros2_energy_monitor.nodes.virtual_robot import VirtualRobot, make_rig


def test_all_topics_with_stamps_of_the_clock(bench):
    states = bench.inbox(JointState, "joint_states", best_effort(1000))
    degc = bench.latest(MotorTemperatures, "motor_temperatures")
    meter = bench.latest(PowerReading, "power_meter")
    before = bench.tester.get_clock().now().nanoseconds
    robot = bench.add(VirtualRobot, start_temperature_degc=35.0, rate=500.0)
    bench.spin_until(lambda: degc() and meter(), "temperatures and readings")
    batch = bench.spin_until(states.drain, "joint states")
    assert robot.rig.period == pytest.approx(0.002)
    assert len(batch) > 1
    stamp = robot.rig.stamp_ns
    assert before < stamp <= bench.tester.get_clock().now().nanoseconds + 2_000_000
    assert list(degc().joint_names) == list(robot.rig.joint_names)
    assert np.allclose(degc().temperature_degc, 35.0, atol=2.0)
    assert meter().meaning == PowerReading.MEANING_MEAN_OVER_INTERVAL
    assert meter().power > 100.0


def test_effort_is_the_motor_torque(bench):
    latest = bench.latest(JointState, "joint_states")
    bench.add(VirtualRobot)
    bench.spin_until(latest, "a joint state")
    message = latest()
    assert len(message.name) == len(message.position) == len(message.velocity) == 6
    assert np.isfinite(message.effort).all()


def test_same_seeds_same_bytes():
    one, again = (make_rig(RobotParameters(), 10**18).step(100).joints for _ in range(2))
    other = make_rig(RobotParameters(program=2), 10**18).step(500).joints
    assert np.array_equal(one.joint_position, again.joint_position)
    assert not np.array_equal(one.joint_position[-1], other.joint_position[-1])


def test_a_drawn_plant_takes_other_torques_for_the_same_motion():
    shipped, drawn, hard = (
        make_rig(RobotParameters(**given), 10**18).step(2000).joints
        for given in ({}, {"plant_seed": 1}, {"plant_seed": 1, "hard": True})
    )
    assert not np.allclose(shipped.measured_motor_torque, drawn.measured_motor_torque, rtol=0.2)
    assert not np.array_equal(drawn.measured_motor_torque, hard.measured_motor_torque)


def test_an_impossible_warm_up_is_refused():
    with pytest.raises(RigError, match="thermal_speedup"):
        make_rig(RobotParameters(thermal_speedup=1e6), 10**18)


def test_pump_and_extruder_on_request(bench):
    powers, states = [], []  # the first counts: both loads switch on after some seconds
    for kind, topic, rows in (
        (PowerReading, "auxiliary/pump/power", powers),
        (UInt8, "auxiliary/extruder/state", states),
    ):
        bench.tester.create_subscription(kind, topic, rows.append, best_effort(1000))
    bench.add(VirtualRobot, auxiliary=True)
    bench.spin_until(lambda: powers and states, "readings and states")
    assert powers[0].power == pytest.approx(PUMP_OFF, rel=0.02)
    assert states[0].data == 0


def test_loads_without_an_end_are_those_of_one_run():
    """In any steps, over three periods: the same readings, and every state."""
    start_ns, seconds = 10**18, 75.0
    whole = auxiliary_loads(start_ns, seconds, 4)
    player = LoadPlayer(start_ns, 4)
    ends = np.cumsum([0.5, 12.0, 17.5, 0.2, 29.8, 15.0])
    steps = [player.step_until(start_ns + round(end * 1e9)) for end in ends]
    for name, load in whole.items():
        stamps = np.concatenate([step[name].readings.stamp_ns for step in steps])
        assert np.array_equal(stamps, load.readings.stamp_ns), name
        for field in ("power", "energy"):
            found = np.concatenate([getattr(step[name].readings, field) for step in steps])
            np.testing.assert_allclose(found, getattr(load.readings, field), atol=1.01)
        changed = np.concatenate([step[name].changed_ns for step in steps])
        state = np.concatenate([step[name].state for step in steps])
        at = np.searchsorted(changed, load.changed_ns, side="right") - 1
        assert np.array_equal(state[at], load.state), name
