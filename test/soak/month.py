"""One simulated month of a moving robot through ingest, pipeline and registers.

The motion repeats bit for bit every ten minutes, faults included: a gap, a message twice, one
that is not finite, one cut off. The powers that the pipeline puts out are compared with those
of the second cycle; an interval that agrees counts once more for an energy that was worked out
from the powers in exact integers. So the reference shares no sum with what it checks, and is
exact over a month.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TypeVar

import numpy as np
from figure import Figure, resident_kib, slope
from numpy.typing import NDArray
from reference import Reference

from robot_energy.accounting.registers import CABINET_REGISTERS, JOINT_REGISTERS
from robot_energy.bag.cdr import Encoder, RawBatch, stamp_columns
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.inputs.meter.meter import MeterIngest
from robot_energy.inputs.temperatures.temperatures import TemperatureIngest
from robot_energy.model import load
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.timeline.blocks import Float, Int, Quality

T = TypeVar("T")

MINUTES = (10.0, 0.5)

RATE = 50  # joint states per second
CYCLE = 600  # s
SECOND_NS = 10**9
PERIOD_NS = SECOND_NS // RATE
CYCLE_NS = CYCLE * SECOND_NS
START_NS = 1_700_000_000 * SECOND_NS
BLOCK = 4096  # messages, as replay takes them
SINGLE = 20 * RATE  # messages at the start of every day that come one by one
GAP = slice(200 * RATE, 203 * RATE)  # nothing is sent
LONGEST_NS = SECOND_NS  # intervals above this are gaps
NOT_FINITE, TWICE, CUT = 100 * RATE, 300 * RATE, 400 * RATE  # the faulty messages
TOLERANCE = 1  # uJ
GROWTH_KIB = 8 * 1024  # of the memory over the run


def run(folder: str, quick: bool) -> list[Figure]:
    """Simulate 30 days, or one."""
    del folder
    return simulate(24 * 6 * (1 if quick else 30)).figures()


def simulate(cycles: int) -> Month:
    """Feed some cycles to the pipeline and keep the reference next to it."""
    month = Month(cycles)
    month.run()
    return month


@dataclass
class Recording:
    """One cycle of messages, and any stretch of the month as batches."""

    names: tuple[str, ...]
    stamp_ns: Int = field(init=False)  # of the messages in order of arrival, from 0
    kept_ns: Int = field(init=False)  # of the good ones
    power: Float = field(init=False)  # meter readings, one per second [W]

    def __post_init__(self) -> None:
        n = len(self.names)
        row = np.arange(CYCLE * RATE)
        row = np.insert(row, TWICE, TWICE)
        row = row[(row < GAP.start) | (row >= GAP.stop)]
        bad = np.isin(row, (NOT_FINITE, CUT))
        self.stamp_ns = row * PERIOD_NS
        self.kept_ns = np.unique(self.stamp_ns[~bad])
        self._cut = int(np.flatnonzero(row == CUT)[0])
        # Every joint ends a cycle where it began it.
        speed = 2 * np.pi * np.arange(17, 17 + n) / CYCLE
        angle = (row / RATE)[:, None] * speed
        position = 0.8 * np.sin(angle)
        position[row == NOT_FINITE, -1] = np.nan
        columns = {"position": position, "velocity": 0.8 * speed * np.cos(angle), "effort": 0.0}
        lengths = dict.fromkeys(("position", "velocity", "effort"), n)
        self._joints = Encoder("sensor_msgs/msg/JointState", {"name": self.names}, lengths).encode(
            {**stamp_columns(self.stamp_ns), **columns}, len(row)
        )
        turn = 2 * np.pi * np.arange(CYCLE) / CYCLE
        warm = 40 + 15 * np.sin(turn)[:, None] - np.arange(n)
        seconds = stamp_columns(np.arange(CYCLE) * SECOND_NS)
        self._temperatures = Encoder(
            "ros2_energy_msgs/msg/MotorTemperatures",
            {"joint_names": self.names},
            {"temperature_degc": n},
        ).encode({**seconds, "temperature_degc": warm}, CYCLE)
        self.power = 600 + 50 * np.cos(10 * turn)
        constants = {"meaning": 1, "location": 1, "energy": np.nan, "interval": np.nan}
        self._meter = Encoder("ros2_energy_msgs/msg/PowerReading", constants).encode(
            {**seconds, "power": self.power}, CYCLE
        )

    def joint_states(self, start: int, stop: int) -> RawBatch:
        """Joint states by their number since the start."""
        stamp, rows = _times(start, stop, self.stamp_ns)
        batch = _batch("sensor_msgs/msg/JointState", stamp, self._joints[rows])
        batch.length[rows == self._cut] -= 20
        return batch

    def readings(self, start: int, stop: int) -> tuple[RawBatch, RawBatch]:
        """Temperatures and meter readings of some seconds since the start."""
        stamp, rows = _times(start, stop, np.arange(CYCLE) * SECOND_NS)
        return (
            _batch("ros2_energy_msgs/msg/MotorTemperatures", stamp, self._temperatures[rows]),
            _batch("ros2_energy_msgs/msg/PowerReading", stamp, self._meter[rows]),
        )

    def measured_microjoule(self, cycles: int) -> Fraction:
        """What the meter saw between the samples, up to its last reading, exactly."""
        power = [Fraction(float(value)) for value in [*self.power, self.power[0]]]
        last, first = GAP.start // RATE - 1, GAP.stop // RATE  # around the gap, whole seconds
        whole = sum((power[k] + power[k + 1]) / 2 for k in range(CYCLE) if k < last or k >= first)
        # The second before the gap, up to the last sample before it.
        share = 1 - Fraction(1, RATE)
        end = power[last] + (power[last + 1] - power[last]) * share
        whole += (power[last] + end) / 2 * share
        return 10**6 * (cycles * whole - (power[CYCLE - 1] + power[CYCLE]) / 2)


def _times(start: int, stop: int, cycle_ns: Int) -> tuple[Int, Int]:
    turn, rows = np.divmod(np.arange(start, stop), len(cycle_ns))
    return START_NS + turn * CYCLE_NS + cycle_ns[rows], rows


def _batch(msgtype: str, stamp: Int, rows: NDArray[np.uint8]) -> RawBatch:
    """Messages with these stamps put in."""
    words = rows[:, 4:12].view("<u4")
    words[:, 0], words[:, 1] = stamp // SECOND_NS, stamp % SECOND_NS
    n, size = rows.shape
    return RawBatch("/t", msgtype, stamp, rows.ravel(), np.arange(n) * size, np.full(n, size))


class Month:
    """The pipeline, what it is fed, and the reference.

    Args:
        cycles: Length of the run.

    Attributes:
        unbalanced: Hours at whose end a count or a time did not add up.
    """

    def __init__(self, cycles: int) -> None:
        model = load("kr16")
        self._cycles = cycles
        self._recording = Recording(model.joint_names)
        self._joints = JointStateIngest(model.joint_names)
        self._temperatures = TemperatureIngest(model.joint_names)
        self._meter = MeterIngest()
        self._pipeline = EnergyPipeline(model, Settings(power_period=1.0))
        self._reference = Reference(START_NS, CYCLE_NS, self._recording.kept_ns, LONGEST_NS)
        self._fed = 0  # joint states
        self._seconds = 0  # of the readings
        self._memory: list[tuple[float, int]] = []  # days since the start, KiB
        self._cut_short = 0  # samples at the end whose window is cut by it
        self.unbalanced = 0

    def run(self) -> None:
        """Feed all cycles and close the books."""
        for start, stop in self._cuts():
            self._step(start, stop)
        flushed = self._pipeline.flush().power
        if flushed is not None:
            incomplete = flushed.quality & np.uint32(Quality.ACCELERATION_INCOMPLETE)
            self._cut_short = int(np.count_nonzero(incomplete))
            self._reference.take(flushed)

    def _cuts(self) -> Iterator[tuple[int, int]]:
        """Where the messages are cut into blocks."""
        day = 24 * 3600 // CYCLE * len(self._recording.stamp_ns)
        total = self._cycles * len(self._recording.stamp_ns)
        start = 0
        while start < total:
            single = start % day < SINGLE
            left = (SINGLE if single else day) - start % day
            stop = min(start + (1 if single else BLOCK), start + left, total)
            yield start, stop
            start = stop

    def _step(self, start: int, stop: int) -> None:
        batch = self._recording.joint_states(start, stop)
        self._fed += len(batch)
        now = int(batch.log_time_ns[-1])
        seconds = (now - START_NS) // SECOND_NS + 1
        temperatures = meter = None
        if seconds > self._seconds:
            warm, power = self._recording.readings(self._seconds, seconds)
            temperatures, meter = self._temperatures.step([warm]), self._meter.step([power])
        block = self._joints.step(batch)
        output = self._pipeline.step(block, temperatures, meter)
        if output.power is not None:
            self._reference.take(output.power)
        hour = seconds // 3600
        if hour > self._seconds // 3600:
            self._check()
            self._memory.append((hour / 24, resident_kib()))
        self._seconds = max(seconds, self._seconds)

    def _check(self) -> None:
        """Check that every message and every ns is accounted for."""
        logs = [self._joints.rejections, self._temperatures.rejections, self._meter.rejections]
        time, reference = self._pipeline.account.registers.time, self._reference
        adds_up = (
            all(log.balanced for log in logs)
            and self._joints.rejections.received == self._fed
            and (time.observed_ns, time.gap_ns) == (reference.observed_ns, reference.gap_ns)
            and time.observed_ns + time.gap_ns == (time.end_ns or 0) - (time.start_ns or 0)
            and self._pipeline.account.counts.samples <= self._joints.rejections.accepted
        )
        self.unbalanced += not adds_up

    def figures(self) -> list[Figure]:
        """Compare the registers with the reference."""
        self._check()
        account, rejections = self._pipeline.account, self._joints.rejections
        reference = self._reference.microjoule()
        groups = self._grouped(account.registers.microjoule.tolist())
        exact = self._grouped(reference)
        groups["measured"] = [round(account.comparison.measured_energy * 1e6)]
        exact["measured"] = [self._recording.measured_microjoule(self._cycles)]
        errors = {
            name: max(
                abs(found - math.floor(true))
                for found, true in zip(groups[name], exact[name], strict=True)
            )
            for name in groups
        }
        worst = max(errors, key=lambda name: errors[name])
        expected = {name: self._cycles for name in ("not_finite", "duplicate_stamp", "malformed")}
        # The first hours fill caches and histories.
        days, memory = zip(*self._memory[2:], strict=True) if self._memory[3:] else ((), ())
        per_day = slope(days, memory)
        return [
            Figure("joint states", rejections.received),
            Figure(f"rate [Hz], in blocks of {BLOCK} and of 1", RATE),
            Figure("grid energy [MJ]", account.registers.cabinet("grid_import") / 1e6),
            Figure(
                f"largest error of {len(reference) + 1} registers ({worst}) [uJ]",
                errors[worst],
                f"<= {TOLERANCE}",
                errors[worst] <= TOLERANCE,
            ),
            Figure(
                "samples unlike those a cycle before",
                self._reference.strange,
                f"the last {self._cut_short}",
                self._reference.strange == self._cut_short,
            ),
            Figure("hours that do not add up", self.unbalanced, "0", not self.unbalanced),
            Figure(
                "messages rejected, one of each fault per cycle",
                ", ".join(f"{count} {name}" for name, count in rejections.rejected.items()),
                f"{self._cycles} each",
                dict(rejections.rejected) == expected,
            ),
            Figure("observed [days]", account.registers.time.observed_ns / 86400e9),
            Figure(
                "samples booked",
                account.counts.samples,
                "all accepted",
                account.counts.samples == rejections.accepted,
            ),
            Figure(
                "memory: slope [KiB per simulated day]",
                per_day,
                f"grows <= {GROWTH_KIB} KiB over the run",
                per_day * self._cycles * CYCLE / 86400 <= GROWTH_KIB,
            ),
            Figure("memory: at the end [MiB]", resident_kib() / 1024),
        ]

    def _grouped(self, values: Sequence[T]) -> dict[str, list[T]]:
        """Registers by name; those of the joints hold one per joint."""
        cabinet, n = len(CABINET_REGISTERS), len(self._recording.names)
        groups = {name: [values[i]] for i, name in enumerate(CABINET_REGISTERS)}
        for i, name in enumerate(JOINT_REGISTERS):
            groups[name] = list(values[cabinet + i * n : cabinet + (i + 1) * n])
        return groups
