"""Identified dynamics: bodies, rotors and friction."""

from dataclasses import field
from typing import Annotated

import numpy as np

from robot_energy.results.base import Number, Result, Texts, known
from robot_energy_identify.dynamics.dynamics import Dynamics
from robot_energy_identify.dynamics.leave_one_out import LeaveOneOut
from robot_energy_identify.dynamics.validation import TorqueError
from robot_energy_identify.excitation.excitation import (
    Excitation,
    ExcitationScore,
    ExcitationSettings,
)
from robot_energy_identify.excitation.limits import Floor
from robot_energy_identify.stats.lag import Delay


class BaseParameter(Result):
    """One group of inertial, rotor and friction parameters."""

    name: Annotated[str, "Name of the standard parameter that stands for the group."]
    sum: Annotated[str, "The group."]
    value: Annotated[float, "Value in the unit of that parameter."]
    std: Annotated[Number, "Standard deviation."]
    interval_95: Annotated[Number, "Half width of the 95 % interval."]
    weakly_excited: Annotated[bool, "Whether the interval is wider than the value."]
    better_known_by_urdf: Annotated[bool, "Whether the URDF determines it more precisely."]
    parts: Annotated[dict[str, float], "Parts of the standard deviation, by cause."]


class DynamicsReport(Result, name="dynamics"):
    """Bodies, rotors and friction."""

    base_parameters: Annotated[tuple[BaseParameter, ...], "Groups that torque determines."]
    torque_error: Annotated[
        dict[str, TorqueError],
        "Error by test: ``held_out`` (least squares) and ``held_out_model_file`` (bodies that can "
        "exist); ``held_out_given_bodies`` where it was compared.",
    ]
    delay: Annotated[Delay, "Lag of the torque behind the positions."]
    across: Annotated[LeaveOneOut | None, "Errors of recordings held out whole; None for one."]
    notes: Annotated[Texts, "What the user should know, one sentence each."]
    result: Annotated[Dynamics, "The identification behind it."] = field(repr=False)


def dynamics_report(
    result: Dynamics,
    held_out: TorqueError,
    consistent: TorqueError,
    given: TorqueError | None = None,
    across: LeaveOneOut | None = None,
) -> DynamicsReport:
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


KINDS = ("position", "velocity", "acceleration", "torque")


class ExcitedJoint(Result):
    """One joint of the motion."""

    name: Annotated[str, "Name of the joint."]
    start: Annotated[float, "Position at the start. [rad] or [m]"]
    use: Annotated[dict[str, Number], "Share of each limit, by kind; None without a limit. [-]"]


class ExcitationReport(Result, name="excitation"):
    """A motion for the identification of the dynamics."""

    settings: Annotated[ExcitationSettings, "Settings of the search."]
    before: Annotated[ExcitationScore, "How well the best random start does."]
    after: Annotated[ExcitationScore, "How well the optimised motion does."]
    base_parameters: Annotated[
        dict[str, str], "All that a motion can determine: sum of each group by its name."
    ]
    without_effect: Annotated[Texts, "Parameters that no torque depends on."]
    margin: Annotated[float, "Share of every limit that was allowed. [-]"]
    acceleration_assumed: Annotated[bool, "Whether the limits of the acceleration were not given."]
    joints: Annotated[tuple[ExcitedJoint, ...], "In model order."]
    floor: Annotated[Floor | None, "Height that a link keeps; None without one."]
    least_height: Annotated[Number, "Least height that the link reaches; None without a floor. [m]"]


def excitation_report(found: Excitation) -> ExcitationReport:
    limits = found.limits
    start = found.motion.sample(np.zeros(1)).joint_position[0].tolist()
    use = {kind: found.use[kind] * limits.margin for kind in KINDS}
    use["torque"] = np.where(np.isfinite(limits.torque), use["torque"], np.nan)
    return ExcitationReport(
        settings=found.settings,
        before=found.start,
        after=found.quality,
        base_parameters={
            name: found.base.expression(place) for place, name in enumerate(found.base.labels)
        },
        without_effect=found.base.without_effect,
        margin=limits.margin,
        acceleration_assumed=limits.acceleration_assumed,
        joints=tuple(
            ExcitedJoint(name, start[joint], {kind: known(use[kind][joint]) for kind in KINDS})
            for joint, name in enumerate(limits.robot.joint_names)
        ),
        floor=limits.floor,
        least_height=found.height,
    )
