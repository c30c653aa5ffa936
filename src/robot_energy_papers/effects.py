"""What each effect that the model of paper A does not have costs in grid energy.

Every row is the whole experiment on a rig with other effects: sets for identification,
rest, held-out sets, all soaked at their temperatures. An effect is switched off alone, or
is alone on a rig that has nothing but rigid bodies, Coulomb friction and oil. The first
gives its cost together with all others, where errors cancel; the second its cost alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from robot_energy.rig import RigConfig, load_profile
from robot_energy_papers.models import FIXED_DEGC, FOLLOWS, fixed_name
from robot_energy_papers.soaked_rigs import Rigs, soaked_errors

MODELLED = "lubricant_temperature"  # the one effect that the proposed model has
SENSORS = (
    "encoder",
    "velocity_noise",
    "torque_noise",
    "stamp_jitter",
    "temperature_sensor",
    "meter_error",
    "drive_power_error",  # of readings that this study does not use
)
EFFECTS: dict[str, tuple[str, ...]] = {
    "copper": ("copper", "copper_temperature"),
    "copper_temperature": ("copper_temperature",),
    "iron": ("iron",),
    "inverter": ("inverter",),
    "rectifier": ("rectifier",),
    "capacitor": ("capacitor",),
    "demagnetisation": ("demagnetisation",),
    "stribeck": ("stribeck",),
    "load_friction": ("load_friction",),
    "warming": ("warming",),
    "sensors": SENSORS,
}
ALL, NOTHING, NO_OIL = "all effects", "none of them", "oil at one temperature"


@dataclass(frozen=True)
class EffectRow:
    """One rig.

    Attributes:
        name: Name of the rig: ``without x``, ``only x``, or one of the three that frame them.
        follows: Error of the proposed model at each held-out temperature. [-]
        fixed: The same of friction fixed at the coldest set. [-]
    """

    name: str
    follows: tuple[float, ...]
    fixed: tuple[float, ...]

    @property
    def mean(self) -> float:
        """Mean error of the proposed model. [-]"""
        return sum(self.follows) / len(self.follows)

    @property
    def worst(self) -> float:
        """Its greatest error in size, with its sign. [-]"""
        return max(self.follows, key=abs)

    @property
    def worst_fixed(self) -> float:
        """Greatest error in size of fixed friction, with its sign. [-]"""
        return max(self.fixed, key=abs)


def configurations(names: Sequence[str] | None = None) -> dict[str, RigConfig]:
    """Return the rigs by name.

    Args:
        names: Effects to look at; all by default.
    """
    everything, bare = RigConfig(), RigConfig.plain().having(MODELLED)
    made = {ALL: everything, NOTHING: bare, NO_OIL: everything.without(MODELLED)}
    for name in EFFECTS if names is None else names:
        made[f"without {name}"] = everything.without(*EFFECTS[name])
    for name in EFFECTS if names is None else names:
        switches = EFFECTS[name]
        if name == "copper":
            switches = ("copper",)
        if name == "copper_temperature":
            switches = ("copper", "copper_temperature")
        made[f"only {name}"] = bare.having(*switches)
    return made


def effect_row(name: str, config: RigConfig, rigs: Rigs, seed: int) -> EffectRow:
    """Do the experiment on one rig.

    Args:
        name: Name of the rig.
        config: Its effects.
        rigs: Temperatures and length.
        seed: Seed of the study; every rig has the same programs, meter and noise.

    Returns:
        What came out.

    Raises:
        RobotEnergyError: If rig, bags or fits fail.
    """
    fixed = fixed_name(FIXED_DEGC[0])
    errors = soaked_errors(load_profile("kr16"), config, rigs, seed, beyond=False)
    return EffectRow(name, errors[FOLLOWS], errors[fixed])
