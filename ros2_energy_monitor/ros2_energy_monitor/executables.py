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
    "console": "ros2_energy_monitor.nodes.console",
    "security_policy": "ros2_energy_monitor.security_policy",
    "player": "ros2_energy_monitor.nodes.player",
    "demo": "ros2_energy_monitor.demo.demo",
    "all_topics": "ros2_energy_monitor.demo.all_topics",
    "live_study": "ros2_energy_monitor.demo.live_study",
}
