"""Identified dynamics as tables, and as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_energy.identify.dynamics.dynamics import Dynamics
from robot_energy.identify.dynamics.dynamics_model import friction_at_joints
from robot_energy.identify.dynamics.leave_one_out import HoldOutResult, LeaveOneOut
from robot_energy.identify.dynamics.sufficiency import temperature_remark
from robot_energy.identify.dynamics.validation import TorqueError
from robot_energy.identify.dynamics.work import share_off
from robot_energy.report.printing import Page, line, pairs, table


@dataclass(frozen=True)
class ReferenceValues:
    """Friction known from elsewhere, to be set beside the identified one, joint side.

    Attributes:
        viscous: Shape (n,). [N m s/rad]
        coulomb: Shape (n,). [N m]
        source: In words.
    """

    viscous: Sequence[float]
    coulomb: Sequence[float]
    source: str


@dataclass(frozen=True)
class TorqueErrorRow:
    """What an identification took.

    Attributes:
        reading: Time to read the files. [s]
        fitting: Time from arrays to the model. [s]
        peak_memory: Of the process. [MB]
    """

    reading: float
    fitting: float
    peak_memory: float


def print_dynamics(
    page: Page,
    result: Dynamics,
    held_out: TorqueError,
    held_out_consistent: TorqueError,
    reference: ReferenceValues | None = None,
    effort: TorqueErrorRow | None = None,
    details: bool = False,
    friction_follows: bool = False,
) -> None:
    """Print an identification.

    Args:
        page: Where.
        result: The identification.
        held_out: Of the least-squares fit.
        held_out_consistent: Of the fit that the model file holds.
        reference: Friction to compare with.
        effort: Time and memory.
        details: Also every group with value and standard deviation.
        friction_follows: Whether friction over temperature is identified afterwards.
    """
    settings, delay = result.settings, result.delay
    applied = "applied" if delay.applied else "not applied"
    rows = [
        ("base parameters", f"{len(result.base)}, {result.n_inertial} of them inertial"),
        (
            "rows",
            f"{int(result.observations.used.sum())} torques at {result.observations.rate:g} Hz, "
            f"as good as {result.fit.independent.sum():.0f} independent ones",
        ),
        (
            "settings",
            f"{settings.method}, both sides through {settings.filters.cutoff:g} Hz, "
            + ", ".join(sorted({column.kind for column in settings.columns})),
        ),
        (
            "torque delay",
            f"{delay.value * 1e3:+.1f} ms would lower the held-out error by {delay.gain:.1%}: "
            f"{applied}",
        ),
    ]
    if effort is not None:
        total = effort.reading + effort.fitting
        rows.append(
            (
                "time",
                f"{total:.2f} s from files to model, {effort.reading:.2f} s of it reading; "
                "without imports",
            )
        )
        rows.append(("memory", f"{effort.peak_memory:.0f} MB at most"))
    pairs(page, rows)
    _errors(page, result, held_out, held_out_consistent)
    _friction(page, result, reference)
    if details:
        _groups(page, result)
    else:
        _weak(page, result)
    last = () if friction_follows else (temperature_remark(result.model),)
    for note in (*result.notes, *last):
        if note:
            line(page, f"note: {note}")


def _errors(page: Page, result: Dynamics, held_out: TorqueError, consistent: TorqueError) -> None:
    errors = (result.in_sample, held_out, consistent)
    rows = [
        [name, *(f"{error.joint[joint]:.1%}" for error in errors)]
        for joint, name in enumerate(result.model.joint_names)
    ]
    rows.append(["all, standstill too", *(f"{error.with_standstill:.2%}" for error in errors)])
    table(
        page,
        f"torque error (norm of error / norm of torque); held out: {result.settings.folds} "
        "contiguous blocks",
        [
            "joint, moving",
            "fitted data: no accuracy",
            "held out, least squares",
            "held out, model file",
        ],
        rows,
        ["all, moving", *(f"{error.total:.2%}" for error in errors)],
    )


def _friction(page: Page, result: Dynamics, reference: ReferenceValues | None) -> None:
    friction = friction_at_joints(result)
    columns = ["joint"]
    for kind in ("viscous", "Coulomb"):
        columns += [kind, "known", "off by"] if reference is not None else [kind]
    rows: list[list[str]] = []
    worst = 0.0
    for joint, name in enumerate(result.model.joint_names):
        row = [name]
        for kind in ("viscous", "coulomb"):
            value, std = (float(part[joint]) for part in friction[kind])
            row.append(f"{value:.3f} +- {std:.3f}")
            if reference is not None:
                known = float(getattr(reference, kind)[joint])
                share = value / known - 1.0 if known else float("nan")
                worst = max(worst, abs(share))
                row += [f"{known:.3g}", f"{share:+.1%}"]
        rows.append(row)
    labels = result.fit.names
    for name in result.model.joint_names:
        if f"joint_coulomb {name}" in labels:  # its motor turns with another joint too
            row = [f"{name}, motor"]
            for kind in ("viscous", "coulomb"):
                place = labels.index(f"{kind} {name}")
                row.append(f"{result.fit.values[place]:.3f} +- {result.fit.std[place]:.3f}")
                row += ["", ""] if reference is not None else []
            rows.append(row)
    table(
        page,
        "friction at the joints, viscous [N m s/rad] and Coulomb [N m] (+- standard deviation)",
        columns,
        rows,
    )
    if reference is not None:
        source = f" ({reference.source})" if reference.source else ""
        line(page, f"largest deviation from the reference{source}: {worst:.1%}")


def weakly_excited(result: Dynamics) -> tuple[str, ...]:
    """Return the base parameters whose 95 % interval exceeds their size, by name."""
    weak = np.abs(result.fit.values) < result.fit.interval()
    return tuple(name for name, w in zip(result.base.labels, weak.tolist(), strict=True) if w)


def _weak(page: Page, result: Dynamics) -> None:
    weak = weakly_excited(result)
    if weak:
        line(
            page,
            f"weakly excited, 95 % interval wider than the parameter itself, {len(weak)} of "
            f"{len(result.base)}: {', '.join(weak)}",
        )


def _groups(page: Page, result: Dynamics) -> None:
    """Every group, those that are weakly excited in a table of their own."""
    half, weak = result.fit.interval(), set(weakly_excited(result))
    groups = list(enumerate(result.base.labels))
    for title, chosen in (
        ("base parameters that the recording tells", [g for g, n in groups if n not in weak]),
        (
            "base parameters weakly excited: 95 % interval wider than the parameter itself",
            [g for g, n in groups if n in weak],
        ),
    ):
        rows = [
            [
                result.base.expression(group),
                f"{result.fit.values[group]:.5g}",
                f"{result.fit.std[group]:.2g}",
                f"{half[group]:.2g}",
                "less than the URDF" if result.base.labels[group] in result.poorly_known else "",
            ]
            for group in chosen
        ]
        if rows:
            table(page, title, ["group", "value", "std", "95 % +-", "told"], rows)


def print_across(page: Page, across: LeaveOneOut, joint_names: Sequence[str]) -> None:
    """Print whole recordings held out: torque of each joint, work of the motors.

    Args:
        page: Where.
        across: The judgements.
        joint_names: Base first.
    """
    judgements = across.judgements
    heads = [_split(judgement) for judgement in judgements]
    rows = [
        [name, *(f"{judgement.torque.joint[joint]:.1%}" for judgement in judgements)]
        for joint, name in enumerate(joint_names)
    ]
    rows.append(
        ["all, standstill too", *(f"{each.torque.with_standstill:.2%}" for each in judgements)]
    )
    rows.append(["all, least squares", *(f"{each.least_squares.total:.2%}" for each in judgements)])
    table(
        page,
        "torque error of recordings held out (norm of error / norm of torque); model file, "
        "without sensor offsets",
        ["joint, moving", *heads],
        rows,
        ["all, moving", *(f"{each.torque.total:.2%}" for each in judgements)],
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
        work.append([f"{name}, off by", *(f"{share:+.1%}" for share in off)])
    work.append(["worst axis", *(_worst(each, joint_names) for each in judgements)])
    table(
        page,
        "work of the motors, torque times speed: net; given (braking left out); worst axis: error "
        "of its net work over the work it gave",
        ["", *heads],
        work,
    )
    for text in across.refused:
        line(page, f"not predicted: {text}")


def _worst(judgement: HoldOutResult, joint_names: Sequence[str]) -> str:
    off = np.abs(judgement.predicted.net - judgement.measured.net)
    share = off / np.maximum(judgement.measured.positive, 1e-12)
    return f"{share.max():.1%} {joint_names[int(np.argmax(share))]}"


def _split(judgement: HoldOutResult) -> str:
    if judgement.trained_on == (judgement.recording,):
        return f"{judgement.recording}, own blocks"
    return f"{judgement.recording} from {', '.join(judgement.trained_on)}"


def dynamics_summary(
    result: Dynamics, held_out: TorqueError, held_out_consistent: TorqueError
) -> dict[str, Any]:
    """Return what `identify dynamics` found, ready for JSON.

    Args:
        result: The identification.
        held_out: Of the least-squares fit.
        held_out_consistent: Of the fit that the model file holds.
    """
    half, weak = result.fit.interval(), set(weakly_excited(result))
    return {
        "base_parameters": [
            {
                "name": name,
                "sum": result.base.expression(group),
                "value": float(result.fit.values[group]),
                "std": _finite(float(result.fit.std[group])),
                "interval_95": _finite(float(half[group])),
                "weakly_excited": name in weak,
                "told_less_than_urdf": name in result.poorly_known,
            }
            for group, name in enumerate(result.base.labels)
        ],
        "torque_error": {
            name: {
                "joints": [_finite(value) for value in error.joint.tolist()],
                "moving": _finite(error.total),
                "with_standstill": _finite(error.with_standstill),
            }
            for name, error in (
                ("held_out", held_out),
                ("held_out_model_file", held_out_consistent),
            )
        },
        "delay": result.delay.value,
        "delay_applied": result.delay.applied,
        "notes": list(result.notes),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
