"""What recordings show: rests, energy that was braked, friction over temperature."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import documented
from robot_energy.model import RobotModel
from robot_energy.physics.drives_and_cabinet import drive_from_model
from robot_energy.physics.drivetrain import motor_rest
from robot_energy.pipeline import Output
from robot_energy.timeline.blocks import NANOSECOND, Float, PowerBlock, TorqueBlock
from robot_energy.timeline.pieces import Compared
from robot_energy_plan.optimization.deviations import ConsecutiveBlocks, DeviationSums

WARMER = 10.0  # K, over which the loss of warmer windings is differentiated
MIN_REST = 1.0  # s; a shorter stop is part of the work
SETTLED_NS = 2_000_000_000  # of a rest, after which a meter with a low pass shows its power [ns]
DEGC_BINS = np.arange(-40.0, 201.0)  # edges, 1 K apart [degC]
DEGC_MIDDLES = 0.5 * (DEGC_BINS[1:] + DEGC_BINS[:-1])
DEMAND_BINS = 2.0 * np.sinh(np.linspace(-13.0, 13.0, 801))
"""Edges of the demand on the DC bus, fine near 0, to 4e5 W either way. [W]"""


@documented
@dataclass
class RecordedRest:
    """One rest with drives on."""

    start_ns: Annotated[int, "Stamp of its first sample. [ns]"]
    end_ns: Annotated[int, "Stamp of its last sample. [ns]"]
    energy: Annotated[float, "From the grid, predicted. [J]"]
    joint_position: Annotated[Float, "Where, shape (n,). [rad] or [m]"]
    compared_time: Annotated[float, "Of it, covered by a meter once settled. [s]"] = 0.0
    measured: Annotated[float, "Over that time, at the meter. [J]"] = 0.0
    predicted: Annotated[float, "Over that time, at the meter's place. [J]"] = 0.0

    @property
    def duration(self) -> float:
        """From first to last sample. [s]"""
        return (self.end_ns - self.start_ns) * NANOSECOND


SUMS = (
    "recordings", "observed_time", "grid_energy", "brake_energy", "brake_columns", "rests",
    "rest_time", "squared_speed", "motion_time", "warm_loss", "demand",
)  # fmt: skip
"""Fields of the evidence of several recordings that add up."""


@documented
@dataclass
class RecordedEvidence:
    """What recordings of one robot model show."""

    recordings: int = 0
    observed_time: Annotated[float, "Predicted. [s]"] = 0.0
    grid_energy: Annotated[float, "From the grid. [J]"] = 0.0
    brake_energy: Annotated[float, "Into the brake resistor. [J]"] = 0.0
    brake_columns: Annotated[
        Float, "Change of that with the error of each figure, shape (K,). [J]"
    ] = field(default_factory=lambda: np.zeros(1))
    rests: list[RecordedRest] = field(default_factory=list[RecordedRest])
    rest_time: Annotated[float, "In rests, those of a dataset included. [s]"] = 0.0
    squared_speed: Annotated[
        Float,
        "Integral of the squared motor speed by 1 K of the motor temperature, while the grid feeds "
        "the bus, shape (n, bins). [rad^2/s]",
    ] = field(default_factory=lambda: np.zeros((1, len(DEGC_BINS) - 1)))
    motion_time: Annotated[Float, "Of each motor by temperature, shape (n, bins). [s]"] = field(
        default_factory=lambda: np.zeros((1, len(DEGC_BINS) - 1))
    )
    warm_loss: Annotated[
        Float,
        "Energy that drives lose more for each kelvin by which their windings are warmer, by "
        "temperature, at rest too, shape (n, bins). [J/K]",
    ] = field(default_factory=lambda: np.zeros((1, len(DEGC_BINS) - 1)))
    demand: Annotated[
        Float,
        "Time [s], and integral of the demand on the DC bus [J], constant losses of that side "
        "included, by this demand in `DEMAND_BINS`, shape (2, bins).",
    ] = field(default_factory=lambda: np.zeros((2, len(DEMAND_BINS) - 1)))
    start_ns: Annotated[int | None, "First sample. [ns since 1970]"] = None
    end_ns: Annotated[int | None, "Last sample. [ns since 1970]"] = None
    measured_temperature: bool = False
    metered: Annotated[bool, "Whether a power meter at the grid was compared."] = False
    robots: tuple[str, ...] = ()
    places: Annotated[bool, "Whether it is known where the robot rested."] = True
    fine: Annotated[bool, "Whether the errors of every figure are known, sample by sample."] = True
    notes: list[str] = field(default_factory=list[str])

    @property
    def mean_degc(self) -> float:
        """Mean motor temperature of the motion, of all joints; NaN without motion. [degC]"""
        time = self.motion_time.sum()
        return float((self.motion_time * DEGC_MIDDLES).sum() / time) if time > 0 else math.nan

    def add(self, other: RecordedEvidence) -> None:
        """Add what another recording shows."""
        for name in SUMS:
            setattr(self, name, getattr(self, name) + getattr(other, name))
        starts = [one for one in (self.start_ns, other.start_ns) if one is not None]
        ends = [one for one in (self.end_ns, other.end_ns) if one is not None]
        self.start_ns, self.end_ns = min(starts, default=None), max(ends, default=None)
        self.measured_temperature |= other.measured_temperature
        self.metered |= other.metered
        self.notes += [note for note in other.notes if note not in self.notes]


class EvidenceSums:
    """Gathers the evidence of one recording.

    A robot rests while its motors are slower than motion that says something of friction, so that
    noise of a reported velocity is not motion.
    """

    def __init__(self, model: RobotModel) -> None:
        self._floor = motor_rest(model)
        self._fallback_degc = model.temperature.fallback_degc
        self._deviations = DeviationSums(model)
        self._waiting: list[TorqueBlock] = []
        self._blocks = ConsecutiveBlocks()
        self._position: Float | None = None
        self._open: RecordedRest | None = None
        shape = len(model.joints), len(DEGC_BINS) - 1
        self._squared_speed, self._motion_time = np.zeros(shape), np.zeros(shape)
        self._warm_loss = np.zeros(shape)
        self._demand = np.zeros((2, len(DEMAND_BINS) - 1))
        self._drive = drive_from_model(model)
        self._energy = self._time = self._brake = 0.0
        self._rests: list[RecordedRest] = []
        self._compared: list[Compared] = []

    def take(self, output: Output) -> None:
        """Take what a step of the pipeline gave: a power sample comes with its torque, or later."""
        self._deviations.take(output)
        if output.torque is not None:
            self._waiting.append(output.torque)
        if output.power is None:
            return
        torque, size = TorqueBlock.concatenate(self._waiting), len(output.power)
        self._waiting = [torque[slice(size, None)]] if len(torque) > size else []
        block, time = self._blocks.joined(output.power)
        position = torque.joint_position[:size]
        if self._position is not None:
            position = np.concatenate([self._position, position])
        self._position = position[-1:]
        if len(block) > 1:
            self._add(block, time, position)
        self._measure(int(block.stamp_ns[-1]))

    def compare(self, compared: Compared) -> None:
        """Take what became comparable with the meter, before the step of the same samples."""
        self._compared.append(compared)

    def evidence(self, metered: bool = False) -> RecordedEvidence:
        """Return what the recording shows, after its last step.

        Args:
            metered: Whether the meter that was compared sits at the grid.
        """
        self._close()
        for rest in () if metered else self._rests:
            rest.compared_time = rest.measured = rest.predicted = 0.0
        return RecordedEvidence(
            recordings=1,
            observed_time=self._time,
            grid_energy=self._energy,
            brake_energy=self._brake,
            brake_columns=self._deviations.brake,
            rests=self._rests,
            rest_time=sum(rest.duration for rest in self._rests),
            squared_speed=self._squared_speed,
            motion_time=self._motion_time,
            warm_loss=self._warm_loss,
            demand=self._demand,
            metered=metered,
        )

    def _add(self, block: PowerBlock, time: Float, position: Float) -> None:
        power = np.maximum(np.nan_to_num(block.grid_power), 0.0)
        energy = 0.5 * (power[1:] + power[:-1]) * time
        brake = np.nan_to_num(block.brake_power)
        self._time += float(time.sum())
        self._energy += float(energy.sum())
        self._brake += float((0.5 * (brake[1:] + brake[:-1]) * time).sum())
        bus = np.clip(
            np.nan_to_num(block.bus_power + block.loss_dc)[:-1], DEMAND_BINS[0], DEMAND_BINS[-1]
        )
        for row, weights in enumerate((time, bus * time)):
            self._demand[row] += np.histogram(bus, DEMAND_BINS, weights=weights)[0]
        speed = np.abs(block.motor_velocity[:-1])
        moving = (speed > self._floor) & (time > 0.0)[:, None]
        fed = (brake[:-1] == 0.0) & (block.grid_power[:-1] > block.loss_grid[:-1])
        degc = np.nan_to_num(block.motor_temperature_degc[:-1], nan=self._fallback_degc)
        warmer = self._warmer(block[slice(0, -1)], degc) * time[:, None]
        for joint in range(speed.shape[1]):
            rows = moving[:, joint]
            at = degc[rows, joint]
            squares = (speed[rows, joint] ** 2) * time[rows] * fed[rows]
            self._squared_speed[joint] += np.histogram(at, DEGC_BINS, weights=squares)[0]
            self._motion_time[joint] += np.histogram(at, DEGC_BINS, weights=time[rows])[0]
            self._warm_loss[joint] += np.histogram(
                degc[:, joint], DEGC_BINS, weights=warmer[:, joint]
            )[0]
        rest = ~moving.any(axis=1) & (time > 0.0)
        cuts = (np.flatnonzero(np.diff(rest)) + 1).tolist()
        for start, stop in zip([0, *cuts], [*cuts, len(time)], strict=True):
            if not rest[start]:
                self._close()
                continue
            end_ns = int(block.stamp_ns[stop])
            if self._open is None:
                middle = position[(start + stop) // 2]
                self._open = RecordedRest(int(block.stamp_ns[start]), end_ns, 0.0, middle)
            self._open.end_ns = end_ns
            self._open.energy += float(energy[start:stop].sum())

    def _warmer(self, block: PowerBlock, degc: Float) -> Float:
        """Loss of the drives for each kelvin of warmer windings, shape (N, n). [W/K]"""
        given = block.shaft_power, block.motor_velocity, block.motor_torque
        now, _ = self._drive.input_power(*given, degc.copy())
        then, _ = self._drive.input_power(*given, degc + WARMER)
        return np.nan_to_num((then - now) / WARMER)

    def _close(self) -> None:
        if self._open is not None and self._open.duration >= MIN_REST:
            self._rests.append(self._open)
        self._open = None

    def _measure(self, until_ns: int) -> None:
        """Add to the rests what the meter has reported of them; what comes later waits."""
        if not self._compared:
            return
        whole = Compared.concatenate(self._compared)
        later = whole.stamp_ns > until_ns
        self._compared = [whole[later]] if later.any() else []
        past = whole[~later]
        begin_ns = past.stamp_ns - past.duration_ns
        oldest_ns = int(begin_ns.min(initial=until_ns))
        going_on = [] if self._open is None else [self._open]
        for rest in reversed(self._rests + going_on):
            if rest.end_ns < oldest_ns:
                break
            rows = (begin_ns >= rest.start_ns + SETTLED_NS) & (past.stamp_ns <= rest.end_ns)
            rest.compared_time += float(past.duration_ns[rows].sum()) * NANOSECOND
            rest.measured += float(past.measured[rows].sum())
            rest.predicted += float(past.predicted[rows].sum())
