"""Zero-order hold: a value counts from its stamp on, until the next one or until it is too old."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Int = NDArray[np.int64]


@dataclass(frozen=True)
class HeldRows:
    """What is computed at some samples only, and holds until the next one of them.

    Attributes:
        values: Shape (M, K).
        row: Which of them holds at each sample, shape (N,).
        begins: Whether it was computed at that sample, shape (N,); else it goes on, at the
            first sample of a block from the block before.
    """

    values: NDArray[np.floating[Any]]
    row: NDArray[np.int64]
    begins: NDArray[np.bool_]
    ndim = 1  # of arrays of one value per sample, which it is cut as

    def __getitem__(self, rows: slice | NDArray[np.bool_] | NDArray[np.int64]) -> HeldRows:
        """Return what holds at some of the samples."""
        return HeldRows(self.values, self.row[rows], self.begins[rows])

    @staticmethod
    def concatenate(parts: Sequence[HeldRows]) -> HeldRows:
        """Return what holds at blocks of samples, joined."""
        sizes = np.cumsum([0, *(len(part.values) for part in parts)]).tolist()
        return HeldRows(
            np.concatenate([part.values for part in parts]),
            np.concatenate([part.row + size for part, size in zip(parts, sizes, strict=False)]),
            np.concatenate([part.begins for part in parts]),
        )

    def __array__(
        self, dtype: np.dtype[Any] | None = None, copy: bool | None = None
    ) -> NDArray[Any]:
        """Return what holds at each sample, shape (N, K)."""
        return self.values[self.row].astype(dtype or np.float64, copy=False)


def taken(values: Any, rows: slice | NDArray[np.bool_] | NDArray[np.int64]) -> Any:
    """Return some samples of what a block of samples holds of one attribute.

    Args:
        rows: Which samples: a slice, a mask of shape (N,), or numbers.
    """
    if isinstance(rows, slice) or values.ndim != 2:
        return values[rows]
    places = rows.nonzero()[0] if rows.dtype == np.bool_ else rows
    return values.T.take(places, axis=1).T  # each column contiguous


def joined(values: Sequence[Any]) -> Any:
    """Return the samples of one attribute one after the other; of one per block, the first."""
    if isinstance(values[0], np.ndarray):
        if values[0].ndim != 2:
            return np.concatenate(values)
        return np.concatenate([part.T for part in values], axis=1).T  # each column contiguous
    return HeldRows.concatenate(values) if isinstance(values[0], HeldRows) else values[0]


def held_rows(times_ns: Int, at_ns: Int, max_age_ns: int | None = None) -> Int:
    """Return the row of the value that holds at each instant, shape of ``at_ns``; -1 for none.

    Args:
        times_ns: Stamps of the values, rising, shape (M,). [ns]
        at_ns: The instants, any shape. [ns]
        max_age_ns: Age beyond which a value does not hold any more; None: it never ends. [ns]
    """
    row = np.asarray(np.searchsorted(times_ns, at_ns, side="right") - 1, dtype=np.int64)
    if max_age_ns is None or not len(times_ns):
        return row
    return np.where(at_ns - times_ns[row] <= max_age_ns, row, -1)


def first_needed(times_ns: Int, oldest_ns: int) -> int:
    """Return the first value that holds at an instant or later; earlier ones can be forgotten.

    Args:
        times_ns: Stamps of the values, rising, shape (M,). [ns]
        oldest_ns: The earliest instant that may still be asked for. [ns]
    """
    return max(int(np.searchsorted(times_ns, oldest_ns, side="right")) - 1, 0)
