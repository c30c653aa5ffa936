"""What robots on one DC bus are claimed to save against what the circuit of the rig saves.

Plants are drawn at random, have every effect of the rig, and are identified elsewhere; each is
recorded at four works. `shared-bus` gets the recordings of two robots, of one plant or of two,
begun at once; `advise` gets one recording and speaks of two such robots with any starts. The truth
is the true power of the drives in the supply circuit of the rig, whose chopper has hysteresis and
whose rectifier loses: once in a supply for each robot, once in one with the capacitors, resistors
and constant losses of both. Simulated throughout.

    python test/bench/bus_study.py FIRST PLANTS
"""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.files.temporary_folder import TemporaryFolder
from robot_energy.model import RobotModel
from robot_energy.replay.bag_replay import replay
from robot_energy.timeline.blocks import Float
from robot_energy_fleet.advice.claims import shared_bus
from robot_energy_fleet.advice.evidence import EvidenceSums
from robot_energy_papers.experiment import MIN_HEIGHT, TOOL
from robot_energy_papers.job_pool import StudyRun, job_pool
from robot_energy_plan.api.shared_bus import shared_bus as shared_bus_of
from robot_energy_plan.motion import Program, random_program, tool_above
from robot_energy_rig import PlantProfile, RigConfig, VirtualRig, random_profile
from robot_energy_rig.plant import Supply
from robot_energy_rig.profile import SupplyProfile
from robot_energy_rig.record import record
from robot_energy_studies.band_coverage import AMBIENT, BODY, TRAINING, DrawnRig
from robot_energy_studies.savings_study import JudgedClaim

MOVES = 8
LENGTH = 60.0  # s of a recording
WORKS = 4  # of a plant
STARTS = 40  # of a second robot
ONE_MODEL, TWO_MODELS, ADVISED = "shared-bus, one plant", "shared-bus, two plants", "advise"


@dataclass(frozen=True)
class JudgedBus(JudgedClaim):
    """One claim.

    Attributes:
        name: Who claims: `ONE_MODEL`, `TWO_MODELS` or `ADVISED`.
        plant: Of the first robot.
        claim: Saving. [J]
        half: Half width of its 90 % band. [J]
        truth: Saving of the rig's circuit. [J]
        energy: True energy of these robots, each with its own supply. [J]
    """

    name: str
    plant: int
    claim: float
    half: float
    truth: float
    energy: float


class DriveWork(Described):
    """What one plant did."""

    profile: Annotated[PlantProfile, "Of the plant."]
    model: Annotated[RobotModel, "Identified from other recordings."]
    bag: Annotated[Path, "The recording."]
    power: Annotated[Float, "True input of all drives, shape (N,). [W]"]
    interval: Annotated[float, "That a sample stands for. [s]"]


def works(folder: Path, plant: int) -> list[DriveWork]:
    """Return two works of a plant."""
    profile = random_profile(BODY, plant)
    model = DrawnRig(profile, RigConfig.hard(), folder / "training").identified(TRAINING)
    robot, _ = profile.mechanics()
    limits, above = profile.motion_limits(robot), tool_above(robot, TOOL, MIN_HEIGHT)
    random = np.random.default_rng(np.random.SeedSequence(plant, spawn_key=(0x627573,)))
    found: list[DriveWork] = []
    for number in range(WORKS):
        drawn = random_program(limits, int(random.integers(1 << 30)), MOVES, accept=above)
        dwell, override = random.uniform(0.2, 2.0, len(drawn.via)), random.uniform(0.6, 1.0)
        program = Program(drawn.via, limits, dwell, float(override))
        degc = float(random.uniform(25.0, 60.0))

        def rig(program: Program = program, degc: float = degc) -> VirtualRig:
            return VirtualRig(profile, program, RigConfig.hard(), plant, degc, AMBIENT)

        bag = record(rig(), LENGTH, folder / f"work{number}").path
        twin = rig()
        truth = twin.step(round(LENGTH / twin.period)).truth
        found.append(DriveWork(profile, model, bag, truth.drive_power.sum(axis=1), twin.period))
    return found


def common_supply(one: SupplyProfile, other: SupplyProfile) -> SupplyProfile:
    """Return the supply of two robots: capacitors and resistors in parallel, behind one rectifier.

    The link stands at the higher rectified voltage, and the chopper that starts first starts both.
    """
    rectified = max(one.rectified_voltage, other.rectified_voltage)
    first = min((one, other), key=lambda supply: supply.chopper_on_voltage)
    return SupplyProfile(
        loss_dc=one.loss_dc + other.loss_dc,
        loss_grid=one.loss_grid + other.loss_grid,
        rectifier_efficiency=0.5 * (one.rectifier_efficiency + other.rectifier_efficiency),
        capacitance=one.capacitance + other.capacitance,
        rectified_voltage=rectified,
        chopper_on_voltage=first.chopper_on_voltage,
        chopper_off_voltage=first.chopper_off_voltage,
        brake_resistance=1.0 / (1.0 / one.brake_resistance + 1.0 / other.brake_resistance),
    )


def circuit_energy(
    profile: PlantProfile, supply: SupplyProfile, power: Float, step: float
) -> float:
    """Return the energy from the grid through a supply of the rig. [J]

    Args:
        power: Input of all drives, shape (N,). [W]
        step: That a sample stands for. [s]
    """
    circuit = Supply(replace(profile, supply=supply), RigConfig.hard(), step)
    return float(circuit.step(power).grid_power.sum()) * step


def true_saving(one: DriveWork, other: DriveWork, shift: int = 0) -> tuple[float, float]:
    """Return what one bus truly saves, and the energy with two supplies. [J]

    Args:
        shift: Samples by which the other starts later; its end comes first.
    """
    count = min(len(one.power), len(other.power))
    powers = one.power[:count], np.roll(other.power[:count], shift)
    apart = sum(
        circuit_energy(work.profile, work.profile.supply, power, work.interval)
        for work, power in zip((one, other), powers, strict=True)
    )
    common = common_supply(one.profile.supply, other.profile.supply)
    return apart - circuit_energy(one.profile, common, powers[0] + powers[1], one.interval), apart


def judged_pair(name: str, plant: int, one: DriveWork, other: DriveWork) -> JudgedBus:
    """Return what `robot-energy shared-bus` claims of two recordings, and the truth."""
    report = shared_bus_of([one.bag, other.bag], [one.model, other.model], same_start=True).report
    truth, apart = true_saving(one, other)
    return JudgedBus(name, plant, report.saved, report.half, truth, apart)


def judged_advice(plant: int, work: DriveWork) -> list[JudgedBus]:
    """Return what `robot-energy advise` claims of one recording, and the mean truth over starts."""
    sums = EvidenceSums(work.model)
    replay(work.bag, work.model, on_output=sums.take)
    claim = shared_bus(sums.evidence(), work.model)
    if claim is None:
        return []
    random = np.random.default_rng(np.random.SeedSequence(plant, spawn_key=(0x737461,)))
    shifts = random.integers(len(work.power), size=STARTS).tolist()
    saved = [true_saving(work, work, shift) for shift in shifts]
    truth, apart = (0.5 * float(np.mean(one)) for one in zip(*saved, strict=True))
    return [JudgedBus(ADVISED, plant, claim.energy, claim.half, truth, apart)]


def judged_plants(first: int) -> list[JudgedBus]:
    """Return all claims about a plant and that of the next seed, as many of each kind."""
    with TemporaryFolder() as scratch:
        plants = [works(scratch.path / str(seed), seed) for seed in (first, first + 1)]
        rows: list[JudgedBus] = []
        for seed, own in enumerate(plants, first):
            pairs = zip(own, own[1:] + own[:1], strict=True)
            rows += [judged_pair(ONE_MODEL, seed, *pair) for pair in pairs]
            rows += [row for work in own for row in judged_advice(seed, work)]
        one, other = plants
        others = zip(one + one, other + other[1:] + other[:1], strict=True)
        return rows + [judged_pair(TWO_MODELS, first, *pair) for pair in others]


def count(rows: Sequence[JudgedBus]) -> list[str]:
    """Return how often bands hold the truth, one line for each who claims."""
    lines: list[str] = []
    for name in dict.fromkeys(row.name for row in rows):
        own = [row for row in rows if row.name == name]
        claimed = [row for row in own if row.claimed]
        inside = sum(row.inside for row in own)
        some = [row for row in own if row.claim > 0.0]
        errors = np.median([abs(row.claim - row.truth) / row.claim for row in some])
        lines.append(
            f"{name}: {inside} of {len(own)} bands hold the truth "
            f"({100 * inside / len(own):.0f} %); {len(claimed)} claimed, "
            f"{sum(row.truth > 0 for row in claimed)} of these with the right sign; median error "
            f"{100 * errors:.0f} %, half width "
            f"{100 * np.median([row.half / row.claim for row in some]):.0f} % of the claim"
        )
    return lines


if __name__ == "__main__":
    parser = ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("first", type=int, help="seed of the first plant")
    parser.add_argument("plants", type=int, help="how many, by two")
    asked = parser.parse_args()
    with job_pool(StudyRun(Path(), 0, 2), asked.plants // 2) as run:
        jobs = [run(judged_plants, asked.first + place) for place in range(0, asked.plants, 2)]
        judged = [row for job in jobs for row in job.result()]
    print("\n".join(count(judged)))
