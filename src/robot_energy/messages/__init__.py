"""The monitor's own messages: blocks <-> serialised ros2_energy_msgs."""

from robot_energy.messages.friction import FrictionReader, FrictionWriter
from robot_energy.messages.payload import PayloadReader, PayloadWriter, answer_set_payload
from robot_energy.messages.power import PowerStateWriter
from robot_energy.messages.registers import RegistersWriter, interval_fields
from robot_energy.messages.torque import TorqueReader, TorqueWriter

__all__ = [
    "FrictionReader",
    "FrictionWriter",
    "PayloadReader",
    "PayloadWriter",
    "PowerStateWriter",
    "RegistersWriter",
    "TorqueReader",
    "TorqueWriter",
    "answer_set_payload",
    "interval_fields",
]
