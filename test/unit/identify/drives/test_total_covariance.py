"""Sums of losses and friction behind one meter are known, their parts much less: drawn robots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from robot_energy.certainty.deviation import Z90
from robot_energy.certainty.priors import SPREAD
from robot_energy.model import load
from robot_energy.model.schema import Covariance
from robot_energy.physics.friction import FrictionModel
from robot_energy.timeline.blocks import Float, MeterLocation
from robot_energy_identify.drives.total_covariance import total_covariance
from robot_energy_identify.drives.total_power import TotalFit, fit_total, with_total
from robot_energy_identify.drives.total_sums import Sums
from robot_energy_identify.stats.systematic import SensorLimits

MODEL = load("kr16")
NAMES = MODEL.joint_names
SIZES = np.array([[0.5], [0.02], [5e-5]]) * np.array([2.0, 2.0, 1.0, 0.5, 0.3, 0.2])
FRICTION = FrictionModel.from_model(MODEL)
COULOMB, VISCOUS = FRICTION.coulomb, FRICTION.viscous(np.full(6, 40.0))
VISCOUS_STD = SPREAD["viscous"] * VISCOUS
EXACT = SensorLimits(0.0, 0.0, 0.0, 0.0, 0.0)


def readings(random: np.random.Generator, count: int, reach: Float) -> Float:
    """Terms of motions in which each axis has a load and a speed of its own, shape (N, 3, 6)."""
    torque, speed = random.uniform(0.0, 1.0, (2, count, 6)) * reach
    torque, speed = 4.0 * torque, 250.0 * speed
    return np.stack([torque**2, speed, speed**2], axis=1)


@dataclass(frozen=True)
class Drawn:
    """Readings of a robot whose figures are off from axis to axis, and what is true of it.

    Attributes:
        friction: Coulomb torque and viscous friction over those of the model, shape (2, 6).
    """

    data: Sums
    losses: Float
    friction: Float
    random: np.random.Generator

    def errors(self, mean: Float, fit: TotalFit) -> tuple[float, float]:
        """Error of the mean power of some motion, and the true power. [W]"""
        of_speed, of_square = (self.friction - 1.0) * np.stack([COULOMB, VISCOUS])
        off = float(mean[1] @ of_speed + mean[2] @ of_square)
        losses = float((mean * self.losses).sum())
        true = 120.0 + losses + off + float(mean[1] @ COULOMB + mean[2] @ VISCOUS)
        return fit.constant + float((mean * fit.coefficients).sum()) - 120.0 - losses - off, true


def drawn(
    seed: int,
    location: MeterLocation,
    spread: float = 0.5,
    stands: bool = False,
    noise: float = 6.0,
) -> Drawn:
    """Draw a robot; the model knows the torque of its bodies, which is 0, and its own friction.

    Args:
        spread: Of the logarithm of each figure.
        stands: Whether the first axis never moves.
        noise: Of the readings. [W]
    """
    random = np.random.default_rng(seed)
    losses = SIZES * np.exp(random.normal(0.0, spread, SIZES.shape))
    friction = np.exp(random.normal(0.0, spread, (2, 6)))
    reach = random.uniform(0.3, 1.0, 6)
    reach[0] *= not stands
    terms = readings(random, 400, reach)
    of_model = terms[:, 1] @ COULOMB + terms[:, 2] @ VISCOUS
    whole = terms[:, 1] @ (friction[0] * COULOMB) + terms[:, 2] @ (friction[1] * VISCOUS)
    measured = (
        120.0 + np.einsum("krj,rj->k", terms, losses) + whole + random.normal(0.0, noise, 400)
    )
    unknown, block = np.full(400, np.nan), np.arange(400) // 10
    data = Sums(NAMES, location, np.ones(400), measured, of_model, terms, unknown, unknown,
                np.zeros(400, dtype=np.int64), block, tuple(SIZES), np.zeros((400, 6)), EXACT,
                viscous=terms[:, 2] * VISCOUS_STD)  # fmt: skip
    return Drawn(data, losses, friction, random)


def band(covariance: Covariance, mean: Float) -> tuple[float, float]:
    """Half the 90 % band of a mean power, and that of figures that err each for itself. [W]"""
    of_figures = {"loss_dc": 1.0, "loss_grid": 1.0}
    rows = (*mean, mean[1], mean[2] * VISCOUS_STD)
    terms = ("copper", "linear", "quadratic", "coulomb", "viscous")
    for term, row in zip(terms, rows, strict=True):
        of_figures |= {f"{term} of {name}": one for name, one in zip(NAMES, row, strict=True)}
    change = np.array([of_figures[name] for name in covariance.figures])
    matrix = np.array(covariance.matrix)
    whole, alone = change @ matrix @ change, change**2 @ np.diagonal(matrix)
    return Z90 * float(np.sqrt(whole)), Z90 * float(np.sqrt(alone))


def known(one: Drawn) -> tuple[TotalFit, Covariance]:
    """What the readings say, with the model as it was given."""
    fit = fit_total(one.data)
    model, _ = with_total(MODEL, fit, one.data.location, "drawn")
    covariance = total_covariance(one.data, fit, model, MODEL, "drawn")
    assert covariance is not None
    assert model.changed(covariance=covariance).covariance == covariance
    return fit, covariance


@pytest.mark.parametrize("location", [MeterLocation.DC_BUS, MeterLocation.GRID])
def test_other_motions_lie_in_the_band_of_the_covariance(location):
    errors, halves, apart = list[float](), list[float](), list[float]()
    for seed in range(10):
        one = drawn(seed, location)
        fit, covariance = known(one)
        for _ in range(5):  # motions of other axes than those that were recorded
            mean = readings(one.random, 50, one.random.uniform(0.0, 1.0, 6)).mean(axis=0)
            error, true = one.errors(mean, fit)
            half, alone = band(covariance, mean)
            errors.append(abs(error) / true)
            halves.append(half / true)
            apart.append(alone / half)
    assert np.mean(np.array(errors) <= halves) >= 0.85
    assert np.median(halves) < 2.5 * np.median(errors)  # 2.4 for normal errors
    assert np.median(apart) > 4.0  # each figure for itself would be that much wider


@pytest.mark.parametrize("noise", [1e-3, 1e-6, 1e-9, 0.0])
def test_readings_without_noise_leave_a_covariance(noise):
    """As of a simulator: what they leave open is small, and no sum of figures has less than 0."""
    _, covariance = known(drawn(2, MeterLocation.DC_BUS, noise=noise))
    size = np.diagonal(np.array(covariance.matrix))
    assert np.isfinite(size).all()
    assert (size > 0).all()


def test_an_axis_of_which_readings_say_nothing_is_as_sure_as_the_others_turn_out_to_be():
    """The figures of the others are those of the model, or off by a factor of 2."""
    halves = list[float]()
    for spread in (0.02, 0.7):
        _, covariance = known(drawn(3, MeterLocation.DC_BUS, spread, stands=True))
        mean = np.zeros((3, 6))
        mean[:, 0] = 0.0, 100.0, 1e4
        halves.append(band(covariance, mean)[0] / float(100.0 * COULOMB[0] + 1e4 * VISCOUS[0]))
    assert halves[0] < 0.2 < 0.6 < halves[1]
