"""The books: registers, comparison with the meter, phases and short-term means."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable

import numpy as np

from robot_energy.blocks import (
    Float,
    Int,
    MeterBlock,
    MeterLocation,
    Phase,
    PowerBlock,
    Quality,
)
from robot_energy.comparison import Compared, Comparison, Judgement
from robot_energy.pipeline.averaging import Averager, MeanBlock
from robot_energy.pipeline.settings import Settings
from robot_energy.registers import CABINET_REGISTERS, ExactSum, Registers
from robot_energy.shaft_comparison import ShaftComparison

BITS = tuple(int(bit) for bit in Quality)


class Ledger:
    """Integrates power and sets it beside the meter.

    Args:
        n_joints: Number of joints.
        settings: Averaging period and the meter's longest gap.

    Attributes:
        registers: Energy registers.
        comparison: Predicted beside measured energy.
        shaft: Predicted beside measured shaft energy of each joint.
        judgement: The residual of the newest minute, and what is wrong with the meter.
        peak_power: Highest predicted grid power, NaN before the first sample. [W]
        quality: How many samples carried each quality bit.
        samples: Number of power samples taken.
        on_compared: Called with what became comparable in each step, for plots.
    """

    def __init__(self, n_joints: int, settings: Settings | None = None) -> None:
        settings = settings or Settings()
        self.registers = Registers(n_joints)
        self.comparison = Comparison(
            settings.meter_max_gap,
            max_power=settings.meter_max_power,
            wraps_at=settings.meter_wraps_at,
        )
        self.judgement = Judgement(settings.meter_unit)
        self.shaft = ShaftComparison(n_joints)
        self.peak_power = float("nan")
        self.quality: Counter[int] = Counter()
        self.samples = 0
        self.on_compared: Callable[[Compared], None] | None = None
        self._unplaced: deque[PowerBlock] = deque()
        self._phase_energy = ExactSum(len(Phase))
        self._phase_ns = np.zeros(len(Phase), dtype=np.int64)
        period = settings.power_period
        self._averager = None if period is None else Averager(period)

    def measure(self, block: MeterBlock) -> None:
        """Take meter readings."""
        self.comparison.measure(block)

    def step(self, block: PowerBlock) -> MeanBlock | None:
        """Book power samples.

        Args:
            block: Power samples in time order.

        Returns:
            Means of the periods that ended, or None.
        """
        intervals = self.registers.step(block)
        shaft = self.shaft.step(block, intervals.duration_ns)
        compared = self._compare(block)
        self.judgement.step(compared)
        if self.on_compared is not None:
            self.on_compared(compared)
        self._book(
            block,
            intervals.energy[:, CABINET_REGISTERS.index("grid_import")],
            intervals.duration_ns,
        )
        if self._averager is None:
            return None
        return self._averager.step(block, intervals, shaft, compared)

    def _compare(self, block: PowerBlock) -> Compared:
        """Compare as far as possible; power waits until it is known where the meter sits."""
        location = self.comparison.location
        if location is MeterLocation.UNKNOWN:
            self._unplaced.append(block)
            now = int(block.stamp_ns[-1])
            oldest = now - self.comparison.patience_ns
            while not oldest <= int(self._unplaced[0].stamp_ns[-1]) <= now:
                self._unplaced.popleft()
            none = np.empty(0, dtype=np.int64)
            return Compared(none, none, np.empty(0), np.empty(0))
        if self._unplaced:
            block = PowerBlock.concatenate([*self._unplaced, block])
            self._unplaced.clear()
        return self.comparison.predict(block.stamp_ns, block.segment, block.power_at(location))

    def flush(self) -> MeanBlock | None:
        """Return the mean of the period that is still open."""
        return None if self._averager is None else self._averager.flush()

    def phase_energy(self, phase: Phase) -> float:
        """Predicted energy drawn from the grid in a phase. [J]"""
        return float(self._phase_energy.joule[phase])

    def phase_time(self, phase: Phase) -> float:
        """Observed time in a phase. [s]"""
        return float(self._phase_ns[phase]) * 1e-9

    def _book(self, block: PowerBlock, energy: Float, duration_ns: Int) -> None:
        self.samples += len(block)
        met = int(np.bitwise_or.reduce(block.quality))
        for bit in BITS if met else ():
            if met & bit:
                self.quality[bit] += int(((block.quality & np.uint32(bit)) > 0).sum())
        split = np.zeros((len(block), len(Phase)))
        rows = np.arange(len(block))
        split[rows, block.phase] = energy
        self._phase_energy.add(split)
        self._phase_ns += np.bincount(
            block.phase, weights=duration_ns, minlength=len(Phase)
        ).astype(np.int64)
        finite = block.grid_power[np.isfinite(block.grid_power)]
        if len(finite):
            self.peak_power = float(np.fmax(self.peak_power, finite.max()))
