"""The virtual test rig: a plant that the monitored model does not know.

Whatever is shown on the rig is labelled so; it proves the method, not a robot.
"""

from robot_energy.rig.config import RigConfig, Sensors
from robot_energy.rig.lubricant import Lubricant
from robot_energy.rig.output import RigJoints, RigOutput, Truth
from robot_energy.rig.printers import irb4600_profile, mantis_profile, testbed_profile
from robot_energy.rig.profile import PlantProfile, SupplyProfile, kr16_profile
from robot_energy.rig.virtual_rig import VirtualRig

PROFILES = {
    "kr16": kr16_profile,
    "mantis": mantis_profile,
    "testbed": testbed_profile,
    "irb4600": irb4600_profile,
}
"""Plants by the name of the shipped model whose bodies they use."""

__all__ = [
    "PROFILES",
    "Lubricant",
    "PlantProfile",
    "RigConfig",
    "RigJoints",
    "RigOutput",
    "Sensors",
    "SupplyProfile",
    "Truth",
    "VirtualRig",
    "irb4600_profile",
    "kr16_profile",
    "mantis_profile",
    "testbed_profile",
]
