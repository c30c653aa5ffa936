"""Constant losses of the cabinet from measured power (paper A, section II-A).

While nothing moves (HOLD) the grid delivers ``P_l,grid + P_l,DC`` and what the drives
take at rest. While the drives feed back more than the DC side uses (GENERATING) it
delivers ``P_l,grid`` alone, because the rectifier cannot return power. So the first determines
the sum and the second splits it. Rest is found from the noise of the velocities
(`robot_energy_identify.data.recordings`), braking through the model, and only readings that lie
inside one whole phase count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.certainty.priors import figure_std
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.figure import PositiveFigure
from robot_energy.timeline.blocks import NANOSECOND, Float, MeterLocation
from robot_energy.timeline.pieces import CoveredPieces
from robot_energy_identify.bounds import identified, only_the_sum
from robot_energy_identify.cabinet.fan import FanFit, FanFound
from robot_energy_identify.cabinet.phase_readings import (
    BEFORE_MOTION,
    SETTLED,
    at_rest,
    fan_power,
    holding,
    parted,
    readings_inside,
)
from robot_energy_identify.data.recordings import (
    Recording,
    with_meter,
)
from robot_energy_identify.data.rest import rest_of
from robot_energy_identify.drives.drive_data import DriveData
from robot_energy_identify.drives.total_sums import sums
from robot_energy_identify.stats.regression import SCATTER, student
from robot_energy_identify.stats.systematic import DRIVE_POWER, METER, SMALL, total

INSIDE = 10_000_000  # ns between a reading and the ends of a generating phase
CLEAR = 0.5  # of the DC loss that braking must exceed for a phase to count as generating
MIN_READINGS = 5
STORED = 0.05  # of the constant losses: what the DC link may give without being named


class Level(Described):
    """Mean power of one phase."""

    power: Annotated[float, "Less what the drives take in it. [W]"]
    std: Annotated[
        float, "Standard deviation of the mean, over events, without constant errors. [W]"
    ]
    readings: Annotated[int, "Number of readings."]
    events: Annotated[int, "Number of separate phases they come from."]
    spread: Annotated[float, "Greatest difference between events, such as of holding poses. [W]"]
    moves: Annotated[
        dict[str, float], "By one standard deviation of each constant error, by cause. [W]"
    ] = field(default_factory=dict[str, float])

    @property
    def parts(self) -> dict[str, float]:
        """Its deviations by cause. [W]"""
        return {SCATTER: self.std, **{cause: abs(move) for cause, move in self.moves.items()}}

    def less(self, other: Level) -> dict[str, float]:
        """Return the deviations of the difference; constant errors are common to both. [W]

        Args:
            other: What is taken off.
        """
        causes = {**self.moves, **other.moves}
        moves = {
            cause: abs(self.moves.get(cause, 0.0) - other.moves.get(cause, 0.0)) for cause in causes
        }
        return {SCATTER: float(np.hypot(self.std, other.std)), **moves}

    def joined(self, other: Level) -> Level:
        """Return the mean of two levels of the same power, weighted by their inverse variances.

        Where they differ by more than their scatter, the deviation is enlarged by the root of
        chi squared, of one degree of freedom (R. T. Birge, The calculation of errors by the
        method of least squares, Phys. Rev. 40, 1932).

        Args:
            other: The other level.
        """
        both, apart = self.std**2 + other.std**2, abs(self.power - other.power)
        own = other.std**2 / both if both > 0.0 else 0.5  # the weight of this one
        rest = 1.0 - own
        std = max(np.sqrt(rest) * other.std, np.sqrt(own * rest) * apart)
        moves = {
            cause: own * self.moves.get(cause, 0.0) + rest * other.moves.get(cause, 0.0)
            for cause in {**self.moves, **other.moves}
        }
        return Level(
            own * self.power + rest * other.power,
            float(std),
            self.readings + other.readings,
            self.events + other.events,
            max(self.spread, other.spread, apart),
            moves,
        )


class CabinetFit(Described):
    """Constant losses of the cabinet."""

    location: Annotated[MeterLocation, "Where the meter sits."]
    hold: Annotated[
        Level | None,
        "``P_l,grid + P_l,DC``, or ``P_l,DC`` for a meter on the DC bus; None if too few readings "
        "lie inside rest.",
    ]
    generating: Annotated[
        Level | None, "``P_l,grid``; None if it never brakes hard enough, or not at the grid."
    ]
    loss_grid: Annotated[float | None, "P_l,grid, None where the data do not determine it. [W]"]
    loss_grid_std: Annotated[
        float | None, "None too where only the sum of both losses is identifiable. [W]"
    ]
    loss_dc: Annotated[float | None, "P_l,DC. [W]"]
    loss_dc_std: Annotated[float | None, "[W]"]
    notes: Annotated[
        tuple[str, ...],
        "What the data cannot separate and what was done instead, one sentence each.",
    ]
    parts: Annotated[
        dict[str, dict[str, float]],
        "Of the deviations of ``loss_grid``, ``loss_dc`` and ``sum``, by cause. [W]",
    ] = field(default_factory=dict[str, dict[str, float]])
    fan: Annotated[FanFit | None, "Whose power is taken off; None where none was found."] = None
    fan_reason: Annotated[str, "Why none was found; empty otherwise."] = ""
    fan_likely: Annotated[
        float,
        "Power of a fan that levels of recordings show, but not surely; the deviation of the loss "
        "on the grid side holds it. [W]",
    ] = 0.0

    def with_fan(self, found: FanFound) -> CabinetFit:
        """Return the losses, with what the same recordings say of a fan."""
        return replace(self, fan=found.fan, fan_reason=found.reason, fan_likely=found.likely)


Rest = tuple[Level, tuple[str, ...]]
"""What the meter shows next to drives whose power is measured, and what that rests on."""


def fit_cabinet(recordings: Sequence[Recording], rest: Rest | None = None) -> CabinetFit:
    """Return the constant losses and what they rest on.

    Args:
        rest: Power of the meter minus the measured power of all drives, from
            `rest_of_drives`; where there is such, it is taken instead of HOLD.

    Raises:
        NotIdentifiableError: If there is no meter, or the robot neither stands still nor
            generates.
    """
    metered = with_meter(recordings)
    locations = {part.meter.location for part in metered if part.meter is not None}
    if len(locations) > 1:
        raise NotIdentifiableError(
            "the meters of the recordings sit in different places", "one place for all"
        )
    location = locations.pop()
    cabinet = metered[0].model.cabinet
    resting = [holding(part) for part in metered]
    seen = "; ".join(
        f"{part.path.name}: {rest_of(part.power.stamp_ns, rest)}"
        for part, rest in zip(metered, resting, strict=True)
    )
    why = (
        f"fewer than {MIN_READINGS} readings lie inside rest, from {SETTLED * NANOSECOND:g} s "
        f"after a motion to {BEFORE_MOTION * NANOSECOND:g} s before the next ({seen})"
    )
    if rest is not None:
        hold: Level | None = rest[0]
    else:
        rested = [at_rest(*entry) for entry in zip(metered, resting, strict=True)]
        rested = [
            (rows, power - fan_power(part, rows))
            for part, (rows, power) in zip(metered, rested, strict=True)
        ]
        hold = _level(rested, metered[0].sensors.std.meter)
    generating = None
    if location is MeterLocation.GRID and cabinet.regeneration_efficiency is None:
        fed = [readings_inside(part, _feeding(part), INSIDE, INSIDE) for part in metered]
        less_fan = [
            (rows, rows.mean_power - fan_power(part, rows))
            for part, rows in zip(metered, fed, strict=True)
        ]
        generating = _level(less_fan, metered[0].sensors.std.meter)
    if hold is None and generating is None:
        raise NotIdentifiableError(
            f"{why}, and none inside hard braking",
            "both",
            "record at least ten seconds of rest with active drives, and fast motions",
        )
    fit = _split(location, hold, generating, metered[0].model, why)
    return fit if rest is None else replace(fit, notes=(*rest[1], *fit.notes))


def rest_of_drives(data: DriveData, model: RobotModel) -> Rest | None:
    """What the meter shows next to the drives, where the power of every drive is measured.

    Returns:
        Median of the readings with its deviation over blocks, and the greatest difference
        between recordings; None where a power is missing.
    """
    try:
        pieces = sums(data, model)
    except NotIdentifiableError:
        return None
    pieces = pieces[np.isfinite(pieces.drives)]
    if len(pieces) < MIN_READINGS:
        return None
    rest = pieces.measured - pieces.drives
    # median: after braking the DC link feeds the drives for a moment, and the meter sees less
    blocks = [float(np.median(rest[pieces.block == k])) for k in np.unique(pieces.block)]
    runs = [float(np.median(rest[pieces.recording == k])) for k in np.unique(pieces.recording)]
    std = _of_mean(np.asarray(blocks)) if len(blocks) > 1 else np.inf
    power, spread = float(np.median(rest)), float(np.ptp(runs))
    notes = ["HOLD is here the meter minus the measured power of all drives, in motion as well"]
    missing = power - float(np.average(rest, weights=pieces.duration))
    if missing > STORED * power:
        notes.append(
            f"on average the meter shows {missing:.0f} W less than drives and constant losses "
            "together: after braking the DC link feeds the drives, which a model file without "
            "cabinet.capacitor cannot determine"
        )
    sensors, drawn = data.sensors.std, np.nan_to_num(np.nanmean(data.drive_power, axis=0))
    # of independent gains: the norm of what the drives draw instead of the sum
    apart = float(np.linalg.norm(drawn)) / max(abs(float(drawn.sum())), SMALL)
    other = rest - sensors.drive_power * apart * pieces.drives
    moves = {
        METER: float(np.median(rest + sensors.meter * pieces.measured)) - power,
        DRIVE_POWER: float(np.median(other)) - power,
    }
    return Level(power, std, len(pieces), len(blocks), spread, moves), tuple(notes)


def _split(
    location: MeterLocation,
    hold: Level | None,
    generating: Level | None,
    model: RobotModel,
    why: str,
) -> CabinetFit:
    before = model.cabinet
    grid = loss_dc = None
    parts: dict[str, dict[str, float]] = {}
    notes: list[str] = []
    if hold is not None:
        parts["sum"] = hold.parts
    if location is MeterLocation.DC_BUS:
        notes.append("a meter on the DC bus does not see the loss on the grid side; it is kept")
        if hold is not None:
            loss_dc = hold.power
            parts["loss_dc"] = parts.pop("sum")
    elif generating is None:
        notes.append(
            "no reading lies inside a phase in which the drives feed back, so HOLD determines the "
            f"sum of both losses only; the DC side keeps its {before.loss_dc.value:g} W and the "
            "grid side takes the rest; to separate them, record hard braking with a fast meter"
        )
        if hold is not None:
            grid = hold.power - before.loss_dc.value
    else:
        level = generating
        if hold is None:
            notes.append(f"the loss on the DC side is kept: {why}")
        else:
            loss_dc = hold.power - generating.power
            parts["loss_dc"] = hold.less(generating)
            if loss_dc < 0:  # then both phases show the grid side alone
                level = hold.joined(generating)
                parts["sum"] = level.parts
                notes.append(
                    "without a loss on the DC side HOLD and GENERATING measure the same power; "
                    "the loss on the grid side is their weighted mean"
                )
        grid = level.power
        parts["loss_grid"] = level.parts
    grid_std, dc_std = (
        total(parts[name]) if name in parts else None for name in ("loss_grid", "loss_dc")
    )
    if hold is not None and hold.spread > 0.1 * abs(hold.power):
        notes.append(
            f"holding power differs by {hold.spread:.0f} W between poses; it is taken as constant"
        )
    for name, value in (("grid", grid), ("DC", loss_dc)):
        if value is not None and value < 0:
            notes.append(
                f"the loss on the {name} side is at the bound 0, negative otherwise: "
                "check the meter"
            )
    return CabinetFit(
        location, hold, generating, grid, grid_std, loss_dc, dc_std, tuple(notes), parts
    )


def with_cabinet(model: RobotModel, fit: CabinetFit, source: str) -> RobotModel:
    """Return a model with the identified losses; what the data do not determine stays.

    Args:
        model: Any model of the same robot.
        source: Where the data come from.
    """
    update: dict[str, PositiveFigure] = {}
    for name, value, std in (
        ("loss_grid", fit.loss_grid, fit.loss_grid_std),
        ("loss_dc", fit.loss_dc, fit.loss_dc_std),
    ):
        if value is not None:
            update[name] = identified(value, std, source)
    if fit.loss_grid is not None and fit.loss_grid_std is None and fit.hold is not None:
        known = f"{fit.hold.power:.4g} +- {total(fit.parts['sum']):.2g} W"
        update["loss_grid"] = only_the_sum(fit.loss_grid, f"both sides, {known}", source)
    return model.changed(cabinet=model.cabinet.model_copy(update=update))


def with_likely_fan(model: RobotModel, power: float) -> RobotModel:
    """Return a model whose loss on the grid side errs by a fan that may run or not.

    Args:
        model: With all that depends on this loss, as the loss on the DC side is the rest of a sum.
        power: Of the fan; 0 changes nothing. [W]
    """
    if not power:
        return model
    side, known = model.cabinet.loss_grid, model.covariance
    std = float(np.hypot(figure_std(side, "loss_grid"), power))
    cabinet = model.cabinet.model_copy(update={"loss_grid": side.model_copy(update={"std": std})})
    if known is not None and "loss_grid" in known.figures:
        at = known.figures.index("loss_grid")
        rows = [list(row) for row in known.matrix]
        rows[at][at] += power**2
        known = known.model_copy(update={"matrix": tuple(tuple(row) for row in rows)})
    return model.changed(cabinet=cabinet, covariance=known)


def _feeding(recording: Recording) -> NDArray[np.bool_]:
    """Where the drives feed back clearly more than the DC side uses."""
    power = recording.power
    excess = -(power.bus_power + power.loss_dc)
    return np.asarray(excess > CLEAR * np.maximum(power.loss_dc, 50.0))


def _level(parts: Sequence[tuple[CoveredPieces, Float]], gain: float) -> Level | None:
    """Mean over events, each event counting once; the meter's gain is off by ``gain``."""
    means: list[float] = []
    readings = 0
    for pieces, power in parts:
        if not len(pieces):
            continue
        readings += len(pieces)
        means += [float(part.mean()) for part in parted(pieces, power)]
    if readings < MIN_READINGS:
        return None
    values = np.asarray(means)
    if len(values) > 1:
        std = _of_mean(values)
    else:  # one event says nothing of others, and its readings may all be off alike
        std = float(np.concatenate([power for _, power in parts]).std(ddof=1))
    shown = np.concatenate([pieces.mean_power for pieces, _ in parts])
    moves = {METER: gain * float(shown.mean())}
    return Level(float(values.mean()), std, readings, len(values), float(np.ptp(values)), moves)


def _of_mean(values: Float) -> float:
    """Deviation of the mean of some values."""
    return float(values.std(ddof=1) / np.sqrt(len(values))) * student(len(values) - 1.0)
