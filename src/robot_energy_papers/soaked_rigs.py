"""The whole experiment on one rig whose parts all start at one temperature.

Sets for identification, a recording at rest, the identification, and held-out sets: other
motions, other temperatures, another meter and other noise.
"""

from __future__ import annotations

from dataclasses import dataclass

from robot_energy.files.temporary_folder import TemporaryFolder
from robot_energy.model import load
from robot_energy.rig import PlantProfile, RigConfig
from robot_energy_papers.experiment import MotionSet, Programs, make_programs, soaked
from robot_energy_papers.held_out import held_out
from robot_energy_papers.models import FIXED_DEGC, FOLLOWS, identify

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


def soaked_errors(
    profile: PlantProfile, config: RigConfig, rigs: Rigs, seed: int, *, beyond: bool
) -> dict[str, tuple[float, ...]]:
    """Do the experiment on one rig.

    Args:
        profile: The plant.
        config: Effects of the rig.
        rigs: Temperatures and length.
        seed: Seed of the study: of programs, meters and noise.
        beyond: Whether to identify more than paper A does, see `models.identify`, and to fix
            friction at the warm operating point too.

    Returns:
        Error of the grid energy at each of the held-out temperatures, by model. [-]

    Raises:
        RobotEnergyError: If rig, bags or fits fail.
    """
    programs: Programs = make_programs(profile, seed, rigs.moves)
    train_seed, test_seed = rig_seeds(seed)
    with TemporaryFolder() as place:

        def sets(what: str, degc: tuple[float, ...], rig_seed: int) -> list[MotionSet]:
            program = getattr(programs, what)
            return soaked(profile, program, degc, place.path, what, rig_seed, config)

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

    Args:
        seed: Seed of the study.
    """
    return 2 * seed + 1, 2 * seed + 2
