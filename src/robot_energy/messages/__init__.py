"""The monitor's own messages: blocks <-> serialised ros2_energy_msgs."""
