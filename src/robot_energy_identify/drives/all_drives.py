"""All that recordings say of the drives: from their own power, and from one meter for all."""

from __future__ import annotations

from dataclasses import field, replace
from functools import partial
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.certainty.priors import figure_std
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.results.base import Number, Result, Texts
from robot_energy.timeline.blocks import MeterLocation
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
from robot_energy_identify.drives.total_sums import COEFFICIENTS, MIN_READINGS, Sums, resting, sums
from robot_energy_identify.stats.cross_validation import EnergyScore
from robot_energy_identify.stats.lag import Delay, MeterDelay, MeterTimeConstant, applied

IDENTIFIED = "identified"
OPEN = 0.05  # probability of the rarer state of a fan, above which nobody knows whether it runs
AGREES = 2.0  # deviations between the power of a fan by its step and by all readings


class LossTerm(Result):
    """One coefficient of the loss model."""

    value: Annotated[float, "In the unit of its term."]
    std: Annotated[Number, "Standard deviation; None where it is not determined."]
    at_bound: Annotated[bool, "Whether the value came out negative and stays at 0."]


class AxisLosses(Result):
    """Losses of one drive behind one meter for all."""

    name: Annotated[str, "Name of the joint."]
    copper: Annotated[LossTerm, "Loss over squared motor torque. [W/(N m)^2]"]
    linear: Annotated[LossTerm, "Loss over motor speed. [W s/rad]"]
    quadratic: Annotated[LossTerm, "Loss over squared motor speed. [W s^2/rad^2]"]


class TotalPower(Result):
    """Losses of all drives, from one meter."""

    location: Annotated[MeterLocation, "Where the meter sits."]
    readings: Annotated[int, "Number of readings of the meter."]
    duration: Annotated[float, "Time that they cover. [s]"]
    recordings: Annotated[int, "Number of recordings that they come from."]
    structure: Annotated[str, "What the readings distinguish."]
    constant: Annotated[float, "Constant power. [W]"]
    constant_std: Annotated[Number, "[W]"]
    axes: Annotated[tuple[AxisLosses, ...], "One per joint."]
    held_out: Annotated[str, "``recordings`` or ``blocks``."]
    ways: Annotated[dict[str, EnergyScore], "Predictions of held-out readings, by way."]
    meter_delay: MeterDelay
    meter_time_constant: MeterTimeConstant
    notes: Annotated[Texts, "What the readings do not determine, one sentence each."]
    parts: Annotated[dict[str, dict[str, float]], "Of the deviations, by column and cause."]
    data: Annotated[Sums, "The readings."] = field(repr=False)
    fit: Annotated[TotalFit, "The fit behind it."] = field(repr=False)
    fan_power: Annotated[
        float | None,
        "Of the fan that a step in these recordings shows, by all readings; None without one. [W]",
    ] = field(default=None, repr=False)
    fan_test: Annotated[
        tuple[tuple[EnergyScore, EnergyScore], ...],
        "Scores of identified losses with that fan and without it: of all readings, and of those "
        "at rest; empty without a fan.",
    ] = field(default=(), repr=False)

    @classmethod
    def of(
        cls,
        data: Sums,
        fit: TotalFit,
        held_out: str,
        ways: dict[str, EnergyScore],
        low_pass: Delay | None = None,
        delay: Delay | None = None,
    ) -> TotalPower:
        """Return what a fit to the readings of one meter says, by itself and on held-out data."""
        return cls(
            location=data.location,
            readings=len(data),
            duration=float(data.duration.sum()),
            recordings=len(set(data.recording.tolist())),
            structure=fit.structure,
            constant=fit.constant,
            constant_std=fit.constant_std,
            axes=tuple(
                AxisLosses(name, *(_term(data, fit, joint, row) for row in range(3)))
                for joint, name in enumerate(data.names)
            ),
            held_out=held_out,
            ways=ways,
            meter_delay=delay,
            meter_time_constant=low_pass,
            notes=tuple(_not_determined(fit)),
            parts=fit.losses.parts,
            data=data,
            fit=fit,
        )


def _term(data: Sums, fit: TotalFit, joint: int, row: int) -> LossTerm:
    names = {f"{COEFFICIENTS[row]} of {which}" for which in (data.names[joint], "all axes")}
    return LossTerm(
        float(fit.coefficients[row, joint]),
        float(fit.deviations[row, joint]),
        bool(names & set(fit.losses.negative)),
    )


def _not_determined(fit: TotalFit) -> list[str]:
    negative, undetermined = fit.losses.negative, fit.losses.undetermined
    notes: list[str] = []
    if undetermined:
        notes.append(f"not distinguished from those before, taken as 0: {', '.join(undetermined)}")
    if negative:
        notes.append(f"at the bound 0, negative otherwise: {', '.join(negative)}")
    if fit.structure in ("shared", "axis_copper"):
        notes.append("what axes share cannot be distinguished per axis from one meter here")
    return notes


class DrivesReport(Result, name="drives"):
    """Electrical power of the drives."""

    torque: Annotated[str, "Where the torque comes from; empty if that was not asked."]
    drives: Annotated[DrivesFit | None, "Fit to the power of each drive; None without such power."]
    delay: Annotated[Delay | None, "Lag of it behind the joint states; None where unknown."]
    total: Annotated[TotalPower | None, "Fit to one meter for all drives; None without a meter."]
    notes: Annotated[Texts, "What was decided for the model file without data, one sentence each."]

    def write(self, model: RobotModel, source: str) -> tuple[RobotModel, list[str]]:
        """Return a model with these drives, and what was decided without data."""
        if self.total is not None:
            model = with_response(
                model, self.total.meter_time_constant, self.total.meter_delay, source
            )
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
    *,
    in_time: bool = False,
) -> DrivesReport:
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
            pieces = pieces[fan_known(pieces, model)]
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
        total = TotalPower.of(pieces, fit, found.kind, found.scores(), low_pass, lag)
        total = replace(total, fan_power=fan_power, fan_test=tested)
    if drives is None and total is None:
        raise NotIdentifiableError(
            "the recordings have neither the power of the drives nor a power meter",
            "measured electrical power, with torque and speed",
            "name the topic of the drives with --drive-power, or record the meter's topic",
        )
    return DrivesReport("", drives, delay, total, ())


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
