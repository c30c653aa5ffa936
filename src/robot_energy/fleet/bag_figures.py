"""What the sums of one bag say of each joint: friction against the model, and a wrong payload.

Both are fitted together, so that neither stands for the other: friction has the sign of the
velocity, a load keeps its sign where the joint turns back.

``y = multiplier friction_model + m p + m' i + offset``

with m' for inertia alone, whose accelerations are less certain than gravity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_energy.blocks import Float, Int
from robot_energy.fleet.joint_sums import INERTIA, MEASURED, MODEL, OFFSET, PAYLOAD, SIGN, VISCOUS

MIN_ROWS = 200  # samples of a joint in motion, below which a bag says nothing of it
TINY = 1e-6  # of the length of a column: less is taken as dependent on the others


@dataclass(frozen=True)
class BagFigures:
    """Figures of B bags.

    Attributes:
        multiplier: Measured over model friction, shape (B, n); NaN where unknown. [-]
        mass: More than the model's payload, of gravity alone, shape (B,); NaN: unknown. [kg]
    """

    multiplier: Float
    mass: Float


def bag_figures(gram: Float, rows: Int) -> BagFigures:
    """Return the figures of bags.

    Args:
        gram: Sums of products, shape (B, n, COLUMNS, COLUMNS). [units of both columns]
        rows: Samples behind them, shape (B, n).

    Returns:
        One row for each bag.
    """
    enough = rows >= MIN_ROWS
    fitted = _solved(gram, [MODEL, PAYLOAD, INERTIA, OFFSET])
    multiplier = np.where(enough & (fitted[..., 0] > 0.0), fitted[..., 0], np.nan)
    square, product, noise = _load(gram, np.maximum(rows, 1))
    weight = np.where(enough & (noise > 0.0), 1.0 / np.maximum(noise, 1e-12), 0.0)
    known = (weight * square).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mass = (weight * product).sum(axis=1) / known
    return BagFigures(multiplier, np.where(known > 0.0, mass, np.nan))


def _scaled(gram: Float) -> tuple[Float, Float]:
    """Products of columns of length 1, and the lengths; what depends on others is damped."""
    length = np.sqrt(np.maximum(np.diagonal(gram, axis1=-2, axis2=-1), 0.0))
    length = np.where(length > 0.0, length, 1.0)
    unit = gram / (length[..., :, None] * length[..., None, :])
    return unit + TINY * np.eye(gram.shape[-1]), length


def _solved(gram: Float, columns: list[int]) -> Float:
    """Coefficients of columns in a fit of the measured friction, shape (..., len(columns))."""
    unit, length = _scaled(gram[..., columns, :][..., columns])
    right = gram[..., columns, MEASURED] / length
    return np.linalg.solve(unit, right[..., None])[..., 0] / length


def _load(gram: Float, rows: Int) -> tuple[Float, Float, Float]:
    """Squares of p, its products with y, and variance of y, less friction, inertia, offset."""
    speed = gram[..., VISCOUS, :].sum(axis=-2)  # products of the velocity with all columns
    own = np.stack([gram[..., SIGN, :], speed, gram[..., INERTIA, :], gram[..., OFFSET, :]], -2)
    inner = np.stack(
        [own[..., SIGN], own[..., VISCOUS].sum(-1), own[..., INERTIA], own[..., OFFSET]], -1
    )
    unit, length = _scaled(inner)
    pair = [PAYLOAD, MEASURED]
    right = own[..., pair] / length[..., None]
    left = gram[..., pair, :][..., pair] - np.swapaxes(right, -1, -2) @ np.linalg.solve(unit, right)
    # of a gravity that hardly changes in a bag, the offset has taken all
    square = np.where(left[..., 0, 0] > 1e-4 * gram[..., PAYLOAD, PAYLOAD], left[..., 0, 0], 0.0)
    product = np.where(square > 0.0, left[..., 0, 1], 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        explained = np.where(square > 0.0, product**2 / square, 0.0)
    return square, product, np.maximum(left[..., 1, 1] - explained, 0.0) / rows
