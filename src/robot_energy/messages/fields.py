"""Topics, and fields of our messages, that others than their writers name; imports nothing."""

# Of recordings that this tool makes, and the defaults of the nodes.
JOINT_STATES_TOPIC = "/joint_states"
TEMPERATURES_TOPIC = "/motor_temperatures"
METER_TOPIC = "/power_meter"
DRIVE_POWER_TOPIC = "/drive_power"
STAMP = ("header.stamp.sec", "header.stamp.nanosec")
FRAME = "header.frame_id"
RECORDING = "recording"  # as a frame: of a recording that is played, not of a robot
ENERGY_REGISTERS = "ros2_energy_msgs/msg/EnergyRegisters"
JOINT_FIELDS = {
    "shaft_positive": "shaft_energy_positive",
    "shaft_negative": "shaft_energy_negative",
    "rigid": "rigid_energy",
    "friction": "friction_energy",
    "drive_loss": "drive_loss_energy",
}
SHAFT_FIELDS = {
    "measured_positive": "shaft_energy_positive_measured",
    "measured_negative": "shaft_energy_negative_measured",
    "predicted_positive": "shaft_energy_positive_compared",
    "predicted_negative": "shaft_energy_negative_compared",
}
EXACT_FIELDS = {
    "grid_import": "predicted_import_microjoule",
    "grid_return": "predicted_return_microjoule",
    "brake": "brake_microjoule",
    "loss_dc": "loss_dc_microjoule",
    "loss_grid": "loss_grid_microjoule",
    "capacitor": "capacitor_microjoule",
}
EXACT_JOINT_FIELDS = {name: f"{name}_microjoule" for name in JOINT_FIELDS}
