"""Friction torque that no fit has seen: what is held out, and how far a law is off there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np

from robot_energy.model.friction_laws import LawEntry
from robot_energy.physics.friction import viscous_law
from robot_energy.timeline.blocks import Float, Int
from robot_energy_identify.friction.laws import MIN_RANGE, nuisance
from robot_energy_identify.friction.samples import FrictionData
from robot_energy_identify.stats.cross_validation import (
    HeldOut,
    Mask,
    contiguous_folds,
    folds_by_value,
    held_out,
)
from robot_energy_identify.stats.regression import Fit

HeldOutPart = Literal["temperatures", "blocks"]


def held_out_law(
    fit: Callable[[FrictionData], tuple[LawEntry, Fit]], data: FrictionData, fold: Int
) -> HeldOut:
    """Return the error of a law on folds that its fit has not seen.

    The nuisances and the offset of the test samples come from the training samples too.

    Args:
        fold: Of each sample, shape (N,).
    """
    data = replace(data, deviations=False)

    def predict(train: Mask, test: Mask) -> Float:
        return law_torque(*fit(data[train]), data[test])

    return held_out(data.friction_torque, fold, predict)


def law_torque(law: LawEntry, fit: Fit, seen: FrictionData) -> Float:
    """Return the torque of a fitted law at other samples, shape (N,). [N m]"""
    degc = np.nan_to_num(seen.motor_temperature_degc)  # without any, the law is a constant
    viscous = viscous_law(law).viscous(degc)
    return fit.values[0] * seen.sign + viscous * seen.turning + nuisance(fit, seen)


def folds_of_axis(data: FrictionData) -> tuple[HeldOutPart, Int]:
    """Return what is held out (temperatures or blocks in time) and each sample's fold, (N,)."""
    degc = data.motor_temperature_degc
    fold = folds_by_value(degc)
    if len(np.unique(fold)) < 2 or not float(np.ptp(degc)) >= MIN_RANGE:
        # One thermal state: a fold by temperature would be a few motions, perhaps all one way.
        number = np.unique(data.block, return_inverse=True)[1]
        return "blocks", contiguous_folds(int(number.max()) + 1)[number]
    return "temperatures", fold
