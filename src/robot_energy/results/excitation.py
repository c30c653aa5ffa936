"""An excitation motion: what it tells, and what it uses of the limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from robot_energy.identify.excitation.excitation import (
    Excitation,
    ExcitationScore,
    ExcitationSettings,
)
from robot_energy.identify.excitation.limits import Floor
from robot_energy.results.base import Number, Result, known

KINDS = ("position", "velocity", "acceleration", "torque")


@dataclass(frozen=True)
class ExcitedJoint(Result):
    """One joint of the motion.

    Attributes:
        name: Of the joint.
        start: Position at the start. [rad] or [m]
        use: Of each limit, by kind; None without a limit. [-]
    """

    name: str
    start: float
    use: dict[str, Number]


@dataclass(frozen=True)
class ExcitationReport(Result):
    """A motion for the identification of the dynamics.

    Attributes:
        settings: Of the search.
        before: How well the best random start tells the base parameters.
        after: How well the optimised motion does.
        base_parameters: All that a motion can tell: sum of each group by its name.
        without_effect: Parameters that no torque depends on.
        margin: Share of every limit that was allowed. [-]
        acceleration_assumed: Whether the limits of the acceleration were not given.
        joints: In model order.
        floor: Height that a link keeps; None without one.
        least_height: That it reaches; None without a floor. [m]
    """

    NAME: ClassVar[str] = "excitation"

    settings: ExcitationSettings
    before: ExcitationScore
    after: ExcitationScore
    base_parameters: dict[str, str]
    without_effect: tuple[str, ...]
    margin: float
    acceleration_assumed: bool
    joints: tuple[ExcitedJoint, ...]
    floor: Floor | None
    least_height: Number


def excitation_report(found: Excitation) -> ExcitationReport:
    """Return what an excitation motion tells and uses.

    Args:
        found: The motion.
    """
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
