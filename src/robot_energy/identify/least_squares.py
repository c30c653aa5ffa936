"""Least squares for the rows of a robot: ordinary, weighted by joint, robust.

Filtered residuals are alike from row to row, so N rows hold far fewer independent ones.
The covariance follows from the measured autocorrelation of the residuals,
``(X'X)^-1 X' Omega X (X'X)^-1`` with Omega the autocovariance of each joint's residuals;
the textbook one would be several times too small. Of the autocorrelation, what comes before
it first falls to zero is signal, the rest is chance (initial positive sequence).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import Float, Int
from robot_energy.identify.observations import Observations
from robot_energy.identify.triangle import triangle_of

Method = Literal["ols", "wls", "irls"]
METHODS: tuple[Method, ...] = get_args(Method)
HUBER = 1.345  # standard deviations; 95 % efficiency on normal residuals
ROUNDS = {"ols": 0, "wls": 2, "irls": 20}
SETTLED = 1e-6  # relative change of the fitted torque at which the weights have settled
LONGEST = 0.25  # of a recording: longest autocorrelation taken into account


@dataclass(frozen=True)
class Fit:
    """Parameters and how well they are known.

    Attributes:
        names: Of the parameters.
        values: Shape (B,).
        covariance: Shape (B, B).
        noise: Standard deviation of each joint's residual, shape (n,). [N m] or [N]
        weight: Of each row and joint in the fit, 0 where unused, shape (N, n). [1/(N m)]
        residual: Measured less fitted, shape (N, n). [N m] or [N]
        independent_rows: Effective number of independent rows of each joint, shape (n,).
    """

    names: tuple[str, ...]
    values: Float
    covariance: Float
    noise: Float
    weight: Float
    residual: Float
    independent_rows: Float

    @property
    def std(self) -> Float:
        """Standard deviations of the parameters, shape (B,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def interval(self, confidence: float = 0.95) -> Float:
        """Half widths of the confidence intervals, shape (B,)."""
        from scipy.stats import t

        degrees = max(float(self.independent_rows.sum()) - len(self.values), 1.0)
        return self.std * float(t.ppf(0.5 + 0.5 * confidence, degrees))


def fit(observations: Observations, method: Method = "wls") -> Fit:
    """Fit the parameters of the rows' columns.

    Args:
        observations: With independent columns only.
        method: ``ols``; ``wls``: each joint weighted by the noise of its residual;
            ``irls``: beside that Huber weights against outliers.

    Returns:
        The fit.
    """
    values, weight = estimate(observations, method)
    residual = observations.joint_torque - observations.regressor @ values
    return _with_covariance(observations, values, weight, residual)


def estimate(observations: Observations, method: Method) -> tuple[Float, Float]:
    """Return what `fit` does without its covariance: values and weights.

    Args:
        observations: With independent columns only.
        method: As of `fit`.

    Returns:
        Values, shape (B,), and the weight of each row and joint, shape (N, n).
    """
    if method != "irls":
        return _estimate_by_joint(observations, ROUNDS[method])
    weight = observations.used.astype(np.float64)
    values = solve(observations.regressor, observations.joint_torque, weight)
    fitted = observations.regressor @ values
    for _ in range(ROUNDS[method]):
        weight = _huber(observations.joint_torque - fitted, observations.used)
        values = solve(observations.regressor, observations.joint_torque, weight)
        before, fitted = fitted, observations.regressor @ values
        if np.linalg.norm(fitted - before) <= SETTLED * np.linalg.norm(fitted):
            break
    return values, weight


def _estimate_by_joint(observations: Observations, rounds: int) -> tuple[Float, Float]:
    """Solve with one weight per joint: every joint's rows are compressed only once."""
    used = observations.used
    n_joints, size = used.shape[1], observations.regressor.shape[2]
    triangles = np.zeros((n_joints, size + 1, size + 1))
    for joint in range(n_joints):
        rows = used[:, joint]
        both = np.column_stack(
            [observations.regressor[rows, joint], observations.joint_torque[rows, joint]]
        )
        triangle = triangle_of(both)
        triangles[joint, : len(triangle)] = triangle
    count = np.maximum(used.sum(axis=0), 1)
    weight = np.ones(n_joints)
    values = _solve_triangles(triangles)
    for _ in range(rounds):
        rest = triangles @ np.append(values, -1.0)
        noise = np.sqrt((rest**2).sum(axis=1) / count)
        weight = 1.0 / np.maximum(noise, 1e-12)
        values = _solve_triangles(triangles * weight[:, None, None])
    return values, used * weight


def _solve_triangles(triangles: Float) -> Float:
    size = triangles.shape[2] - 1
    triangle = triangle_of(triangles.reshape(-1, size + 1))
    return np.linalg.lstsq(triangle[:size, :size], triangle[:size, size], rcond=None)[0]


def solve(regressor: Float, torque: Float, weight: Float) -> Float:
    """Minimise ``sum (weight (torque - regressor . values))^2``.

    Args:
        regressor: Shape (N, n, B).
        torque: Shape (N, n). [N m] or [N]
        weight: Shape (N, n).

    Returns:
        The values, shape (B,).
    """
    triangle, target = factor(regressor, torque, weight)
    return np.linalg.lstsq(triangle, target, rcond=None)[0]


def factor(regressor: Float, torque: Float, weight: Float) -> tuple[Float, Float]:
    """Compress weighted rows to a triangle with the same sums of squares.

    Args:
        regressor: Shape (N, n, B).
        torque: Shape (N, n). [N m] or [N]
        weight: Shape (N, n); rows of weight 0 are left out.

    Returns:
        R of shape (K, B) and b of shape (K,): ``|R x - b|^2`` is the weighted sum of
        squares of x but for a constant; K is B, or less where rows are few.
    """
    rows = weight != 0.0
    scale = weight[rows][:, None]
    both = np.concatenate([regressor[rows] * scale, torque[rows][:, None] * scale], axis=1)
    triangle = triangle_of(both)
    size = regressor.shape[2]
    return triangle[:size, :size], triangle[:size, size]


def _huber(residual: Float, used: NDArray[np.bool_]) -> Float:
    """One over the noise of each joint, times the root of the Huber weight."""
    from scipy.stats import median_abs_deviation

    weight = np.zeros_like(residual)
    for joint, rows in enumerate(used.T):
        rest = residual[rows, joint]
        if len(rest):
            noise = max(float(median_abs_deviation(rest, scale="normal")), 1e-12)
            reach = HUBER * noise / np.maximum(np.abs(rest), 1e-300)
            weight[rows, joint] = np.sqrt(np.minimum(1.0, reach)) / noise
    return weight


def _with_covariance(
    observations: Observations, values: Float, weight: Float, residual: Float
) -> Fit:
    n_joints, n_values = residual.shape[1], len(values)
    triangle, _ = factor(observations.regressor, observations.joint_torque, weight)
    inverse = np.linalg.pinv(triangle)
    inverse = inverse @ inverse.T
    middle = np.zeros((n_values, n_values))
    noise, independent = np.zeros(n_joints), np.zeros(n_joints)
    for joint in range(n_joints):
        rows = weight[:, joint] > 0.0
        count = int(rows.sum())
        if not count:
            continue
        rest = np.where(rows, weight[:, joint] * residual[:, joint], 0.0)
        columns = observations.regressor[:, joint] * weight[:, joint, None]
        taken = float(((columns @ inverse) * columns).sum())  # leverage
        shares = _autocorrelation(rest, rows, observations.segment)
        inflation = 1.0 + 2.0 * float(shares[1:].sum())
        independent[joint] = count / inflation
        # Parameters eat part of the residuals; of correlated ones, a larger part.
        left = max(independent[joint] - taken, 0.25 * independent[joint], 1.0)
        variance = float(rest @ rest) / count * independent[joint] / left
        noise[joint] = float(np.sqrt(np.mean(residual[rows, joint] ** 2)))
        middle += variance * _correlated(columns, shares, observations.segment)
    covariance = inverse @ middle @ inverse
    return Fit(observations.names, values, covariance, noise, weight, residual, independent)


def _autocorrelation(rest: Float, rows: NDArray[np.bool_], segment: Int) -> Float:
    """Autocorrelation of one joint's residuals from lag 0 to before it is first not positive."""
    shares = [1.0]
    size = float(rest @ rest) / max(int(rows.sum()), 1)
    same = [np.flatnonzero(segment == number) for number in np.unique(segment)]
    longest = int(LONGEST * max(len(part) for part in same))
    for lag in range(1, longest + 1):
        total, pairs = 0.0, 0
        for part in same:
            if len(part) > lag:
                early, late = part[:-lag], part[lag:]
                total += float(rest[early] @ rest[late])
                pairs += int((rows[early] & rows[late]).sum())
        if not pairs or total <= 0.0 or size <= 0.0:
            break
        shares.append(min(total / pairs / size, 1.0))
    return np.array(shares)


def _correlated(columns: Float, shares: Float, segment: Int) -> Float:
    """``X' Omega X`` with Omega the autocorrelation within each segment, shape (B, B).

    Where the estimate of Omega is no covariance, rows count for less by their number alone.
    """
    from scipy.signal import oaconvolve

    kernel = np.concatenate([shares[:0:-1], shares])[:, None]
    result = np.zeros((columns.shape[1], columns.shape[1]))
    for number in np.unique(segment):
        part = columns[segment == number]
        result += (
            part.T
            @ np.asarray(oaconvolve(part, kernel, mode="full", axes=0))[
                len(shares) - 1 : len(shares) - 1 + len(part)
            ]
        )
    result = 0.5 * (result + result.T)
    white = columns.T @ columns
    least = float(np.linalg.eigvalsh(result)[0])
    if least < -1e-9 * float(np.trace(white)):
        return white * (1.0 + 2.0 * float(shares[1:].sum()))
    return result
