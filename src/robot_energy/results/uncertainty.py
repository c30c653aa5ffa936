"""How sure a predicted energy is, and what makes it unsure."""

from collections.abc import Sequence
from typing import Annotated

from robot_energy.accounting.account import EnergyAccount
from robot_energy.results.base import Number, Result
from robot_energy.uncertainty.band import energy_variances
from robot_energy.uncertainty.deviation import names_of


class Contribution(Result):
    """What one figure of the model, or several of one kind, add to the uncertainty."""

    name: Annotated[str, "Of the figures."]
    std: Annotated[float, "Standard deviation of the energy that they alone cause. [J]"]
    share: Annotated[Number, "Of the variance. [-]"]


class EnergyUncertainty(Result):
    """How sure the predicted net energy from the grid is."""

    std: Annotated[float, "Standard deviation from the figures of the model. [J]"]
    band: Annotated[
        str,
        "``parametric``: from that alone; ``calibrated``: scaled by the errors that a meter "
        "showed in windows of 5 s.",
    ]
    lower: Annotated[float, "Of the 90 % band. [J]"]
    upper: Annotated[float, "Of the 90 % band. [J]"]
    half_relative: Annotated[Number, "Half width over the energy. [-]"]
    readings: Annotated[int, "Of the meter that were compared with the band of power."]
    inside: Annotated[Number, "Share of them that lay within it. [-]"]
    inside_parametric: Annotated[
        Number, "The same of a band from the standard deviation alone. [-]"
    ]
    contributions: Annotated[
        tuple[Contribution, ...], "What adds how much, the largest first: what to measure next."
    ]


def uncertainty_of(account: EnergyAccount, joint_names: Sequence[str]) -> EnergyUncertainty:
    """Return how sure the predicted net energy of an account is.

    Args:
        account: Of one robot.
        joint_names: In model order.
    """
    registers, calibration, band = account.registers, account.calibration, account.energy_band
    net = registers.cabinet("grid_import") - registers.cabinet("grid_return")
    variances = energy_variances(registers.deviation)
    total = float(variances.sum())
    found = [
        Contribution(name, variance**0.5, variance / total if total else None)
        for name, variance in zip(names_of(joint_names), variances.tolist(), strict=True)
        if variance > 0
    ]
    count = calibration.readings
    return EnergyUncertainty(
        std=band.std,
        band=band.kind.name.lower(),
        lower=net - band.half,
        upper=net + band.half,
        half_relative=band.half / net if net > 0 else None,
        readings=count,
        inside=calibration.inside / count if count else None,
        inside_parametric=calibration.inside_parametric / count if count else None,
        contributions=tuple(sorted(found, key=lambda one: -one.std)),
    )
