"""Identified dynamics: torque errors, friction, base parameters, recordings held out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.results.base import known
from robot_energy_identify.dynamics.dynamics import Dynamics, DynamicsReport
from robot_energy_identify.dynamics.dynamics_model import friction_at_joints
from robot_energy_identify.dynamics.leave_one_out import share_off
from robot_energy_identify.dynamics.validation import (
    HoldOutResult,
    LeaveOneOut,
    TorqueError,
    temperature_remark,
)
from robot_energy_identify.excitation.excitation import KINDS, ExcitationReport
from robot_energy_identify.stats.cross_validation import FOLDS
from robot_energy_report.document import Column, Document
from robot_energy_report.formats import (
    NOTHING,
    fixed,
    percent,
    signed_percent,
    significant,
    uncertain,
)
from robot_energy_report.identification import delay_use


class ReferenceValues(Described):
    """Friction known from elsewhere, to be compared with the identified one, joint side."""

    viscous: Annotated[Sequence[float], "Shape (n,). [N m s/rad]"]
    coulomb: Annotated[Sequence[float], "Shape (n,). [N m]"]
    source: str


def dynamics_document(
    report: DynamicsReport,
    page: Document,
    reference: ReferenceValues | None = None,
    details: bool = False,
    friction_follows: bool = False,
) -> None:
    """Add an identification; with details every group of parameters on the terminal too."""
    result, delay = report.result, report.delay
    settings = result.settings
    page.pairs(
        [
            ("base parameters", f"{len(result.base)}, {result.n_inertial} of them inertial"),
            (
                "rows",
                f"{int(result.observations.used.sum())} torques at {result.observations.rate:g} "
                f"Hz, with the information of {result.fit.independent.sum():.0f} independent ones",
            ),
            (
                "settings",
                f"{settings.method}, both sides through {settings.filters.cutoff:g} Hz, "
                + ", ".join(sorted({column.kind for column in settings.columns})),
            ),
            (
                "torque delay",
                f"{delay.value * 1e3:+.1f} ms would lower the held-out error by "
                f"{percent(delay.gain)}: {delay_use(delay, 'applied')}",
            ),
        ]
    )
    errors = {
        "data of the fit": result.in_sample,
        "held out, least squares": report.torque_error["held_out"],
        "held out, model file": report.torque_error["held_out_model_file"],
    }
    _torque_errors(
        page,
        f"torque error below {result.settings.filters.cutoff:g} Hz "
        f"(norm of error / norm of torque); held out: {FOLDS} contiguous blocks",
        list(errors),
        list(errors.values()),
        result.model.joint_names,
    )
    _friction(page, result, reference)
    with page.only("both" if details else "page"):
        _groups(page, report)
    weak = [entry.name for entry in report.base_parameters if entry.weakly_excited]
    if weak and not details:
        with page.only("terminal"):
            page.paragraph(
                f"weakly excited, 95 % interval wider than the parameter itself, {len(weak)} of "
                f"{len(report.base_parameters)}: {', '.join(weak)}"
            )
    last = () if friction_follows else (temperature_remark(result.model),)
    page.notes([note for note in (*report.notes, *last) if note])
    if report.across is not None:
        _across(page, report.across, result.model.joint_names)


def _torque_errors(
    page: Document,
    title: str,
    heads: Sequence[str],
    errors: Sequence[TorqueError],
    names: Sequence[str],
    more: Sequence[Sequence[str]] = (),
) -> None:
    rows = [
        [name, *(percent(error.joint[joint]) for error in errors)]
        for joint, name in enumerate(names)
    ]
    rows.append(
        ["all, standstill too", *(percent(error.with_standstill, digits=2) for error in errors)]
    )
    total = ["all, moving", *(percent(error.total, digits=2) for error in errors)]
    page.table(title, ["joint, moving", *heads], [*rows, *more], total)


def _friction(page: Document, result: Dynamics, reference: ReferenceValues | None) -> None:
    friction, labels = friction_at_joints(result), result.fit.names
    columns = ["joint"]
    for kind in ("viscous", "Coulomb"):
        columns += [kind, "known", "off by"] if reference is not None else [kind]
    rows, motors, shares = list[list[str]](), list[list[str]](), [0.0]
    for joint, name in enumerate(result.model.joint_names):
        row, motor = [name], [f"{name}, motor"]
        for kind in ("viscous", "coulomb"):
            value, std = (float(part[joint]) for part in friction[kind])
            row.append(uncertain(value, std))
            if f"joint_coulomb {name}" in labels:  # its motor turns with another joint too
                place = labels.index(f"{kind} {name}")
                own = float(result.fit.values[place]), float(result.fit.std[place])
                motor.append(uncertain(*own))
            if reference is not None:
                known = float(getattr(reference, kind)[joint])
                shares.append(value / known - 1.0 if known else float("nan"))
                row += [f"{known:.3g}", signed_percent(shares[-1])]
                motor += ["", ""]
        rows.append(row)
        if f"joint_coulomb {name}" in labels:
            motors.append(motor)
    page.table(
        "friction at the joints, viscous [N m s/rad] and Coulomb [N m] (+- standard deviation)",
        columns,
        [*rows, *motors],
    )
    if reference is not None:
        source = f" ({reference.source})" if reference.source else ""
        worst = percent(float(np.nanmax(np.abs(shares))))
        page.paragraph(f"largest deviation from the reference{source}: {worst}")


def _groups(page: Document, report: DynamicsReport) -> None:
    """Every group, those that are weakly excited in a table of their own."""
    columns = [
        Column("group", "sum"),
        Column("value", "value", significant(5)),
        Column("std", "std", significant(2)),
        Column("95 % +-", "interval_95", significant(2)),
        Column("better known by", lambda one: "the URDF" if one.better_known_by_urdf else ""),
    ]
    for title, weak in (
        ("base parameters determined by the recording", False),
        ("base parameters weakly excited: 95 % interval wider than the parameter itself", True),
    ):
        rows = [entry for entry in report.base_parameters if entry.weakly_excited is weak]
        page.rows(title, columns, rows)


def _across(page: Document, across: LeaveOneOut, joint_names: Sequence[str]) -> None:
    """Whole recordings held out: torque of each joint, work of the motors."""
    judgements = across.judgements
    heads = [_split(judgement) for judgement in judgements]
    _torque_errors(
        page,
        "torque error of recordings held out, filtered alike (norm of error / norm of torque); "
        "model file, "
        "without sensor offsets",
        heads,
        [each.torque for each in judgements],
        joint_names,
        [
            [
                "all, least squares",
                *(percent(each.least_squares.total, digits=2) for each in judgements),
            ]
        ],
    )
    work: list[list[str]] = []
    for kind, name in (("net", "net"), ("positive", "given")):
        sums = [
            (float(getattr(each.measured, kind).sum()), float(getattr(each.predicted, kind).sum()))
            for each in judgements
        ]
        work.append([f"{name}, measured [J]", *(f"{measured:.0f}" for measured, _ in sums)])
        work.append([f"{name}, predicted [J]", *(f"{said:.0f}" for _, said in sums)])
        off = (share_off(said, measured) for measured, said in sums)
        work.append([f"{name}, off by", *(signed_percent(share) for share in off)])
    work.append(["worst axis", *(_worst(each, joint_names) for each in judgements)])
    page.table(
        "work of the motors, torque times speed: net; given (braking left out); worst axis: error "
        "of its net work over the work it gave",
        ["", *heads],
        work,
    )
    for text in across.refused:
        page.paragraph(f"not predicted: {text}")


def _worst(judgement: HoldOutResult, joint_names: Sequence[str]) -> str:
    off = np.abs(judgement.predicted.net - judgement.measured.net)
    share = off / np.maximum(judgement.measured.positive, 1e-12)
    return f"{percent(share.max())} {joint_names[int(np.argmax(share))]}"


def _split(judgement: HoldOutResult) -> str:
    if judgement.trained_on == (judgement.recording,):
        return f"{judgement.recording}, own blocks"
    return f"{judgement.recording} from {', '.join(judgement.trained_on)}"


def excitation_document(report: ExcitationReport, page: Document) -> None:
    """Add what an excitation motion determines and uses."""
    named = (
        ("condition number", "condition"),
        ("log determinant per parameter", "log_determinant"),
    )
    settings = report.settings
    page.rows(
        f"Observation matrix of {len(report.base_parameters)} base parameters, "
        f"{settings.harmonics} harmonics of {1.0 / settings.period:.4g} Hz, {settings.period:g} s",
        [
            Column("", lambda row: row[0]),
            Column(
                "best random start",
                lambda row: known(getattr(report.before, row[1])),
                significant(4),
            ),
            Column("optimised", lambda row: known(getattr(report.after, row[1])), significant(4)),
        ],
        named,
    )
    page.rows(
        "Start pose, and use of the limits of URDF and robot (at most "
        f"{100 * report.margin:.0f} % was allowed)",
        [
            Column("joint", "name"),
            Column("start", "start", fixed(4), "rad or m"),
            *(Column(kind, lambda joint, kind=kind: joint.use[kind], percent) for kind in KINDS),
        ],
        report.joints,
    )
    if report.floor is not None:
        page.paragraph(
            f"{report.floor.link} stays above {report.least_height:.3f} m "
            f"({report.floor.height:g} m allowed)"
        )
    else:
        page.note("no link is kept above a floor; --floor and --tool do")
    silent = report.after.not_excited
    excited = [name for name in report.base_parameters if name not in silent]
    count = len(report.base_parameters)
    with page.only("terminal"):
        page.paragraph(f"excited: {len(excited)} of {count} base parameters")
    with page.only("page"):
        page.paragraph(f"excited, {len(excited)} of {count}: {', '.join(excited) or NOTHING}")
    page.paragraph(f"not excited: {', '.join(silent) or NOTHING}")
    page.paragraph(f"no torque depends on: {', '.join(report.without_effect) or NOTHING}")
    if report.acceleration_assumed:
        page.note(
            "a URDF has no acceleration limits; full speed in 0.5 s is assumed, "
            "--acceleration gives those of the robot"
        )
    if any(joint.use["torque"] is None for joint in report.joints):
        page.note("the URDF gives no torque limit for some joints; none was kept there")
    page.note(
        "collisions of the robot with itself and its surroundings are not checked; play "
        "the motion in simulation, then slowly, before recording it"
    )
