"""Accuracy of a predicted energy, by every definition that paper B may have meant.

The paper names an accuracy of energy and gives no formula in its text. All of these are one
less a relative error; they differ in what is integrated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from robot_energy.blocks import Float

Definition = Literal["net", "absolute", "positive", "pointwise"]
DEFINITIONS: dict[Definition, str] = {
    "net": "1 - |dE| / E, E the integral of the power, braking negative",
    "absolute": "the same, E the integral of the magnitude of the power",
    "positive": "the same, E the integral of the power where it is positive",
    "pointwise": "1 - integral of |dP| over integral of |P|: errors cannot cancel",
}


@dataclass(frozen=True)
class Accuracy:
    """Accuracy by one definition.

    Attributes:
        joint: Of each joint, shape (n,). [-]
        total: Of the sum of the joints' energies. [-]
        summed: Of the energy of the summed power, taken before magnitudes. [-]
        mean: Mean over the joints. [-]
    """

    joint: Float
    total: float
    summed: float
    mean: float


def energy(power: Float, duration: Float, definition: Definition) -> Float:
    """Integrate power.

    Args:
        power: Shape (N, ...). [W]
        duration: That each sample stands for, shape (N,). [s]
        definition: What is integrated; ``pointwise`` is taken as ``absolute``.

    Returns:
        Shape (...). [J]
    """
    if definition == "positive":
        power = np.maximum(power, 0.0)
    elif definition != "net":
        power = np.abs(power)
    return np.asarray(np.tensordot(duration, power, axes=1))


def accuracies(predicted: Float, measured: Float, duration: Float) -> dict[Definition, Accuracy]:
    """Compare predicted with measured power of the joints by all definitions.

    Args:
        predicted: Shape (N, n). [W]
        measured: Shape (N, n). [W]
        duration: That each sample stands for, shape (N,). [s]

    Returns:
        By definition.
    """
    result: dict[Definition, Accuracy] = {}
    for definition in DEFINITIONS:
        joint = _accuracy(predicted, measured, duration, definition)
        if definition == "pointwise":
            error = energy(predicted - measured, duration, definition).sum()
            total = 1.0 - error / energy(measured, duration, definition).sum()
        else:
            ours, theirs = (
                energy(power, duration, definition).sum() for power in (predicted, measured)
            )
            total = 1.0 - abs(ours - theirs) / abs(theirs)
        summed = _accuracy(
            predicted.sum(axis=1, keepdims=True),
            measured.sum(axis=1, keepdims=True),
            duration,
            definition,
        )
        result[definition] = Accuracy(joint, float(total), float(summed[0]), float(joint.mean()))
    return result


def _accuracy(predicted: Float, measured: Float, duration: Float, definition: Definition) -> Float:
    """One less the relative error of each column."""
    theirs = np.abs(energy(measured, duration, definition))
    if definition == "pointwise":
        error = energy(predicted - measured, duration, definition)
    else:
        error = np.abs(
            energy(predicted, duration, definition) - energy(measured, duration, definition)
        )
    return 1.0 - error / theirs
