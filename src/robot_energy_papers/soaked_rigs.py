"""The experiment of paper A on rigs whose parts all start at one temperature.

Sets for identification, a recording at rest, the identification, and held-out sets: other
motions, other temperatures, another meter and other noise. Two questions are asked with it.

What does each effect cost that the model of paper A does not have? An effect is switched off
alone, or is alone on a rig that has nothing but rigid bodies, Coulomb friction and oil. The first
gives its cost together with all others, where errors cancel; the second its cost alone.

And how often does the method work? One plant shows that it can. How often it does, and how badly
it fails, shows only on many: their friction, losses and constants come from distributions of the
rig, and every effect of the rig is on.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.foundation.files.temporary_folder import TemporaryFolder
from robot_energy.model import load
from robot_energy_papers.experiment import RATE, MotionSet, make_programs, soaked
from robot_energy_papers.models import FIXED_DEGC, FOLLOWS, fixed_name, held_out, identify
from robot_energy_rig import PlantProfile, RigConfig, load_profile, random_profile

HOLD_DEGC = 50.0  # of the recording at rest
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
SHARED = (
    "bodies, joint geometry and payload of the URDF",
    "gear ratios, wrist coupling and rotor inertias",
    "the form of the power chain: rigid torque plus friction, times motor speed, plus losses, a DC "
    "link, constant losses",
)
"""All that a drawn plant and a model have in common."""


class Rigs(Described):
    """Temperatures and length of the experiments on soaked rigs."""

    train_degc: tuple[float, ...]
    test_degc: tuple[float, ...]
    moves: int
    rate: Annotated[float, "Of the joint states. [Hz]"] = RATE


def soaked_errors(
    profile: PlantProfile, config: RigConfig, rigs: Rigs, seed: int, *, beyond: bool
) -> dict[str, tuple[float, ...]]:
    """Return the error of the grid energy at each of the held-out temperatures, by model. [-]

    Args:
        beyond: Whether to identify more than paper A does, see `models.identify`, and to fix
            friction at the warm operating point too.
    """
    programs = make_programs(profile, seed, rigs.moves)
    train_seed, test_seed = rig_seeds(seed)
    with TemporaryFolder() as place:

        def sets(what: str, degc: tuple[float, ...], rig_seed: int) -> list[MotionSet]:
            program = getattr(programs, what)
            return soaked(profile, program, degc, place.path, what, rig_seed, config, rigs.rate)

        train = sets("train", rigs.train_degc, train_seed)
        rest = sets("hold", (HOLD_DEGC,), train_seed)
        test = sets("test", rigs.test_degc, test_seed)
        found = identify(
            [entry.path for entry in train],
            rest[0].path,
            load(profile.body),
            fixed_degc=FIXED_DEGC if beyond else FIXED_DEGC[:1],
            beyond=beyond,
        )
        rows = held_out(test, found.models, FOLLOWS)
    return {name: tuple(row.error(name) for row in rows) for name in found.models}


def rig_seeds(seed: int) -> tuple[int, int]:
    """Return the seeds of the rig that is identified and of the one that tests.

    They differ in their meters and their noise.
    """
    return 2 * seed + 1, 2 * seed + 2


class EffectRow(Described):
    """One rig with some effects."""

    name: Annotated[str, "``without x``, ``only x``, or one of the three that frame them."]
    follows: Annotated[tuple[float, ...], "Errors of the proposed model at test temperatures. [-]"]
    fixed: Annotated[tuple[float, ...], "The same of friction fixed at the coldest set. [-]"]

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
    """Return the rigs by name."""
    everything, bare = RigConfig(), RigConfig.plain().having(MODELLED)
    names = list(EFFECTS) if names is None else names
    # Alone, the loss of windings is that of cold ones, and its rise needs a loss that can rise.
    alone = EFFECTS | {"copper": ("copper",), "copper_temperature": EFFECTS["copper"]}
    return {
        ALL: everything,
        NOTHING: bare,
        NO_OIL: everything.without(MODELLED),
        **{f"without {name}": everything.without(*EFFECTS[name]) for name in names},
        **{f"only {name}": bare.having(*alone[name]) for name in names},
    }


def effect_row(name: str, config: RigConfig, rigs: Rigs, seed: int) -> EffectRow:
    """Return what comes out on one rig.

    Args:
        seed: Seed of the study; every rig has the same programs, meter and noise.
    """
    fixed = fixed_name(FIXED_DEGC[0])
    errors = soaked_errors(load_profile("kr16"), config, rigs, seed, beyond=False)
    return EffectRow(name, errors[FOLLOWS], errors[fixed])


class PlantRow(Described):
    """One plant."""

    plant_seed: int
    error: Annotated[
        dict[str, tuple[float, ...]], "Of the grid energy at test temperatures, by model. [-]"
    ]
    refused: Annotated[str, "What identification found; empty where it went through."] = ""


class ErrorSpread(Described):
    """Sizes of the errors of one model over all plants and temperatures. [-]"""

    median: Annotated[float, "Half of the errors are at most so large."]
    ninety: float
    worst: float
    least: float
    greatest: float


def plant_row(plant_seed: int, rigs: Rigs, seed: int) -> PlantRow:
    """Return what comes out on one drawn plant, with every effect of the rig."""
    profile, hard = random_profile("kr16", plant_seed), RigConfig.hard()
    try:
        return PlantRow(plant_seed, soaked_errors(profile, hard, rigs, seed, beyond=True))
    except NotIdentifiableError as error:
        return PlantRow(plant_seed, {}, error.found)


def error_spreads(rows: Sequence[PlantRow]) -> dict[str, ErrorSpread]:
    """Return the distribution of the errors of every model, of the plants that have it."""
    by_model: dict[str, list[float]] = {}
    for row in rows:
        for name, errors in row.error.items():
            by_model.setdefault(name, []).extend(errors)
    return {
        name: ErrorSpread(
            float(np.median(np.abs(errors))),
            float(np.quantile(np.abs(errors), 0.9)),
            max(errors, key=abs),
            min(errors),
            max(errors),
        )
        for name, errors in by_model.items()
    }
