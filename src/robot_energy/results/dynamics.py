"""Identified dynamics: bodies, rotors and friction."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from robot_energy.identify.dynamics.dynamics import Dynamics
from robot_energy.identify.dynamics.leave_one_out import LeaveOneOut
from robot_energy.identify.dynamics.validation import TorqueError
from robot_energy.identify.stats.lag import Delay
from robot_energy.results.base import Number, Result


@dataclass(frozen=True)
class BaseParameter(Result):
    """One group of inertial, rotor and friction parameters.

    Attributes:
        name: Of the standard parameter that stands for the group.
        sum: The group.
        value: In the unit of that parameter.
        std: Standard deviation.
        interval_95: Half width of the 95 % interval.
        weakly_excited: Whether the interval is wider than the value.
        told_less_than_urdf: Whether the recording tells less of it than the URDF.
        parts: Of the standard deviation, by cause.
    """

    name: str
    sum: str
    value: float
    std: Number
    interval_95: Number
    weakly_excited: bool
    told_less_than_urdf: bool
    parts: dict[str, float]


@dataclass(frozen=True)
class DynamicsReport(Result):
    """Bodies, rotors and friction.

    Attributes:
        base_parameters: Groups of parameters that torque tells.
        torque_error: By ``held_out`` (least squares) and ``held_out_model_file`` (bodies that
            can exist); ``held_out_given_bodies`` where it was compared.
        delay: Of the torque behind the positions.
        across: Recordings held out whole; None for a single one.
        notes: What the user should know, one sentence each.
        result: The identification behind it.
    """

    NAME: ClassVar[str] = "dynamics"

    base_parameters: tuple[BaseParameter, ...]
    torque_error: dict[str, TorqueError]
    delay: Delay
    across: LeaveOneOut | None
    notes: tuple[str, ...]
    result: Dynamics = field(repr=False)


def dynamics_report(
    result: Dynamics,
    held_out: TorqueError,
    consistent: TorqueError,
    given: TorqueError | None = None,
    across: LeaveOneOut | None = None,
) -> DynamicsReport:
    """Return what a recording tells of the dynamics.

    Args:
        result: The identification.
        held_out: Torque error of the least-squares fit.
        consistent: Of the fit that the model file holds.
        given: Of the bodies as given.
        across: Recordings held out whole.
    """
    values, half, std = result.fit.values, result.fit.interval(), result.fit.std
    errors = {"held_out": held_out, "held_out_model_file": consistent}
    return DynamicsReport(
        base_parameters=tuple(
            BaseParameter(
                name,
                result.base.expression(group),
                float(values[group]),
                float(std[group]),
                float(half[group]),
                bool(abs(values[group]) < half[group]),
                name in result.poorly_known,
                result.fit.parts_of(group),
            )
            for group, name in enumerate(result.base.labels)
        ),
        torque_error=errors if given is None else errors | {"held_out_given_bodies": given},
        delay=result.delay,
        across=across,
        notes=result.notes,
        result=result,
    )
