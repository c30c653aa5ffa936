"""Recordings whose friction is not that of the others, or that lack temperatures others have."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_energy.model import RobotModel
from robot_energy.physics.friction import FrictionModel
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.friction.friction import FrictionFit, with_friction
from robot_energy_identify.friction.samples import FrictionData, moving_rows

APART = 0.1  # of the friction power of an axis: sound recordings of one plant are off by 0.05
MIN_AXES = 2  # that are so far off: one alone may be of another form than its law
LACKING = 0.1  # of the samples of a recording without a temperature, worth a sentence
MIN_RECORDINGS = 3  # before one may be left out: two sound ones are both off, by up to 0.4


def recordings_apart(
    names: Sequence[str],
    axes: Sequence[FrictionData],
    fits: Sequence[FrictionFit],
    model: RobotModel,
) -> tuple[str, ...]:
    """Return the recordings whose friction power is far from the laws, all in one sentence.

    One law for all takes up what differs in one of them, and then fits none: which is wrong does
    not show.

    Args:
        names: Of the recordings.
        axes: What the fits have seen, with the temperatures that the friction follows.
    """
    friction = FrictionModel.from_model(with_friction(model, fits, ""))
    velocity, degc, load, measured = (
        np.stack([getattr(axis, name) for axis in axes], axis=1)
        for name in ("motor_velocity", "motor_temperature_degc", "load", "friction_torque")
    )
    # without a temperature the law is a constant
    torque = friction.torque(
        velocity, friction.coulomb, friction.viscous(np.nan_to_num(degc)), motor_torque_rigid=load
    )
    fitted = {fit.name for fit in fits}
    shares = np.zeros((len(names), len(axes)))
    for joint, axis in enumerate(axes):
        if axis.name not in fitted:
            continue
        used = moving_rows(axis) & np.isfinite(torque[:, joint])
        for number in range(len(names)):
            rows = used & (axis.run == number)
            drawn, said = (
                float((one[rows, joint] * velocity[rows, joint]).sum())
                for one in (measured, torque)
            )
            shares[number, joint] = drawn / said - 1.0 if said > 0.0 else 0.0
    off = (np.abs(shares) > APART) & (len(names) > 1)
    found = [
        f"{name} ("
        + ", ".join(
            f"{axes[k].name} {100.0 * share[k]:+.0f} %" for k in np.flatnonzero(far).tolist()
        )
        + ")"
        for name, share, far in zip(names, shares, off, strict=True)
        if far.sum() >= MIN_AXES
    ]
    if not found:
        return ()
    remedy = "record temperatures in between"
    if len(names) >= MIN_RECORDINGS:
        remedy += ", or leave out one that is wrong: it puts sound ones off as well"
    return (
        f"friction power is off the laws of all recordings in {', '.join(found)}: too few "
        "temperatures for a law, or none, motor temperatures that are wrong in one of them, gears "
        "that are not as warm as motors, a payload that the model does not have, or another robot; "
        f"{remedy}",
    )


def recordings_without_temperature(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return the recordings that lack a temperature that others have, one sentence each."""
    known = [np.isfinite(part.power.motor_temperature_degc) for part in recordings]
    lacking = 1.0 - np.array([rows.mean(axis=0) for rows in known])
    lacking[:, (lacking == 1.0).all(axis=0)] = 0.0
    return tuple(
        f"{part.path.name}: no motor temperature of {', '.join(joints)} in {100.0 * row.max():.0f} "
        "% of its samples, which friction and drives leave out; check these sensors, or name their "
        "topic with --inputs"
        for part, row in zip(recordings, lacking, strict=True)
        if (joints := [part.model.joint_names[k] for k in np.flatnonzero(row > LACKING).tolist()])
    )
