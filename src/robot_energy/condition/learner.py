"""What a running monitor learns of its robot, and how it is used.

The samples of one part, five seconds of stamps, are learned from together once a later part
begins, and what was learned holds from there on. Of every 10 ms, the first sample is enough. So
nothing depends on how the input is cut, and a replay learns what the monitor has learned.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.accounting.power_curve import MeterCurve
from robot_energy.condition.fan_odds import FanOdds
from robot_energy.condition.joint_friction import FrictionLearner, MotionReader, interpolated
from robot_energy.condition.meter_fit import METER_WAIT, MeterFit, MeterWindows, Window
from robot_energy.condition.record import ConditionPart, FrictionRecord, MeterRecord, Stamp
from robot_energy.condition.thermal_observer import ThermalObserver
from robot_energy.condition.wear import WearMonitor, WearState
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import StateFileError
from robot_energy.model import RobotModel
from robot_energy.physics.drivetrain import Drivetrain, motor_standstill
from robot_energy.timeline.blocks import (
    Bits,
    Float,
    Int,
    Learning,
    MeterBlock,
    MeterLocation,
    Phase,
    PowerBlock,
    Quality,
    differences,
    sum_over_joints,
)

if TYPE_CHECKING:
    from robot_energy.pipeline.settings import Settings

SLOT_NS = 10_000_000  # of each, the first sample is learned from [ns]
PART_NS = 5_000_000_000  # of stamps that are learned from together, whole slots [ns]
STUCK = np.uint32(Quality.TEMPERATURE_STUCK)  # what warms unseen would be taken for wear


class ConditionRecord(ConditionPart):
    """What was learned of one robot with one model file."""

    model_id: str
    joint_names: tuple[str, ...]
    end_ns: Stamp | None
    friction: FrictionRecord
    meter: MeterRecord
    wear: Annotated[WearState, "Records of friction, and the changes found in them."]


class _InUse(Described):
    """Learned figures that hold for one part."""

    table: Annotated[
        Float, "Multipliers of the joints with torque, shape (n, ...), see `FrictionLearner.table`."
    ]
    by_torque: Annotated[NDArray[np.bool_], "Which joints these are, shape (n,)."]
    factor: Annotated[float, "On the friction of the others. [-]"]
    offset: Annotated[float, "Of the constant losses. [W]"]
    at_bus: Annotated[bool, "Whether the offset is on the DC side."]

    @property
    def any(self) -> bool:
        """Whether a figure differs from that of the model file."""
        return bool(self.by_torque.any() or self.factor != 1.0 or self.offset != 0.0)


class ConditionLearner:
    """Learns multipliers on friction and the constant losses from power samples.

    A `robot_energy.pipeline.power_stage.Condition`.

    Attributes:
        learns: Whether anything is learned.
        applies: Whether predictions use what was learned.
        in_use: Whether predictions of this part differ from those of the model file.
        fan_odds: That the fan of the cabinet runs, by the meter alone; 1 unless applied. [-]
        thermal: What estimates temperatures that no sensor measures.
        end_ns: Newest sample learned from; None before the first. [ns]
    """

    def __init__(self, model: RobotModel, settings: Settings) -> None:
        limits = settings.meter_max_gap, settings.meter_max_power, settings.meter_wraps_at
        assumed = settings.temperature_assumed
        self.learning = Learning.OFF if assumed else settings.learning
        self.learns = self.learning is not Learning.OFF
        self.applies = self.learning is Learning.APPLY
        self.thermal = ThermalObserver(model, not assumed)
        self._model = model
        n_joints = len(model.joints)
        drivetrain = Drivetrain.from_model(model)
        self.reader = MotionReader(
            np.abs(np.diag(drivetrain.transmission)),
            motor_standstill(model),
            model.temperature.fallback_degc,
        )
        self.friction = FrictionLearner(n_joints)
        cabinet = model.cabinet
        self._losses = (cabinet.loss_dc.value, cabinet.loss_grid.value)
        self.meter = MeterFit(sum(self._losses))
        self.wear = WearMonitor(model.joint_names)
        self.end_ns: int | None = None
        self.fan_odds = 1.0
        fan = cabinet.fan if self.applies else None
        self._fan = None if fan is None else FanOdds(fan.power.value)
        columns = 3 if self._fan is None else 4  # predicted, friction, added; fan
        self._windows = MeterWindows(columns, MeterCurve(*limits))
        self._readings: list[MeterBlock] = []  # since the last part
        self._begin_part()
        self._taught = (self.friction.table(), self.friction.valid)
        self._set_figures()

    def measure(self, block: MeterBlock) -> None:
        """Take readings of the meter."""
        if self.learns:
            self._readings.append(block)

    def cuts(self, stamp_ns: Int, before_ns: int, rising: bool) -> list[int]:
        """Cut at parts and windows, as in `robot_energy.pipeline.power_stage.Condition.cuts`."""
        windows = self.thermal.cuts(stamp_ns, before_ns, rising) if self.thermal.on else []
        if not self.applies:
            return windows
        parts = np.flatnonzero(differences(stamp_ns // PART_NS, before_ns // PART_NS)).tolist()
        return [*windows, *parts]

    def estimate(
        self, begin_ns: int, stuck: NDArray[np.bool_], reading_degc: Float, viscous: Float,
        std: Float, shared: Float, quality: Bits,
    ) -> tuple[Float, Float]:  # fmt: skip
        """Begin a part, as in `robot_energy.pipeline.power_stage.Condition.estimate`."""
        if begin_ns // PART_NS != self._part:
            if self._part is not None:
                self._end_part()
            if self._fan is not None:
                self.fan_odds = self._fan.odds(begin_ns)
                self.in_use = self._use.any or self.fan_odds != 1.0
        if not self.thermal.on:
            return reading_degc, reading_degc
        self.thermal.begin(begin_ns, stuck)
        return self.thermal.estimate(reading_degc, viscous, std, shared, quality)

    def learned(
        self, motor_velocity: Float, motor_temperature_degc: Float
    ) -> tuple[Float | float, float, float]:
        """Say what counts, as in `robot_energy.pipeline.power_stage.Condition.learned`."""
        use = self._use
        factor: Float | float = 1.0
        if use.by_torque.any() or use.factor != 1.0:
            factor = self._multiplier(use, motor_velocity, motor_temperature_degc)
        return (factor, use.offset, 0.0) if use.at_bus else (factor, 0.0, use.offset)

    def step(self, block: PowerBlock, reading_degc: Float) -> None:
        """Take the power of a part, as in `robot_energy.pipeline.power_stage.Condition.step`."""
        if self.thermal.on:
            self.thermal.take(block, reading_degc)
        if not self.learns:
            return
        starts = list[int]()
        if int(block.stamp_ns[0]) // PART_NS != int(block.stamp_ns[-1]) // PART_NS:
            starts = (differences(block.stamp_ns // PART_NS, 0)[1:].nonzero()[0] + 1).tolist()
        for start, stop in zip([0, *starts], [*starts, len(block)], strict=True):
            part = int(block.stamp_ns[start]) // PART_NS
            if self._part is not None and part != self._part:
                self._end_part()
            self._part = part
            self._open.append(block[slice(start, stop)] if starts else block)

    def _begin_part(self) -> None:
        """Keep nothing of the part so far."""
        self._part: int | None = None
        self._open: list[PowerBlock] = []

    def flush(self) -> None:
        """Learn from the part that has not ended, as at the end of a bag."""
        if self._open:
            self._end_part()

    def state(self) -> ConditionRecord:
        """Return what must be kept across a restart."""
        return ConditionRecord(
            model_id=self._model.model_id,
            joint_names=tuple(self._model.joint_names),
            end_ns=self.end_ns,
            friction=FrictionRecord.of(self.friction),
            meter=MeterRecord.of(self.meter),
            wear=self.wear.state(),
        )

    def restore(self, record: ConditionRecord) -> None:
        """Continue from a record; what was learned since the start is dropped."""
        model = self._model
        if (record.model_id, record.joint_names) != (model.model_id, tuple(model.joint_names)):
            raise StateFileError(
                f"learned figures of model {record.model_id}", f"model {model.model_id}"
            )
        record.friction.put_into(self.friction)
        record.meter.put_into(self.meter)
        self.wear.restore(record.wear)
        self.end_ns = record.end_ns
        self._taught = (self.friction.table(), self.friction.valid)
        self._set_figures()

    def restart(self) -> None:
        """Drop what waits, as after an error."""
        self._begin_part()

    @np.errstate(invalid="ignore", over="ignore")
    def _end_part(self) -> None:
        """Learn from the samples of a part."""
        samples = PowerBlock.concatenate(self._open)
        stuck = bool((samples.quality & STUCK).any())  # whether a thermometer was, at any sample
        self.end_ns = int(samples.stamp_ns[-1])
        samples = samples[differences(samples.stamp_ns // SLOT_NS, -1).nonzero()[0]]
        self._begin_part()
        for _, alike in groupby(self._readings, lambda r: (r.meaning, r.location)):
            self._windows.measure(MeterBlock.concatenate(list(alike)))
        self._readings.clear()
        use, friction, known = self._use, samples.friction_power, None
        if use.any:
            velocity, degc = samples.motor_velocity, samples.motor_temperature_degc
            known = self._multiplier(use, velocity, degc)
            if self.applies:
                friction = friction / known  # by the model file
        part = self.reader.read(samples, friction)
        if part is not None:
            used = self.friction.step(part)
            if not stuck:
                self.wear.step(used)
            self._taught = (self.friction.table(), self.friction.valid)
        if self._windows.location is not MeterLocation.UNKNOWN:
            power = self._powers(samples, friction, known, use)
            until = (int(samples.stamp_ns[-1]) // PART_NS + 1) * PART_NS - METER_WAIT
            windows = self._windows.step(samples.stamp_ns, samples.segment, power, until)
            self._learn_from_meter(windows, samples.motor_temperature_degc[-1], stuck)
        self._set_figures()

    def _learn_from_meter(
        self, windows: Iterator[Window], motor_temperature_degc: Float, stuck: bool
    ) -> None:
        """Take windows of the meter; wear of the whole robot is of joints without torque."""
        degc = float(self.reader.temperature(motor_temperature_degc).mean())
        for window in windows:
            predicted, friction, correction, *fan = window.energies.tolist()
            residual = window.measured - predicted + correction
            if self._fan is not None and self._windows.location is MeterLocation.GRID:
                without = (window.measured - predicted + fan[0]) / window.duration
                self._fan.step(window.stamp_ns, without, window.measured / window.duration)
            self.meter.step(window.duration, window.measured, residual, friction)
            if not (stuck or self.friction.parts.any()):
                self.wear.step_meter(window.stamp_ns, window.duration, residual, friction, degc)

    def _powers(
        self, samples: PowerBlock, friction: Float, known: Float | None, use: _InUse
    ) -> Float:
        """Predicted power, friction the meter can learn of, what was added, a fan; (N, K). [W]"""
        seen = samples.phase != Phase.GENERATING  # else the brake resistor takes the difference
        friction_seen = friction
        if use.by_torque.any():
            friction_seen = friction * np.where(use.by_torque, 0.0, 1.0)
        learnable = np.where(seen, sum_over_joints(friction_seen), 0.0)
        added = np.zeros(len(samples))
        if self.applies:
            added += (use.factor - 1.0) * learnable + use.offset
        elif known is not None:  # what torque has taught is not learned again
            taught = sum_over_joints(np.where(use.by_torque, (known - 1.0) * friction, 0.0))
            added -= np.where(seen, taught, 0.0)
        predicted = samples.grid_power
        if self._windows.location is MeterLocation.DC_BUS:
            predicted = predicted - samples.loss_grid
        columns = [predicted, learnable, added]
        if self._fan is not None:
            constant = self._losses[1] + (0.0 if use.at_bus else use.offset)
            columns.append(samples.loss_grid - constant)
        return np.stack(columns, axis=1)

    def _multiplier(self, use: _InUse, velocity: Float, degc: Float) -> Float:
        if not use.by_torque.any():
            return np.full_like(velocity, use.factor)
        known = interpolated(use.table, *self.reader.places(velocity, degc))
        return np.where(use.by_torque, known, use.factor)

    def _set_figures(self) -> None:
        """Let what was learned hold from now on."""
        factor, offset = self.meter.filtered if self.meter.valid else (1.0, 0.0)
        table, by_torque = self._taught
        self._use = _InUse(
            table,
            by_torque,
            1.0 if by_torque.all() else factor,
            offset,
            self._windows.location is MeterLocation.DC_BUS,
        )
        self.in_use = self.applies and self._use.any
