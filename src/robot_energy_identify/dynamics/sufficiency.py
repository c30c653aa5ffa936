"""Whether a recording suffices, and what the user should record instead.

What makes a fit impossible is refused; what makes it doubtful is said next to the result.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.friction_laws import FRICTION_LAWS
from robot_energy.physics.rigid_body import Robot
from robot_energy_identify.data.observations import ROWS_PER_RATE, Filters, Observations
from robot_energy_identify.data.signals import Channels
from robot_energy_identify.dynamics.base_parameters import BaseParameters
from robot_energy_identify.dynamics.consistent import Prior
from robot_energy_identify.dynamics.validation import TorqueError
from robot_energy_identify.stats.lag import Delay
from robot_energy_identify.stats.regression import Fit

MAX_SPEED_RATIO = 3.0  # times the URDF's velocity limit: not a motion of this robot
ROWS_PER_PARAMETER = 3.0
POOR = 0.5  # torque error above which units or ratios are likelier wrong than the fit poor


def check_channels(channels: Sequence[Channels], model: RobotModel) -> None:
    """Refuse recordings without what a fit needs: every joint, every sample, a torque."""
    names = model.joint_names
    if not channels:
        raise NotIdentifiableError("there is no stretch of recording without gaps", "one or more")
    if len({part.rate for part in channels}) != 1:
        raise NotIdentifiableError(
            "the stretches of the recording have different rates", "one rate for all"
        )
    for part in channels:
        if part.joint_position.shape[1] != len(names):
            raise NotIdentifiableError(
                f"the recording has {part.joint_position.shape[1]} joints",
                f"{len(names)} as the model: {', '.join(names)}",
            )
        for what, values in (("position", part.joint_position), ("torque", part.motor_torque)):
            whole = np.atleast_1d(np.isfinite(values).all(axis=0)).tolist()
            bad = [name for name, ok in zip(names, whole, strict=True) if not ok]
            if bad:
                raise NotIdentifiableError(
                    f"the {what} of {', '.join(bad)} is missing or has gaps",
                    "a number at every sample",
                    f"record the {what} of every joint",
                )
    torque = np.concatenate([part.motor_torque for part in channels])
    dead = [n for n, span in zip(names, np.ptp(torque, axis=0), strict=True) if span == 0.0]
    if dead:
        raise NotIdentifiableError(
            f"the torque of {', '.join(dead)} never changes",
            "measured motor torque of every joint",
            "check which column or topic holds it",
        )


def check_motion(rows: Observations, robot: Robot, filters: Filters) -> None:
    """Refuse joints that stand, or move as no robot does."""
    speed = np.abs(rows.motion.joint_velocity).max(axis=0)
    still = [
        n for n, v in zip(robot.joint_names, speed, strict=True) if v < filters.standing_velocity
    ]
    if still:
        raise NotIdentifiableError(
            f"no motion faster than {filters.standing_velocity:g} rad/s of {', '.join(still)}",
            "motion of every joint",
            "record an excitation trajectory of all joints",
        )
    fast = [
        f"{n} ({v:.3g} rad/s)"
        for n, v, limit in zip(robot.joint_names, speed, robot.limits.velocity, strict=True)
        if v > MAX_SPEED_RATIO * limit
    ]
    if fast:
        raise NotIdentifiableError(
            f"motion over {MAX_SPEED_RATIO:g} times faster than the URDF allows: {', '.join(fast)}",
            "positions in rad and m, at the rate they were recorded",
            "check units, gear ratios and rate",
        )


def check_length(rows: Observations) -> None:
    """Refuse what the filter lets too little through of: two independent rows per period."""
    available = float(rows.used.sum()) * 2.0 / ROWS_PER_RATE
    wanted = ROWS_PER_PARAMETER * len(rows.names)
    if available < wanted:
        needed = math.ceil(rows.duration * wanted / max(available, 1.0))
        raise NotIdentifiableError(
            f"{rows.duration:.1f} s of recording hold {available:.0f} independent torques in "
            f"motion for {len(rows.names)} parameters",
            f"at least {wanted:.0f}",
            f"record at least {needed} s of motion",
        )


def poorly_known(base: BaseParameters, result: Fit, prior: Prior) -> tuple[str, ...]:
    """Return groups of links whose 95 % interval exceeds the prior's standard deviation."""
    count = len(prior.std)
    expected = np.sqrt((base.matrix[:, :count] * prior.std) ** 2 @ np.ones(count))
    weak = (base.independent < count) & (result.interval() > expected)
    return tuple(label for label, bad in zip(base.labels, weak.tolist(), strict=True) if bad)


def temperature_remark(model: RobotModel) -> str:
    """Return what becomes of friction over temperature; empty if the model had none."""
    warm = [
        joint.name
        for joint in model.joints
        if FRICTION_LAWS[joint.friction.viscous.law].follows_temperature
    ]
    if not warm:
        return ""
    return (
        f"friction of {', '.join(warm)} no longer follows the temperature: it is that of this "
        "recording; identify friction from recordings at several temperatures"
    )


def remarks(
    delay: Delay,
    delay_span: float,
    in_sample: TorqueError,
    result: Fit,
    poor: Sequence[str],
) -> list[str]:
    """Return what the user should know about a result, one sentence each.

    Args:
        delay_span: Largest delay that was tried. [s]
    """
    found: list[str] = []
    if delay.at_edge:
        found.append(
            f"the delay of the torque is at the limit of its search, {delay_span * 1e3:g} ms, and "
            "is not applied: search further with --delay; if it reaches every limit, the cause is "
            "not a delay but a filter of the drive or elastic bodies: then record faster, or "
            "leave it"
        )
    if in_sample.total > POOR:
        found.append(
            f"the fit leaves {100 * in_sample.total:.0f} % of the torque unexplained: check "
            "units, gear "
            "ratios, signs and zero offsets"
        )
    if poor:
        found.append(
            f"the recording determines less precisely than the URDF: {', '.join(poor)}; record "
            "faster and wider motion of the joints from there to the base"
        )
    half = result.interval()
    unsure = int((np.abs(result.values) < half).sum())
    if unsure:
        found.append(
            f"{unsure} of {len(half)} base parameters have a 95 % interval that contains 0, "
            "because they are small or the recording hardly determines them"
        )
    return found
