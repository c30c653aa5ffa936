"""Electrical power of the drives, identified from their own power or from one meter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from robot_energy.blocks import MeterLocation
from robot_energy.identify.drives.all_drives import DrivesFound, TotalFound
from robot_energy.identify.drives.drives import DrivesFit
from robot_energy.identify.drives.total_power import TotalFit
from robot_energy.identify.drives.total_sums import COEFFICIENTS, Sums
from robot_energy.identify.stats.cross_validation import EnergyScore
from robot_energy.identify.stats.lag import Delay
from robot_energy.results.base import Number, Result


@dataclass(frozen=True)
class LossTerm(Result):
    """One coefficient of the loss model.

    Attributes:
        value: In the unit of its term.
        std: Standard deviation; None where it is not told.
        at_bound: Whether the value came out negative and stays at 0.
    """

    value: float
    std: Number
    at_bound: bool


@dataclass(frozen=True)
class AxisLosses(Result):
    """Losses of one drive behind one meter for all.

    Attributes:
        name: Of the joint.
        copper: Over squared motor torque. [W/(N m)^2]
        linear: Over motor speed. [W s/rad]
        quadratic: Over squared motor speed. [W s2/rad2]
    """

    name: str
    copper: LossTerm
    linear: LossTerm
    quadratic: LossTerm


@dataclass(frozen=True)
class TotalPower(Result):
    """Losses of all drives, from one meter.

    Attributes:
        location: Where the meter sits.
        readings: Of the meter.
        duration: That they cover. [s]
        recordings: That they come from.
        structure: What the readings tell apart.
        constant: Constant power. [W]
        constant_std: [W]
        axes: One per joint.
        block_rms: RMS error on blocks not seen, by structure. [W]
        held_out: ``recordings`` or ``blocks``.
        ways: Predictions of held-out readings, by way.
        meter_delay: Of the meter behind the joint states; None where it cannot be told.
        meter_time_constant: Of a low pass in the meter; likewise.
        notes: What the readings do not tell, one sentence each.
        parts: Of the standard deviations, by column of the fit and cause.
    """

    location: MeterLocation
    readings: int
    duration: float
    recordings: int
    structure: str
    constant: float
    constant_std: Number
    axes: tuple[AxisLosses, ...]
    block_rms: dict[str, float]
    held_out: str
    ways: dict[str, EnergyScore]
    meter_delay: Delay | None
    meter_time_constant: Delay | None
    notes: tuple[str, ...]
    parts: dict[str, dict[str, float]]


@dataclass(frozen=True)
class DrivesReport(Result):
    """Electrical power of the drives.

    Attributes:
        torque: Where the torque comes from; empty if that was not asked.
        drives: From the power of each drive; None without.
        delay: Of that power behind the joint states; None where it cannot be told.
        total: From one meter for all drives; None without.
        notes: What was decided for the model file without data, one sentence each.
    """

    NAME: ClassVar[str] = "drives"

    torque: str
    drives: DrivesFit | None
    delay: Delay | None
    total: TotalPower | None
    notes: tuple[str, ...]


def drives_report(found: DrivesFound, torque: str = "", notes: Sequence[str] = ()) -> DrivesReport:
    """Return all that was found of the drives.

    Args:
        found: From the power of each drive, from one meter, or both.
        torque: Where the torque comes from.
        notes: What was decided for the model file without data, one sentence each.
    """
    total = None if found.total is None else total_power(found.total)
    return DrivesReport(torque, found.drives, found.delay, total, tuple(notes))


def total_power(found: TotalFound) -> TotalPower:
    """Return what was found from one meter for all drives.

    Args:
        found: Pieces between its readings and losses behind them.
    """
    data, fit = found.data, found.fit
    return TotalPower(
        location=data.location,
        readings=len(data),
        duration=float(data.duration.sum()),
        recordings=len(set(data.recording.tolist())),
        structure=fit.structure,
        constant=fit.constant,
        constant_std=fit.constant_std,
        axes=tuple(
            AxisLosses(name, *(_term(data, fit, joint, row) for row in range(len(COEFFICIENTS))))
            for joint, name in enumerate(data.names)
        ),
        block_rms={str(name): rms for name, rms in fit.errors.items()},
        held_out=found.held_out,
        ways=found.scores,
        meter_delay=found.delay,
        meter_time_constant=found.low_pass,
        notes=tuple(_not_told(fit)),
        parts=fit.losses.parts,
    )


def _term(data: Sums, fit: TotalFit, joint: int, row: int) -> LossTerm:
    names = {f"{COEFFICIENTS[row]} of {which}" for which in (data.names[joint], "all axes")}
    return LossTerm(
        float(fit.coefficients[row, joint]),
        float(fit.deviations[row, joint]),
        bool(names & set(fit.losses.negative)),
    )


def _not_told(fit: TotalFit) -> list[str]:
    negative, untold = fit.losses.negative, fit.losses.untold
    notes: list[str] = []
    if untold:
        notes.append(f"not told apart from the terms before, taken as 0: {', '.join(untold)}")
    if negative:
        notes.append(f"at the bound 0, negative otherwise: {', '.join(negative)}")
    if fit.structure in ("shared", "axis_copper"):
        notes.append("what axes share cannot be told apart per axis from one meter here")
    return notes
