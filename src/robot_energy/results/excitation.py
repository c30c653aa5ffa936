"""An excitation motion: what it tells, and what it uses of the limits."""

from typing import Annotated

import numpy as np

from robot_energy.identify.excitation.criterion import ExcitationScore
from robot_energy.identify.excitation.excitation import Excitation, ExcitationSettings
from robot_energy.identify.excitation.limits import Floor
from robot_energy.results.base import Number, Result, known

KINDS = ("position", "velocity", "acceleration", "torque")


class ExcitedJoint(Result):
    """One joint of the motion."""

    name: Annotated[str, "Of the joint."]
    start: Annotated[float, "Position at the start. [rad] or [m]"]
    use: Annotated[dict[str, Number], "Of each limit, by kind; None without a limit. [-]"]


class ExcitationReport(Result, name="excitation"):
    """A motion for the identification of the dynamics."""

    settings: Annotated[ExcitationSettings, "Of the search."]
    before: Annotated[ExcitationScore, "How well the best random start tells the base parameters."]
    after: Annotated[ExcitationScore, "How well the optimised motion does."]
    base_parameters: Annotated[
        dict[str, str], "All that a motion can tell: sum of each group by its name."
    ]
    without_effect: Annotated[tuple[str, ...], "Parameters that no torque depends on."]
    margin: Annotated[float, "Share of every limit that was allowed. [-]"]
    acceleration_assumed: Annotated[bool, "Whether the limits of the acceleration were not given."]
    joints: Annotated[tuple[ExcitedJoint, ...], "In model order."]
    floor: Annotated[Floor | None, "Height that a link keeps; None without one."]
    least_height: Annotated[Number, "That it reaches; None without a floor. [m]"]


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
