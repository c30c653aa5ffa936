"""The study of paper A from end to end on the virtual rig."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from robot_energy.foundation.errors import RigError
from robot_energy.model import RobotModel, load
from robot_energy.timeline.blocks import Float
from robot_energy_papers.calibration import Calibration, calibrate
from robot_energy_papers.experiment import MOVES, MotionSet, Plan, by_motion, make_programs, soaked
from robot_energy_papers.held_out import SetRow, held_out, shaft_power
from robot_energy_papers.job_pool import Steps, StudyRun, job_pool
from robot_energy_papers.kr16_sensitivity import holding_table, rise_table
from robot_energy_papers.models import FOLLOWS, Identified, identify
from robot_energy_papers.sensitivity import SensitivityTable
from robot_energy_papers.soaked_rigs import (
    EffectRow,
    PlantRow,
    Rigs,
    configurations,
    effect_row,
    plant_row,
    rig_seeds,
)
from robot_energy_rig import RigConfig, load_profile
from robot_energy_rig.plant import PlantFriction
from robot_energy_rig.record import RigRecording

SHARE_BEFORE_FITS = 0.9  # of the work that the bar shows
AXIS = 0  # of fig. 5
REFERENCE_DEGC = 22.0  # of fig. 7a
POWER_DEGC = 60.0  # of fig. 4
ROUNDING = 0.5  # K, of the thermometers


@dataclass(frozen=True)
class PaperAStudySize:
    """How much of the experiment is done.

    Attributes:
        train: Experiment by motion for identification; None: soaked rigs.
        test: Experiment by motion that tests; None: soaked rigs.
        train_degc: Temperatures of soaked rigs for identification. [degC]
        test_degc: Temperatures of soaked rigs that test. [degC]
        effects: Effects of the table; None for all.
        rigs: Temperatures and length of the experiments behind that table and on those plants.
    """

    moves: int
    train: Plan | None
    test: Plan | None
    train_degc: tuple[float, ...]
    test_degc: tuple[float, ...]
    effects: tuple[str, ...] | None
    plants: int
    rigs: Rigs
    programs: int


# The halls are warm so that continuous motion takes the motors to about 80 degC, the
# upper end of the paper; conductances to the hall are assumed anyway. 22 degC is recorded
# because the paper normalises to it.
FULL = PaperAStudySize(
    moves=MOVES,
    train=Plan(125, (20.0, 22.0, *range(24, 94, 4)), ambient_degc=32.0),
    test=Plan(
        115, (20.0, 22.0, *range(24, 90, 4)), 14, tuple(range(70, 34, -6)), ambient_degc=30.0
    ),
    train_degc=(),
    test_degc=(),
    effects=None,
    plants=12,
    rigs=Rigs((20.0, 35.0, 50.0, 65.0, 80.0), (20.0, 40.0, 60.0, 80.0), MOVES),
    programs=6,
)
QUICK = PaperAStudySize(
    moves=14,
    train=None,
    test=None,
    train_degc=(20.0, 40.0, 60.0, 80.0),
    test_degc=(22.0, 40.0, 60.0, 78.0),
    effects=("copper", "capacitor"),
    plants=1,
    rigs=Rigs((20.0, 50.0, 80.0), (22.0, 78.0), 14, 100.0),
    programs=1,
)


@dataclass(frozen=True)
class ShaftCurve:
    """Shaft power of one axis in one set.

    Attributes:
        robot_degc: Mean over the motors. [degC]
        motor_degc: Temperature of this axis. [degC]
        time: Since the start of the set, shape (N,). [s]
        power: Measured torque times speed, shape (N,). [W]
    """

    robot_degc: float
    motor_degc: float
    time: Float = field(repr=False)
    power: Float = field(repr=False)

    @property
    def mean_power(self) -> float:
        """Mean over the set. [W]"""
        return float(np.trapezoid(self.power, self.time) / (self.time[-1] - self.time[0]))


@dataclass(frozen=True)
class PaperA:
    """Everything the study found; all of it from the virtual rig.

    Attributes:
        rows: Held-out sets with every model, in the order of ``test``.
        truth: Of every set for identification mean motor temperatures [degC], and the true viscous
            friction at the gear temperature with the eddy drag of the motor [N m s/rad], shape (n,)
            each.
        open: What the HOLD power over poses and the rise of temperature owe to figures that are
            not published, by quantity.
    """

    seed: int
    scale: PaperAStudySize
    train: list[MotionSet]
    test: list[MotionSet]
    rest: RigRecording
    identified: Identified
    rows: list[SetRow]
    shaft: list[ShaftCurve]
    truth: list[tuple[Float, Float]]
    effects: list[EffectRow]
    plants: list[PlantRow]
    calibration: Calibration
    open: dict[str, SensitivityTable]

    @property
    def quick(self) -> bool:
        """Whether this is the short form."""
        return self.scale.train is None

    @property
    def model(self) -> RobotModel:
        """The identified model of the paper."""
        return self.identified.models[FOLLOWS]

    @property
    def warming(self) -> list[SetRow]:
        """Held-out sets that were not recorded while cooling, coldest first."""
        rows = [row for row in self.rows if row.way != "cooling"]
        return sorted(rows, key=lambda row: row.robot_degc)

    @property
    def friction_errors(self) -> list[tuple[Float, Float]]:
        """Errors of the identified viscous friction in every set for identification.

        Motor temperatures [degC], and identified over true friction minus 1 [-], shape (n,) each.
        """
        return [(degc, self.identified.viscous(degc) / true - 1.0) for degc, true in self.truth]

    @property
    def viscous_fall(self) -> Float:
        """Identified viscous friction in the coldest set over that in the hottest, shape (n,)."""
        cold, hot = (self.truth[index][0] for index in (0, -1))
        return self.identified.viscous(cold) / self.identified.viscous(hot)

    @property
    def coulomb_drift(self) -> Float:
        """Coulomb friction of the hottest set over that of the coldest minus 1, shape (n,)."""
        sets = self.identified.sets
        return sets[-1].coulomb / sets[0].coulomb - 1.0

    @property
    def beyond_range(self) -> tuple[int, float]:
        """Number of held-out sets with a motor outside its fitted range, and by how much. [K]"""
        low = np.array([fit.range_degc[0] for fit in self.identified.fits])
        high = np.array([fit.range_degc[1] for fit in self.identified.fits])
        degc = [entry.recording.motor_temperature_degc for entry in self.test]
        away = [float(np.maximum(low - found, found - high).max()) for found in degc]
        outside = [kelvin for kelvin in away if kelvin > ROUNDING]
        return len(outside), max(outside, default=0.0)

    def nearest(self, degc: float) -> int:
        """Return the index of the held-out set of warming up nearest to a robot temperature.

        Args:
            degc: Robot temperature. [degC]
        """
        usable = [index for index, row in enumerate(self.rows) if row.way != "cooling"]
        return min(usable, key=lambda index: abs(self.rows[index].robot_degc - degc))


def study(options: StudyRun, scale: PaperAStudySize) -> PaperA:
    """Return what the whole study finds."""
    seed = options.seed
    profile, rigs = load_profile("kr16"), configurations(scale.effects)
    steps = Steps(len(rigs) + scale.plants + 5, options.progress, SHARE_BEFORE_FITS)
    with job_pool(options.workers, steps.done) as run:
        training, testing = (
            run(record, options.folder, seed, scale) for record in (_record_training, record_test)
        )
        effects = [run(effect_row, name, rig, scale.rigs, seed) for name, rig in rigs.items()]
        calibration = run(calibrate, profile, seed, scale.programs, scale.moves)
        plants = [run(plant_row, 1 + number, scale.rigs, seed) for number in range(scale.plants)]
        hold, rise = run(holding_table, seed), run(rise_table, seed, scale.train is None)
        train, rest = training.result()
        test = testing.result()
        identified = identify(
            [entry.path for entry in train], rest.path, load(profile.body), profile.supply
        )
        rows = held_out(test, identified.models, FOLLOWS)
        found = PaperA(
            seed,
            scale,
            train,
            test,
            rest,
            identified,
            rows,
            _shaft_curves(test, rows, identified),
            [_true_friction(entry) for entry in train],
            [job.result() for job in effects],
            [job.result() for job in plants],
            calibration.result(),
            hold.result() | rise.result(),
        )
    if options.progress is not None:
        options.progress(1.0)
    return found


def _record_training(
    folder: Path, seed: int, scale: PaperAStudySize
) -> tuple[list[MotionSet], RigRecording]:
    profile = load_profile("kr16")
    programs, rig = make_programs(profile, seed, scale.moves), rig_seeds(seed)[0]
    if scale.train is None:
        rate = scale.rigs.rate
        sets = soaked(profile, programs.train, scale.train_degc, folder, "train", rig, rate=rate)
        rest = soaked(
            profile, programs.hold, scale.train_degc[:1], folder, "train_rest", rig, rate=rate
        )
        return sets, rest[0].recording
    sets, rest = by_motion(
        profile, programs.train, programs.train_warm_up, scale.train, folder, "train", rig,
        programs.hold,
    )  # fmt: skip
    if rest is None:
        raise RigError("the experiment recorded no rest", "a program that holds")
    return sets, rest


def record_test(folder: Path, seed: int, scale: PaperAStudySize) -> list[MotionSet]:
    """Return the recorded sets that no fit sees."""
    profile = load_profile("kr16")
    programs, rig = make_programs(profile, seed, scale.moves), rig_seeds(seed)[1]
    if scale.test is None:
        return soaked(
            profile, programs.test, scale.test_degc, folder, "test", rig, rate=scale.rigs.rate
        )
    sets, _ = by_motion(
        profile, programs.test, programs.test_warm_up, scale.test, folder, "test", rig
    )
    return sets


def _shaft_curves(
    test: list[MotionSet], rows: list[SetRow], identified: Identified
) -> list[ShaftCurve]:
    """Coldest, middle and hottest set of warming up."""
    heating = [index for index, row in enumerate(rows) if row.way != "cooling"]
    order = sorted(heating, key=lambda index: rows[index].robot_degc)
    middle = 0.5 * (rows[order[0]].robot_degc + rows[order[-1]].robot_degc)
    between = min(order, key=lambda index: abs(rows[index].robot_degc - middle))
    found: list[ShaftCurve] = []
    for index in dict.fromkeys((order[0], between, order[-1])):
        recording = test[index].recording
        time, power = shaft_power(recording.path, identified.models[FOLLOWS], AXIS)
        motor = float(recording.motor_temperature_degc[:, AXIS].mean())
        found.append(ShaftCurve(rows[index].robot_degc, motor, time, power))
    return found


def _true_friction(entry: MotionSet) -> tuple[Float, Float]:
    profile = load_profile("kr16")
    gear = entry.recording.gear_temperature_degc.mean(axis=0)
    viscous = PlantFriction(profile, RigConfig(), 1.0).viscous(gear) + profile.eddy_viscous
    return entry.recording.motor_temperature_degc.mean(axis=0), viscous
