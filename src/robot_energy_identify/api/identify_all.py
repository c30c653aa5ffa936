"""Identification of everything that recordings allow, tested on what was held out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Unpack

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.foundation.options import takes
from robot_energy.replay.inputs import ModelName, model_of, silent
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
from robot_energy_identify.options import IdentifyOptions
from robot_energy_identify.plausibility import check_signs
from robot_energy_identify.provenance import require_distinct
from robot_energy_identify.results.identification import IdentificationReport, identification_report
from robot_energy_identify.run_all import FullIdentification, identify_everything, with_provenance
from robot_energy_identify.stats.held_out_energy import held_out_energy


@takes(IdentifyOptions)
def identify_all(
    bags: Names,
    model: ModelName,
    effort: str | None = None,
    **options: Unpack[IdentifyOptions],
) -> IdentificationResult[IdentificationReport]:
    """Identify everything that the recordings allow, and test it on what was held out.

    Args:
        bags: Recordings of one robot.
        model: Model to begin with: the model, its file, or the name of a shipped one.
        effort: What the effort in the joint states is: ``motor_torque``, ``joint_torque`` or
            ``motor_current``; None: as ``inputs`` says. Without it neither bodies nor friction
            can be identified.
        **options: What is identified and how it is tested: see `IdentifyOptions`.

    Returns:
        Every step with its reason where nothing was found, and the model with all of them.

    Raises:
        NotIdentifiableError: If nothing can be identified, with the reason of every step.
        RobotEnergyError: If recordings or model cannot be used.
    """
    given, progress, skip = (
        model_of(model),
        options.get("progress", silent),
        options.get("skip", ()),
    )
    drives = drive_topics(
        options.get("drive_power"), options.get("drive_joints"), options.get("dq_scaling", "peak")
    )
    paths, test_paths = (
        [Path(one)] if isinstance(one, str | Path) else [Path(bag) for bag in one]
        for one in (bags, options.get("test", ()))
    )
    require_distinct(paths)
    require_distinct(test_paths)
    require_distinct(paths, test_paths)
    source = BagSource(paths, effort, options.get("inputs"), sensors=options.get("sensors"))
    fitted, refused = source.lazy(given, drives)
    tests, _ = BagSource(test_paths, effort, source.inputs).lazy(given, drives)
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
            options.get("link_voltages"),
            share_shape=options.get("share_shape", False),
        )
    _require_something(whole)
    energy = None
    if options.get("held_out", True):
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
