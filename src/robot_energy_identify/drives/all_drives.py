"""All that recordings say of the drives: from their own power, and from one meter for all."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.certainty.priors import figure_std
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy_identify.drives.delays import (
    estimate_power_delay,
    meter_lags,
    with_delay_undone,
    with_meters_earlier,
    with_response,
)
from robot_energy_identify.drives.drive_data import DriveData, location
from robot_energy_identify.drives.drives import DrivesFit, fit_drives, with_drives
from robot_energy_identify.drives.efficiency_map import CUTOFF
from robot_energy_identify.drives.total_covariance import total_covariance
from robot_energy_identify.drives.total_power import (
    BY_LEVELS,
    HeldOutPowers,
    TotalFit,
    fan_share,
    fit_total,
    held_out_powers,
    with_total,
)
from robot_energy_identify.drives.total_sums import MIN_READINGS, Sums, resting, sums
from robot_energy_identify.stats.cross_validation import EnergyScore
from robot_energy_identify.stats.lag import Delay, applied

IDENTIFIED = "identified"
OPEN = 0.05  # probability of the rarer state of a fan, above which nobody knows whether it runs
AGREES = 2.0  # deviations between the power of a fan by its step and by all readings


class TotalFound(Described):
    """What one meter for all drives determines."""

    data: Sums
    fit: TotalFit
    held_out: Annotated[str, "``recordings`` or ``blocks``."]
    scores: Annotated[dict[str, EnergyScore], "On held-out data, by way."]
    delay: Annotated[
        Delay | None,
        "Of the meter behind the joint states; undone where it is sure. None where it cannot "
        "be determined, or was known before.",
    ] = None
    low_pass: Annotated[Delay | None, "Time constant of a low pass in the meter; likewise."] = None
    fan_power: Annotated[
        float | None,
        "Of the fan that a step in these recordings shows, by all readings; None without one. [W]",
    ] = None
    fan_test: Annotated[
        tuple[tuple[EnergyScore, EnergyScore], ...],
        "Scores of identified losses with that fan and without it: of all readings, and of those "
        "at rest; empty without a fan.",
    ] = ()


class DrivesFound(Described):
    """What recordings say of the drives."""

    drives: Annotated[DrivesFit | None, "From the power of each drive; None without."]
    total: Annotated[TotalFound | None, "From one meter for all; None without."]
    delay: Annotated[
        Delay | None, "Of the power of the drives behind the joint states; undone where it is sure."
    ] = None

    def write(self, model: RobotModel, source: str) -> tuple[RobotModel, list[str]]:
        """Return a model with these drives, and what was decided without data."""
        if self.total is not None:
            model = with_response(model, self.total.low_pass, self.total.delay, source)
        if self.drives is not None:
            changed = with_drives(model, self.drives, source)
            return changed, _unfitted(model, changed.drive)
        if self.total is not None:
            changed, notes = with_total(
                model,
                self.total.fit,
                self.total.data.location,
                source,
                self.total.data.sensors.std.meter,
            )
            fan = changed.cabinet.fan
            if fan is not None and self.total.fan_power is not None:
                power = fan.power.model_copy(update={"value": self.total.fan_power})
                if power != fan.power:
                    notes.append(
                        "the power of the fan is fitted to all readings of the meter: "
                        f"{power.value:.1f} W ({fan.power.value:.1f} W before)"
                    )
                fan = fan.model_copy(update={"power": power})
                changed = changed.changed(cabinet=changed.cabinet.model_copy(update={"fan": fan}))
            known = total_covariance(self.total.data, self.total.fit, changed, model, source)
            changed = changed.changed(covariance=known)
            return changed, [*_unfitted(model, changed.drive), *notes]
        return model, []


def find_drives(
    data: DriveData,
    model: RobotModel | None,
    source: str = "",
    cutoff: float = CUTOFF,
    in_time: bool = False,
) -> DrivesFound:
    """Return what the power of each drive and the meter say of the drives.

    Args:
        model: Of the robot; None for a log.
        cutoff: Of the low-pass of the maps. [Hz]
        in_time: Whether delay and low pass of the meters are known and undone.
    """
    drives = delay = None
    if data.usable.any():
        delay = estimate_power_delay(data)
        if delay is not None:
            data = with_delay_undone(data, delay.applied)
        drives = fit_drives(data, source, cutoff)
    total = None
    if location(data) is not None:
        low_pass = lag = None
        if not in_time:
            low_pass, lag = meter_lags(partial(with_meters_earlier, data, 0.0))
        data = with_meters_earlier(data, applied(lag), applied(low_pass))
        pieces = sums(data, model)
        here = model is not None and pieces.fan is not None and _found_here(model, source)
        if model is not None and here:
            pieces = pieces.rows(fan_known(pieces, model))
        fit = fit_total(pieces)
        fan_power, whole = None, None
        if model is not None and here:
            pieces, fan_power = _with_fan_fitted(pieces, fit, model)
            fit = fit_total(pieces)
            assert pieces.fan is not None
            whole = replace(pieces, measured=pieces.measured + pieces.fan, fan=None)
        found = held_out_powers(pieces, model, fit)
        tested = ()
        if model is not None and whole is not None:
            tested = fan_test(found, held_out_powers(whole, None), resting(pieces, model))
        total = TotalFound(
            pieces, fit, found.kind, found.scores(), lag, low_pass, fan_power, tested
        )
    if drives is None and total is None:
        raise NotIdentifiableError(
            "the recordings have neither the power of the drives nor a power meter",
            "measured electrical power, with torque and speed",
            "name the topic of the drives with --drive-power, or record the meter's topic",
        )
    return DrivesFound(drives, total, delay)


def _found_here(model: RobotModel, source: str) -> bool:
    """Whether the recordings of this source show the fan of a model."""
    fan = model.cabinet.fan
    if fan is None or fan.power.tag != "identified" or not source:
        return False
    return fan.power.source in (source, BY_LEVELS + source)


def fan_known(pieces: Sums, model: RobotModel) -> NDArray[np.bool_]:
    """Return readings of which is known whether a fan that its step shows runs, shape (K,).

    Half of it would be taken off the others: all of a recording that begins near its start is then
    off by that, and what predicts it is judged wrongly. All where too few are left, or where levels
    of recordings show the fan, as their temperatures are within its deviation.
    """
    fan = model.cabinet.fan
    assert fan is not None
    assert pieces.fan is not None
    share = pieces.fan / fan.power.value
    known = np.minimum(share, 1.0 - share) <= OPEN
    by_levels = fan.power.source.startswith(BY_LEVELS)
    return np.ones_like(known) if by_levels or known.sum() < MIN_READINGS else known


def fan_test(
    new: HeldOutPowers, old: HeldOutPowers, rest: NDArray[np.bool_]
) -> tuple[tuple[EnergyScore, EnergyScore], ...]:
    """Return scores with a fan and without it: of all readings, and of enough at rest.

    Args:
        rest: Readings at rest, where errors of motion hide no fan, shape (K,).
    """
    if IDENTIFIED not in new.ways or IDENTIFIED not in old.ways:
        return ()
    scores = [(new.score(IDENTIFIED), old.score(IDENTIFIED))]
    if rest.sum() >= MIN_READINGS:
        scores.append((new.score(IDENTIFIED, rest), old.score(IDENTIFIED, rest)))
    return tuple(scores)


def _with_fan_fitted(pieces: Sums, fit: TotalFit, model: RobotModel) -> tuple[Sums, float]:
    """Readings less a fan of the power that all of them show, and that power. [W]

    One that its step contradicts is not taken: other losses follow the temperature as well. By
    levels of recordings the power of the fan comes from all readings already.
    """
    fan = model.cabinet.fan
    assert fan is not None
    assert pieces.fan is not None
    if fan.power.source.startswith(BY_LEVELS):
        return pieces, fan.power.value
    share = fan_share(pieces, fit.structure)
    if abs(share - 1.0) * fan.power.value > AGREES * figure_std(fan.power, "loss_grid"):
        share = 1.0
    left = pieces.measured + (1.0 - share) * pieces.fan
    return replace(pieces, measured=left, fan=share * pieces.fan), share * fan.power.value


def _unfitted(model: RobotModel, written: str) -> list[str]:
    """What becomes of drives whose kind identification does not know, one sentence."""
    kind = DRIVE_MODELS[model.drive]
    if kind.fitted is not None or kind.lossless:
        return []
    return [
        f"the drive model '{kind.name}' has no fit: the drives are written as "
        f"'{written}', and its own figures stay as given"
    ]
