"""How torque constants fall with temperature, from measured torque in a warm-up.

A torque known by its current is read as ``tau / (1 - beta (T - 20))`` at a motor temperature T. The
torque of the bodies does not know temperature. So what is measured of it grows by ``beta`` per
kelvin, which no friction does: friction has the sign of the speed. What recordings differ in for
another reason, such as a payload, does not count: the temperature is taken from its mean in each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.figure import PositiveFigure
from robot_energy.model.joint import MAX_FALL
from robot_energy.physics.equations import REFERENCE_DEGC
from robot_energy.physics.torque_constant import TorqueConstants
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_identify.bounds import identified
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.friction.samples import FrictionData, moving_samples
from robot_energy_identify.stats.regression import regress

BY_CURRENT = (EffortMeaning.MOTOR_TORQUE, EffortMeaning.MOTOR_CURRENT)
MIN_WARMING = 5.0  # K of a motor within one recording
SURE = 4.0  # standard deviations by which the fall must show
SCALE = 25.0  # K over which viscous friction falls, as a shape among others


class FallingConstant(Described):
    """Torque constant of one motor over its temperature."""

    name: Annotated[str, "Of the joint."]
    fall: Annotated[PositiveFigure, "Share that is lost per kelvin. [1/K]"]


def fit_fall(data: FrictionData, source: str = "") -> FallingConstant:
    """Return how the torque constant of one axis falls.

    Args:
        data: Samples of all recordings, with the torque of the bodies.

    Raises:
        NotIdentifiableError: If no recording warms the motor, or no fall is sure.
    """
    moving = moving_samples(data)
    degc, rigid = moving.motor_temperature_degc, moving.rigid
    assert rigid is not None
    number = np.unique(moving.run, return_inverse=True)[1]
    mean = np.bincount(number, degc) / np.bincount(number)
    since = degc - mean[number]
    warming = float(np.ptp(since[number == number[np.argmax(np.abs(since))]]))
    if not (warming >= MIN_WARMING and rigid.any()):
        raise NotIdentifiableError(
            f"{data.name}: its motor warms by {warming:.0f} K at most in a recording",
            f"{MIN_WARMING:g} K under the torque of the bodies, which show weaker magnets",
            "record one warm-up from a cold start",
        )
    sign, speed, ones = moving.sign, moving.motor_velocity, np.ones(len(moving))
    middle = (degc - float(degc.mean())) / SCALE
    friction = (
        *(sign, sign * middle, sign * np.abs(rigid), sign * np.abs(rigid) * middle),
        *(speed, speed * middle, speed * np.exp(-middle)),
        *(sign * np.sqrt(np.abs(speed)), ones, middle),
    )
    columns = np.column_stack([rigid * since, rigid, *friction])
    names = ["fall", "bodies", *(f"friction {place}" for place in range(len(friction)))]
    what = f"the motions of {data.name}"
    fit = regress(columns, moving.friction_torque, moving.block, names, "irls", what)
    middle_degc = float(np.average(degc, weights=rigid**2))
    slope = float(fit.values[0] / (1.0 + fit.values[1]))  # over what is read at that temperature
    fall = slope / (1.0 + slope * (middle_degc - REFERENCE_DEGC))
    std = float(fit.std[0])
    if not SURE * std < fall <= MAX_FALL:
        raise NotIdentifiableError(
            f"{data.name}: the measured torque of its bodies grows by {100 * fall:.3f} +- "
            f"{100 * std:.3f} % per kelvin",
            f"more than {SURE:g} deviations and at most {100 * MAX_FALL:g} %, as of weaker magnets",
            "its torque constant stays the same at every temperature",
        )
    return FallingConstant(data.name, identified(fall, std, source))


def find_falls(
    recordings: Sequence[Recording], axes: Sequence[FrictionData], source: str
) -> tuple[FallingConstant, ...]:
    """Return the torque constants that fall, of axes whose torque is known by a current."""
    found: list[FallingConstant] = []
    for axis in axes if _by_current(recordings) else ():
        try:
            found.append(fit_fall(axis, source))
        except NotIdentifiableError:
            continue
    return tuple(found)


def with_falls(model: RobotModel, found: Sequence[FallingConstant]) -> RobotModel:
    """Return a model with torque constants that fall; others stay as they are."""
    falls = {one.name: one.fall for one in found}
    return model.with_joints("torque_constant_fall", falls) if falls else model


def at_shaft(recordings: Sequence[Recording], model: RobotModel) -> list[Recording]:
    """Return recordings whose measured torque is that of the shaft, not that of the current.

    They stay as they are where no torque constant falls, or torque is known without a current.
    """
    constants = TorqueConstants.of(model)
    if constants is None or not _by_current(recordings):
        return list(recordings)
    return [
        replace(
            part,
            torque=replace(
                part.torque,
                motor_torque_measured=part.torque.motor_torque_measured
                * constants.left(part.power.motor_temperature_degc),
            ),
        )
        for part in recordings
    ]


def _by_current(recordings: Sequence[Recording]) -> bool:
    """Whether all recordings know their torque by a current."""
    return all(one.replay is not None and one.replay.effort in BY_CURRENT for one in recordings)
