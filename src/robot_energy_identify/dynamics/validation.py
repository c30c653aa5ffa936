"""Whether a recording suffices for a fit, and torque errors on data that were held out.

What makes a fit impossible is refused; what makes it doubtful is said next to the result.

Held-out data are contiguous folds. The filters smear a moment of each sample into its
neighbours, so training leaves out that moment on both sides of the fold it is tested on.

Drives filter and transport their torque on another way than positions, so the delay between the
two channels comes from the same folds. Its fits draw on the prior: without it, a short recording
leaves parameters free that take up any delay.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.friction_laws import FRICTION_LAWS
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import Float, Int
from robot_energy_identify.data.observations import ROWS_PER_RATE, Channels, Filters, Observations
from robot_energy_identify.dynamics.base_parameters import BaseParameters
from robot_energy_identify.dynamics.consistent import Prior
from robot_energy_identify.stats import cross_validation
from robot_energy_identify.stats.cross_validation import (
    Mask,
    contiguous_folds,
    relative_error,
    splits,
)
from robot_energy_identify.stats.lag import Delay, best_delay, held_out_errors
from robot_energy_identify.stats.regression import Fit, qr_r

STEPS = 10  # delays of the torque on each side of zero
MIN_GAIN = 0.01  # of the held-out error, below which a delay is not worth believing


class TorqueError(Described):
    """Norm of the torque error over the norm of the measured torque."""

    joint: Annotated[Float, "Of each joint, over its moving rows, shape (n,). [-]"]
    total: Annotated[float, "Of all joints, over their moving rows. [-]"]
    with_standstill: Annotated[float, "Of all joints, over moving and standing rows. [-]"]


class Work(Described):
    """Work of every motor over the rows that are compared."""

    net: Annotated[Float, "Integral of the power, shape (n,). [J]"]
    positive: Annotated[Float, "Integral of the power where it is positive, shape (n,). [J]"]


class HoldOutResult(Described):
    """A prediction of one recording next to what was measured in it."""

    recording: Annotated[str, "The one that was predicted."]
    trained_on: Annotated[tuple[str, ...], "Recordings of the fit; itself: its other blocks."]
    torque: Annotated[TorqueError, "Error of the model file."]
    predicted: Annotated[Work, "Work as the model file says it."]
    measured: Annotated[Work, "Work as measured."]
    least_squares: Annotated[TorqueError, "Torque error of the fit without bodies that can exist."]


class LeaveOneOut(Described):
    """Recordings of one robot, each held out once."""

    judgements: Annotated[tuple[HoldOutResult, ...], "From the others, then from own blocks."]
    refused: Annotated[tuple[str, ...], "What was not predicted, and why, one sentence each."]


def torque_error(observations: Observations, predicted: Float) -> TorqueError:
    """Return the errors of a prediction of the measured torque.

    Args:
        predicted: Joint torque, shape (N, n). [N m] or [N]
    """
    error = predicted - observations.joint_torque
    used, torque = observations.used, observations.joint_torque
    return TorqueError(
        np.array(
            [relative_error(error[rows, j], torque[rows, j]) for j, rows in enumerate(used.T)]
        ),
        relative_error(error[used], torque[used]),
        relative_error(error[observations.compared], torque[observations.compared]),
    )


def predict_held_out(
    observations: Observations, estimate: Callable[[Observations], Float], guard: float
) -> Float:
    """Return the joint torque of every fold as the others predict it, (N, n). [N m] or [N]

    Args:
        estimate: Fits the parameters of the columns to the used rows of what it is given.
        guard: Time left out of the training on both sides of the fold. [s]
    """

    def predict(train: Mask, test: Mask) -> Float:
        values = estimate(replace(observations, used=observations.used & train[:, None]))
        return observations.regressor[test] @ values

    reach = round(guard * observations.rate)
    return cross_validation.predict_held_out(folds_of(observations), predict, reach)


def folds_of(observations: Observations) -> Int:
    """Return the fold of each row, shape (N,); what is not compared goes with its neighbours."""
    place = np.cumsum(observations.compared) - 1
    count = int(observations.compared.sum())
    return contiguous_folds(count)[np.clip(place, 0, count - 1)]


def estimate_delay(
    observations: Observations, weight: Float, prior: Prior, span: float, guard: float
) -> Delay:
    """Return the delay of the torque, by cross-validation.

    Args:
        weight: Of each joint, shape (n,), one over the noise of an independent row. [1/(N m)]
        span: Delays from minus to plus this are tried. [s]
        guard: Time left out next to each fold. [s]
    """
    delays = np.linspace(-span, span, 2 * STEPS + 1)
    torque = np.stack([observations.advanced(float(d)).joint_torque for d in delays], axis=2)
    reach = int(np.ceil(span * observations.rate))
    row, segment = np.arange(len(observations.segment)), observations.segment
    starts, ends = (np.searchsorted(segment, segment, side=side) for side in ("left", "right"))
    # rows whose shifted torque is measured, not held from the end of a stretch
    measured = (row - starts >= reach) & (row < ends - reach)
    used = observations.used & measured[:, None]
    pairs = list(splits(folds_of(observations), round(guard * observations.rate)))
    kept = np.logical_and.reduce([test | train for train, test in pairs])
    triangles: list[Float] = []
    for _, test in pairs:
        rows, joints = np.nonzero(used & (test & kept)[:, None])
        both = np.concatenate([observations.regressor[rows, joints], torque[rows, joints]], axis=1)
        both *= weight[joints][:, None]
        triangles.append(qr_r(both))
    # rows [parameter, value of every delay] / std of what is known, shape (K, P + D)
    known = np.isfinite(prior.std)
    rows = np.diag(np.where(known, 1.0 / np.where(known, prior.std, 1.0), 0.0))
    known = np.column_stack([rows, *[rows @ prior.values] * len(delays)])[known]
    error = held_out_errors(triangles, observations.regressor.shape[2], known)
    return best_delay(delays, error, error[:, STEPS], span, MIN_GAIN)


MAX_SPEED_RATIO = 3.0  # times the URDF's velocity limit: not a motion of this robot
ROWS_PER_PARAMETER = 3.0
POOR = 0.5  # torque error above which units or ratios are likelier wrong than the fit poor


def check_channels(channels: Sequence[Channels], model: RobotModel) -> None:
    """Refuse recordings without what a fit needs: every sample, a torque."""
    names = model.joint_names
    if not channels:
        raise NotIdentifiableError("there is no stretch of recording without gaps", "one or more")
    for part in channels:
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
    delay: Delay, delay_span: float, in_sample: TorqueError, result: Fit, poor: Sequence[str]
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
