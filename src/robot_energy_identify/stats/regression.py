"""Robust linear regression with standard deviations that can be believed.

Residuals of a robot's torque or power are alike from row to row, so N rows hold far fewer
independent ones and the textbook covariance is several times too small. What it is instead
is an argument of the fit: `jackknife` takes the scatter of the parameters when one contiguous
block after the other is left out; `autocorrelated` is ``(X'X)^-1 X' Omega X (X'X)^-1`` with Omega
the autocovariance of the residuals. A scatter from few blocks is itself uncertain, so it counts as
Student's t says (`student`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import field
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from robot_energy.certainty.deviation import MEDIAN_TO_STD
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError, check_shape
from robot_energy.timeline.blocks import Float, Int

Method = Literal["ols", "wls", "irls"]
HUBER = 1.345  # standard deviations; 95 % efficiency on normal residuals
WEIGHTINGS = 2  # times that noise of each joint is found and weights follow it
MAX_ROUNDS = 30  # of the Huber weights
SETTLED = 1e-6  # relative change of what is fitted at which the weights have settled
ROUGHLY = 1e-4  # the same for a held-out prediction, whose error is a hundred times that
MIN_NOISE = 1e-12  # below which residuals are rounding
MIN_INDEPENDENCE = 1e-4  # share of a column that the other columns do not explain
CHUNK = 1_000  # rows of all targets compressed at once, so that no copy of all of them is made
CONFIDENCE = 0.95  # of the intervals at which Student's t and a normal distribution agree
SCATTER = "scatter"  # the part of a deviation that recordings show themselves


class Fit(Described):
    """Parameters of ``target = columns . values`` and how well they are known."""

    names: tuple[str, ...]
    values: Annotated[Float, "Shape (P,)."]
    covariance: Annotated[Float, "Of the values, as if normally distributed, shape (P, P)."]
    independent: Annotated[Float, "Independent rows of each target, or blocks, shape (n,)."]
    degrees: Annotated[float, "Of freedom, of the scatter."]
    residual: Annotated[Float, "Target less fitted, shape (N,) or (N, n)."]
    weight: Annotated[Float, "On each row, 0 where unused, same shape. [1/unit of the target]"]
    parts: Annotated[
        Mapping[str, Float],
        "Deviations by cause, shape (P,) each; their squares add up to the variance.",
    ] = field(default_factory=dict[str, Float])
    moves: Annotated[
        Mapping[str, Float],
        "Of the values by one deviation of constant errors, shape (P, errors) each.",
    ] = field(default_factory=dict[str, Float])

    def errors(self) -> dict[str, Float]:
        """Return moves by one deviation of independent errors by cause, shape (P, errors) each.

        Their products, with those of the scatter, sum to the covariance.
        """
        rest = self.covariance - sum(
            (moves @ moves.T for moves in self.moves.values()), np.zeros_like(self.covariance)
        )
        size, direction = np.linalg.eigh(0.5 * (rest + rest.T))
        return {SCATTER: direction * np.sqrt(np.maximum(size, 0.0)), **self.moves}

    @property
    def std(self) -> Float:
        """Standard deviations of the parameters, shape (P,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def noise(self) -> Float:
        """Standard deviation of each target's residual, 0 where unused, shape (n,)."""
        used = self.weight > 0.0
        squares = (np.where(used, self.residual, 0.0) ** 2).sum(axis=0)
        return np.sqrt(squares / np.maximum(used.sum(axis=0), 1))

    def parts_of(self, place: int) -> dict[str, float]:
        return {cause: float(part[place]) for cause, part in self.parts.items()}

    def interval(self) -> Float:
        """Return half widths of the intervals of `CONFIDENCE`, shape (P,)."""
        from scipy.special import ndtri

        return self.std * float(ndtri(0.5 + 0.5 * CONFIDENCE))


Covariance = Callable[[Float, Float, Float], tuple[Float, Float, float]]
"""Columns, residual and weight -> covariance, independent rows and degrees of freedom."""


def fit(
    columns: Float,
    target: Float,
    names: Sequence[str],
    covariance: Covariance,
    method: Method = "irls",
    used: NDArray[np.bool_] | None = None,
    base: tuple[Float, Float] | None = None,
    settled: float = SETTLED,
) -> Fit:
    """Return one set of parameters for one target or several, such as the torques of joints.

    Args:
        columns: Independent, finite, shape (N, P) or (N, n, P). [target/parameter]
        target: Finite, shape (N,) or (N, n). [any unit]
        names: Of the parameters.
        covariance: From `jackknife` or `autocorrelated`.
        method: ``ols``; ``wls``: each target weighted by the noise of its residual; ``irls``:
            with Huber weights against outliers as well.
        used: Rows of each target that count; None for all, shape of the target.
        base: QR decomposition of the columns, shapes (N, P) and (P, P) [target/parameter], where
            all rows count and it is known.
        settled: Relative change at which the weights of ``irls`` have settled. [-]
    """
    values, weight = estimate(columns, target, method, used, base, settled)
    residual = target - columns @ values
    matrix, independent, degrees = covariance(columns, residual, weight)
    matrix = matrix * student(degrees) ** 2
    parts = {SCATTER: np.sqrt(np.maximum(np.diag(matrix), 0.0))}
    return Fit(tuple(names), values, matrix, independent, degrees, residual, weight, parts)


def student(degrees: float) -> float:
    """Return by how much a deviation counts for more because it comes from a scatter itself.

    Half a 95 % interval by Student's t over that of a normal distribution.

    Args:
        degrees: Of freedom; below 1 counts as 1. [-]
    """
    from scipy.special import ndtri, stdtrit

    level = 0.5 + 0.5 * CONFIDENCE
    return float(stdtrit(max(degrees, 1.0), level) / ndtri(level))


def estimate(
    columns: Float,
    target: Float,
    method: Method = "irls",
    used: NDArray[np.bool_] | None = None,
    base: tuple[Float, Float] | None = None,
    settled: float = SETTLED,
) -> tuple[Float, Float]:
    """Return values and the weight of each row; arguments as in `fit`."""
    size = len(target)
    wide = columns.reshape(size, -1, columns.shape[-1]), target.reshape(size, -1)
    rows = np.ones(wide[1].shape, dtype=np.bool_) if used is None else used
    if method == "irls":
        values, weight = _huber(*wide, rows, base, settled)
    else:
        values, weight = _by_target(*wide, rows, 0 if method == "ols" else WEIGHTINGS)
    return values, weight.reshape(target.shape)


def _huber(
    columns: Float,
    target: Float,
    used: NDArray[np.bool_],
    known: tuple[Float, Float] | None,
    settled: float,
) -> tuple[Float, Float]:
    """Solve with weights of one over the noise times the root of the Huber weight."""
    measured = target[used]
    joint = np.nonzero(used)[1]
    every = np.unique(joint)
    groups = [joint == number for number in every] if len(every) > 1 else [slice(None)]
    # orthonormal, so that squares lose nothing
    base, triangle = np.linalg.qr(columns[used]) if known is None else known
    rows = np.ascontiguousarray(base.T)
    inner, weight = rows @ measured, np.ones(len(measured))
    for _ in range(MAX_ROUNDS):
        residual = measured - inner @ rows
        for own in groups:
            rest = residual[own]
            middle = np.median(np.abs(rest - np.median(rest)))
            noise = max(MEDIAN_TO_STD * float(middle), MIN_NOISE)
            reach = HUBER * noise / np.maximum(np.abs(rest), 1e-300)
            weight[own] = np.sqrt(np.minimum(1.0, reach)) / noise
        weighted = rows * (weight * weight)
        before, inner = inner, np.linalg.solve(weighted @ rows.T, weighted @ measured)
        if np.linalg.norm(inner - before) <= settled * np.linalg.norm(inner):
            break
    spread = np.zeros(target.shape)
    spread[used] = weight
    return np.linalg.lstsq(triangle, inner, rcond=None)[0], spread


def _by_target(
    columns: Float, target: Float, used: NDArray[np.bool_], rounds: int
) -> tuple[Float, Float]:
    """Solve with one weight per target: every target's rows are compressed only once."""
    n_targets, size = used.shape[1], columns.shape[2]
    triangles = np.zeros((n_targets, size + 1, size + 1))
    for joint, rows in enumerate(used.T):
        triangle = qr_r(np.column_stack([columns[rows, joint], target[rows, joint]]))
        triangles[joint, : len(triangle)] = triangle
    weight, values = np.ones(n_targets), _solve(triangles)
    for _ in range(rounds):
        rest = triangles @ np.append(values, -1.0)
        noise = np.sqrt((rest**2).sum(axis=1) / np.maximum(used.sum(axis=0), 1))
        weight = 1.0 / np.maximum(noise, MIN_NOISE)
        values = _solve(triangles * weight[:, None, None])
    return values, used * weight


def _solve(triangles: Float) -> Float:
    size = triangles.shape[2] - 1
    whole = qr_r(triangles.reshape(-1, size + 1))
    return np.linalg.lstsq(whole[:size, :size], whole[:size, size], rcond=None)[0]


def qr_r(rows: Float) -> Float:
    """Return R, (min(M, P), P), of a QR decomposition: ``R'R = rows' rows``, nothing squared.

    Args:
        rows: Shape (M, P). [any unit]
    """
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)  # pyright: ignore


def independent(columns: Float, least: Float) -> list[int]:
    """Return the places, in order, of the columns that those before them do not explain.

    Args:
        columns: In their own units, shape (N, P). [-]
        least: Length that must be left of each column, shape (P,). [-]
    """
    base = np.empty((len(columns), 0))
    found: list[int] = []
    for place, rest in enumerate(columns.T):
        for _ in range(2):  # once more, against the rounding of the first time
            rest = rest - base @ (base.T @ rest)
        left = float(np.linalg.norm(rest))
        if left > least[place]:
            base = np.column_stack([base, rest / left])
            found.append(place)
    return found


def factor(columns: Float, target: Float, weight: Float) -> tuple[Float, Float]:
    """Return R (K, P) and b (K,) with ``|R x - b|^2`` the weighted squares of x but for a constant.

    Args:
        columns: Shape (N, n, P). [target/parameter]
        target: Shape (N, n). [any unit]
        weight: Shape (N, n); rows of weight 0 are left out. [1/target]
    """
    size = columns.shape[2]
    triangle = np.zeros((0, size + 1))
    for first in range(0, len(columns), CHUNK):
        part = slice(first, first + CHUNK)
        rows = weight[part] != 0.0
        both = np.column_stack([columns[part][rows], target[part][rows]])
        both *= weight[part][rows][:, None]
        triangle = qr_r(both if not len(triangle) else np.concatenate([triangle, both]))
    return triangle[:size, :size], triangle[:size, size]


def jackknife(block: Int) -> Covariance:
    """Return the covariance from leaving out one contiguous block after the other.

    Leaving out block g moves the fit by ``-(A - A_g)^-1 s_g``, where s is the sum of
    columns times weighted residuals and A its slope: a row whose weight is already
    reduced pulls no harder when it moves away, so it does not count in A.

    Args:
        block: Number of the block of each row of one target, shape (N,).
    """

    def covariance(columns: Float, residual: Float, weight: Float) -> tuple[Float, Float, float]:
        _, index = np.unique(block, return_inverse=True)
        order = np.argsort(index, kind="stable")
        edges = np.flatnonzero(np.diff(index[order])) + 1
        free = np.where(weight == weight.max(), weight, 0.0)
        pulls = columns * (weight * weight * residual)[:, None]
        parts = np.split(order, edges.tolist())
        slope = np.stack(
            [(columns[part] * free[part, None] ** 2).T @ columns[part] for part in parts]
        )
        pull = np.stack([pulls[part].sum(axis=0) for part in parts])
        blocks, n_parameters = pull.shape
        whole: Float = slope.sum(axis=0)
        count = np.array([float(blocks)])
        if blocks == 1:  # one block says nothing of its own scatter: white residuals are assumed
            rest = weight * residual
            share = float(rest @ rest) / max(len(residual) - n_parameters, 1)
            return np.linalg.inv(whole) * share, count, 0.0
        try:
            change = np.linalg.solve(whole - slope, pull[..., None])[..., 0]
        except np.linalg.LinAlgError:  # some block alone determines some parameter
            change = np.full((blocks, n_parameters), np.inf)
            for number in range(blocks):
                with suppress(np.linalg.LinAlgError):
                    change[number] = np.linalg.solve(whole - slope[number], pull[number])
        with np.errstate(invalid="ignore"):
            scatter = change.T @ change * (blocks - 1) / blocks
        return np.where(np.isnan(scatter), np.inf, scatter), count, blocks - 1.0

    return covariance


def _undeviated(columns: Float, residual: Float, weight: Float) -> tuple[Float, Float, float]:
    """NaN for each: a fit that only predicts what was held out needs no covariance."""
    size = columns.shape[-1]
    return np.full((size, size), np.nan), np.full(1, np.nan), float("nan")


def regress(
    columns: Float,
    target: Float,
    block: Int,
    names: Sequence[str],
    method: Method = "irls",
    what: str = "the data",
    deviations: bool = True,
    base: tuple[Float, Float] | None = None,
) -> Fit:
    """Return the fit of one target with deviations from blocks; refuse columns that are alike.

    Columns, target and their decomposition as in `fit`; blocks are contiguous.
    """
    check_shape("target", target.shape, (len(columns),))
    known = np.linalg.qr(columns) if base is None else base
    _require_excitation(columns, known[1], names, what)
    if not deviations:
        return fit(columns, target, names, _undeviated, method, base=known, settled=ROUGHLY)
    return fit(columns, target, names, jackknife(block), method, base=known)


def _require_excitation(columns: Float, triangle: Float, names: Sequence[str], what: str) -> None:
    """Refuse columns that are zero, or that the others explain but for rounding."""
    length = np.linalg.norm(columns, axis=0)
    weak = [name for name, size in zip(names, length, strict=True) if not size > 0.0]
    if len(columns) < columns.shape[1]:
        weak = list(names)
    if not weak:
        _, size, direction = np.linalg.svd(triangle / length)
        inverse = direction.T / np.maximum(size, np.finfo(float).tiny)
        unexplained = 1.0 / np.linalg.norm(inverse, axis=1)
        weak = [
            name for name, share in zip(names, unexplained, strict=True) if share < MIN_INDEPENDENCE
        ]
    if weak:
        raise NotIdentifiableError(
            f"{what} do not distinguish {', '.join(weak)}",
            "motion that changes each of them on its own",
            "record motions at several speeds and in both directions",
        )


MAX_LAG_SHARE = 0.25  # of a recording: longest autocorrelation taken into account


def autocorrelated(segment: Int) -> Covariance:
    """Return the covariance from the autocorrelation of each target's residuals.

    What comes before the autocorrelation first falls to zero is signal, the rest is chance
    (initial positive sequence).

    Args:
        segment: Number of the uninterrupted stretch of each row, shape (N,).
    """

    def covariance(columns: Float, residual: Float, weight: Float) -> tuple[Float, Float, float]:
        n_targets, n_values = residual.shape[1], columns.shape[2]
        triangle, _ = factor(columns, residual, weight)
        inverse = np.linalg.pinv(triangle)
        inverse = inverse @ inverse.T
        middle, independent = np.zeros((n_values, n_values)), np.zeros(n_targets)
        for joint in range(n_targets):
            rows = weight[:, joint] > 0.0
            count = int(rows.sum())
            if not count:
                continue
            rest = np.where(rows, weight[:, joint] * residual[:, joint], 0.0)
            own = columns[:, joint] * weight[:, joint, None]
            taken = float(((own @ inverse) * own).sum())  # leverage
            shares = _autocorrelation(rest, rows, segment)
            independent[joint] = count / (1.0 + 2.0 * float(shares[1:].sum()))
            # Parameters eat part of the residuals; of correlated ones, a larger part.
            left = max(independent[joint] - taken, 0.25 * independent[joint], 1.0)
            variance = float(rest @ rest) / count * independent[joint] / left
            middle += variance * _correlated(own, shares, segment)
        degrees = float(independent.sum()) - n_values
        return inverse @ middle @ inverse, independent, degrees

    return covariance


def _autocorrelation(rest: Float, rows: NDArray[np.bool_], segment: Int) -> Float:
    """Autocorrelation of one target's residuals from lag 0 to before it is first not positive."""
    shares = [1.0]
    size = float(rest @ rest) / max(int(rows.sum()), 1)
    same = [np.flatnonzero(segment == number) for number in np.unique(segment)]
    longest = int(MAX_LAG_SHARE * max(len(part) for part in same))
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
    """``X' Omega X`` with Omega the autocorrelation within each segment, shape (P, P).

    Where the estimate of Omega is not a covariance, rows count for less by their number alone.
    """
    from scipy.signal import oaconvolve

    kernel = np.concatenate([shares[:0:-1], shares])[:, None]
    first = len(shares) - 1
    result = np.zeros((columns.shape[1], columns.shape[1]))
    for number in np.unique(segment):
        part = columns[segment == number]
        smeared = np.asarray(oaconvolve(part, kernel, mode="full", axes=0))
        result += part.T @ smeared[first : first + len(part)]
    result = 0.5 * (result + result.T)
    white = columns.T @ columns
    if float(np.linalg.eigvalsh(result)[0]) < -1e-9 * float(np.trace(white)):
        return white * (1.0 + 2.0 * float(shares[1:].sum()))
    return result
