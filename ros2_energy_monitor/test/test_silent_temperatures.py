# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""A thermometer that stops, and one whose clock is behind: what each is called, live."""

from __future__ import annotations

import math
import shutil
import time
from functools import partial
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from ros2_energy_msgs.msg import MotorTemperatures
from sensor_msgs.msg import JointState

from robot_energy.foundation.units import SECOND_NS
from robot_energy.model import load
from ros2_energy_monitor.nodes.energy_monitor import EnergyMonitor
from ros2_energy_monitor.nodes.friction_monitor import FrictionMonitor
from ros2_energy_monitor.nodes.power_monitor import PowerMonitor
from ros2_energy_monitor.nodes.torque_monitor import TorqueMonitor

NAMES = load("kr16").joint_names
STALE_AFTER = 6.0  # s
TEMPERATURES = "energy_monitor: motor temperatures"
JOINT_STATES = "energy_monitor: joint states"


@pytest.fixture
def model(tmp_path: Path) -> str:
    shipped = Path(load("kr16").source)
    shutil.copy(shipped.with_suffix(".urdf"), tmp_path)
    text = shipped.read_text()
    own = text.replace("temperature:\n", f"temperature:\n  stale_after: {STALE_AFTER}\n", 1)
    (tmp_path / "kr16.yaml").write_text(own)
    return str(tmp_path / "kr16.yaml")


class Robot:
    """Publishes joint states, and temperatures whose stamps are off by so much. [s]"""

    def __init__(self, bench) -> None:
        self._bench = bench
        self._states = bench.publisher(JointState, "joint_states")
        self._temperatures = bench.publisher(MotorTemperatures, "motor_temperatures")
        self.offset: float | None = None
        self.moves = True
        bench.tester.create_timer(0.05, self._joints)
        bench.tester.create_timer(0.2, self._warm)

    def _stamped(self, message, offset=0.0):
        now = self._bench.tester.get_clock().now().nanoseconds + round(offset * 1e9)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, SECOND_NS)
        return message

    def _joints(self) -> None:
        message = JointState(name=list(NAMES), position=[0.1] * 6, velocity=[0.0] * 6)
        if self.moves:
            self._states.publish(self._stamped(message))

    def _warm(self) -> None:
        message = MotorTemperatures(joint_names=list(NAMES), temperature_degc=[41.0] * 6)
        if self.offset is not None:
            self._temperatures.publish(self._stamped(message, self.offset))


def sentences(diagnosed) -> str:
    names = (TEMPERATURES, JOINT_STATES, "energy_monitor: energy")
    return "; ".join(diagnosed[name].message for name in names)


def test_a_thermometer_that_stops_is_no_clock(bench, model):
    bench.add(EnergyMonitor, model=model, state_folder="")
    diagnosed, robot = bench.diagnosed(), Robot(bench)
    robot.offset = 0.0
    value = partial(_value, diagnosed, TEMPERATURES, "motor_temperature_degc.joint_a1")
    bench.spin_until(lambda: value() == 41.0, "a temperature in use")
    robot.offset = None
    status = diagnosed.wait(TEMPERATURES, "no new motor temperature for")
    assert status.level == DiagnosticStatus.STALE
    assert status.message.startswith("check its driver or topic: no new motor temperature for")
    assert "; friction is taken at 22 degC" in status.message
    assert math.isnan(value())
    used = partial(_value, diagnosed, "energy_monitor: energy", "fallback_temperature_samples")
    before = used()
    bench.spin_until(lambda: used() > before, "samples at the fallback temperature")
    assert "clock" not in sentences(diagnosed)


def test_a_thermometer_whose_stamps_lag_is_a_clock(bench, model):
    bench.add(EnergyMonitor, model=model, state_folder="")
    diagnosed, robot = bench.diagnosed(), Robot(bench)
    robot.offset = -100.0
    status = diagnosed.wait(TEMPERATURES, "synchronise the clocks")
    assert 98.0 < float(status.message.split("is stamped ")[1].split()[0]) < 102.0
    energy = diagnosed.wait("energy_monitor: energy", "synchronise the clocks")
    assert "s behind those of the joint states: synchronise the clocks" in energy.message


def test_three_monitors_say_a_clock_from_a_thermometer_that_stops(bench, model):
    for monitor in (TorqueMonitor, FrictionMonitor, PowerMonitor):
        bench.add(monitor, model=model)
    name = "power_monitor: energy"
    diagnosed, robot = bench.diagnosed(), Robot(bench)
    robot.offset = -100.0
    message = diagnosed.wait(name, "synchronise the clocks").message
    behind = float(message.split("its stamps are ")[1].split()[0])
    assert behind == pytest.approx(100.0, abs=4.0)
    robot.offset = 0.0
    used = partial(_value, diagnosed, name, "fallback_temperature_samples")
    bench.spin_until(lambda: "clock" not in diagnosed[name].message, "the right clock")
    robot.offset, before = None, used()
    bench.spin_until(lambda: used() > before + 50, "samples at the fallback temperature")
    assert "clock" not in diagnosed.wait_anew(name, "").message
    silent = "check its driver or topic: no new motor temperature for"
    diagnosed.wait("friction_monitor: motor temperatures", silent)


def test_joints_age_while_nothing_arrives(bench, model):
    bench.add(EnergyMonitor, model=model, state_folder="")
    diagnosed, robot = bench.diagnosed(), Robot(bench)
    age = partial(_value, diagnosed, JOINT_STATES, "age_s.joint_a1")
    bench.spin_until(lambda: age() < 1.0, "joint states")
    robot.moves = False
    stopped = time.monotonic()
    bench.spin_until(lambda: age() > 2.0, "an age")
    assert time.monotonic() - stopped > 1.0
    silent = _value(diagnosed, JOINT_STATES, "input_age_s")
    assert age() == pytest.approx(silent, abs=0.1)


def _value(diagnosed, name: str, key: str) -> float:
    try:
        return diagnosed.values(diagnosed[name])[key]
    except KeyError:
        return math.nan
