"""What identification found; the fits of `identify` are parts of it as they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from robot_energy.errors import NotIdentifiableError
from robot_energy.identify.cabinet.cabinet import CabinetFit
from robot_energy.identify.cabinet.dc_link import LinkFit
from robot_energy.identify.cabinet.supply import SupplyFound
from robot_energy.identify.data.bags import BagFacts
from robot_energy.identify.drives.all_drives import DrivesFound
from robot_energy.identify.friction.friction import FrictionFit
from robot_energy.identify.friction.temperature_study import Study
from robot_energy.identify.run_all import FullIdentification
from robot_energy.identify.stats.held_out_energy import HeldOutEnergy
from robot_energy.identify.stats.lag import Delay
from robot_energy.identify.steps import DynamicsFound, FrictionFound, Step, ThermalFound
from robot_energy.model import RobotModel
from robot_energy.results.base import Number, Result
from robot_energy.results.drives import DrivesReport, drives_report
from robot_energy.results.dynamics import DynamicsReport, dynamics_report
from robot_energy.results.thermal import ThermalReport


@dataclass(frozen=True)
class FrictionReport(Result):
    """Friction over motor temperature.

    Attributes:
        effort: What the torque was measured as; ``log`` for relative figures of a log.
        axes: One per axis that could be identified.
        refused: Why the others could not, one sentence each.
    """

    NAME: ClassVar[str] = "friction"

    effort: str
    axes: tuple[FrictionFit, ...]
    refused: tuple[str, ...]

    @property
    def torque_unit(self) -> str:
        """Unit of the torque."""
        return "A" if self.effort == "log" else "N m"


@dataclass(frozen=True)
class AxisStudy(Result):
    """Laws of one axis, tested on temperatures that their fits have not seen.

    Attributes:
        name: Of the axis.
        study: The test.
        gain: RMS of the exponential law over that of the constant; None without such a law. [-]
        shuffles: How often the temperatures were shuffled between the runs.
        median_gain: The same ratio then: its median. [-]
        least_gain: Its least value. [-]
    """

    name: str
    study: Study
    gain: Number
    shuffles: int
    median_gain: Number
    least_gain: Number


@dataclass(frozen=True)
class FrictionStudyReport(Result):
    """Friction at temperatures that were not seen.

    Attributes:
        studies: One per axis.
    """

    NAME: ClassVar[str] = "friction_study"

    studies: tuple[AxisStudy, ...]


def axis_study(name: str, study: Study, chance: Sequence[float]) -> AxisStudy:
    """Return a test on unseen temperatures.

    Args:
        name: Of the axis.
        study: The test.
        chance: Gain with temperatures shuffled between the runs, one per shuffle. [-]
    """
    known = (float(np.median(chance)), float(np.min(chance))) if chance else (None, None)
    return AxisStudy(name, study, exponential_gain(study), len(chance), *known)


def exponential_gain(study: Study) -> float | None:
    """Return the RMS of the exponential law over that of the constant; None without such a law.

    Args:
        study: The test.
    """
    try:
        return study.row("exponential", "extend").rms / study.row("constant").rms
    except NotIdentifiableError:
        return None


@dataclass(frozen=True)
class CabinetReport(Result):
    """Constant losses of the cabinet, and energy of the DC link.

    Attributes:
        losses: Constant losses.
        meter_delay: Of the meter behind the joint states; None where it cannot be told.
        meter_time_constant: Of a low pass in the meter; likewise.
        link: Energy of the DC link; None where it was not told.
        link_taken: Whether the model has it.
        link_reason: Why not; empty if it has.
        link_note: What was taken for its voltages; empty if it has it not.
    """

    NAME: ClassVar[str] = "cabinet"

    losses: CabinetFit
    meter_delay: Delay | None
    meter_time_constant: Delay | None
    link: LinkFit | None
    link_taken: bool
    link_reason: str
    link_note: str


def cabinet_report(found: SupplyFound) -> CabinetReport:
    """Return what a meter tells of everything behind the drives.

    Args:
        found: Cabinet and DC link.
    """
    taken = found.link is not None and not found.reason
    return CabinetReport(
        found.cabinet,
        found.delay,
        found.low_pass,
        found.link,
        taken,
        found.reason,
        found.note,
    )


StepFound = DynamicsReport | FrictionReport | CabinetFit | DrivesReport | LinkFit | ThermalReport


@dataclass(frozen=True)
class StepReport(Result):
    """One step of the whole.

    Attributes:
        subject: What it is about.
        taken: Whether the model has what was found.
        reason: Why it was left out, or not taken; empty otherwise.
        notes: What was decided without data, one sentence each.
        found: What the recordings tell; None if the step was left out.
        step: The step behind it.
    """

    subject: str
    taken: bool
    reason: str
    notes: tuple[str, ...]
    found: StepFound | None
    step: Step = field(repr=False)


@dataclass(frozen=True)
class IdentificationReport(Result):
    """All that was identified, and the test on what was held out.

    Attributes:
        model: As it is written, with its provenance; in JSON its identity.
        given: As it was before; likewise.
        recordings: Bags of the fit.
        tests: Bags of the test alone.
        steps: In the order in which they were done.
        meter_delay: Of the meter behind the joint states; None where it cannot be told.
        meter_time_constant: Of a low pass in the meter; likewise.
        energy: Energy on what was held out; None if there was no test.
        mean_error: Mean size of its error at the meter, by stage; empty without a meter. [-]
        notes: What does not fit the model as given, one sentence each.
    """

    NAME: ClassVar[str] = "identification"

    model: RobotModel
    given: RobotModel
    recordings: tuple[BagFacts, ...]
    tests: tuple[BagFacts, ...]
    steps: tuple[StepReport, ...]
    meter_delay: Delay | None
    meter_time_constant: Delay | None
    energy: HeldOutEnergy | None
    mean_error: dict[str, float]
    notes: tuple[str, ...] = ()

    def taken(self, subject: str) -> bool:
        """Whether the model has new figures of a subject.

        Args:
            subject: Such as ``friction``, as the steps name it.
        """
        return any(step.subject == subject and step.taken for step in self.steps)


def identification_report(
    whole: FullIdentification,
    model: RobotModel,
    recordings: Sequence[BagFacts],
    tests: Sequence[BagFacts],
    test: HeldOutEnergy | None,
    notes: Sequence[str] = (),
) -> IdentificationReport:
    """Return all that was identified.

    Args:
        whole: The steps.
        model: As it is written, with its provenance.
        recordings: Bags of the fit.
        tests: Bags of the test alone.
        test: Energy on what was held out.
        notes: What does not fit the model as given, one sentence each.
    """
    return IdentificationReport(
        model=model,
        given=whole.given,
        recordings=tuple(recordings),
        tests=tuple(tests),
        steps=tuple(
            StepReport(step.subject, step.taken, step.reason, step.notes, _found(step), step)
            for step in whole.steps
        ),
        meter_delay=whole.meter_delay,
        meter_time_constant=whole.meter_time_constant,
        energy=test,
        mean_error={stage: test.mean_error(stage) for stage in test.stages}
        if test is not None and test.metered
        else {},
        notes=tuple(notes),
    )


def _found(step: Step) -> StepFound | None:
    match step.found:
        case DynamicsFound() as found:
            return dynamics_report(found.result, found.least_squares, found.consistent, found.given)
        case FrictionFound() as found:
            return FrictionReport("measured", found.fits, found.refused)
        case DrivesFound() as found:
            return drives_report(found)
        case ThermalFound() as found:
            return ThermalReport("losses", found.ambient_degc, found.fits, found.refused)
        case found:
            return found
