"""Do bands hold? Shares of measured powers and energies within the 90 % bands of predictions.

Plants of the virtual rig, drawn at random and with effects that no model has a term for, are
identified from three recordings and a warm-up, run for ten minutes with a meter, and then make runs
that neither has seen: other motions, started cold, warm, hot, and colder and hotter than the
recordings of the identification; with long waits; as cold as the air; and with gears warmer than
their motors. Every plant has motions of its own: one program for all of them
would make their errors alike. The band of an energy is the one before its run: the meter of the run
itself does not count. Simulated throughout: nothing was measured on a robot.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import field, replace
from pathlib import Path
from statistics import median
from typing import Annotated

import numpy as np

from robot_energy.accounting.averaging import MeanBlock
from robot_energy.accounting.record import Calibrated
from robot_energy.certainty.band_calibration import BandCalibration
from robot_energy.certainty.deviation import TEMPERATURE, Z90, power_std
from robot_energy.foundation.described import Described
from robot_energy.model import RobotModel
from robot_energy.pipeline import Output, Settings
from robot_energy.replay.bag_replay import Replay, replay
from robot_energy.replay.setup import ReplaySetup
from robot_energy.timeline.blocks import Float, Int
from robot_energy_identify.api.identify import identify_all, identify_friction
from robot_energy_papers.experiment import MIN_HEIGHT, TOOL
from robot_energy_plan.motion import random_program, tool_above
from robot_energy_rig import PlantProfile, RigConfig, VirtualRig, load_profile, random_profile
from robot_energy_rig.record import record

BODY = "kr16"
AMBIENT = 22.0  # degC
LABEL = "virtual rig, plants drawn at random; nothing here was measured on a robot"
SEEDS = 100  # of motions, for each plant
MEAN = 1.0  # of the powers without a meter that are compared [s]


class Recorded(Described):
    """What the rig does in one recording."""

    name: str
    degc: Annotated[float, "Temperature of motors and gears at the start. [degC]"]
    duration: Annotated[float, "[s]"]
    dwell: Annotated[float, "Rest after every motion. [s]"]
    speedup: Annotated[float, "Factor on how fast temperatures change. [-]"] = 1.0
    gear_degc: Annotated[float | None, "Of the gears at the start; None: of motors. [degC]"] = None
    rate: Annotated[float, "Of the joint states. [Hz]"] = 250.0


TRAINING = (
    Recorded("train_25", 25.0, 60.0, 0.5),
    Recorded("train_40", 40.0, 60.0, 0.2),
    Recorded("train_60", 60.0, 60.0, 0.5),
)
WARM_UP = Recorded("warm_up", AMBIENT, 3600.0, 2.0, rate=50.0)
SHORT_TRAINING = (
    Recorded("train_25", 25.0, 30.0, 0.5, rate=100.0),
    Recorded("train_55", 55.0, 30.0, 0.5, rate=100.0),
)
RUNS = (
    Recorded("cold", 28.0, 60.0, 0.2),
    Recorded("warm", 45.0, 60.0, 0.5),
    Recorded("hot", 60.0, 60.0, 0.2),
    Recorded("colder than identified", 10.0, 60.0, 0.3),
    Recorded("hotter than identified", 75.0, 60.0, 0.2),
    Recorded("waiting", 40.0, 60.0, 4.0),
    Recorded("cold start", AMBIENT, 120.0, 0.3),
    Recorded("gears 8 K above motors", 38.0, 60.0, 0.3, gear_degc=46.0),
)


class BandRuns(Described):
    """What the rig does for the bands."""

    training: tuple[Recorded, ...] = TRAINING
    warm_up: Annotated[Recorded | None, "For gears; None: friction follows motors."] = WARM_UP
    metered: Annotated[Recorded, "With a meter, which calibrates the bands."] = Recorded(
        "ten_minutes", 30.0, 600.0, 0.5
    )
    held_out: tuple[Recorded, ...] = RUNS


class Covered(Described):
    """One run, with and without the ten minutes at the meter."""

    plant: str
    run: str
    error: Annotated[float, "Predicted over measured energy, less 1. [-]"]
    half: Annotated[float, "Half of the band after ten minutes with a meter, over the energy. [-]"]
    half_known: Annotated[float, "The same at known temperatures. [-]"]
    half_alone: Annotated[float, "The same without a meter. [-]"]
    counts: Annotated[
        Int, "Readings of 0.1 s by phase: all, and those within the band, shape (P, 2)."
    ]
    half_power: Annotated[float, "Median half width of that band over the mean power. [-]"]
    means: int
    inside_alone: Annotated[int, "Of them, within the band of power without a meter."]
    half_power_alone: Annotated[float, "Median half width of that band over the mean power. [-]"]
    scores_power: Annotated[
        Float, "Errors over the deviation of the band, shape (readings,). [-]"
    ] = field(repr=False)
    scores_power_alone: Annotated[
        Float, "The same of the means without a meter, shape (means,). [-]"
    ] = field(repr=False)

    @property
    def readings(self) -> int:
        """Of the meter."""
        return int(self.counts[:, 0].sum())

    @property
    def inside(self) -> int:
        """Of them, within the band of power."""
        return int(self.counts[:, 1].sum())


def band_coverage(
    folder: Path,
    plants: Sequence[int | None],
    runs: BandRuns | None = None,
    *,
    hard: bool = True,
    bare: bool = False,
) -> Iterator[Covered]:
    """Yield how the bands of each run fared.

    Args:
        plants: Seeds of drawn plants; None: the standard plant of the KR 16 class.
        hard: Whether the rig has effects that no model has a term for.
    """
    runs = runs or BandRuns()
    for plant in plants:
        name = "standard" if plant is None else f"plant {plant}"
        profile = load_profile(BODY) if plant is None else random_profile(BODY, plant)
        rig = DrawnRig(profile, RigConfig.hard() if hard else RigConfig(), folder / name)
        model = rig.identified(runs.training, None if bare else runs.warm_up)
        if bare:
            model = model.changed(hold=None)
        own = 0 if plant is None else SEEDS * plant
        first = replay(rig.record(runs.metered, own + 10), model)
        kept = first.account.calibration.state()
        for seed, one in enumerate(runs.held_out, own + 20):
            yield _covered(name, one.name, rig.record(one, seed), model, kept)


class DrawnRig:
    """Records one plant, and identifies it."""

    def __init__(self, profile: PlantProfile, config: RigConfig, folder: Path) -> None:
        self._profile, self._config, self._folder = profile, config, folder
        robot, _ = profile.mechanics()
        self._limits = profile.motion_limits(robot)
        self._above = tool_above(robot, TOOL, MIN_HEIGHT)

    def record(self, what: Recorded, seed: int) -> Path:
        """Return the bag of one recording."""
        program = random_program(self._limits, seed, dwell=what.dwell, accept=self._above)
        config = replace(self._config, thermal_speedup=what.speedup)
        rig = VirtualRig(
            self._profile, program, config, seed, what.degc, AMBIENT, rate_hz=what.rate,
            start_gear_degc=what.gear_degc,
        )  # fmt: skip
        return record(rig, what.duration, self._folder / what.name.replace(" ", "_")).path

    def identified(
        self, training: Sequence[Recorded], warm_up: Recorded | None = None
    ) -> RobotModel:
        """Return the model that is identified from recordings.

        Args:
            warm_up: The same for the gears, which friction then follows; None for no gears.
        """
        bags = [self.record(one, seed) for seed, one in enumerate(training, 1)]
        model = identify_all(bags, BODY, "motor_torque", held_out=False).model
        if warm_up is None:
            return model
        bags.append(self.record(warm_up, len(bags) + 1))
        return identify_friction(bags, model, "motor_torque").model


def _covered(plant: str, run: str, bag: Path, model: RobotModel, kept: Calibrated) -> Covered:
    after, after_means = _replayed(bag, model, 0.1, kept)
    alone, means = _replayed(bag, model, MEAN, None)
    comparison, calibration = after.account.comparison, after.account.calibration
    registers, before = after.account.registers, BandCalibration()
    before.restore(kept)
    band = before.energy_band(registers.deviation)
    at_known = registers.deviation.copy()
    at_known[TEMPERATURE] = 0.0
    measured = comparison.measured_energy
    known = np.isfinite(means.measured_power)
    half = Z90 * power_std(means.deviation[known])
    off = (means.predicted_power_at_meter - means.measured_power)[known]
    known = np.isfinite(after_means.measured_power) & (after_means.band_half > 0)
    errors = after_means.predicted_power_at_meter - after_means.measured_power
    scores = Z90 * errors[known] / after_means.band_half[known]
    power = measured / comparison.compared_ns * 1e9
    return Covered(
        plant,
        run,
        comparison.predicted_energy / measured - 1.0,
        band.half / measured,
        before.energy_band(at_known).half / measured,
        Z90 * alone.account.energy_band.std / measured,
        calibration.counts[:, :2],
        float(np.nanmedian(after_means.band_half)) / power,
        len(off),
        int((np.abs(off) <= half).sum()),
        float(np.median(half)) / power,
        scores,
        Z90 * off / half,
    )


def _replayed(
    bag: Path, model: RobotModel, period: float, kept: Calibrated | None
) -> tuple[Replay, MeanBlock]:
    blocks: list[MeanBlock] = []

    def take(output: Output) -> None:
        if output.means is not None:
            blocks.append(output.means)

    setup = ReplaySetup(settings=Settings(power_period=period), calibration=kept)
    result = replay(bag, model, setup, on_output=take)
    return result, MeanBlock.concatenate(blocks)


def summary(rows: Sequence[Covered]) -> dict[str, float]:
    """Return shares within the bands, and median half widths, over all runs, by name. [-]"""
    count = len(rows)
    return {
        "power, with meter": sum(one.inside for one in rows) / sum(one.readings for one in rows),
        "energy, with meter": sum(abs(one.error) <= one.half for one in rows) / count,
        "power, without": sum(one.inside_alone for one in rows) / sum(one.means for one in rows),
        "energy, without": sum(abs(one.error) <= one.half_alone for one in rows) / count,
        "median half width, power, with meter": median(one.half_power for one in rows),
        "median half width, energy, with meter": median(one.half for one in rows),
        "median half width, power, without": median(one.half_power_alone for one in rows),
        "median half width, energy, without": median(one.half_alone for one in rows),
    }
