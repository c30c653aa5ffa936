"""Counters of samples, whose short blocks wait for a reader."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np

from accounts import steady
from robot_energy.accounting.exact_sum import SampleCounts
from robot_energy.timeline.blocks import Phase, PowerBlock, Quality

SIZE = 1500


def samples() -> PowerBlock:
    """Samples with every phase, some quality bits and a sample without a power."""
    random = np.random.default_rng(2)
    block = steady(10.0, 25.0)[slice(0, SIZE)]
    power = random.normal(100.0, 50.0, SIZE)
    power[700] = np.nan
    return replace(
        block,
        phase=random.integers(0, len(Phase), SIZE).astype(np.uint8),
        quality=random.choice([0, 1, 8, 9, int(Quality.LEARNED)], SIZE).astype(np.uint32),
        grid_power=power,
    )


def test_reading_and_cutting_change_nothing():
    block, energy = samples(), np.linspace(0.0, 2.0, SIZE)
    duration_ns = np.full(SIZE, 2_000_000)
    whole, cut = SampleCounts(), SampleCounts()
    whole.count(block, energy, duration_ns)
    for row in range(0, SIZE, 7):
        rows = slice(row, row + 7)
        undo = cut.mark()
        cut.count(block[rows], energy[rows] + 1.0, duration_ns[rows])  # taken back at once
        if row % 3 == 0:
            assert cut.samples == min(row + 7, SIZE)
            assert cut.peak_power > 0.0
        for each in undo:
            each()
        cut.count(block[rows], energy[rows], duration_ns[rows])
    for one in (whole, cut):
        assert one.samples == SIZE
        assert one.peak_power == np.nanmax(block.grid_power)
        assert one.quality == Counter(
            {bit: int(((block.quality & bit) > 0).sum()) for bit in (1, 8, int(Quality.LEARNED))}
        )
        np.testing.assert_array_equal(
            one.phase_ns, [2_000_000 * int((block.phase == phase).sum()) for phase in Phase]
        )
        for phase in Phase:
            known = math.fsum(energy[block.phase == phase])
            np.testing.assert_allclose(one.phase_energy_sum.joule[phase], known, atol=1e-6)
        learned = math.fsum(energy[(block.quality & Quality.LEARNED) > 0])
        np.testing.assert_allclose(one.learned_energy_sum.joule[0], learned, atol=1e-6)
    np.testing.assert_array_equal(whole.phase_energy_sum.remainder, cut.phase_energy_sum.remainder)
