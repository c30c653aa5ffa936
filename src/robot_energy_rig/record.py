"""Record the rig, perhaps with a pump and an extruder, as topics of a robot would be recorded."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from operator import itemgetter
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from robot_energy.bag import SENSOR_QOS, BagWriter
from robot_energy.bag.cdr import Encoder, stamp_columns
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import RigError
from robot_energy.messages.fields import (
    DRIVE_POWER_TOPIC,
    JOINT_STATES_TOPIC,
    METER_TOPIC,
    TEMPERATURES_TOPIC,
)
from robot_energy.timeline.blocks import (
    NANOSECOND,
    Float,
    Int,
    MeterBlock,
    MeterLocation,
    MeterMeaning,
    TemperatureBlock,
)
from robot_energy_rig.config import RigJoints, RigOutput
from robot_energy_rig.virtual_rig import VirtualRig

LOADS = ("pump", "extruder")
INTEGRAL_STEP = 1e-3  # s, of the integral of the power
METER_CLASS = 0.005  # gain error of a meter is drawn once within +- this share
PUMP_PERIOD, PUMP_RUNS, PUMP_STARTS = 30.0, 20.0, 5.0  # s
PUMP_OFF, PUMP_ON, PUMP_SWING, SWING_PERIOD = 12.0, 850.0, 0.1, 7.0  # W, W, share, s
EXTRUDER_OFF, EXTRUDER_HEATS, EXTRUDER_WORKS = 5.0, 400.0, 180.0  # W
HEAT_FROM, HEAT_UNTIL = 3.0, 15.0  # s
COUNTER_STEP = 1.0  # J
PUMP_RATE, EXTRUDER_RATE = 1.0, 2.0  # Hz, of the meters


class LoadRecord(Described):
    """What one load and its meter did."""

    readings: MeterBlock
    changed_ns: Annotated[Int, "When its state changed, the first at the start, shape (K,). [ns]"]
    state: Annotated[Int, "Number of the state since then, shape (K,)."]
    energy: Annotated[float, "True energy. [J]"]


def auxiliary_loads(
    start_ns: int,
    duration: float,
    seed: int,
    begin: float = 0.0,
    used: Mapping[str, float] | None = None,
) -> dict[str, LoadRecord]:
    """Return what ``pump`` and ``extruder`` do during a run of the rig, or during a part of it.

    Their powers are functions of time alone. The pump has a meter that reports means, the extruder
    a counter of whole joules. States follow by message when they change.

    Args:
        duration: Of the run, or of the part. [s]
        begin: Where the part begins. [s]
        used: True energy of each load before. [J]
    """
    time = begin + np.arange(round(duration / INTEGRAL_STEP) + 1) * INTEGRAL_STEP
    runs = (time >= PUMP_STARTS) & ((time - PUMP_STARTS) % PUMP_PERIOD < PUMP_RUNS)
    swing = 1.0 + PUMP_SWING * np.sin(2.0 * np.pi * time / SWING_PERIOD)
    pump = np.where(runs, PUMP_ON * swing, PUMP_OFF)
    heats = (time >= HEAT_FROM) & (time < HEAT_UNTIL)
    works = (time >= HEAT_UNTIL) & runs
    extruder = np.select([heats, works], [EXTRUDER_HEATS, EXTRUDER_WORKS], EXTRUDER_OFF)
    states = {"pump": runs.astype(np.int64), "extruder": heats + 2 * works}
    gain = 1.0 + np.random.default_rng(seed).uniform(-METER_CLASS, METER_CLASS, 2)
    found: dict[str, LoadRecord] = {}
    for place, (name, power) in enumerate({"pump": pump, "extruder": extruder}.items()):
        energy = np.concatenate([[0.0], np.cumsum(power[:-1] * INTEGRAL_STEP)]) + (used or {}).get(
            name, 0.0
        )
        rate = PUMP_RATE if name == "pump" else EXTRUDER_RATE
        at = np.arange(0, len(time), round(1.0 / (rate * INTEGRAL_STEP)))
        stamp = start_ns + np.rint(time[at] / NANOSECOND).astype(np.int64)
        counted = energy[at] * gain[place]
        none, grid = np.full(len(stamp), np.nan), MeterLocation.GRID
        if name == "pump":
            interval = np.diff(stamp) * NANOSECOND
            power, kind = np.diff(counted) / interval, MeterMeaning.MEAN_OVER_INTERVAL
            readings = MeterBlock(stamp[1:], power, none[1:], interval, kind, grid)
        else:
            steps = COUNTER_STEP * np.floor(counted / COUNTER_STEP)
            readings = MeterBlock(stamp, none, steps, none, MeterMeaning.CUMULATIVE, grid)
        change = np.concatenate([[0], np.flatnonzero(np.diff(states[name])) + 1])
        changed = start_ns + np.rint(time[change] / NANOSECOND).astype(np.int64)
        found[name] = LoadRecord(readings, changed, states[name][change], float(energy[-1]))
    return found


class LoadPlayer:
    """Pump and extruder next to a rig that runs without an end."""

    def __init__(self, start_ns: int, seed: int) -> None:
        self._start_ns, self._seed = start_ns, seed
        self._parts = 0  # of one period of the pump each
        self._due = auxiliary_loads(start_ns, 0.0, seed)
        self._used: dict[str, float] = {}

    def step_until(self, stamp_ns: int) -> dict[str, LoadRecord]:
        """Return what meters and states have said since the last call, by the names of loads."""
        while self._start_ns + round(self._parts * PUMP_PERIOD / NANOSECOND) <= stamp_ns:
            begin, self._parts = self._parts * PUMP_PERIOD, self._parts + 1
            more = auxiliary_loads(self._start_ns, PUMP_PERIOD, self._seed, begin, self._used)
            self._used = {name: load.energy for name, load in more.items()}
            self._due = {name: _joined(self._due[name], load) for name, load in more.items()}
        before = {name: _cut(load, stamp_ns, False) for name, load in self._due.items()}
        self._due = {name: _cut(load, stamp_ns, True) for name, load in self._due.items()}
        return before


def _joined(first: LoadRecord, later: LoadRecord) -> LoadRecord:
    """Two parts in one; a reading at the end of the first is not repeated."""
    readings = later.readings
    if len(first.readings):
        readings = readings[readings.stamp_ns > first.readings.stamp_ns[-1]]
    return LoadRecord(
        MeterBlock.concatenate([first.readings, readings]),
        np.concatenate([first.changed_ns, later.changed_ns]),
        np.concatenate([first.state, later.state]),
        later.energy,
    )


def _cut(load: LoadRecord, stamp_ns: int, later: bool) -> LoadRecord:
    """What a load did until a stamp, or after it."""
    readings = (load.readings.stamp_ns > stamp_ns) == later
    changes = (load.changed_ns > stamp_ns) == later
    return LoadRecord(
        load.readings[readings], load.changed_ns[changes], load.state[changes], load.energy
    )


READING, STATE = "ros2_energy_msgs/msg/PowerReading", "std_msgs/msg/UInt8"
TYPES = {
    JOINT_STATES_TOPIC: "sensor_msgs/msg/JointState",
    TEMPERATURES_TOPIC: "ros2_energy_msgs/msg/MotorTemperatures",
    METER_TOPIC: READING,
    DRIVE_POWER_TOPIC: "std_msgs/msg/Float64MultiArray",
}
Message = tuple[int, str, bytes]  # log time [ns], topic, content

ORIGIN = "virtual rig: simulated, nothing in it was measured on a robot"
STEP = 1.0  # s of samples written at once
JOINT_DELAY_NS = 500_000  # from measurement to log
TEMPERATURE_DELAY_NS = 5_000_000
METER_DELAY_NS = 20_000_000


class RigRecording(Described):
    """What was written."""

    path: Path
    messages: dict[str, int]
    energy: Annotated[float, "True energy drawn from the grid. [J]"]
    peak_power: Annotated[float, "Greatest true power from the grid. [W]"]
    motor_temperature_degc: Annotated[Float, "True ones, first and last, shape (2, n). [degC]"]
    gear_temperature_degc: Annotated[Float, "The same of the oil, shape (2, n). [degC]"]
    auxiliary_energy: Annotated[dict[str, float], "True energy of each auxiliary load. [J]"]


class RigEncoder:
    """Serializes a rig to ROS 2 messages; ``effort`` is motor torque, as drives report it."""

    def __init__(self, joint_names: tuple[str, ...]) -> None:
        n_joints = len(joint_names)
        self._names = tuple(joint_names)
        self._joints = Encoder(
            TYPES[JOINT_STATES_TOPIC],
            {"name": self._names},
            {"position": n_joints, "velocity": n_joints, "effort": n_joints},
        )
        self._temperatures = Encoder(
            TYPES[TEMPERATURES_TOPIC], {"joint_names": self._names}, {"temperature_degc": n_joints}
        )
        self._meter = Encoder(TYPES[METER_TOPIC])
        # Without a layout, as drivers write it: one value per joint in the order of the joints.
        self._drives = Encoder(
            TYPES[DRIVE_POWER_TOPIC], {"layout.data_offset": 0}, {"layout.dim": 0, "data": n_joints}
        )

    def joint_states(self, block: RigJoints) -> NDArray[np.uint8]:
        """Return sensor_msgs/JointState messages, shape (N, size)."""
        return self._joints.encode(
            {
                **stamp_columns(block.stamp_ns),
                "position": block.joint_position,
                "velocity": block.joint_velocity,
                "effort": block.measured_motor_torque,
            },
            len(block),
        )

    def drive_power(self, block: RigJoints) -> NDArray[np.uint8]:
        """Return std_msgs/Float64MultiArray messages, one value per drive, shape (N, size)."""
        nothing = np.empty((len(block), 0), dtype=np.uint32)
        columns = {"layout.dim.size": nothing, "layout.dim.stride": nothing}
        return self._drives.encode({**columns, "data": block.measured_drive_power}, len(block))

    def temperatures(self, block: TemperatureBlock) -> NDArray[np.uint8]:
        """Return ros2_energy_msgs/MotorTemperatures messages, shape (N, size)."""
        degc = {"temperature_degc": block.motor_temperature_degc}
        return self._temperatures.encode(stamp_columns(block.stamp_ns) | degc, len(block))

    def meter(self, block: MeterBlock) -> NDArray[np.uint8]:
        """Return ros2_energy_msgs/PowerReading messages, shape (N, size)."""
        return self._meter.encode(
            {
                **stamp_columns(block.stamp_ns),
                "meaning": np.uint8(block.meaning),
                "location": np.uint8(block.location),
                "power": block.power,
                "energy": block.energy,
                "interval": block.interval,
            },
            len(block),
        )


def _write(bag: BagWriter, waiting: list[Message], before_ns: int | None) -> list[Message]:
    """Write what is logged before an instant, or everything, and return the rest."""
    waiting.sort(key=itemgetter(0))
    ready = len(waiting)
    if before_ns is not None:
        ready = bisect_left(waiting, before_ns, key=itemgetter(0))
    bag.write_in_order(waiting[:ready])
    return waiting[ready:]


def outputs(rig: VirtualRig, duration: float, step: float = STEP) -> Iterator[RigOutput]:
    """Yield what a rig gives in a while, one piece at a time.

    Args:
        duration: [s]
        step: Length of a piece. [s]
    """
    if not (duration > 0 and step > 0 and np.isfinite(duration)):
        raise RigError(f"a run of {duration} s in steps of {step} s was asked for", "times > 0 s")
    last = rig.stamp_ns + round(duration / NANOSECOND) - 1  # the end itself is not included
    piece = max(round(step / NANOSECOND), 1)
    end = rig.stamp_ns - 1
    while end < last:
        end = min(end + piece, last)
        output = rig.step_until(end)
        if output is not None:
            yield output


def record(
    rig: VirtualRig,
    duration: float,
    path: str | Path,
    compression: Literal["zstd", "none"] = "zstd",
    overwrite: bool = False,
    drive_power: bool = False,
    auxiliary: bool = False,
) -> RigRecording:
    """Return the account of a run of a rig, whose topics are written to a bag.

    ``/joint_states`` (sensor_msgs/JointState, effort = motor torque),
    ``/motor_temperatures`` (ros2_energy_msgs/MotorTemperatures) and ``/power_meter``
    (ros2_energy_msgs/PowerReading), logged a small delay after their stamps.

    Args:
        duration: [s]
        drive_power: Record the electrical input of each drive as well, on ``/drive_power``
            (std_msgs/Float64MultiArray), at every sample of the joint states.
        auxiliary: Record a pump and an extruder as well (`rig.auxiliary`): meters on
            ``/auxiliary/NAME/power`` (PowerReading), states on ``/auxiliary/NAME/state``
            (std_msgs/UInt8).
    """
    pieces = outputs(rig, duration)
    first = next(pieces, None)
    if first is None:
        raise RigError(f"a run of {duration} s holds no sample", "a longer duration")
    encoder = RigEncoder(rig.joint_names)
    types = {
        topic: kind for topic, kind in TYPES.items() if drive_power or topic != DRIVE_POWER_TOPIC
    }
    begin_ns = int(first.truth.stamp_ns[0])
    loads = auxiliary_loads(begin_ns, duration, rig.seed) if auxiliary else {}
    for name in loads:
        types |= {f"/auxiliary/{name}/power": READING, f"/auxiliary/{name}/state": STATE}
    counts = dict.fromkeys(types, 0)
    energy, peak, end = 0.0, 0.0, first.truth
    waiting: list[Message] = []

    def wait(messages: Iterable[tuple[str, Int, NDArray[np.uint8]]]) -> None:
        for topic, time_ns, rows in messages:
            times = time_ns.tolist()
            waiting.extend((t, topic, row.tobytes()) for t, row in zip(times, rows, strict=True))
            counts[topic] += len(rows)

    wait(load_messages(encoder, loads))
    with BagWriter(path, compression, overwrite, origin=ORIGIN) as bag:
        for topic, kind in types.items():
            bag.add_topic(topic, kind, *([SENSOR_QOS] if topic == JOINT_STATES_TOPIC else []))
        for output in chain([first], pieces):
            wait(_messages(encoder, output, drive_power))
            end = output.truth
            energy += float(end.grid_power.sum()) * rig.period
            peak = max(peak, float(end.grid_power.max()))
            waiting = _write(bag, waiting, int(end.stamp_ns[-1]))
        _write(bag, waiting, None)
    begin = first.truth
    return RigRecording(
        Path(path),
        counts,
        energy,
        peak,
        np.stack([begin.motor_temperature_degc[0], end.motor_temperature_degc[-1]]),
        np.stack([begin.gear_temperature_degc[0], end.gear_temperature_degc[-1]]),
        {name: load.energy for name, load in loads.items()},
    )


def load_messages(
    encoder: RigEncoder, loads: Mapping[str, LoadRecord]
) -> Iterator[tuple[str, Int, NDArray[np.uint8]]]:
    """Yield topic, log times [ns] and messages of the meter, then of the states, of each load."""
    state = Encoder(STATE)
    for name, load in loads.items():
        readings = load.readings
        stamp = readings.stamp_ns + METER_DELAY_NS
        yield f"/auxiliary/{name}/power", stamp, encoder.meter(readings)
        rows = state.encode({"data": load.state.astype(np.uint8)}, len(load.state))
        yield f"/auxiliary/{name}/state", load.changed_ns, rows


def _messages(
    encoder: RigEncoder, output: RigOutput, drive_power: bool
) -> Iterator[tuple[str, Int, NDArray[np.uint8]]]:
    joints = output.joints
    yield JOINT_STATES_TOPIC, joints.stamp_ns + JOINT_DELAY_NS, encoder.joint_states(joints)
    if drive_power:
        yield DRIVE_POWER_TOPIC, joints.stamp_ns + JOINT_DELAY_NS, encoder.drive_power(joints)
    if output.temperatures is not None:
        stamp = output.temperatures.stamp_ns + TEMPERATURE_DELAY_NS
        yield TEMPERATURES_TOPIC, stamp, encoder.temperatures(output.temperatures)
    if output.meter is not None:
        yield METER_TOPIC, output.meter.stamp_ns + METER_DELAY_NS, encoder.meter(output.meter)
