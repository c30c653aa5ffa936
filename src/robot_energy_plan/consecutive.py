"""Blocks joined across the steps of a pipeline, for sums over the time between two samples."""

from __future__ import annotations

import numpy as np

from robot_energy.timeline.blocks import NANOSECOND, Float, PowerBlock


class ConsecutiveBlocks:
    """Puts the last row of the block before in front of each block."""

    def __init__(self) -> None:
        self._last: PowerBlock | None = None

    def joined(self, block: PowerBlock) -> tuple[PowerBlock, Float]:
        """Return the block with that row in front, and the time from each row to the next.

        Args:
            block: In time order, shape (N,).

        Returns:
            Block of shape (N + 1,), of (N,) the first time; times of shape one less, 0 where a
            gap divides two rows. [s]
        """
        if self._last is not None:
            block = PowerBlock.concatenate([self._last, block])
        self._last = block[slice(len(block) - 1, None)]
        time = np.diff(block.stamp_ns) * NANOSECOND
        return block, np.where(np.diff(block.segment) == 0, time, 0.0)
