"""Counterbalances from measured torque: columns, model entries, and when none is determined.

The torque of a counterbalance is linear in two figures (`robot_energy.physics.counterbalance`). A
lever spring has the form of a weight, and a torsion spring over a small angle that of a weight and
an offset: only motion that shows the inertia of the bodies, or a wide range, separates them. So
an entry is written where its figures are significant next to those of the bodies, and where
torque is predicted better on parts of the recording that the fit has not seen.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from robot_energy.model import RobotModel
from robot_energy.model.figure import Figure, PositiveFigure
from robot_energy.model.joint import GasSpring, Joint, LeverSpring, TorsionSpring
from robot_energy.physics.counterbalance import AnySpring, torque_columns
from robot_energy.timeline.blocks import Float
from robot_energy_identify.dynamics.torque_model import Estimate, ParameterColumn

SIGNIFICANT = 13.8  # of chi squared with two degrees of freedom: one chance in a thousand
NAMES = {
    "spring": (("stiffness", "N m/rad"), ("rest_torque", "N m")),
    "lever": (("moment_cosine", "N m"), ("moment_sine", "N m")),
    "gas_spring": (("gas_force", "N"), ("gas_rate", "N/m")),
}


STRENGTH = {"spring": "stiffness", "lever": "moment", "gas_spring": "force"}


def open_springs(model: RobotModel) -> dict[int, AnySpring]:
    """Return counterbalances that recordings are to determine, by joint: of assumed strength.

    Published, derived and identified ones count as known.
    """
    return {
        joint: entry
        for joint, entry in enumerate(one.counterbalance for one in model.joints)
        if entry is not None and getattr(entry, STRENGTH[entry.kind]).tag == "assumed"
    }


def spring_columns(springs: Mapping[int, AnySpring]) -> tuple[ParameterColumn, ...]:
    """Return the two columns of every counterbalance."""
    return tuple(
        ParameterColumn(
            kind,
            unit,
            "joint_position",
            partial(_shape, entry, place),
            "counterbalance",
            partial(WRITTEN[entry.kind], entry, place),
            (joint,),
        )
        for joint, entry in springs.items()
        for place, (kind, unit) in enumerate(NAMES[entry.kind])
    )


def _shape(entry: AnySpring, place: int, position: Float) -> Float:
    return torque_columns(entry, position)[..., place]


def _write_spring(
    entry: TorsionSpring, place: int, joint: Joint, ratio: float, estimate: Estimate
) -> Joint:
    if place == 0:
        return _with(joint, entry, stiffness=estimate.figure(1.0), rest=entry.rest)
    found = joint.counterbalance
    stiffness = found.stiffness.value if isinstance(found, TorsionSpring) else 0.0
    if stiffness == 0.0:
        return joint
    return _with(joint, found, rest=_figure(estimate, -1.0 / stiffness))


def _write_lever(
    entry: LeverSpring, place: int, joint: Joint, ratio: float, estimate: Estimate
) -> Joint:
    """A cos q + B sin q: moment and angle are the polar form."""
    if place == 0:
        size = replace(estimate, value=abs(estimate.value)).figure(1.0)
        angle = Figure(value=0.0 if estimate.value >= 0.0 else np.pi, tag=estimate.tag)
        return _with(joint, entry, moment=size, angle=angle)
    first = joint.counterbalance
    if not isinstance(first, LeverSpring):
        return joint
    a = first.moment.value * float(np.cos(first.angle.value))
    moment = float(np.hypot(a, estimate.value))
    std: list[float | None] = [None, None]
    if first.moment.std is not None and estimate.std is not None and moment > 0.0:
        own, other = first.moment.std, estimate.std
        std[0] = float(np.hypot(a * own, estimate.value * other)) / moment
        std[1] = float(np.hypot(estimate.value * own, a * other)) / moment**2
    angle = float(np.arctan2(estimate.value, a))
    return _with(
        joint,
        first,
        moment=PositiveFigure(value=moment, std=std[0], tag=estimate.tag, source=estimate.source),
        angle=Figure(value=angle, std=std[1], tag=estimate.tag, source=estimate.source),
    )


def _write_gas(
    entry: GasSpring, place: int, joint: Joint, ratio: float, estimate: Estimate
) -> Joint:
    before = joint.counterbalance if place else entry
    return _with(joint, before or entry, **{("force", "rate")[place]: estimate.figure(1.0)})


WRITTEN: dict[str, Callable[..., Joint]] = {
    "spring": _write_spring, "lever": _write_lever, "gas_spring": _write_gas,
}  # fmt: skip


def _figure(estimate: Estimate, factor: float) -> Figure:
    std = None if estimate.std is None else estimate.std * abs(factor)
    value = estimate.value * factor
    return Figure(value=value, std=std, tag=estimate.tag, source=estimate.source)


def _with(joint: Joint, entry: AnySpring | None, **figures: Figure) -> Joint:
    changed = None if entry is None else entry.model_copy(update=figures)
    return joint.model_copy(update={"counterbalance": changed})
