"""Everything that was identified, for the terminal, as an HTML document, and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robot_energy import __version__
from robot_energy.blocks import EffortMeaning
from robot_energy.identify.cabinet.cabinet import CabinetFit
from robot_energy.identify.cabinet.dc_link import LinkFit
from robot_energy.identify.data.bags import VIRTUAL, BagFacts
from robot_energy.identify.drives.all_drives import DrivesFound
from robot_energy.identify.run_all import FullIdentification
from robot_energy.identify.stats.held_out_energy import HeldOutEnergy
from robot_energy.identify.steps import DynamicsFound, FrictionFound, Step
from robot_energy.model import RobotModel
from robot_energy.report.dc_link import error_over_energy, link_summary, print_link
from robot_energy.report.document import Document
from robot_energy.report.drives import delay_text, drives_found_summary, print_drives
from robot_energy.report.dynamics import dynamics_summary, print_dynamics, weakly_excited
from robot_energy.report.efficiency_figure import efficiency_maps
from robot_energy.report.friction_figure import friction_over_temperature
from robot_energy.report.held_out import PLACES, energy_summary, print_energy, verdict
from robot_energy.report.identification import (
    cabinet_summary,
    friction_summary,
    print_cabinet,
    print_friction,
)
from robot_energy.report.model_summary import count_tags
from robot_energy.report.parameters import print_changes
from robot_energy.report.printing import (
    NOTE,
    NOTHING,
    Page,
    heading,
    line,
    pairs,
    percent,
    table,
)

TITLES = {
    "dynamics": "Dynamics: bodies, rotors and friction",
    "friction": "Friction over motor temperature",
    "cabinet": "Constant losses of the cabinet",
    "drives": "Drives: electrical power",
    "capacitor": "Energy of the DC link",
}


@dataclass(frozen=True)
class Identification:
    """All that a report of `identify all` shows.

    Attributes:
        whole: What was identified.
        model: As it is written, with its provenance.
        read: Bags of the fit.
        tests: Bags of the test alone.
        test: Energy on what was held out; None if there was no test.
        command: The command line that made it; may be empty.
        out: Model file that was written; may be empty.
    """

    whole: FullIdentification
    model: RobotModel
    read: Sequence[BagFacts]
    tests: Sequence[BagFacts]
    test: HeldOutEnergy | None
    command: str = ""
    out: str = ""

    @property
    def lead(self) -> str:
        """What this is, and of what data."""
        origins = sorted({entry.origin for entry in (*self.read, *self.tests) if entry.origin})
        text = f"{self.model.robot.type}, identified from {_counted(len(self.read), 'recording')}"
        return f"{text}. {'. '.join(origins)}." if origins else f"{text}."


def print_identification(found: Identification, page: Page) -> None:
    """Print everything; a document gets figures too.

    Args:
        found: What to show.
        page: Where to.
    """
    heading(page, "In short")
    _overview(found, page)
    heading(page, "What was read")
    _read(found, page)
    for step in found.whole.steps:
        heading(page, TITLES[step.subject])
        _step(step, found, page)
    if found.test is not None:
        heading(page, "Energy on what the model has not seen")
        print_energy(found.test, found.model.joint_names, page)
    heading(page, "Model file")
    _model(found, page)


def _overview(found: Identification, page: Page) -> None:
    table(
        page,
        "What was identified, in the order in which it was done",
        ("step", "in the model", "what came of it"),
        [(step.subject, _state(step), _came_of(step)) for step in found.whole.steps],
    )
    line(page, verdict(found.test))
    virtual = [entry.name for entry in found.read if VIRTUAL in entry.origin]
    if virtual:
        line(
            page,
            f"{NOTE}virtual rig: {', '.join(virtual)} simulated; figures on it show the "
            "method, not a robot",
        )


def _state(step: Step) -> str:
    return "new" if step.taken else "as given"


def _came_of(step: Step) -> str:
    if step.reason:
        return step.reason
    match step.found:
        case DynamicsFound() as found:
            return (
                f"{len(found.result.base)} base parameters, {len(weakly_excited(found.result))} "
                f"of them weakly excited; torque {percent(found.consistent.total)} off held out, "
                f"{percent(found.given.total)} with the bodies as given"
            )
        case FrictionFound() as found:
            low = min(fit.range_degc[0] for fit in found.fits)
            high = max(fit.range_degc[1] for fit in found.fits)
            laws = ", ".join(sorted({fit.chosen for fit in found.fits}))
            return (
                f"{_counted(len(found.fits), 'axis', 'axes')}, {low:.0f} to {high:.0f} degC: {laws}"
            )
        case CabinetFit() as fit:
            sides = (("grid", fit.loss_grid), ("DC", fit.loss_dc))
            return ", ".join(
                f"{name} side as given" if value is None else f"{name} side {value:.1f} W"
                for name, value in sides
            )
        case DrivesFound() as found:
            if found.drives is None:
                return "losses behind one meter for all drives"
            return f"each drive by its own power: {found.drives.chosen.replace('_', ' ')}"
        case LinkFit() as fit:
            return (
                f"{fit.energy:.0f} J, 95 % interval {fit.interval[0]:.0f} to {fit.interval[1]:.0f}"
            )
        case None:
            return ""


def _read(found: Identification, page: Page) -> None:
    rows = [
        (
            entry.name,
            use,
            f"{entry.duration:.1f} s, {entry.rate:.0f} Hz",
            NOTHING if entry.range_degc is None else "{:.0f} to {:.0f}".format(*entry.range_degc),
            NOTHING if entry.effort is EffortMeaning.NONE else entry.effort.value.replace("_", " "),
            NOTHING
            if entry.meter is None
            else f"{entry.readings} at {PLACES.get(entry.meter, 'unknown place')}"
            + (", drives" if entry.drives else ""),
        )
        for use, entries in (("fit", found.read), ("test", found.tests))
        for entry in entries
    ]
    table(
        page,
        "Recordings",
        (
            "bag",
            "for",
            "samples",
            "motors [degC]",
            "effort",
            "power readings",
        ),
        rows,
    )
    delay = found.whole.meter_delay
    if delay is not None:
        line(page, delay_text("the power meter", dict(delay.__dict__)))
    for entry in (*found.read, *found.tests):
        for problem in entry.problems:
            line(page, f"{NOTE}{entry.name}: {problem}")


def _step(step: Step, found: Identification, page: Page) -> None:
    if step.found is None:
        line(page, f"{NOTE}not done: {step.reason}")
        return
    if step.reason:
        line(page, f"{NOTE}not taken: {step.reason}")
    summary = step_summary(step, found.whole)
    match step.found:
        case DynamicsFound() as part:
            print_dynamics(
                page,
                part.result,
                part.least_squares,
                part.consistent,
                details=isinstance(page, Document),
                friction_follows=not step.taken or found.whole.step("friction").taken,
            )
            line(
                page,
                f"held out with the bodies as given, rotors and friction refitted: "
                f"{percent(part.given.total)} of the moving torque; identified bodies "
                f"{percent(part.consistent.total)}",
            )
            if part.seconds < float("inf"):
                line(page, f"of each recording the first {part.seconds:.0f} s were used")
        case FrictionFound() as part:
            print_friction(summary, page)
            if isinstance(page, Document):
                page.figure(
                    lambda path: friction_over_temperature(part.fits, path),
                    "Viscous friction over motor temperature: free points and the laws that "
                    "competed on temperatures that their fits have not seen.",
                )
        case CabinetFit():
            print_cabinet(summary, page)
        case DrivesFound() as part:
            print_drives(summary, page)
            axes = [] if part.drives is None else list(part.drives.axes)
            mapped = [axis for axis in axes if axis.map is not None]
            if isinstance(page, Document) and mapped:
                page.figure(
                    lambda path: efficiency_maps(mapped, path),
                    "Reduced efficiency maps in four quadrants, with their points.",
                )
        case LinkFit() as fit:
            print_link(summary, page)
            if isinstance(page, Document):
                page.figure(
                    lambda path: error_over_energy(fit, path),
                    "Error of the predicted power at the grid over the energy of the DC link, the "
                    "constant of the DC side free beside it; shaded: 95 % interval.",
                )
    for note in step.notes:
        line(page, f"{NOTE}{note}")


def step_summary(step: Step, whole: FullIdentification) -> dict[str, Any]:
    """Return what one step found, ready for JSON; empty if it was left out."""
    match step.found:
        case DynamicsFound() as found:
            return {
                **dynamics_summary(found.result, found.least_squares, found.consistent),
                "held_out_given_bodies": found.given.total,
            }
        case FrictionFound() as found:
            return friction_summary(found.fits, found.refused, "measured")
        case CabinetFit() as fit:
            return cabinet_summary(fit)
        case DrivesFound() as found:
            return drives_found_summary(found)
        case LinkFit() as fit:
            return link_summary(fit)
        case None:
            return {}


def _model(found: Identification, page: Page) -> None:
    model, before = found.model, found.whole.given
    print_changes(before, model, page)
    tags = ", ".join(f"{count} {tag}" for tag, count in count_tags(model).items() if count)
    provenance = model.provenance
    pairs(
        page,
        [
            ("model file", found.out or "not written: name it with --out"),
            (
                "model",
                f"{model.model_id} (as given: {before.model_id}, {Path(before.source).name})",
            ),
            ("figures", tags),
            ("made from", ", ".join(provenance.bags)),
            ("recorded", provenance.data_date or NOTHING),
            ("made by", f"robot-energy {__version__}"),
        ],
    )
    if isinstance(page, Document) and found.command:
        page.heading("Commands", 3)
        page.paragraph("This report was made by")
        page.command(found.command)
        if found.out:
            page.paragraph("The model is run on a recording by")
            page.command(f"robot-energy replay BAG --model {found.out} --compare")


def identification_summary(found: Identification) -> dict[str, Any]:
    """Return everything, ready for JSON.

    Args:
        found: What to show.
    """
    return {
        "tool_version": __version__,
        "model_id": found.model.model_id,
        "model_id_given": found.whole.given.model_id,
        "command": found.command,
        "recordings": [_facts(entry, "fit") for entry in found.read]
        + [_facts(entry, "test") for entry in found.tests],
        "steps": [
            {
                "subject": step.subject,
                "taken": step.taken,
                "reason": step.reason or None,
                "notes": list(step.notes),
                "found": step_summary(step, found.whole) or None,
            }
            for step in found.whole.steps
        ],
        "meter_delay": None
        if found.whole.meter_delay is None
        else dict(found.whole.meter_delay.__dict__),
        "energy": energy_summary(found.test),
    }


def _facts(entry: BagFacts, use: str) -> dict[str, Any]:
    return {
        "name": entry.name,
        "use": use,
        "sha256": entry.sha256,
        "origin": entry.origin or None,
        "duration": entry.duration,
        "motor_temperature_degc": entry.range_degc,
        "effort": entry.effort.value,
        "meter": None if entry.meter is None else entry.meter.name.lower(),
        "readings": entry.readings,
        "drive_power": entry.drives,
        "problems": list(entry.problems),
    }


def _counted(count: int, one: str, many: str = "") -> str:
    return f"{count} {one if count == 1 else many or one + 's'}"
