# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The executables of the package and their modules; read by setup.py and by ``python -m``."""

EXECUTABLES = {
    "torque_monitor": "ros2_energy_monitor.nodes.torque_monitor",
    "friction_monitor": "ros2_energy_monitor.nodes.friction_monitor",
    "power_monitor": "ros2_energy_monitor.nodes.power_monitor",
    "energy_monitor": "ros2_energy_monitor.nodes.energy_monitor",
    "energy_dashboard": "ros2_energy_monitor.nodes.energy_dashboard",
    "virtual_robot": "ros2_energy_monitor.nodes.virtual_robot",
    "meter_driver": "ros2_energy_monitor.nodes.meter_driver",
    "energy_exporter": "ros2_energy_monitor.nodes.energy_exporter",
    "energy_recorder": "ros2_energy_monitor.nodes.energy_recorder",
    "console": "ros2_energy_monitor.nodes.console",
    "security_policy": "ros2_energy_monitor.security_policy",
    "player": "ros2_energy_monitor.nodes.player",
    "demo": "ros2_energy_monitor.demo.demo",
}
