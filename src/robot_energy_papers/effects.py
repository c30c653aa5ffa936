"""What each effect that the model of paper A does not have costs in grid energy.

Every row is the whole experiment on a rig with other effects: sets for identification,
rest, held-out sets, all soaked at their temperatures. An effect is switched off alone, or
is alone on a rig that has nothing but rigid bodies, Coulomb friction and oil. The first
gives its cost together with all others, where errors cancel; the second its cost alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from robot_energy.files.temporary_folder import TemporaryFolder
from robot_energy.model import load
from robot_energy.rig import RigConfig, load_profile
from robot_energy_papers.experiment import Programs, make_programs, soaked
from robot_energy_papers.held_out import held_out
from robot_energy_papers.models import FIXED_DEGC, FOLLOWS, fixed_name, identify

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
HOLD_DEGC = 50.0  # of the recording at rest


@dataclass(frozen=True)
class Rigs:
    """Temperatures and length of the experiments on soaked rigs.

    Attributes:
        train_degc: Temperatures of the sets for identification.
        test_degc: Temperatures of the held-out sets.
        moves: In a set.
    """

    train_degc: tuple[float, ...]
    test_degc: tuple[float, ...]
    moves: int


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
    profile = load_profile("kr16")
    programs: Programs = make_programs(profile, seed, rigs.moves)
    train_seed, test_seed = rig_seeds(seed)
    with TemporaryFolder() as place:
        folder = place.path
        train = soaked(
            profile, programs.train, rigs.train_degc, folder, "train", train_seed, config
        )
        rest = soaked(profile, programs.hold, (HOLD_DEGC,), folder, "rest", train_seed, config)
        test = soaked(profile, programs.test, rigs.test_degc, folder, "test", test_seed, config)
        found = identify(
            [entry.path for entry in train],
            rest[0].path,
            load(profile.body),
            fixed_degc=FIXED_DEGC[:1],
            beyond=False,
        )
        fixed = fixed_name(FIXED_DEGC[0])
        models = {name: found.models[name] for name in (FOLLOWS, fixed)}
        rows = held_out(test, models, FOLLOWS)
    return EffectRow(
        name,
        tuple(row.error(FOLLOWS) for row in rows),
        tuple(row.error(fixed) for row in rows),
    )


def rig_seeds(seed: int) -> tuple[int, int]:
    """Return the seeds of the rig that is identified and of the one that tests.

    They differ in their meters and their noise.

    Args:
        seed: Seed of the study.
    """
    return 2 * seed + 1, 2 * seed + 2
