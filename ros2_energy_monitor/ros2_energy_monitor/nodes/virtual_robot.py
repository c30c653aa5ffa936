# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Node: the virtual rig, live. It plays a robot of the KR 16 class with its power meter."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from ros2_energy_msgs.msg import MotorTemperatures, PowerReading
from sensor_msgs.msg import JointState
from std_msgs.msg import UInt8

from robot_energy_plan.motion import random_program, tool_above
from robot_energy_rig import RigConfig, VirtualRig, load_profile, random_profile
from robot_energy_rig.record import LOADS, LoadPlayer, RigEncoder, load_messages
from ros2_energy_monitor.base.node_parameters import RobotParameters
from ros2_energy_monitor.base.parameters import declare
from ros2_energy_monitor.base.publishers import PacedPublisher, RowPublisher, latched, reliable
from ros2_energy_monitor.base.run_node import run

BODY = "kr16"
CLEARANCE = 0.3  # height that the flange keeps above the base [m]


def make_rig(parameters: RobotParameters, start_stamp_ns: int) -> VirtualRig:
    """Return the rig with a random program, at rest before its first sample."""
    drawn = parameters.plant_seed >= 0
    profile = random_profile(BODY, parameters.plant_seed) if drawn else load_profile(BODY)
    config = RigConfig.hard() if parameters.hard else RigConfig()
    robot, _ = profile.mechanics()
    program = random_program(
        profile.motion_limits(robot),
        parameters.program,
        override=parameters.speed,
        accept=tool_above(robot, "flange", CLEARANCE),
    )
    return VirtualRig(
        profile,
        program,
        replace(config, thermal_speedup=parameters.thermal_speedup),
        seed=parameters.seed,
        start_temperature_degc=parameters.start_temperature_degc,
        ambient_degc=parameters.ambient_degc,
        start_stamp_ns=start_stamp_ns,
        rate_hz=parameters.rate,
    )


class VirtualRobot(Node):
    """Publishes ``joint_states``, ``motor_temperatures`` and ``power_meter``; loads on request.

    Every tick computes the samples that are due; the joint states among them go out one a period,
    up to a tick later, so that they come as evenly as those of a driver. Stamps are those of the
    node's clock at the start plus the time of the rig. ``effort`` is the motor torque that the
    drives report.
    """

    NAME = "virtual_robot"

    def __init__(self, **options: Any) -> None:
        super().__init__(self.NAME, **options)
        self.parameters = declare(self, RobotParameters)
        self.rig = make_rig(self.parameters, self.get_clock().now().nanoseconds)
        self._encoder = RigEncoder(self.rig.joint_names)
        rate, tick_rate = self.parameters.rate, self.parameters.tick_rate
        joints = RowPublisher(self, JointState, "joint_states", reliable(2 * round(rate)))
        self._joints = PacedPublisher(joints, ticks=1, max_waiting=math.ceil(rate / tick_rate) + 2)
        self._temperatures = RowPublisher(
            self, MotorTemperatures, "motor_temperatures", reliable(10)
        )
        self._meter = RowPublisher(self, PowerReading, "power_meter", reliable(100))
        self._player: LoadPlayer | None = None
        self._loads: dict[str, RowPublisher] = {}
        if self.parameters.auxiliary:
            self._player = LoadPlayer(self.rig.stamp_ns, self.parameters.seed)
            for name in LOADS:
                power, state = f"auxiliary/{name}/power", f"auxiliary/{name}/state"
                self._loads[f"/{power}"] = RowPublisher(self, PowerReading, power, reliable(100))
                self._loads[f"/{state}"] = RowPublisher(self, UInt8, state, latched(1))
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0 / tick_rate, self.tick, clock=steady)
        self.create_timer(self.rig.period, self._joints.tick, clock=steady)
        self.get_logger().info(
            f"the virtual rig plays a robot of the KR 16 class at {self.parameters.rate:g} Hz"
        )

    def tick(self) -> None:
        """Compute what became due since the last tick; `PacedPublisher` sends the joint states."""
        output = self.rig.step_until(self.get_clock().now().nanoseconds)
        if output is None:
            return
        if output.temperatures is not None:
            self._temperatures.publish(self._encoder.temperatures(output.temperatures))
        if output.meter is not None:
            self._meter.publish(self._encoder.meter(output.meter))
        self._joints.add(self._encoder.joint_states(output.joints))
        if self._player is not None:
            done = self._player.step_until(self.rig.stamp_ns)
            for topic, _, rows in load_messages(self._encoder, done):
                self._loads[topic].publish(rows)


main = partial(run, VirtualRobot)
