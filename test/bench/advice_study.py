"""Advice against the virtual rig: each plant is recorded, the advice applied, and counted.

Plants are drawn at random, have every effect of the rig, and are identified elsewhere.
A plant then runs from cold with waits and a long rest, sped up in heating. From that recording
alone the tool advises; the rig applies the advice: it starts at the warm temperature, holds at the
place advised, rests in a state whose power is drawn from its stated deviation, and a supply whose
efficiency is drawn likewise returns what went into its own resistor. Simulated throughout.

    python test/bench/advice_study.py FIRST PLANTS
"""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.files.temporary_folder import TemporaryFolder
from robot_energy.replay.bag_replay import replay
from robot_energy.timeline.blocks import Float
from robot_energy_fleet.advice.claims import (
    REGENERATION,
    Claim,
    regenerative,
    standby,
    waiting_pose,
    warm_up,
)
from robot_energy_fleet.advice.evidence import EvidenceSums
from robot_energy_papers.experiment import MIN_HEIGHT, TOOL
from robot_energy_plan.motion import Program, random_program, tool_above
from robot_energy_plan.optimization.rest_states import ASSUMED, rest_cost
from robot_energy_rig import RigConfig, VirtualRig, random_profile
from robot_energy_rig.record import record
from robot_energy_studies.band_coverage import AMBIENT, BODY, TRAINING, DrawnRig, Recorded
from robot_energy_studies.savings_study import JudgedClaim

COLD = 24.0  # degC
SPEEDUP = 120.0  # of warming
LONG = 75.0  # s of rest in each period
MOVES = 6
PERIODS = 2
NEAR = 0.02  # rad or m


@dataclass(frozen=True)
class JudgedAdvice(JudgedClaim):
    """One advice for one plant.

    Attributes:
        metered: Whether the recording had a power meter.
        claim: Saving in the recording. [J]
        half: Half width of its 90 % band. [J]
        truth: Saving on the rig. [J]
        energy: Of the recording, on the rig. [J]
    """

    plant: int
    name: str
    metered: bool
    claim: float
    half: float
    truth: float
    energy: float

    @property
    def right_sign(self) -> bool:
        """Whether it saves on the rig what it is claimed to save."""
        return self.claim * self.truth > 0


class AdvisedPlant:
    """One plant: its recording, and what it needs with an advice applied."""

    def __init__(self, folder: Path, seed: int) -> None:
        self._profile = random_profile(BODY, seed)
        robot, _ = self._profile.mechanics()
        limits = self._profile.motion_limits(robot)
        random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0x616476,)))
        drawn = random_program(
            limits, int(random.integers(1 << 30)), MOVES, accept=tool_above(robot, TOOL, MIN_HEIGHT)
        )
        dwell = random.uniform(4.0, 9.0, len(drawn.via))
        dwell[0] = LONG
        self.program = Program(drawn.via, limits, dwell, float(random.uniform(0.5, 1.0)))
        self._seed, self._folder = seed, folder
        self._random = random
        self.length = PERIODS * self.program.period

    def _rig(self, degc: float | Float, warming: bool) -> VirtualRig:
        config = replace(RigConfig.hard(), thermal_speedup=SPEEDUP)
        config = config if warming else config.without("warming")
        return VirtualRig(self._profile, self.program, config, self._seed, degc, AMBIENT)

    def recorded(self) -> Path:
        """Return the recording."""
        return record(self._rig(COLD, True), self.length, self._folder / "work").path

    def judge(self, claims: Sequence[tuple[Claim | None, bool]]) -> list[JudgedAdvice]:
        """Return what each advice saves on the rig."""
        rig = self._rig(COLD, True)
        count = round(self.length / rig.period)
        truth = rig.step(count).truth
        energy = float(truth.grid_power.sum()) * rig.period
        still = np.asarray((np.abs(truth.motor_velocity) < 1e-6).all(axis=1))
        edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]))).reshape(-1, 2)
        rests = [(slice(a, b), (b - a) * rig.period) for a, b in edges.tolist() if b - a > 250]
        shares = self._random.standard_normal((len(ASSUMED), 2))
        returned = REGENERATION[0] + REGENERATION[1] * self._random.standard_normal()
        found: list[JudgedAdvice] = []
        for claim, metered in claims:
            if claim is None:
                continue
            if claim.name == "regenerative":
                saved = returned * float(truth.brake_power.sum()) * rig.period
            elif claim.motor_temperature_degc is not None:
                warm = self._rig(claim.motor_temperature_degc, False).step(count).truth
                saved = energy - float(warm.grid_power.sum()) * rig.period
            elif claim.joint_position is not None and claim.places is not None:
                short = [
                    (rows, time)
                    for rows, time in rests
                    if time < 60.0 and _near(claim.places, truth.joint_position[rows]).any()
                ]
                watts = np.array([truth.grid_power[rows].mean() for rows, _ in short])
                there = np.array(
                    [_near(claim.joint_position, truth.joint_position[rows]) for rows, _ in short]
                )
                times = np.array([time for _, time in short])
                saved = float((times * (watts - watts[there].mean())).sum())
            elif claim.state is not None:
                number = [one.name for one in ASSUMED].index(claim.state.name)
                state = claim.state
                real = state.model_copy(
                    update={
                        "power": state.power + state.power_std * shares[number, 0],
                        "wake_power": state.wake_power + state.wake_power_std * shares[number, 1],
                    }
                )
                saved = 0.0
                for rows, time in rests:
                    cost = rest_cost(real, time)
                    if time < 60.0 or cost is None:
                        continue
                    fixed = truth.loss_dc[rows] + truth.loss_grid[rows]
                    saved += float(truth.grid_power[rows].mean()) * time
                    saved -= float(fixed.mean()) * cost.held
            else:
                continue
            found.append(
                JudgedAdvice(
                    self._seed, claim.name, metered, claim.energy, claim.half, saved, energy
                )
            )
        return found


def _judge_advice(folder: Path, seed: int, training: Sequence[Recorded]) -> list[JudgedAdvice]:
    """What was advised on one plant, and what it saves on the rig."""
    drawn = DrawnRig(random_profile(BODY, seed), RigConfig.hard(), folder / "training")
    model = drawn.identified(training)
    plant = AdvisedPlant(folder, seed)
    sums = EvidenceSums(model)
    replay(plant.recorded(), model, on_output=sums.take, on_compared=sums.compare)
    evidence = sums.evidence(metered=True)
    evidence.measured_temperature = True
    nothing = {"compared_time": 0.0, "measured": 0.0, "predicted": 0.0}
    rests = [replace(rest, **nothing) for rest in evidence.rests]
    alone = replace(evidence, rests=rests, metered=False)
    metered = (
        standby(evidence, model, ASSUMED, True),
        regenerative(evidence, model),
        warm_up(evidence, model),
        waiting_pose(evidence, model),
    )
    without = standby(alone, model, ASSUMED, True), waiting_pose(alone, model)
    return plant.judge([*((one, True) for one in metered), *((one, False) for one in without)])


def _near(places: Float, rest: Float) -> NDArray[np.bool_]:
    """Whether a rest is at these places."""
    return np.asarray(np.abs(places - rest.mean(axis=0)).max(axis=-1) < NEAR)


def count(rows: Sequence[JudgedAdvice]) -> list[str]:
    """Return how often claims and bands were right, one line for each kind of advice."""
    lines: list[str] = []
    for name, metered in sorted({(row.name, row.metered) for row in rows}):
        own = [row for row in rows if (row.name, row.metered) == (name, metered)]
        claimed = [row for row in own if row.claimed]
        lines.append(
            f"{name}, {'with' if metered else 'without'} a meter: {len(claimed)} of {len(own)} "
            f"claimed, {sum(row.right_sign for row in claimed)} of these with the right sign; "
            f"{sum(row.inside for row in own)} of {len(own)} bands hold the truth"
        )
    return lines


if __name__ == "__main__":
    parser = ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("first", type=int, help="seed of the first plant")
    parser.add_argument("plants", type=int, help="how many")
    asked = parser.parse_args()
    judged: list[JudgedAdvice] = []
    for plant in range(asked.first, asked.first + asked.plants):
        with TemporaryFolder() as scratch:
            judged += _judge_advice(scratch.path, plant, TRAINING)
    print("\n".join(count(judged)))
