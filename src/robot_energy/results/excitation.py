"""An excitation motion: what it tells, and what it uses of the limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from robot_energy.identify.excitation.excitation import Excitation, ExcitationScore
from robot_energy.results.base import Number, Result

KINDS = ("position", "velocity", "acceleration", "torque")


@dataclass(frozen=True)
class Observability(Result):
    """How well a motion tells the base parameters.

    Attributes:
        condition: Condition number of the scaled observation matrix. [-]
        log_determinant: Of the scaled information matrix, per base parameter. [-]
    """

    condition: Number
    log_determinant: Number

    @classmethod
    def of(cls, score: ExcitationScore) -> Observability:
        """Return it; nothing where the matrix is singular."""
        known = np.isfinite(score.condition)
        return cls(*((score.condition, score.log_determinant) if known else (None, None)))


@dataclass(frozen=True)
class ExcitedParameter(Result):
    """One base parameter.

    Attributes:
        name: Of the standard parameter that stands for its group.
        sum: The group.
        excited: Whether the motion tells it.
    """

    name: str
    sum: str
    excited: bool


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
class FloorKept(Result):
    """Height that a link keeps.

    Attributes:
        link: The link.
        height: Allowed. [m]
        least: Reached. [m]
    """

    link: str
    height: float
    least: float


@dataclass(frozen=True)
class ExcitationReport(Result):
    """A motion for the identification of the dynamics.

    Attributes:
        criterion: ``determinant`` or ``condition``.
        harmonics: Of each joint.
        period: Of the motion. [s]
        base_frequency: One over it. [Hz]
        starts: Random starts of the search.
        seed: Of the search.
        before: The best random start.
        after: The optimised motion.
        base_parameters: All that a motion can tell.
        without_effect: Parameters that no torque depends on.
        margin: Share of every limit that was allowed. [-]
        acceleration_assumed: Whether the limits of the acceleration were not given.
        joints: In model order.
        floor: Height that was kept; None without one.
    """

    NAME: ClassVar[str] = "excitation"

    criterion: str
    harmonics: int
    period: float
    base_frequency: float
    starts: int
    seed: int
    before: Observability
    after: Observability
    base_parameters: tuple[ExcitedParameter, ...]
    without_effect: tuple[str, ...]
    margin: float
    acceleration_assumed: bool
    joints: tuple[ExcitedJoint, ...]
    floor: FloorKept | None


def excitation_report(found: Excitation) -> ExcitationReport:
    """Return what an excitation motion tells and uses.

    Args:
        found: The motion.
    """
    limits, settings = found.limits, found.settings
    start = found.motion.sample(np.zeros(1)).joint_position[0].tolist()
    unlimited = ~np.isfinite(limits.torque)
    return ExcitationReport(
        criterion=settings.criterion,
        harmonics=settings.harmonics,
        period=settings.period,
        base_frequency=1.0 / settings.period,
        starts=settings.starts,
        seed=settings.seed,
        before=Observability.of(found.start),
        after=Observability.of(found.quality),
        base_parameters=tuple(
            ExcitedParameter(
                name, found.base.expression(place), name not in found.quality.not_excited
            )
            for place, name in enumerate(found.base.labels)
        ),
        without_effect=found.base.without_effect,
        margin=limits.margin,
        acceleration_assumed=limits.acceleration_assumed,
        joints=tuple(
            ExcitedJoint(
                name,
                start[joint],
                {
                    kind: None
                    if kind == "torque" and unlimited[joint]
                    else float(found.use[kind][joint]) * limits.margin
                    for kind in KINDS
                },
            )
            for joint, name in enumerate(limits.robot.joint_names)
        ),
        floor=None
        if limits.floor is None
        else FloorKept(limits.floor.link, limits.floor.height, found.height),
    )
