"""Which parameters a robot's torque can determine, alone or in groups (base parameters).

Columns of the regressor that others explain belong to parameters that are only known
together. A rank-revealing QR decomposition of the columns finds them (paper B, 4.3.1).
Columns are never scaled to unit length first: a column that is nothing but rounding would
become as long as any other and count as a parameter.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import Float, Int
from robot_energy_identify.stats.regression import independent, qr_r

ROUNDING = 1e-9  # of the largest pivot: what is below it may be rounding
SHOWN = 1e-6  # coefficients below are rounding
INDEPENDENCE = 1e-6  # share of a column, at unit length, that others must leave unexplained


class BaseParameters(Described):
    """Groups of standard parameters that the torque depends on.

    ``base = standard[independent] + relation @ standard[dependent]``.
    """

    names: Annotated[tuple[str, ...], "Of all standard parameters, shape (P,)."]
    independent: Annotated[Int, "One parameter of each group, which names it, shape (B,)."]
    dependent: Annotated[Int, "The others; without effect: zeros in ``relation``, shape (D,)."]
    relation: Annotated[Float, "Shape (B, D)."]

    def __len__(self) -> int:
        return len(self.independent)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the parameters that stand for their groups."""
        places: list[int] = self.independent.tolist()
        return tuple(self.names[index] for index in places)

    @property
    def matrix(self) -> Float:
        """Base parameters per standard parameter, shape (B, P)."""
        result = np.zeros((len(self.independent), len(self.names)))
        result[np.arange(len(self)), self.independent] = 1.0
        result[:, self.dependent] = self.relation
        return result

    @property
    def without_effect(self) -> tuple[str, ...]:
        """Standard parameters that no torque depends on."""
        free = ~(np.abs(self.relation) > SHOWN).any(axis=0)
        places: list[int] = self.dependent[free].tolist()
        return tuple(self.names[index] for index in places)

    def alone(self, name: str) -> bool:
        """Return whether a standard parameter is identified by itself."""
        if name not in self.labels:
            return False
        return not (np.abs(self.relation[self.labels.index(name)]) > SHOWN).any()

    def expression(self, group: int) -> str:
        """Return a group as a sum, such as ``Izz 2 + rotor_inertia 2 + 0.0506 m 3``."""
        text = self.names[int(self.independent[group])]
        for coefficient, index in zip(
            self.relation[group].tolist(), self.dependent.tolist(), strict=True
        ):
            if abs(coefficient) > SHOWN:
                sign = "+" if coefficient > 0 else "-"
                factor = "" if abs(abs(coefficient) - 1) < SHOWN else f"{abs(coefficient):.4g} "
                text += f" {sign} {factor}{self.names[index]}"
        return text


def numerical_rank(pivots: Float) -> int:
    """Return how many pivots are not rounding: those before the widest gap, or all.

    Args:
        pivots: Magnitudes on the diagonal of a pivoted QR decomposition, falling, shape (K,).
            [any unit]
    """
    size = np.abs(np.asarray(pivots, dtype=np.float64))
    if not len(size) or size[0] == 0.0:
        return 0
    size = np.maximum(size, np.finfo(np.float64).eps * size[0])  # below, sizes say nothing
    suspect = np.flatnonzero(size[1:] < ROUNDING * size[0])
    if not len(suspect):
        return len(size)
    gap = size[:-1] / size[1:]
    return int(suspect[np.argmax(gap[suspect])]) + 1


def base_parameters(columns: Float, names: Sequence[str]) -> BaseParameters:
    """Return the groups of parameters that columns distinguish.

    Args:
        columns: In their own units, on motion that excites everything, shape (M, P).
            [N m/parameter]
    """
    from scipy.linalg import qr

    triangle = qr_r(columns)
    pivoted: Float = np.asarray(qr(triangle, mode="r", pivoting=True)[0], dtype=np.float64)
    pivots = np.abs(np.diagonal(pivoted))
    rank = numerical_rank(pivots)
    floor = pivots[rank] if rank < len(pivots) else 0.0
    least = float(np.sqrt(pivots[rank - 1] * max(floor, np.finfo(float).tiny))) if rank else np.inf
    least = max(least, 10.0 * float(floor))
    every = np.arange(columns.shape[1], dtype=np.int64)
    chosen = np.array(independent(triangle, np.full(len(every), least))[:rank], np.int64)
    others = np.setdiff1d(every, chosen)
    relation = np.linalg.lstsq(triangle[:, chosen], triangle[:, others], rcond=None)[0]
    return BaseParameters(tuple(names), chosen, others, relation)


def not_excited(columns: Float, labels: Sequence[str]) -> tuple[str, ...]:
    """Return the groups that a recording does not determine: silent, or that others explain.

    Args:
        columns: Of independent parameters, on the recorded motion, shape (M, B). [N m/parameter]
    """
    if len(columns) < columns.shape[1]:
        return tuple(labels)
    length = np.linalg.norm(columns, axis=0)
    silent = length < ROUNDING * length.max(initial=0.0)
    names: list[str] = [name for name, weak in zip(labels, silent.tolist(), strict=True) if weak]
    heard = np.flatnonzero(~silent)
    if len(heard):
        triangle = qr_r(columns[:, heard] / length[heard])
        _, size, direction = np.linalg.svd(triangle)
        mixed = direction[size < INDEPENDENCE * size[0]]
        strength = np.abs(mixed).max(axis=0, initial=0.0)
        mixed_up: list[int] = heard[strength > 0.1].tolist()
        names += [labels[index] for index in mixed_up]
    return tuple(names)
