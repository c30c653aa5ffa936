"""How sure the tool says it is, and how often it was right: all on the virtual rig.

Intervals of identified figures, bands of predicted power and energy, what a monitor learns, wear,
temperatures without a sensor. Each is proven by repetition on plants drawn at random.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.files.temporary_folder import TemporaryFolder
from robot_energy.results.base import json_value
from robot_energy.timeline.blocks import Float, Learning
from robot_energy_papers.drawings import reliability
from robot_energy_papers.job_pool import StudyRun, job_pool
from robot_energy_papers.pages import Piece
from robot_energy_rig import load_profile, random_profile
from robot_energy_studies.band_coverage import (
    LABEL,
    SHORT_TRAINING,
    BandRuns,
    Covered,
    Recorded,
    band_coverage,
    summary,
)
from robot_energy_studies.interval_coverage import (
    GROUPS,
    IntervalCoverage,
    Judged,
    coverages,
    repetitions,
)
from robot_energy_studies.learning_study import (
    LearningRow,
    Shift,
    WearRow,
    detection,
    learning_study,
)
from robot_energy_studies.thermal_study import ROBOTS, HiddenPlant, hidden_sensors

WEAR, BEFORE, AFTER = 0.15, 8.0, 2.0  # of friction [-]; work before and after it [h]
FRESH = 600  # first plant of the bands; their constants were chosen and proven on others
NOMINAL = np.linspace(0.05, 0.99, 48)
"""Shares that intervals state. [-]"""


SHORT = BandRuns(
    SHORT_TRAINING,
    None,
    Recorded("metered", 30.0, 60.0, 0.5),
    (Recorded("cold", 28.0, 20.0, 0.2), Recorded("warm", 50.0, 20.0, 0.2)),
)


class CertaintyStudySize(Described):
    """How much is done."""

    robots: Annotated[tuple[str, ...], "Whose bodies plants have; each repetition has the next."]
    repetitions: int
    hard: int
    bands: Annotated[BandRuns | None, "Runs behind the bands; None for the full ones."]
    band_plants: int
    thermal: int
    wear: Annotated[int, "Axes of one plant that wear by 15 %, each in a run of its own."]
    learning_robots: Annotated[tuple[str, ...], "Plants with a mistaken model and a learner."]
    learning_minutes: Annotated[int, "How long each works. [min]"]


FULL = CertaintyStudySize(
    ("kr16", "irb4600", "ur5e"), 60, 30, None, 10, 6, 6, ("kr16", "irb4600"), 30
)
QUICK = CertaintyStudySize(("ur5e",), 1, 0, SHORT, 1, 0, 0, ("kr16",), 3)


@dataclass(frozen=True)
class LearningResult:
    """One plant at work, predicted with figures that are 30 % and 15 % too low."""

    robot: str
    with_torque: bool
    off: list[LearningRow]
    applied: list[LearningRow]


class Certainty(Described):
    """Everything the study found."""

    seed: int
    scale: CertaintyStudySize
    intervals: Annotated[list[list[Judged]], "Of each repetition, within the form of the model."]
    hard: Annotated[list[list[Judged]], "The same with every effect of the rig."]
    bands: list[Covered]
    thermal: list[HiddenPlant]
    wear: list[WearRow]
    learning: list[LearningResult]

    @property
    def coverages(self) -> list[IntervalCoverage]:
        """How often intervals held the truth, within the form of the model."""
        return coverages(self.intervals)

    @property
    def hard_coverages(self) -> list[IntervalCoverage]:
        """The same with every effect of the rig."""
        return coverages(self.hard)


def reliability_of(found: list[list[Judged]]) -> dict[str, tuple[Float, Float]]:
    """Return stated and observed shares of intervals that hold the truth, by group."""
    from scipy.stats import norm

    curves: dict[str, tuple[Float, Float]] = {}
    limits = np.asarray(norm.ppf(0.5 + 0.5 * NOMINAL))
    for group in GROUPS:
        errors = np.abs([e.deviations for part in found for e in part if e.group == group])
        known = errors[np.isfinite(errors)]
        if len(known):
            curves[group] = NOMINAL, (known[:, None] <= limits).mean(axis=0)
    return curves


def study(options: StudyRun, scale: CertaintyStudySize) -> Certainty:
    """Return what the whole study finds."""
    seed = options.seed
    first = 1000 * seed
    plants = [(robot, torque) for robot in scale.learning_robots for torque in (True, False)]
    single = scale.repetitions + scale.hard + scale.band_plants + scale.thermal + scale.wear
    with job_pool(options, single + len(plants)) as run:
        own, hard = (
            [run(repetitions, scale.robots, [first + k], kind) for k in range(number)]
            for number, kind in ((scale.repetitions, False), (scale.hard, True))
        )
        banded = [run(_bands_of, first + FRESH + k, scale.bands) for k in range(scale.band_plants)]
        hidden = [
            run(hidden_sensors, ROBOTS[k % len(ROBOTS)], first + k) for k in range(scale.thermal)
        ]
        worn = [run(_worn_axis, joint, first + 3) for joint in range(scale.wear)]
        learned = [
            run(_learning_result, robot, torque, scale.learning_minutes, seed)
            for robot, torque in plants
        ]
        return Certainty(
            seed,
            scale,
            [found for job in own for found in job.result()],
            [found for job in hard for found in job.result()],
            [found for job in banded for found in job.result()],
            [job.result() for job in hidden],
            [job.result() for job in worn],
            [job.result() for job in learned],
        )


def _bands_of(plant_seed: int, runs: BandRuns | None) -> list[Covered]:
    """Identify one plant with every effect of the rig, and see how its bands fare."""
    with TemporaryFolder() as place:
        return list(band_coverage(place.path, [plant_seed], runs))


def _worn_axis(joint: int, plant_seed: int) -> WearRow:
    """Let one axis of a drawn plant wear by 15 % after eight hours, and look for two more."""
    return detection(Shift(random_profile("kr16", plant_seed)), joint, WEAR, BEFORE, AFTER)


def _learning_result(robot: str, with_torque: bool, minutes: int, seed: int) -> LearningResult:
    """Let a monitor with a mistaken model watch one plant, without and with learning."""
    profile = load_profile(robot)
    off, applied = (
        learning_study(profile, way, with_torque, minutes, seed=seed)[0]
        for way in (Learning.OFF, Learning.APPLY)
    )
    return LearningResult(robot, with_torque, off, applied)


def figures(result: Certainty) -> dict[str, Any]:
    """Return every figure of the study, ready for JSON; shares are 0 to 1."""
    return {
        "label": LABEL,
        "seed": result.seed,
        "intervals": json_value(result.coverages),
        "intervals_hard": json_value(result.hard_coverages),
        "bands": summary(result.bands) if result.bands else {},
        "bands_by_run": json_value(result.bands),
        "thermal": json_value(result.thermal),
        "wear": json_value(result.wear),
        "learning": [
            {
                "robot": row.robot,
                "with_torque": row.with_torque,
                "error_without": [minute.error for minute in row.off],
                "error_with": [minute.error for minute in row.applied],
            }
            for row in result.learning
        ],
    }


def context(result: Certainty) -> dict[str, Any]:
    """Return what the expressions of the templates use."""
    return {
        "result": result,
        "data": figures(result),
        "quick": result.scale.repetitions < 50,
        "hidden": [
            {
                "name": row.name,
                "warm": float(np.nanmax(row.warm_rms)),
                "early": float(np.nanmax(row.early_rms)),
                "energy_change": row.energy_change,
                "fallback_change": row.fallback_change,
                "covered": row.covered,
            }
            for row in result.thermal
        ],
    }


def pieces(result: Certainty) -> dict[str, Piece]:
    """Return the figures of the page."""
    found: dict[str, Piece] = {}
    for name, figures_of in (("within", result.intervals), ("hard", result.hard)):
        if curves := reliability_of(figures_of):
            found[name] = partial(reliability, curves)
    return found
