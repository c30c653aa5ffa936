"""Identification of everything that recordings allow, tested on what was held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.foundation.units import DqScaling
from robot_energy.replay.inputs import ModelName, Stages, model_of, silent
from robot_energy_identify.api.bag_source import BagSource
from robot_energy_identify.api.identify import IdentificationResult, Names
from robot_energy_identify.causes import (
    bodies_known,
    cause_named,
    notes_on_torque,
    refuse_meter,
    refuse_torque,
    torque_evidence,
)
from robot_energy_identify.check.evidence import Evidence
from robot_energy_identify.data.bags import Bag, BagFacts, Kept, Span, facts, folds_of
from robot_energy_identify.drives.drive_power import drive_topics
from robot_energy_identify.plausibility import check_signs
from robot_energy_identify.provenance import require_distinct
from robot_energy_identify.results.identification import IdentificationReport, identification_report
from robot_energy_identify.run_all import FullIdentification, identify_everything, with_provenance
from robot_energy_identify.stats.held_out_energy import held_out_energy
from robot_energy_identify.stats.systematic import SensorLimits
from robot_energy_identify.steps import Subject


def identify_all(
    bags: Names,
    model: ModelName,
    effort: str | None = None,
    *,
    test: Names = (),
    held_out: bool = True,
    skip: Sequence[Subject] = (),
    drive_power: str | Sequence[str] | None = None,
    drive_joints: Sequence[str] | None = None,
    dq_scaling: DqScaling = "peak",
    link_voltages: tuple[float, float] | None = None,
    share_shape: bool = False,
    inputs: str | Path | None = None,
    sensors: SensorLimits | None = None,
    progress: Stages = silent,
) -> IdentificationResult[IdentificationReport]:
    """Identify everything that the recordings allow, and test it on what was held out.

    Args:
        bags: Recordings of one robot.
        model: Model to begin with: the model, its file, or the name of a shipped one.
        effort: What the effort in the joint states is: ``motor_torque``, ``joint_torque`` or
            ``motor_current``; None: as ``inputs`` says. Without it neither bodies nor friction
            can be identified.
        test: Recordings for the test alone.
        held_out: Whether to test the energy on held-out recordings.
        skip: Subjects that stay as the model has them.
        drive_power: Topic of an array with the power of each drive [W], or four: currents d and
            q [A], voltages d and q [V] (paper B eq. 1).
        drive_joints: Joints in the order of these arrays; None: of the model.
        dq_scaling: What the amplitudes of the four are: ``peak``, ``rms`` or ``power_invariant``.
        link_voltages: Of the DC link: rectified mains, start of the brake chopper. [V]
        share_shape: Whether axes of too small a range borrow the temperature shape of others.
        inputs: Parameter file of a monitor: read the bags as that node reads its topics.
        sensors: Limits of the constant errors of the sensors; None for the usual ones.
        progress: Called with what is going on; gives a function of the share done.

    Returns:
        Every step with its reason where nothing was found, and the model with all of them.

    Raises:
        NotIdentifiableError: If nothing can be identified, with the reason of every step.
        RobotEnergyError: If recordings or model cannot be used.
    """
    given = model_of(model)
    drives = drive_topics(drive_power, drive_joints, dq_scaling)
    paths, test_paths = (
        [Path(one)] if isinstance(one, str | Path) else [Path(bag) for bag in one]
        for one in (bags, test)
    )
    require_distinct(paths)
    require_distinct(test_paths)
    require_distinct(paths, test_paths)
    source = BagSource(paths, effort, inputs, sensors=sensors)
    fitted, refused = source.lazy(given, drives)
    tests, _ = BagSource(test_paths, effort, inputs).lazy(given, drives)
    known: list[tuple[BagFacts, Span]] = []
    evidence: list[Evidence] = []
    kept: list[Bag] = []
    for bag in (*fitted, *tests):
        with progress(f"reading {bag.name}") as report:
            recording = bag.whole(given, report)
        kept.append(replace(bag, kept=Kept(recording)) if recording.in_order else bag)
        known.append((facts(bag, recording), recording.span_ns))
        evidence.append(torque_evidence(recording, bag.effort))
        if len(known) <= len(fitted):
            check_signs([recording], bag.effort)
            refuse_meter([recording], bag.effort)
    fitted, tests = kept[: len(fitted)], kept[len(fitted) :]
    read = [entry for entry, _ in known[: len(fitted)]]
    fit_parts, test_parts = evidence[: len(fitted)], evidence[len(fitted) :]
    with progress("comparing with the model"):
        compare = refuse_torque if bodies_known(given) else notes_on_torque
        notes = [*compare(fit_parts), *notes_on_torque(test_parts, "in the test: ")]
    with progress("identifying") as report, cause_named(lambda: fit_parts):
        whole = identify_everything(
            fitted,
            given,
            skip,
            lambda _, share: report(share),
            refused,
            link_voltages,
            share_shape=share_shape,
        )
    _require_something(whole)
    energy = None
    if held_out:
        kind, folds = folds_of(fitted, tests, [span for _, span in known])
        with progress("testing on what was held out") as report:
            energy = held_out_energy(kind, folds, whole, skip, lambda _, share: report(share))
    written = with_provenance(whole, read)
    tested = [entry for entry, _ in known[len(fitted) :]]
    found = identification_report(whole, written, read, tested, energy, notes)
    return IdentificationResult(written, found)


def _require_something(whole: FullIdentification) -> None:
    """Refuse to report where not one step could be done.

    Raises:
        NotIdentifiableError: With the reason of every step.
    """
    if all(step.found is None for step in whole.steps):
        reasons = " ".join(f"{step.subject.capitalize()}: {step.reason}" for step in whole.steps)
        raise NotIdentifiableError(
            f"nothing can be identified from these recordings. {reasons}",
            remedy="record with torque or current, temperature, or a power meter",
        )
