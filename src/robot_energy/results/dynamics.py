"""Identified dynamics: bodies, rotors and friction."""

from dataclasses import field
from typing import Annotated

from robot_energy.identify.dynamics.dynamics import Dynamics
from robot_energy.identify.dynamics.leave_one_out import LeaveOneOut
from robot_energy.identify.dynamics.validation import TorqueError
from robot_energy.identify.stats.lag import Delay
from robot_energy.results.base import Number, Result


class BaseParameter(Result):
    """One group of inertial, rotor and friction parameters."""

    name: Annotated[str, "Of the standard parameter that stands for the group."]
    sum: Annotated[str, "The group."]
    value: Annotated[float, "In the unit of that parameter."]
    std: Annotated[Number, "Standard deviation."]
    interval_95: Annotated[Number, "Half width of the 95 % interval."]
    weakly_excited: Annotated[bool, "Whether the interval is wider than the value."]
    told_less_than_urdf: Annotated[bool, "Whether the recording tells less of it than the URDF."]
    parts: Annotated[dict[str, float], "Of the standard deviation, by cause."]


class DynamicsReport(Result, name="dynamics"):
    """Bodies, rotors and friction."""

    base_parameters: Annotated[tuple[BaseParameter, ...], "Groups of parameters that torque tells."]
    torque_error: Annotated[
        dict[str, TorqueError],
        "By ``held_out`` (least squares) and ``held_out_model_file`` (bodies that can exist); "
        "``held_out_given_bodies`` where it was compared.",
    ]
    delay: Annotated[Delay, "Of the torque behind the positions."]
    across: Annotated[LeaveOneOut | None, "Recordings held out whole; None for a single one."]
    notes: Annotated[tuple[str, ...], "What the user should know, one sentence each."]
    result: Annotated[Dynamics, "The identification behind it."] = field(repr=False)


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
