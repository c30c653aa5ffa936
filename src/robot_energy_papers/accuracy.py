"""Accuracy of a predicted energy, by every definition that paper B may have meant.

The paper names an accuracy of energy and gives no formula in its text. All of these are one
less a relative error; they differ in what is integrated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from robot_energy.timeline.blocks import Float

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
        joint: Accuracy of each joint, shape (n,). [-]
        total: Accuracy of the sum of the joints' energies. [-]
        summed: Accuracy of the energy of the summed power, taken before magnitudes. [-]
        mean: Mean over the joints. [-]
    """

    joint: Float
    total: float
    summed: float
    mean: float


def energy(power: Float, duration: Float, definition: Definition) -> Float:
    """Return the integral of power, shape (...). [J]

    Args:
        power: Shape (N, ...). [W]
        duration: That each sample stands for, shape (N,). [s]
    """
    if definition == "positive":
        power = np.maximum(power, 0.0)
    elif definition != "net":
        power = np.abs(power)
    return np.asarray(np.tensordot(duration, power, axes=1))


def accuracies(predicted: Float, measured: Float, duration: Float) -> dict[Definition, Accuracy]:
    """Return how accurate a predicted power of the joints is, by all definitions.

    Args:
        predicted: Shape (N, n). [W]
        measured: Shape (N, n). [W]
        duration: That each sample stands for, shape (N,). [s]
    """
    result: dict[Definition, Accuracy] = {}
    for definition in DEFINITIONS:
        joint, total = _accuracy(predicted, measured, duration, definition)
        sums = predicted.sum(axis=1, keepdims=True), measured.sum(axis=1, keepdims=True)
        _, summed = _accuracy(*sums, duration, definition)
        result[definition] = Accuracy(joint, total, summed, float(joint.mean()))
    return result


def _accuracy(
    predicted: Float, measured: Float, duration: Float, definition: Definition
) -> tuple[Float, float]:
    """1 minus the relative error of each column, and of their sum."""
    theirs = energy(measured, duration, definition)
    if definition == "pointwise":
        error = energy(predicted - measured, duration, definition)
    else:
        error = energy(predicted, duration, definition) - theirs
    joint = 1.0 - np.abs(error) / np.abs(theirs)
    return joint, float(1.0 - abs(error.sum()) / abs(theirs.sum()))
