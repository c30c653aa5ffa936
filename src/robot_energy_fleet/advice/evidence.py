"""What recordings or the dataset of a fleet show: rests, braking, friction over temperature."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import polars as pl

from robot_energy.foundation.described import Described, documented
from robot_energy.foundation.errors import DatasetError
from robot_energy.foundation.units import HOUR_NS
from robot_energy.model import RobotModel
from robot_energy.physics.drives_and_cabinet import drive_from_model
from robot_energy.physics.drivetrain import motor_rest
from robot_energy.pipeline import Output
from robot_energy.replay.options import ReplayOptions
from robot_energy.timeline.blocks import NANOSECOND, Float, PowerBlock, TorqueBlock
from robot_energy.timeline.pieces import Compared
from robot_energy_fleet.dataset import read_tables
from robot_energy_fleet.tables import counted_twice, is_history
from robot_energy_plan.optimization.deviations import ConsecutiveBlocks, DeviationSums
from robot_energy_report.formats import counted

WARMER = 10.0  # K, over which the loss of warmer windings is differentiated
LONG_REST = 60.0  # s; from here on the drives are left on for nothing
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


FULL = 0.99  # of an hour in standby: it was one rest
MAX_BAGS = 5
MIN_BAGS = 3  # that say something of their spread


class SampledBag(Described):
    """A bag of a dataset that is still where it was."""

    address: str
    options: Annotated[dict[str, Any], "As of the dataset and as given now, without jobs."]


def evenly(count: int) -> list[int]:
    """Return `MAX_BAGS` places in a list at most, evenly spread."""
    chosen = min(MAX_BAGS, count)
    places: list[int] = ((np.arange(chosen) + 0.5) * count / max(chosen, 1)).astype(int).tolist()
    return places


def _bag_sample(runs: pl.DataFrame, options: ReplayOptions) -> tuple[list[SampledBag], int]:
    """Bags that can be looked at again, evenly spread over runs.

    They are `MAX_BAGS` at most, and none where fewer than `MIN_BAGS` can be read from this host.
    The number is that of bags that are there, but were replayed with a file of inputs, of which a
    dataset keeps a hash alone. A history does not say where its bags are.
    """
    given = {name: value for name, value in options.items() if value is not None}
    there = [
        SampledBag(bag, _options(settings))
        for bag, settings in runs.select("bag", "settings").iter_rows()
        if settings is not None and Path(bag).exists()
    ]
    usable = [one for one in there if "inputs" in given or "inputs" not in one.options]
    chosen = [usable[k] for k in evenly(len(usable))] if len(usable) >= MIN_BAGS else []
    bags = [replace(one, options=one.options | given) for one in chosen]
    return bags, len(there) - len(usable)


def _options(settings: str) -> dict[str, Any]:
    """Options of the replay, as far as a dataset keeps them."""
    known = ReplayOptions.__annotations__.keys() - {"jobs"}
    given: dict[str, Any] = json.loads(settings)
    return {name: value for name, value in given.items() if name in known and value is not None}


def dataset_evidence(
    folder: str | Path, model: RobotModel, options: ReplayOptions | None = None
) -> tuple[RecordedEvidence, list[SampledBag]]:
    """Return what a dataset shows of the robots with one model, and bags to look at again.

    How often a robot rested within an hour is not in it: hours that were all standby are one rest
    with their neighbours, standby in others is taken as rests of `LONG_REST`, the shortest that
    count as standby, so that no state is claimed to pay that might not.

    Args:
        options: With which bags are looked at, before those of the dataset.
    """
    tables = read_tables(folder)
    everything = tables.runs
    used = (everything["reason"] == "") & (everything["model_id"] == model.model_id)
    runs = everything.filter(used)
    if runs.is_empty():
        others = ", ".join(sorted(set(tables.runs["model_id"].to_list()) - {""})) or "none"
        raise DatasetError(
            f"{folder} holds no bag of model {model.model_id}, but of {others}",
            "the model that the bags were replayed with",
        )
    sample, without_inputs = _bag_sample(runs.sort("robot", "start_ns", "bag"), options or {})
    largest = runs.sort("grid_energy", "bag", descending=[True, False])["bag"][0]
    bags = (
        f"{len(sample)} of its {len(runs)} bags are analysed, spread over robots and time; the "
        "bands include how much they differ"
        if sample
        else f"name bags instead, such as {largest}, which took most energy: fewer than {MIN_BAGS} "
        "can still be read at their places"
    )
    what = "history" if is_history(folder) else "dataset"
    if what == "history":
        bags = "name bags instead: a history does not state where those of this robot are"
    found = RecordedEvidence(
        recordings=len(runs),
        observed_time=float(runs["observed_time"].sum()),
        grid_energy=float(runs["grid_energy"].sum()),
        brake_energy=float(runs["brake_energy"].sum()),
        start_ns=int(runs["start_ns"].to_numpy().min()),
        end_ns=int(runs["end_ns"].to_numpy().max()),
        places=False,
        fine=False,
        notes=[
            f"a {what} cannot separate short and long rests within an hour",
            f"a {what} holds sums: for warm-up, speeds and waiting poses {bags}",
        ],
    )
    if without_inputs:
        found.notes.append(
            f"not analysed: {counted(without_inputs, 'bag')} replayed with a file of inputs, which "
            "a dataset does not keep; name bags instead, and that file with --inputs"
        )
    found.notes += counted_twice(runs)
    hours = tables.hours.join(runs.select("key"), on="key", how="semi")
    moved = float(hours["motion_time"].sum())
    found.rest_time = float(hours["observed_time"].sum()) - moved
    shape = len(model.joints), len(DEGC_BINS) - 1
    found.squared_speed, found.motion_time = np.zeros(shape), np.zeros(shape)
    still = np.zeros(len(model.joints))
    columns = ["robot", "hour_ns", "standby_time", "standby_energy"]
    summed = hours.select(columns).group_by(columns[:2], maintain_order=True).sum()
    last: tuple[str, int] | None = None
    for robot, hour_ns, time, energy in summed.sort("robot", "hour_ns").iter_rows():
        if time >= FULL * 3600.0:
            if last == (robot, hour_ns):
                found.rests[-1].end_ns += round(time * 1e9)
                found.rests[-1].energy += energy
            else:
                end_ns = hour_ns + round(time * 1e9)
                found.rests.append(RecordedRest(hour_ns, end_ns, energy, still))
            last = robot, hour_ns + HOUR_NS
        elif time >= LONG_REST:
            count = int(time // LONG_REST)
            length = round(time / count * 1e9)
            found.rests += [
                RecordedRest(hour_ns, hour_ns + length, energy / count, still) for _ in range(count)
            ]
    return found, sample
