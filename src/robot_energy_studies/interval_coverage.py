"""How often the intervals of identified figures hold the truth, over repetitions on the rig.

Every repetition draws a plant, its sensors with their constant errors, and a motion; records it
at several temperatures; identifies everything, beginning with a model whose bodies, friction and
losses are those of the shipped model and wrong; and compares each figure with the plant. A 95 %
interval is the figure +- 1.96 of its standard deviation, as the model file says it. Within the
form of the model a plant has no effect without a term in the model file; a hard plant has all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np

from robot_energy.certainty.deviation import Z95
from robot_energy.foundation.described import Described
from robot_energy.messages.fields import DRIVE_POWER_TOPIC
from robot_energy.model import RobotModel, load
from robot_energy.model.figure import Figure
from robot_energy.physics.friction import viscous_law
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_identify.data.bags import Bag, Kept
from robot_energy_identify.drives.drive_power import DrivePowerTopics
from robot_energy_identify.dynamics.dynamics import Dynamics, DynamicsReport
from robot_energy_identify.dynamics.dynamics_model import with_link_parameters
from robot_energy_identify.run_all import FullIdentification, identify_everything
from robot_energy_identify.stats.systematic import ROOT3, SensorLimits
from robot_energy_papers.models import with_values
from robot_energy_plan.motion import Program, random_program, tool_above
from robot_energy_rig import PlantProfile, RigConfig, Sensors, VirtualRig, random_profile
from robot_energy_rig.record import record

BEYOND_MODEL = ("stribeck", "load_friction", "demagnetisation", "rectifier", "inverter", "warming")
"""Effects of the rig that the model file has no term for; off within its form."""
SENSORS = Sensors(meter_class=0.01, torque_constant_error=0.02, temperature_offset=1.0)
LIMITS = SensorLimits(meter=0.01, torque=0.02 * ROOT3, thermometer=ROOT3, drive_power=0.01)
"""What the data sheets of `SENSORS` say: thermometers and torque constants have normal errors."""
DEGC = (25.0, 40.0, 55.0, 70.0)  # of one recording each
SECONDS, RATE = 30.0, 250.0  # s of each recording; Hz of its joint states
MOVES, REST_EVERY, REST, DWELL = 20, 5, 1.5, 0.1  # motions of a program; s of rest
MIN_HEIGHT = 0.2  # m of the tool above the floor
WRONG_BODIES, WRONG_ROTORS = 0.08, 0.15  # standard deviations of the given figures' errors
GROUPS = ("bodies", "Coulomb", "viscous", "copper", "constants", "DC link")


class Judged(Described):
    """One identified figure and what is true."""

    group: str
    name: str
    truth: Annotated[float, "Of the plant, in the unit of the figure. [-]"]
    value: Annotated[float, "As identified. [-]"]
    std: Annotated[float, "As identified; NaN where none is given. [-]"]

    @property
    def deviations(self) -> float:
        """Error in standard deviations. [-]"""
        return (self.value - self.truth) / self.std if self.std > 0.0 else float("nan")

    @property
    def held(self) -> bool:
        """Whether the 95 % interval holds the truth."""
        return abs(self.deviations) <= Z95


class IntervalCoverage(Described):
    """How often the intervals of one group hold the truth."""

    group: str
    figures: int
    repetitions: int
    share: Annotated[float, "Of the intervals that hold the truth. [-]"]
    half_width: Annotated[float, "Median of half the interval over the truth. [-]"]
    deviations: Annotated[float, "RMS of the error in standard deviations; 1: as stated. [-]"]


class DrawnPlant(Described):
    """A plant drawn at random, recorded, identified and compared with the truth."""

    profile: PlantProfile
    config: RigConfig
    seed: Annotated[int, "Of motions, noise, constant errors and errors of the first model."]

    @classmethod
    def of(cls, robot: str, seed: int, hard: bool) -> DrawnPlant:
        """Return a plant drawn at random with the effects of the rig.

        Args:
            hard: With all effects; else with those alone that the model file has terms for. The
                chopper then has no hysteresis.
        """
        profile = random_profile(robot, seed)
        if hard:
            return cls(profile, replace(RigConfig.hard(), sensors=SENSORS), seed)
        supply = profile.supply
        middle = 0.5 * (supply.chopper_on_voltage + supply.chopper_off_voltage)
        supply = replace(
            supply, chopper_on_voltage=middle + 0.01, chopper_off_voltage=middle - 0.01
        )
        config = RigConfig(sensors=SENSORS).without(*BEYOND_MODEL).having("temperature_error")
        return cls(replace(profile, supply=supply), config, seed)

    def given_model(self) -> RobotModel:
        """Return its model, with bodies and rotors that are off as those of a data sheet are."""
        model = load(self.profile.body)
        random = np.random.default_rng([self.seed, 1])
        links = Robot.from_model(model).link_parameters.reshape(-1, 10)
        wrong = links * np.exp(WRONG_BODIES * random.standard_normal((len(links), 1)))
        factors = np.exp(WRONG_ROTORS * random.standard_normal(len(model.joints)))
        joints = [
            with_values(joint, rotor_inertia=joint.rotor_inertia.value * float(factor))
            for joint, factor in zip(model.joints, factors, strict=True)
        ]
        xml = with_link_parameters(model.urdf_xml, model.joint_names, wrong.ravel())
        return model.changed(joints=joints).with_urdf(xml, model.source)

    def recorded(self, folder: Path, drive_power: bool = False) -> list[Bag]:
        """Return a bag per temperature: other motions and noise, the same sensors.

        Args:
            drive_power: Whether the power of each drive is measured.
        """
        bags: list[Bag] = []
        for number, degc in enumerate(DEGC):
            own = len(DEGC) * self.seed + number
            program = program_of(self.profile, own)
            rig = VirtualRig(
                self.profile,
                program,
                self.config,
                own,
                degc,
                degc,
                rate_hz=RATE,
                device_seed=self.seed,
            )
            path = record(rig, SECONDS, folder / f"{degc:.0f}degc", drive_power=drive_power).path
            powers = None
            if drive_power:
                powers = DrivePowerTopics((DRIVE_POWER_TOPIC,)).read(path, rig.joint_names)
            bag = Bag(path, EffortMeaning.MOTOR_TORQUE, drive_power=powers, sensors=LIMITS)
            bags.append(replace(bag, kept=Kept(bag.whole(self.given_model()))))
        return bags

    def judged(self, result: FullIdentification) -> list[Judged]:
        """Return every identified figure that has a group here, compared with the plant."""
        model, profile = result.model, self.profile
        found = result.step("dynamics").found
        figures: list[Judged] = []
        if isinstance(found, DynamicsReport):
            figures += _bodies(found.result, profile)
        figures += _friction(model, profile, self.config)
        for joint, resistance, constant in zip(
            model.joints, profile.resistance, profile.torque_constant, strict=True
        ):
            if joint.losses is not None:
                truth = 3.0 * float(resistance) / float(constant) ** 2
                figures += _of("copper", joint.name, joint.losses.copper, truth)
        supply, cabinet = profile.supply, model.cabinet
        for name in ("loss_dc", "loss_grid"):
            figures += _of("constants", name, getattr(cabinet, name), getattr(supply, name))
        link = cabinet.capacitor
        if link is not None:
            middle = 0.5 * (supply.chopper_on_voltage + supply.chopper_off_voltage)
            half = 0.5 * (link.chopper_voltage.value**2 - link.nominal_voltage.value**2)
            truth = 0.5 * supply.capacitance * (middle**2 - supply.rectified_voltage**2)
            figures += _of("DC link", "energy", link.capacitance, truth / half)
        return figures

    def identified(self, bags: Sequence[Bag]) -> list[Judged]:
        """Return what an identification from some of its bags finds, compared with the truth."""
        return self.judged(identify_everything(bags, self.given_model(), strict=False))

    def repetition(self, folder: Path) -> list[Judged]:
        """Return every identified figure, compared with the truth.

        In every second repetition the power of each drive is measured as well.
        """
        return self.identified(self.recorded(folder, drive_power=bool(self.seed % 2)))


def program_of(profile: PlantProfile, seed: int) -> Program:
    """Return a motion of a plant: point to point, with rests."""
    robot, _ = profile.mechanics()
    limits = profile.motion_limits(robot)
    above = tool_above(robot, "tool0", MIN_HEIGHT) if robot.has_link("tool0") else None
    program = random_program(limits, seed, MOVES, accept=above)
    dwell = [DWELL if k % REST_EVERY else REST for k in range(len(program.via))]
    return Program(program.via, limits, dwell)


def _of(group: str, name: str, figure: Figure, truth: float) -> list[Judged]:
    if figure.tag != "identified":
        return []
    std = float("nan") if figure.std is None else figure.std
    return [Judged(group, name, truth, figure.value, std)]


def _bodies(result: Dynamics, profile: PlantProfile) -> list[Judged]:
    """Groups of parameters that bodies and rotors alone make up."""
    model = load(profile.body)
    names, base = result.base.names, result.base
    truth = np.full(len(names), np.nan)
    links = Robot.from_model(model).link_parameters.ravel()
    truth[: len(links)] = links
    for joint in model.joints:
        rotor = joint.rotor_inertia.value * joint.gear_ratio.value**2
        truth[names.index(f"rotor_inertia {joint.name}")] = rotor
    figures: list[Judged] = []
    for row, weights in enumerate(base.matrix):
        own = np.abs(weights) > 0.0
        if np.isfinite(truth[own]).all():
            exact = float(weights[own] @ truth[own])
            value, std = float(result.fit.values[row]), float(result.fit.std[row])
            figures.append(Judged("bodies", base.labels[row], exact, value, std))
    return figures


def _friction(model: RobotModel, profile: PlantProfile, config: RigConfig) -> list[Judged]:
    """Coulomb, and the viscous law at the temperatures of the recordings.

    The drag of the iron is in the measured torque, so hysteresis counts as Coulomb and eddy
    currents as viscous friction.
    """
    iron = float(config.iron)
    figures: list[Judged] = []
    for place, joint in enumerate(model.joints):
        truth = float(profile.coulomb[place] + iron * profile.hysteresis_torque[place])
        figures += _of("Coulomb", joint.name, joint.friction.coulomb, truth)
    for place, (joint, oil) in enumerate(zip(model.joints, profile.lubricant, strict=True)):
        law = viscous_law(joint.friction.viscous)
        for degc in np.clip(DEGC, law.lower_degc, law.upper_degc).tolist():
            truth = float(profile.viscous_40[place]) * float(oil.friction_factor(degc))
            truth += iron * float(profile.eddy_viscous[place])
            name = f"{joint.name} at {degc:.0f} degC, {joint.friction.viscous.law}"
            std = float(law.std(degc))
            figures.append(Judged("viscous", name, truth, float(law.viscous(degc)), std))
    return figures


def repetitions(
    robots: Sequence[str],
    seeds: Iterable[int],
    hard: bool = False,
    progress: Callable[[str, int], None] | None = None,
) -> list[list[Judged]]:
    """Return the figures of each repetition, one robot after the other.

    Args:
        robots: Names of shipped models; each seed has the next of them.
    """
    found: list[list[Judged]] = []
    for seed in seeds:
        robot = robots[seed % len(robots)]
        if progress is not None:
            progress(robot, seed)
        with TemporaryDirectory() as name:
            found.append(DrawnPlant.of(robot, seed, hard).repetition(Path(name)))
    return found


def coverages(found: Sequence[Sequence[Judged]]) -> list[IntervalCoverage]:
    """Return how often the intervals of each group hold the truth."""
    rows: list[IntervalCoverage] = []
    for group in GROUPS:
        own = [[entry for entry in part if entry.group == group] for part in found]
        figures = [entry for part in own for entry in part]
        if not figures:
            continue
        errors = np.array([entry.deviations for entry in figures])
        known = errors[np.isfinite(errors)]
        widths = [Z95 * entry.std / abs(entry.truth) for entry in figures if entry.truth]
        rows.append(
            IntervalCoverage(
                group,
                len(figures),
                sum(bool(part) for part in own),
                float(np.mean([entry.held for entry in figures])),
                float(np.nanmedian(widths)) if len(known) else float("nan"),
                float(np.sqrt(np.mean(known**2))) if len(known) else float("nan"),
            )
        )
    return rows
