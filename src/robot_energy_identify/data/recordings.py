"""What a recording gives to identification: the stages of the monitor, with its samples kept.

The same ingest, derivative, drivetrain and joining by stamp that run live make these
arrays, so what is fitted is what runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.accounting.comparison import Comparison
from robot_energy.accounting.meter_response import MeterResponse
from robot_energy.accounting.power_curve import MeterLimits
from robot_energy.bag.reader import TimeRange
from robot_energy.condition.learner import ConditionLearner
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import BagError, NotIdentifiableError
from robot_energy.inputs.sources import Inputs
from robot_energy.model import RobotModel
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.pipeline import Settings, TorqueStage
from robot_energy.pipeline.friction_stage import FrictionStage
from robot_energy.pipeline.power_stage import PowerStage, SupplyStage
from robot_energy.replay.bag_replay import Progress, Replay, replay
from robot_energy.replay.replay_steps import ROWS
from robot_energy.replay.setup import ReplaySetup
from robot_energy.timeline.blocks import (
    DOUBTFUL,
    NANOSECOND,
    Block,
    EffortMeaning,
    Float,
    Int,
    JointBlock,
    Learning,
    MeterBlock,
    PowerBlock,
    Quality,
    TemperatureBlock,
    TorqueBlock,
)
from robot_energy.timeline.pieces import Compared
from robot_energy_identify.data.observations import Channels, stretches
from robot_energy_identify.data.thinned import MOST, Thinned, without_deviation
from robot_energy_identify.stats.systematic import DEFAULT_LIMITS, SensorLimits

EVER: tuple[int, int] = (-(2**62), 2**62)  # ns: all stamps
MINUTE = 60_000_000_000  # ns
AROUND = 5_000_000_000  # ns around a minute, in which readings of the meter belong to it
SPREAD = 600.0  # s of motion for what does not change over a recording: delays, the DC link
MOTION = (
    "stamp_ns", "segment", "quality", "joint_position", "joint_velocity", "joint_acceleration",
)  # fmt: skip
OF_MOTION = (
    "urdf", "urdf_xml", "gravity", "massless_links", "coupling", "payload", "temperature", "hold",
)  # fmt: skip  # of a model, besides the joints, decides torque, friction and temperature
LACKING = 0.1  # of samples that lack a motor temperature or have one: fewer do not count
APART = 2.5  # usual times between readings of a meter, beyond which no slope is taken


class MotionBlock(Block):
    """What the dynamics see of a recording, motor side but for the positions."""

    segment: Annotated[Int, "Changes at every gap or jump of the stamps, shape (N,)."]
    joint_position: Annotated[Float, "Shape (N, n). [rad] or [m]"]
    motor_velocity: Annotated[Float, "Shape (N, n). [rad/s]"]
    motor_torque_measured: Annotated[Float, "Shape (N, n). [N m]"]
    motor_temperature_degc: Annotated[Float, "Shape (N, n). [degC]"]


class Recording(Described):
    """One recording, run through the stages with one model."""

    path: Path
    model: RobotModel
    torque: Annotated[TorqueBlock, "Motion, rigid-body torque and measured torque of every sample."]
    power: Annotated[PowerBlock, "Temperature, bus power and phase, row by row as ``torque``."]
    meter: MeterBlock | None
    origin: Annotated[str, "Where the recording comes from, as its writer said."]
    problems: tuple[str, ...]
    known: Annotated[tuple[Compared, ...] | None, "What was compared; None: when asked for."] = None
    limits: MeterLimits = field(default_factory=MeterLimits)
    replay: Annotated[Replay | None, "The replay that gave it, with its accounting."] = field(
        default=None, repr=False
    )
    sensors: SensorLimits = DEFAULT_LIMITS
    temperatures: Annotated[TemperatureBlock | None, "As they came, for another model."] = None
    every: Annotated[int, "Of how many samples of the recording one is kept."] = 1
    response: Annotated[MeterResponse | None, "Of the meter that is compared with."] = None

    def __len__(self) -> int:
        return len(self.torque)

    @property
    def sound(self) -> NDArray[np.bool_]:
        """Which samples have a full derivative window and finite figures, shape (N,)."""
        return np.asarray((self.torque.quality & np.uint32(DOUBTFUL)) == 0)

    @property
    def motion(self) -> MotionBlock:
        """What the dynamics see of it; shares its arrays."""
        block = self.torque
        return MotionBlock(
            block.stamp_ns,
            block.segment,
            block.joint_position,
            block.motor_velocity,
            block.motor_torque_measured,
            self.power.motor_temperature_degc,
        )

    @property
    def span_ns(self) -> tuple[int, int]:
        """First and last stamp. [ns]"""
        return int(self.torque.stamp_ns.min()), int(self.torque.stamp_ns.max())

    @cached_property
    def in_order(self) -> bool:
        """Whether the stamps rise all the way, as `Recording.with_model` needs them."""
        return bool((np.diff(self.torque.stamp_ns) > 0).all())

    @cached_property
    def compared(self) -> tuple[Compared, ...]:
        """Predicted and measured energy between readings of the meter, in the order of time."""
        meter, supply = self.meter, self.power.supply
        if self.known is not None or meter is None:
            return self.known or ()
        comparison = Comparison(**self.limits.__dict__, response=self.response)
        comparison.measure(meter)
        power = supply.power_at(meter.location)
        compared = comparison.predict(supply.stamp_ns, supply.segment, power)
        return (compared,) if len(compared.duration_ns) else ()

    def between(self, start_ns: int, end_ns: int) -> Recording:
        """Return what lies in ``start_ns <= stamp < end_ns``; what was compared stays out."""
        stamp, rows = self.torque.stamp_ns, _inside(self.torque.stamp_ns, start_ns, end_ns)
        if self.in_order:  # then nothing is copied
            rows = slice(*np.searchsorted(stamp, (start_ns, end_ns)).tolist())
        meter = self.meter
        if meter is not None:
            meter = meter[_inside(meter.stamp_ns, start_ns, end_ns)]
        return replace(
            self,
            torque=self.torque[rows],
            power=self.power[rows],
            meter=meter if meter is not None and len(meter) else None,
            known=(),
        )

    def spread(self, seconds: float) -> Recording:
        """Return whole minutes of the recording, evenly spread; each is a segment of its own.

        Args:
            seconds: That they last together, about. [s]
        """
        stamp = self.power.stamp_ns
        every = int(np.ceil(np.ptp(stamp) * NANOSECOND / seconds))
        if every <= 1:
            return self
        minute = (stamp - stamp.min()) // MINUTE
        rows = minute % every == 0
        segment = self.torque.segment[rows] + (minute[rows] << 32)
        meter = self.meter
        if meter is not None:  # readings around these minutes, too
            since = meter.stamp_ns - stamp.min()
            near = [(since + side * AROUND) // MINUTE % every == 0 for side in (-1, 0, 1)]
            used = np.concatenate([[False], np.logical_or.reduce(near), [False]])
            meter = meter[used[:-2] | used[1:-1] | used[2:]]
        return replace(
            self,
            torque=replace(self.torque[rows], segment=segment),
            power=replace(self.power[rows], segment=segment),
            meter=meter,
            known=(),
        )

    def with_meter_earlier(self, delay: float, time_constant: float = 0.0) -> Recording:
        """Return the recording with its meter undone, compared again; figures as in `undone`."""
        if (delay == 0.0 and time_constant == 0.0) or self.meter is None:
            return self
        meter = undone(self.meter, delay, time_constant)
        return replace(self, meter=meter, response=MeterResponse(), known=None)

    def with_model(self, model: RobotModel) -> Recording:
        """Return the recording as a model of the same joints, gears and torque constants sees it.

        Motion, measured torque, temperatures and meter are those of the recording; the torque of
        the bodies and all that follows from it are computed again.
        """
        if model is self.model:
            return self
        seen = replace(self, model=model, response=MeterResponse.of(model), known=None)
        block = self.torque
        effort = EffortMeaning.NONE if self.replay is None else self.replay.effort
        settings = Settings(effort=effort, learning=Learning.OFF, deviations=False)
        if self.differs_in_supply(model):
            return replace(seen, power=SupplyStage(model, settings).again(self.power))
        stage = TorqueStage(model)
        for change in () if self.replay is None else self.replay.payload.changes:
            stage.set_payload(change.payload, change.from_ns)
        unknown = np.full_like(block.joint_position, np.nan)
        motion = {name: getattr(block, name) for name in MOTION}
        torque = stage.plan(JointBlock(**motion, joint_effort=unknown))
        assert torque is not None
        torque = replace(torque, motor_torque_measured=block.motor_torque_measured)
        powers = _powers(torque, self.temperatures, model, settings)
        return replace(seen, torque=torque, power=powers)

    def differs_in_supply(self, model: RobotModel) -> bool:
        """Return whether a model has but other drives and cabinet, which move no temperature.

        One that is estimated follows the losses, and a gear such a motor.
        """
        before, drives = self.model, {kind.key: None for kind in DRIVE_MODELS.values() if kind.key}
        if any(getattr(before, name) != getattr(model, name) for name in OF_MOTION) or any(
            old.model_copy(update=drives) != new.model_copy(update=drives)
            for old, new in zip(before.joints, model.joints, strict=True)
        ):
            return False
        guessed = np.uint32(Quality.TEMPERATURE_ESTIMATED | Quality.TEMPERATURE_STUCK)
        gears, networks = ([getattr(one, n) for one in model.joints] for n in ("gear", "thermal"))
        follows = any(gears) and any(networks)
        return not (follows or (self.power.quality & guessed).any())


def _powers(
    torque: TorqueBlock,
    temperatures: TemperatureBlock | None,
    model: RobotModel,
    settings: Settings,
) -> PowerBlock:
    """The stages behind the torque, whose stamps rise."""
    friction = FrictionStage(model)
    power = PowerStage(model, settings, ConditionLearner(model, settings))
    parts: list[PowerBlock | None] = []
    for first in range(0, len(torque), ROWS):
        rows = torque[slice(first, first + ROWS)]
        since = int(rows.stamp_ns[0]) if first else EVER[0]
        until = int(torque.stamp_ns[first + ROWS]) if first + ROWS < len(torque) else EVER[1]
        if temperatures is not None:
            arrived = temperatures[_inside(temperatures.stamp_ns, since, until)]
            if len(arrived) and (found := friction.step(arrived)) is not None:
                power.timeline.add(found)
        parts.append(power.step(rows))
    parts.append(power.flush())
    return PowerBlock.concatenate([without_deviation(part) for part in parts if part is not None])


def undone(meter: MeterBlock, delay: float, constant: float = 0.0) -> MeterBlock:
    """Return readings with a delay and a low pass of the meter undone: ``x = y + T dy/dt``.

    The slope is that of a cubic spline through the readings: a difference of the readings on both
    sides smears what begins and ends within a few of them.

    Args:
        meter: Readings; a counter has no low pass.
        delay: By which they are late. [s]
        constant: Time constant of the low pass. [s]
    """
    from scipy.interpolate import CubicSpline

    earlier = replace(meter, stamp_ns=meter.stamp_ns - round(delay / NANOSECOND))
    known = np.flatnonzero(np.isfinite(meter.power))
    if constant == 0.0 or len(known) < 2:
        return earlier
    seconds = (meter.stamp_ns[known] - meter.stamp_ns[0]) * NANOSECOND
    step = np.diff(seconds)
    edges = np.flatnonzero((step <= 0.0) | (step > APART * float(np.median(step)))) + 1
    power = meter.power.copy()
    for rows in np.split(np.arange(len(known)), edges):
        if len(rows) > 1:
            place = known[rows]
            power[place] += constant * CubicSpline(seconds[rows], power[place])(seconds[rows], 1)
    return replace(earlier, power=power)


def spread(recordings: Sequence[Recording]) -> list[Recording]:
    """Return minutes of all recordings, an equal share of each, see `Recording.spread`."""
    return [part.spread(SPREAD / len(recordings)) for part in recordings]


def temperatures_known(recordings: Sequence[Recording]) -> list[NDArray[np.bool_]]:
    """Return which samples know the temperature of every axis that has one, shape (N,) each.

    The others have friction at the fallback temperature, which a meter would count as losses. An
    axis has one if more than `LACKING` of the samples of all recordings know it.
    """
    known = [np.isfinite(part.power.motor_temperature_degc) for part in recordings]
    has = np.concatenate(known).mean(axis=0) > LACKING
    return [np.asarray((rows | ~has).all(axis=1)) for rows in known]


def with_meter(recordings: Sequence[Recording]) -> list[Recording]:
    metered = [part for part in recordings if part.meter is not None]
    if not metered:
        raise NotIdentifiableError(
            "no recording has a power meter",
            "measured grid power as well as joint states",
            "record the meter's topic too",
        )
    return metered


def _inside(stamp_ns: Int, start_ns: int, end_ns: int) -> NDArray[np.bool_]:
    return np.asarray((stamp_ns >= start_ns) & (stamp_ns < end_ns))


def channels_of(pieces: Sequence[MotionBlock], rate: float | None = None) -> list[Channels]:
    """Return stretches of motor torque and position between gaps, on one uniform grid.

    Args:
        rate: Of the grid; None for that of the first piece. [Hz]
    """
    channels: list[Channels] = []
    for block in pieces:
        channels += stretches(
            block.stamp_ns,
            block.segment,
            block.joint_position,
            block.motor_torque_measured,
            channels[0].rate if channels else rate,
        )
    return channels


def read_recording(
    path: str | Path,
    model: RobotModel,
    effort: EffortMeaning = EffortMeaning.NONE,
    progress: Progress | None = None,
    inputs: Inputs | None = None,
    most: float = MOST,
    time_range: TimeRange | None = None,
) -> Recording:
    """Return a bag run through the stages, of a long one every second sample, fourth, ...

    Args:
        most: Samples that are kept, about 0.7 kB each for six joints. [-]
    """
    kept = Thinned(most)
    settings = Settings(effort=effort, power_period=None, deviations=False)
    if inputs is not None:
        gaps = {"max_gap": inputs.max_gap, "meter_max_gap": inputs.meter_max_gap}
        settings = replace(settings, **gaps)
    setup = ReplaySetup(settings=settings, inputs=inputs, time_range=time_range, progress=progress)
    result = replay(path, model, setup, on_output=kept.take)
    torque, power, meter, temperatures = kept.blocks()
    max_power, wraps_at, _ = result.meter.source.limits
    if torque is None or power is None:
        raise BagError(f"{path} gives not one torque", "a recording of several samples")
    return Recording(
        Path(path),
        model,
        torque,
        power,
        meter,
        result.origin,
        tuple(result.problems),
        limits=MeterLimits(settings.meter_max_gap, max_power, wraps_at),
        replay=result,
        temperatures=temperatures,
        every=kept.every,
        response=MeterResponse.of(model),
    )
