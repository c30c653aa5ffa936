"""The virtual test rig: a plant with other friction and losses than the model has.

Whatever is shown on the rig is labelled so; it proves the method, not a robot.
"""

from robot_energy_rig.config import RigConfig, RigJoints, RigOutput, Sensors, Truth
from robot_energy_rig.profile import (
    HardEffects,
    Lubricant,
    PlantProfile,
    SupplyProfile,
    load_profile,
    random_profile,
)
from robot_energy_rig.virtual_rig import VirtualRig

__all__ = [
    "HardEffects", "Lubricant", "PlantProfile", "RigConfig", "RigJoints", "RigOutput", "Sensors",
    "SupplyProfile", "Truth", "VirtualRig", "load_profile", "random_profile",
]  # fmt: skip
