"""Robust linear regression with standard deviations that can be believed.

Residuals of a robot's torque are not white: unmodelled dynamics make neighbours alike, so
the textbook covariance is several times too small. Here it is the scatter of the fit when
one contiguous block of samples after the other is left out (jackknife over blocks), and
confidence intervals use Student's t with the number of blocks less one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_energy.blocks import Float, Int, check_shape
from robot_energy.errors import NotIdentifiableError

HUBER = 1.345  # in standard deviations: 95 % efficiency on normal residuals
MEDIAN_TO_STD = 1.4826  # of the absolute deviation of a normal variable
MAX_ROUNDS = 30
SETTLED = 1e-6  # relative change of the parameters at which the weights have settled
LEAST_INDEPENDENCE = 1e-4  # share of a column that the other columns do not explain


@dataclass(frozen=True)
class Regression:
    """Parameters of ``target = columns . values`` and how well they are known.

    Attributes:
        names: Name of each parameter.
        values: Shape (P,).
        covariance: Shape (P, P).
        blocks: Number of blocks behind the covariance.
        residual: ``target - columns . values``, shape (N,).
        weight: Huber weight of each sample, 0 to 1, shape (N,).
    """

    names: tuple[str, ...]
    values: Float
    covariance: Float
    blocks: int
    residual: Float
    weight: Float

    @property
    def std(self) -> Float:
        """Standard deviations, shape (P,)."""
        return np.sqrt(np.diag(self.covariance))

    def interval(self, confidence: float = 0.95) -> Float:
        """Half widths of the confidence intervals of the parameters.

        Args:
            confidence: In (0, 1).

        Returns:
            Shape (P,).
        """
        from scipy.stats import t

        return self.std * float(t.ppf(0.5 + 0.5 * confidence, max(self.blocks - 1, 1)))


def regress(
    columns: Float,
    target: Float,
    block: Int,
    names: Sequence[str],
    robust: bool = True,
    what: str = "the data",
) -> Regression:
    """Fit by least squares, with Huber weights against outliers unless told otherwise.

    Args:
        columns: Shape (N, P), finite.
        target: Shape (N,), finite.
        block: Number of the contiguous block that each sample belongs to, shape (N,).
        names: Name of each parameter, for messages.
        robust: Whether to weight outliers down (iteratively reweighted least squares).
        what: What the data are, for messages.

    Returns:
        The fit.

    Raises:
        ShapeError: If shapes do not fit.
        NotIdentifiableError: If the data do not excite a parameter; names it.
    """
    n_samples = len(columns)
    check_shape("target", target, (n_samples,))
    _require_excitation(columns, names, what)
    base, triangle = np.linalg.qr(columns)  # orthonormal, so that squares lose nothing
    weight = np.ones(n_samples)
    inner = base.T @ target
    for _ in range(MAX_ROUNDS if robust else 0):
        residual = target - base @ inner
        scale = MEDIAN_TO_STD * float(np.median(np.abs(residual - np.median(residual))))
        if scale == 0.0:
            break
        weight = np.minimum(1.0, HUBER * scale / np.maximum(np.abs(residual), 1e-300))
        before, inner = inner, _solve(base, target, weight)
        if np.linalg.norm(inner - before) <= SETTLED * np.linalg.norm(inner):
            break
    values = np.linalg.solve(triangle, inner)
    residual = target - columns @ values
    covariance, blocks = _covariance(columns, residual, weight, block)
    return Regression(tuple(names), values, covariance, blocks, residual, weight)


def _solve(base: Float, target: Float, weight: Float) -> Float:
    weighted = base * weight[:, None]
    return np.linalg.solve(weighted.T @ base, weighted.T @ target)


def _covariance(columns: Float, residual: Float, weight: Float, block: Int) -> tuple[Float, int]:
    """Scatter of the parameters when one block after the other is left out (jackknife).

    Leaving out block g moves the fit by ``-(A - A_g)^-1 s_g``, where s is the sum of
    columns times weighted residuals and A its slope: a sample whose weight is already
    reduced pulls no harder when it moves away, so it does not count in A.
    """
    _, index = np.unique(block, return_inverse=True)
    order = np.argsort(index, kind="stable")
    edges = np.flatnonzero(np.diff(index[order])) + 1
    parts = [
        (columns[rows], weight[rows], residual[rows]) for rows in np.split(order, edges.tolist())
    ]
    slope = np.stack([(part * (given == 1.0)[:, None]).T @ part for part, given, _ in parts])
    pull = np.stack([part.T @ (given * rest) for part, given, rest in parts])
    blocks, n_parameters = pull.shape
    whole: Float = slope.sum(axis=0)
    if blocks == 1:  # one block says nothing of its own scatter: white residuals are assumed
        degrees = max(len(residual) - n_parameters, 1)
        return np.linalg.inv(whole) * float((weight * residual) @ residual) / degrees, 1
    change = np.empty((blocks, n_parameters))
    for number in range(blocks):
        try:
            change[number] = np.linalg.solve(whole - slope[number], pull[number])
        except np.linalg.LinAlgError:  # this block alone tells some parameter
            change[number] = np.inf
    with np.errstate(invalid="ignore"):
        covariance = change.T @ change * (blocks - 1) / blocks
    return np.where(np.isnan(covariance), np.inf, covariance), blocks


def _require_excitation(columns: Float, names: Sequence[str], what: str) -> None:
    """Refuse columns that are zero, or that the others explain but for rounding."""
    length = np.linalg.norm(columns, axis=0)
    weak = [name for name, size in zip(names, length, strict=True) if not size > 0.0]
    if len(columns) < columns.shape[1]:
        weak = list(names)
    if not weak:
        _, size, direction = np.linalg.svd(np.linalg.qr(columns / length, mode="r"))
        inverse = direction.T / np.maximum(size, np.finfo(float).tiny)
        unexplained = 1.0 / np.linalg.norm(inverse, axis=1)
        weak = [
            name
            for name, share in zip(names, unexplained, strict=True)
            if share < LEAST_INDEPENDENCE
        ]
    if weak:
        raise NotIdentifiableError(
            f"{what} do not tell apart {', '.join(weak)}",
            "motion that changes each of them on its own",
            "record motions at several speeds and in both directions",
        )
