"""Velocity and acceleration from irregular samples, at a fixed lag.

A quadratic is fitted by least squares to the actual stamps in a window around each
sample and its slope at that sample is reported. The window reaches ``lag`` seconds
ahead, so a sample leaves once the stamps have passed it by ``lag``: the estimate is
phase-true, and the same live and in replay. Lag 0 makes a causal fit.

Where single velocities are missing, the fit goes through those that the window has. Where it
has fewer than `VELOCITIES`, or all lie on one side, positions take their place. Of positions
the window is `POSITIONS_RATIO` as long: a second derivative makes far more of their noise.

Where the window holds too few samples (slow drivers), it reaches to the nearest
neighbours instead. It never crosses a change of segment. Positions of a joint that turns
without end are followed the short way round, wherever its driver lets them begin again.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robot_energy.physics import kernels
from robot_energy.physics.equations import CACHED
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, JointBlock, Quality, mark

FULL_TURN = 2 * np.pi  # rad
POSITIONS_RATIO = 2.5  # window of positions over that of velocities [-]
NEIGHBOURS = 5  # least number of samples in a window
VELOCITIES = 3  # least number in a window for a slope


class Derivative:
    """Stage that fills in missing velocities and all accelerations.

    Measured velocities pass unchanged, and the acceleration is their slope. A missing
    velocity comes from its neighbours in time, or with them from the positions; its sample is
    flagged ``VELOCITY_DERIVED``, and so is one whose acceleration comes from positions. It
    leaves once the longer window is complete. Where the window is cut by the start, the end or
    a gap, the sample is flagged ``ACCELERATION_INCOMPLETE``; with a single sample the result is
    NaN.

    Args:
        window: Length of the window. [s]
        lag: How far the window reaches ahead; half of it by default. [s]
        wraps: Joints that turn without end, shape (n,); None: no joint does.

    Raises:
        ValueError: If the lag is negative or longer than the window.
    """

    def __init__(
        self,
        window: float = 0.02,
        lag: float | None = None,
        wraps: NDArray[np.bool_] | None = None,
    ) -> None:
        lag = window / 2 if lag is None else lag
        if not 0 <= lag <= window or window <= 0:
            raise ValueError(f"lag {lag} s; expected between 0 and the window of {window} s")
        self._short, self._long = (
            _Window(
                round(ratio * (window - lag) / NANOSECOND),
                round(ratio * lag / NANOSECOND),
                ratio * window / 2,
            )
            for ratio in (1.0, POSITIONS_RATIO)
        )
        self._least_ahead = (NEIGHBOURS - 1) // 2 if lag > 0 else 0
        self._least_behind = NEIGHBOURS - 1 - self._least_ahead
        self._wraps = wraps if wraps is not None and bool(wraps.any()) else None
        self._pending: JointBlock | None = None  # context behind plus samples not yet out
        self._done = 0  # samples of _pending that are context only
        self._turns: Float = np.empty((0, 0))  # of _pending, see _follow

    def step(self, block: JointBlock) -> list[JointBlock]:
        """Return the samples whose window is complete, one block for each segment touched."""
        out: list[JointBlock] = []
        segment = block.segment
        starts = ((segment[1:] != segment[:-1]).nonzero()[0] + 1).tolist()
        for start, stop in zip([0, *starts], [*starts, len(block)], strict=True):
            if start == stop:
                continue
            part = block[slice(start, stop)] if starts else block
            if self._pending is not None and self._pending.segment[-1] != part.segment[0]:
                out += self.flush()
            if self._wraps is not None:
                self._follow(part.joint_position, self._wraps)
            if self._pending is not None:
                part = JointBlock.concatenate([self._pending, part])
            self._pending = part
            out += self._emit(closing=False)
        return out

    def flush(self) -> list[JointBlock]:
        """Return what still waits for its window, and forget the past."""
        out = self._emit(closing=True)
        self.restart()
        return out

    def restart(self) -> None:
        """Forget all samples."""
        self._pending, self._done = None, 0

    def _follow(self, position: Float, wraps: NDArray[np.bool_]) -> None:
        """Note how many turns new positions lack since the segment began, in whole numbers."""
        first = self._pending is None
        before = position[:1] if self._pending is None else self._pending.joint_position[-1:]
        lost = np.rint(np.diff(position, axis=0, prepend=before) / -FULL_TURN)
        turns = np.cumsum(np.where(wraps & np.isfinite(lost), lost, 0.0), axis=0)
        self._turns = turns if first else np.concatenate([self._turns, self._turns[-1] + turns])

    def _emit(self, closing: bool) -> list[JointBlock]:
        buffer = self._pending
        if buffer is None:
            return []
        start, stop = self._done, len(buffer)
        if not closing:
            stop = self._complete(buffer, self._short)
        out: list[JointBlock] = []
        if stop > start:
            measured = np.isfinite(buffer.joint_velocity)
            too_few = None if measured.all() else self._too_few(buffer, measured, start, stop)
            if too_few is not None and not closing:
                later = np.flatnonzero(too_few.any(axis=1))
                later = later[later >= self._complete(buffer, self._long) - start]
                stop = start + int(later[0]) if later.size else stop
            if stop > start:
                out.append(self._differentiate(buffer, start, stop, measured, too_few))
                self._done = stop
        if self._done:  # drop what no later window reaches
            oldest = int(buffer.stamp_ns[min(self._done, len(buffer) - 1)]) - self._long.behind_ns
            reach = int(np.searchsorted(buffer.stamp_ns, oldest, side="left"))
            keep = max(0, min(reach, self._done - self._least_behind))
            self._pending = buffer[slice(keep, None)]
            self._turns = self._turns[keep:]
            self._done -= keep
        return out

    def _complete(self, buffer: JointBlock, window: _Window) -> int:
        """Return how many samples have a window that is complete."""
        stamp = buffer.stamp_ns
        within = int(np.searchsorted(stamp, int(stamp[-1]) - window.ahead_ns, side="right"))
        return min(within, len(stamp) - self._least_ahead)

    def _too_few(
        self, buffer: JointBlock, measured: NDArray[np.bool_], start: int, stop: int
    ) -> NDArray[np.bool_]:
        """Return where the short window has no velocities for a slope, shape (rows, n)."""
        rows = np.arange(start, stop)
        behind, ahead = self._reach(buffer.stamp_ns, rows, self._short)
        until = np.zeros((len(measured) + 1, measured.shape[1]), dtype=np.int64)
        np.cumsum(measured, axis=0, out=until[1:])
        before = until[rows + 1] - until[rows - behind]
        after = until[rows + ahead + 1] - until[rows]
        found = until[rows + ahead + 1] - until[rows - behind]
        one_sided = ((before == 0) & (behind > 0)[:, None]) | ((after == 0) & (ahead > 0)[:, None])
        return one_sided | (found < np.minimum(behind + ahead + 1, VELOCITIES)[:, None])

    def _reach(self, stamp: Int, rows: Int, window: _Window) -> tuple[Int, Int]:
        """Return how many samples the window of each row has behind and ahead of it."""
        low = np.searchsorted(stamp, stamp[rows] - window.behind_ns, side="left")
        high = np.searchsorted(stamp, stamp[rows] + window.ahead_ns, side="right") - 1
        low = np.maximum(np.minimum(low, rows - self._least_behind), 0)
        high = np.minimum(np.maximum(high, rows + self._least_ahead), len(stamp) - 1)
        return rows - low, high - rows

    @np.errstate(
        invalid="ignore", over="ignore", divide="ignore"
    )  # bad samples become NaN, nothing else
    def _differentiate(
        self,
        buffer: JointBlock,
        start: int,
        stop: int,
        measured: NDArray[np.bool_],
        too_few: NDArray[np.bool_] | None,
    ) -> JointBlock:
        rows = slice(start, stop)
        quality = buffer.quality[rows].copy()
        velocity = buffer.joint_velocity
        if too_few is None:
            window, acceleration = self._short, np.empty((velocity.shape[1], stop - start)).T
            if kernels.compiled is None or not kernels.compiled.slopes(
                buffer.stamp_ns, np.asfortranarray(velocity), acceleration, start, window.behind_ns,
                window.ahead_ns, self._least_behind, self._least_ahead, window.scale,
            ):  # fmt: skip
                acceleration = self._fit(buffer, start, stop, window).slope(velocity)
            velocity = velocity[rows]
        else:
            too_few, missing = too_few[: stop - start], ~measured
            velocity, acceleration = self._filled(buffer, start, stop, missing, too_few)
            derived = np.logical_or.reduce(too_few | missing[rows], axis=1)
            mark(quality, derived, Quality.VELOCITY_DERIVED)
        instants = np.arange(start, stop)
        cut = instants < self._least_behind
        cut |= instants + self._least_ahead >= len(buffer)
        if cut.any():
            mark(quality, cut, Quality.ACCELERATION_INCOMPLETE)
        return JointBlock(
            stamp_ns=buffer.stamp_ns[rows],
            segment=buffer.segment[rows],
            quality=quality,
            joint_position=buffer.joint_position[rows],
            joint_velocity=velocity,
            joint_acceleration=acceleration,
            joint_effort=buffer.joint_effort[rows],
        )

    def _filled(
        self,
        buffer: JointBlock,
        start: int,
        stop: int,
        missing: NDArray[np.bool_],
        too_few: NDArray[np.bool_],
    ) -> tuple[Float, Float]:
        """Return velocity and acceleration where velocities are missing, shapes (rows, n)."""
        rows = slice(start, stop)
        velocity = buffer.joint_velocity[rows].copy()
        acceleration = np.empty_like(velocity)
        if not bool(too_few.all()):
            alike: dict[bytes, list[int]] = {}  # joints whose velocities are missing together
            for joint in range(missing.shape[1]):
                alike.setdefault(missing[:, joint].tobytes(), []).append(joint)
            for joints in alike.values():
                gone = missing[:, joints]
                fit = self._fit(buffer, start, stop, self._short, gone[:, 0])
                known = np.where(gone, 0.0, buffer.joint_velocity[:, joints])
                acceleration[:, joints] = fit.slope(known)
                velocity[:, joints] = np.where(gone[rows], fit.value(known), known[rows])
        if bool(too_few.any()):
            position = buffer.joint_position
            if self._wraps is not None:
                position = position + FULL_TURN * self._turns
            fit = self._fit(buffer, start, stop, self._long)
            acceleration = np.where(too_few, fit.curvature(position), acceleration)
            velocity = np.where(too_few & missing[rows], fit.slope(position), velocity)
        return velocity, acceleration

    def _fit(
        self,
        buffer: JointBlock,
        start: int,
        stop: int,
        window: _Window,
        missing: NDArray[np.bool_] | None = None,
    ) -> _QuadraticFit:
        stamp = buffer.stamp_ns
        behind, ahead = self._reach(stamp, np.arange(start, stop), window)
        return _QuadraticFit(stamp, start, behind, ahead, window.scale, missing)


class _Window(NamedTuple):
    """How far the window of a sample reaches, and the unit of its times."""

    behind_ns: int
    ahead_ns: int
    scale: float  # [s]


class _QuadraticFit:
    """Weights of a local quadratic through the samples around each row.

    With ``u = (t - t_k) / scale`` and the moments ``S_p = sum u^p`` over the window, the
    normal equations of ``y = c0 + c1 u + c2 u^2`` are solved by cofactors. Sums run over
    the offsets in rising order, so a row gives the same bits in every block.
    """

    def __init__(
        self,
        stamp: Int,
        start: int,
        behind: Int,
        ahead: Int,
        scale: float,
        missing: NDArray[np.bool_] | None = None,
    ) -> None:
        instants = stamp[start : start + len(behind)]
        self._scale = scale
        offsets = np.arange(-int(behind.max()), int(ahead.max()) + 1)
        self._first, self._last = start + int(offsets[0]), start + len(behind) + int(offsets[-1])
        # u and the weights are (offsets, rows), so that every operation runs along the rows
        near = (self._part(stamp) - instants[0]).astype(np.float64)  # whole numbers, exact
        around = windows_of(near, len(instants))
        self._u = around - (instants - instants[0]).astype(np.float64)
        self._u *= NANOSECOND / scale
        shortest_behind, shortest_ahead = int(behind.min()), int(ahead.min())
        self._outside = {  # of the offsets that lie outside of some windows, which windows
            index: (offset < -behind) | (offset > ahead)
            for index, offset in enumerate(offsets.tolist())
            if missing is not None or not -shortest_behind <= offset <= shortest_ahead
        }
        count = behind + ahead + 1
        if missing is not None:
            gone = windows_of(self._part(missing), len(instants))
            for index, outside in self._outside.items():
                count -= gone[index] & ~outside
                outside |= gone[index]
        for index, outside in self._outside.items():
            self._u[index][outside] = 0.0
        self._solve(count)

    @np.errstate(divide="ignore", invalid="ignore")
    def _solve(self, count: Int) -> None:
        """Solve the normal equations of every row."""
        powers = np.empty((len(self._u), 4, len(count)))
        u, squared = powers[:, 0], powers[:, 1]
        u[:] = self._u
        np.multiply(u, u, out=squared)
        np.multiply(squared, u, out=powers[:, 2])
        np.multiply(squared, squared, out=powers[:, 3])
        s0, (s1, s2, s3, s4) = count.astype(np.float64), np.add.reduce(powers, axis=0)
        a, b, c = s2 * s4 - s3 * s3, s1 * s4 - s2 * s3, s1 * s3 - s2 * s2
        determinant = s0 * a - s1 * b + s2 * c
        d, e, f = s0 * s4 - s2 * s2, s0 * s3 - s1 * s2, s0 * s2 - s1 * s1
        bend = 1 / determinant
        self._value = (a, -b, c, determinant)
        self._slope = (-b / determinant, d / determinant, -e / determinant)
        if int(count.min()) < 3:
            few, line = count < 3, np.where(count >= 2, 1 / f, np.nan)
            bend[few] = np.nan
            for weight, linear in zip(self._slope, (-s1 * line, s0 * line, 0 * s0), strict=True):
                weight[few] = linear[few]
        self._curvature = (c * bend, -e * bend, f * bend)

    def value(self, values: Float) -> Float:
        """Return the fitted value at each row, shape (rows, n). [unit]"""
        *cofactors, determinant = self._value
        a, b, c = (cofactor / determinant for cofactor in cofactors)
        return self._weigh(values, (a, b, c))

    def slope(self, values: Float) -> Float:
        """Return the first derivative at each row, shape (rows, n). [unit/s]"""
        return self._weigh(values, self._slope) / self._scale

    def curvature(self, values: Float) -> Float:
        """Return the second derivative at each row, shape (rows, n). [unit/s^2]"""
        return self._weigh(values, self._curvature) * (2 / self._scale**2)

    def _weigh(self, values: Float, coefficients: tuple[Float, Float, Float]) -> Float:
        c0, c1, c2 = coefficients
        weight = c2 * self._u
        weight += c1
        weight *= self._u
        weight += c0
        for index, outside in self._outside.items():
            weight[index][outside] = 0.0
        part = self._part(values.T)
        clean = bool(np.isfinite(part.sum()))
        size = weight.shape[1]
        if clean and weight.size * len(part) <= CACHED:  # few calls for short blocks
            part = part if part.flags.forc else part.copy()
            near, far = part.strides
            shape, strides = (len(weight), len(part), size), (far, near, far)
            around = np.ndarray(shape, part.dtype, part, 0, strides)
            terms = np.multiply(weight[:, None, :], around, order="C")
            if terms[0].size > 1:  # rows are added one by one; of single numbers, pairs
                return np.add.reduce(terms, axis=0, initial=0.0).T
        result = np.zeros((len(part), size))
        term = np.empty_like(result)
        for index, row in enumerate(weight):
            np.multiply(row, part[:, index : index + size], out=term)
            if not clean and index in self._outside:  # NaN times 0 would still be NaN
                term[:, self._outside[index]] = 0.0
            result += term
        return result.T

    def _part(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return all samples that some row meets, last axis; any number beyond the ends."""
        size = values.shape[-1]
        inside = values[..., max(self._first, 0) : min(self._last, size)]
        if self._first >= 0 and self._last <= size:
            return inside
        part = np.zeros((*values.shape[:-1], self._last - self._first), dtype=values.dtype)
        begin = max(-self._first, 0)
        part[..., begin : begin + inside.shape[-1]] = inside
        return part


def windows_of(values: NDArray[Any], size: int) -> NDArray[Any]:
    """Return a view of every run of neighbours, shape (N - size + 1, size), as numpy's but faster.

    Args:
        values: Any quantity, contiguous, shape (N,), N >= size. [-]
    """
    step = values.strides[0]
    return np.ndarray((len(values) - size + 1, size), values.dtype, values, 0, (step, step))
