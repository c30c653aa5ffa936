"""Sums of losses behind one meter are known, their parts much less: counted on drawn robots."""

from __future__ import annotations

import numpy as np
import pytest

from robot_energy.certainty.band import Z90
from robot_energy.model import load
from robot_energy.timeline.blocks import Float, MeterLocation
from robot_energy_identify.drives.total_covariance import total_covariance
from robot_energy_identify.drives.total_power import fit_total, with_total
from robot_energy_identify.drives.total_sums import Sums
from robot_energy_identify.stats.systematic import SensorLimits

NAMES = load("kr16").joint_names
SIZES = np.array([[0.5], [0.02], [5e-5]]) * np.array([2.0, 2.0, 1.0, 0.5, 0.3, 0.2])
EXACT = SensorLimits(0.0, 0.0, 0.0, 0.0, 0.0)


def readings(random: np.random.Generator, count: int, reach: Float) -> Float:
    """Terms of motions in which each axis has a load and a speed of its own, shape (N, 3, 6)."""
    torque, speed = random.uniform(0.0, 1.0, (2, count, 6)) * reach
    torque, speed = 4.0 * torque, 250.0 * speed
    return np.stack([torque**2, speed, speed**2], axis=1)


def drawn(seed: int, location: MeterLocation) -> tuple[Sums, Float, np.random.Generator]:
    """Readings of a robot whose losses are off by about half from axis to axis, and its losses."""
    random = np.random.default_rng(seed)
    losses = SIZES * np.exp(random.normal(0.0, 0.5, SIZES.shape))
    terms = readings(random, 400, random.uniform(0.3, 1.0, 6))
    measured = 120.0 + np.einsum("krj,rj->k", terms, losses) + random.normal(0.0, 6.0, 400)
    unknown, block = np.full(400, np.nan), np.arange(400) // 10
    data = Sums(NAMES, location, np.ones(400), measured, np.zeros(400), terms, unknown, unknown,
                np.zeros(400, dtype=np.int64), block, SIZES, np.zeros((400, 6)), EXACT)  # fmt: skip
    return data, losses, random


@pytest.mark.parametrize("location", [MeterLocation.DC_BUS, MeterLocation.GRID])
def test_other_motions_lie_in_the_band_of_the_covariance(location):
    inside, halves, apart = list[bool](), list[float](), list[float]()
    for seed in range(10):
        data, losses, random = drawn(seed, location)
        fit = fit_total(data)
        model, _ = with_total(load("kr16"), fit, location, "drawn")
        covariance = total_covariance(data, fit, model, "drawn")
        assert covariance is not None
        model = model.changed(covariance=covariance)
        matrix = np.array(covariance.matrix)
        for _ in range(5):  # motions of other axes than those that were recorded
            mean = readings(random, 50, random.uniform(0.0, 1.0, 6)).mean(axis=0)
            of_figures = np.concatenate([[1.0], mean.ravel()])
            if location is MeterLocation.GRID:
                of_figures = np.append(of_figures, 1.0)
            error = fit.constant - 120.0 + float((mean * (fit.coefficients - losses)).sum())
            half = Z90 * float(np.sqrt(of_figures @ matrix @ of_figures))
            inside.append(abs(error) <= half)
            halves.append(half / (120.0 + float((mean * losses).sum())))
            apart.append(float(np.sqrt((of_figures**2 * np.diagonal(matrix)).sum())) / half)
    assert 0.8 <= np.mean(inside) <= 0.99  # 30 robots: 85 %
    assert np.median(halves) < 0.03
    if location is MeterLocation.GRID:  # each figure for itself would be that much wider
        assert np.median(apart) > 20.0
