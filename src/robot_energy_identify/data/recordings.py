"""What a recording gives to identification: the stages of the monitor, with all samples kept.

The same ingest, derivative, drivetrain and joining by stamp that run live make these
arrays, so what is fitted is what runs.

Which joints stand still is recognised by the noise of their velocity and not by a fixed threshold.
The noise of a joint's velocity is its standard deviation about a straight line in windows of a
quarter of a second, of which the lowest twentieth counts: rest, or motion at constant speed. A
joint stands where its velocity is within four of these deviations of 0, and its mean over a
tenth of a second within two; both limits are at least the ``standstill_velocity`` of the model.
The first finds rest under noise, the second keeps a slow, steady motion apart from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robot_energy.accounting.comparison import Comparison
from robot_energy.accounting.meter_response import MeterResponse
from robot_energy.accounting.power_curve import MeterLimits
from robot_energy.foundation.errors import BagError, NotIdentifiableError
from robot_energy.inputs.sources import Inputs
from robot_energy.model import RobotModel
from robot_energy.pipeline import Output, Settings
from robot_energy.replay.bag_replay import Progress, Replay, replay
from robot_energy.replay.replay_topics import Topics
from robot_energy.timeline.blocks import (
    DOUBTFUL,
    NANOSECOND,
    EffortMeaning,
    Float,
    Int,
    MeterBlock,
    PowerBlock,
    TorqueBlock,
)
from robot_energy.timeline.pieces import Compared
from robot_energy_identify.check.evidence import velocity_noise
from robot_energy_identify.data.signals import Channels, stretches
from robot_energy_identify.stats.systematic import DEFAULT_LIMITS, SensorLimits

AROUND = 50_000_000  # ns to each side, over which the mean velocity is taken
SAMPLE_DEVIATIONS = 4.0
MEAN_DEVIATIONS = 2.0
MAX_NOISE = 0.02  # rad/s: a recording without rest or steady motion shows no noise, but motion
APART = 2.5  # usual times between readings of a meter, beyond which no slope is taken


@dataclass(frozen=True)
class Recording:
    """One recording, run through the stages with one model.

    Attributes:
        torque: Position, velocity, acceleration, rigid-body torque and measured torque of
            every sample.
        power: Temperature, bus power and phase of the same samples, row by row.
        meter: Readings of the power meter, None without one.
        origin: Where the recording comes from, as its writer said.
        problems: What was wrong with the bag, one sentence each.
        replay: The replay that gave it, with its accounting.
    """

    path: Path
    model: RobotModel
    torque: TorqueBlock
    power: PowerBlock
    meter: MeterBlock | None
    origin: str
    problems: tuple[str, ...]
    compared: tuple[Compared, ...] = ()
    limits: MeterLimits = field(default_factory=MeterLimits)
    replay: Replay | None = field(default=None, repr=False)
    sensors: SensorLimits = DEFAULT_LIMITS

    def __len__(self) -> int:
        return len(self.torque)

    @property
    def sound(self) -> NDArray[np.bool_]:
        """Which samples have a full derivative window and finite figures, shape (N,)."""
        return np.asarray((self.torque.quality & np.uint32(DOUBTFUL)) == 0)

    @property
    def span_ns(self) -> tuple[int, int]:
        """First and last stamp. [ns]"""
        return int(self.torque.stamp_ns.min()), int(self.torque.stamp_ns.max())

    def between(self, start_ns: int, end_ns: int) -> Recording:
        """Return what lies in ``start_ns <= stamp < end_ns``; what was compared stays out.

        Args:
            start_ns: First stamp. [ns]
            end_ns: Behind the last one. [ns]
        """
        rows = _inside(self.torque.stamp_ns, start_ns, end_ns)
        meter = self.meter
        if meter is not None:
            meter = meter[_inside(meter.stamp_ns, start_ns, end_ns)]
        return replace(
            self,
            torque=self.torque[rows],
            power=self.power[rows],
            meter=meter if meter is not None and len(meter) else None,
            compared=(),
        )

    def with_meter_earlier(self, delay: float, time_constant: float = 0.0) -> Recording:
        """Return the recording with delay and low pass of its meter undone, compared again.

        Args:
            delay: Of the readings behind the joint states. [s]
            time_constant: Of the low pass. [s]
        """
        if (delay == 0.0 and time_constant == 0.0) or self.meter is None:
            return self
        meter = undone(self.meter, delay, time_constant)
        comparison = Comparison(**self.limits.__dict__, response=MeterResponse())
        comparison.measure(meter)
        supply = self.power.supply
        compared = comparison.predict(
            supply.stamp_ns, supply.segment, supply.power_at(meter.location)
        )
        return replace(self, meter=meter, compared=(compared,))


def undone(meter: MeterBlock, delay: float, constant: float = 0.0) -> MeterBlock:
    """Return readings with a delay and a low pass of the meter undone: ``x = y + T dy/dt``.

    The slope is that of the readings on both sides, which is exact for means over equal
    intervals of a power that is linear between their middles.

    Args:
        meter: Readings; a counter has no low pass.
        delay: By which they are late. [s]
        constant: Time constant of the low pass. [s]
    """
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
            power[place] += constant * np.gradient(power[place], seconds[rows])
    return replace(earlier, power=power)


def with_meter(recordings: Sequence[Recording]) -> list[Recording]:
    """Return the recordings that have a power meter.

    Raises:
        NotIdentifiableError: If there is none.
    """
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


def channels_of(
    recordings: Sequence[Recording], most: float = np.inf, rate: float | None = None
) -> list[Channels]:
    """Return stretches of motor torque and position between gaps, on one uniform grid.

    Args:
        most: Time to take from the start of each recording. [s]
        rate: Of the grid; None for that of the first recording. [Hz]

    Raises:
        NotIdentifiableError: If a recording has no stretch that is long enough.
    """
    channels: list[Channels] = []
    for recording in recordings:
        block = recording.torque
        block = block[(block.stamp_ns - block.stamp_ns[0]) * NANOSECOND <= most]
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
    topics: Topics | None = None,
    progress: Progress | None = None,
    inputs: Inputs | None = None,
) -> Recording:
    """Run a bag through the stages and keep every sample.

    Args:
        path: MCAP file or rosbag2 folder.
        topics: Topics to use where they cannot be determined by type.
        progress: Called with the share done, 0 to 1.
        inputs: What the inputs of a live monitor are, to read the bag in the same way.

    Returns:
        The recording; memory grows with its length, about 1 kB per sample of six joints.

    Raises:
        BagError: If the bag gives not one torque.
        RobotEnergyError: If bag or model cannot be used.
    """
    outputs: list[Output] = []
    settings = Settings(effort=effort, power_period=None)
    if inputs is not None:
        gaps = {"max_gap": inputs.max_gap, "meter_max_gap": inputs.meter_max_gap}
        settings = replace(settings, **gaps)
    result = replay(
        path,
        model,
        topics,
        settings,
        keep_compared=True,
        progress=progress,
        inputs=inputs,
        on_output=outputs.append,
    )
    torque = [output.torque for output in outputs if output.torque is not None]
    power = [output.power for output in outputs if output.power is not None]
    meter = [output.meter for output in outputs if output.meter is not None]
    max_power, wraps_at, _ = result.meter.source.limits
    if not torque or not power:
        raise BagError(f"{path} gives not one torque", "a recording of several samples")
    return Recording(
        Path(path),
        model,
        TorqueBlock.concatenate(torque),
        PowerBlock.concatenate(power),
        MeterBlock.concatenate(meter) if meter else None,
        result.origin,
        tuple(result.problems),
        tuple(part for part in result.compared if len(part.duration_ns)),
        MeterLimits(settings.meter_max_gap, max_power, wraps_at),
        result,
    )


def still(stamp_ns: Int, velocity: Float, standstill: Float) -> NDArray[np.bool_]:
    """Return where each joint stands, shape (N, n); False where the velocity is not finite.

    Args:
        stamp_ns: Rising, shape (N,). [ns]
        velocity: Shape (N, n). [rad/s] or [m/s]
        standstill: Of the model, shape (n,). [rad/s] or [m/s]
    """
    noise = np.minimum(np.nan_to_num(velocity_noise(stamp_ns, velocity)), MAX_NOISE)
    known = np.isfinite(velocity)
    total = np.zeros((len(velocity) + 1, velocity.shape[1]))
    np.cumsum(np.where(known, velocity, 0.0), axis=0, out=total[1:])
    first, last = window(stamp_ns)
    mean = (total[last] - total[first]) / (last - first)[:, None]
    near = np.abs(velocity) <= np.maximum(standstill, SAMPLE_DEVIATIONS * noise)
    return known & near & (np.abs(mean) <= np.maximum(standstill, MEAN_DEVIATIONS * noise))


def window(stamp_ns: Int) -> tuple[Int, Int]:
    """Return the first sample of `AROUND` each one and the one behind the last, shape (N,).

    Args:
        stamp_ns: Rising, shape (N,). [ns]
    """
    first = np.searchsorted(stamp_ns, stamp_ns - AROUND, side="left")
    last = np.searchsorted(stamp_ns, stamp_ns + AROUND, side="right")
    return first, last


def still_joints(recording: Recording) -> NDArray[np.bool_]:
    """Return where each joint of a recording stands, shape (N, n)."""
    block = recording.torque
    standstill = np.array([joint.standstill_velocity for joint in recording.model.joints])
    return still(block.stamp_ns, block.joint_velocity, standstill)


@dataclass(frozen=True)
class Rest:
    """Stretches in which no joint moves.

    Attributes:
        total: Time of all of them. [s]
        longest: [s]
    """

    total: float
    longest: float
    count: int

    def __str__(self) -> str:
        if not self.count:
            return "no joint states at rest were found"
        return (
            f"the joints rest {self.total:.1f} s in all, {self.count} times, {self.longest:.1f} s "
            "at the longest"
        )


def rest_of(stamp_ns: Int, resting: NDArray[np.bool_]) -> Rest:
    """Return how long and how often a robot rests.

    Args:
        stamp_ns: Rising, shape (N,). [ns]
        resting: Where no joint moves, shape (N,).
    """
    edges = np.flatnonzero(np.diff(resting.astype(np.int8), prepend=0, append=0))
    starts, ends = edges[::2], edges[1::2] - 1
    spans = (stamp_ns[ends] - stamp_ns[starts]) * NANOSECOND
    return Rest(float(spans.sum()), float(spans.max(initial=0.0)), len(spans))
