"""What the sensors of a simulated robot say, as the topics that a robot would have.

Encoders count; velocities are differences of them. Torque is current times the name plate. The
thermometer of a winding stands between winding and housing, lags, has a constant error and reads
whole degrees. The power meter has a limited bandwidth and a delay, and reads whole watts.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_energy.bag import SENSOR_QOS, BagWriter
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
from robot_energy_rig.config import RigJoints
from robot_energy_rig.record import (
    JOINT_DELAY_NS,
    METER_DELAY_NS,
    TEMPERATURE_DELAY_NS,
    TYPES,
    RigEncoder,
    RigRecording,
)
from robot_energy_studies.simulator.drawn import DrawnRobot
from robot_energy_studies.simulator.heat import HOUSING, OIL, WINDING
from robot_energy_studies.simulator.robots import BLOCK, SAMPLE, STEP, SimulatedRun

ORIGIN = "second simulator: simulated, nothing in it was measured on a robot"
START_NS = 1_100_000_000 * 1_000_000_000  # an arbitrary instant in 2004
COUNTS = 16384  # of an encoder by motor turn
TORQUE_NOISE = 0.01  # of the rated torque
WINDING_SHARE = 0.7  # of winding against housing at the thermometer
THERMOMETER_LAG = 30.0  # s
READING = 100  # steps between readings of the meter
METER_NOISE = 0.002  # of a reading


@dataclass(frozen=True)
class DrawnSensors:
    """Constant errors of the sensors of one robot."""

    temperature_offset: Float  # shape (n,) [K]
    meter_gain: float  # [-]
    meter_lag: float  # time constant of the meter [s]
    meter_delay: float  # of its stamps [s]
    seed: int  # of the noise


def drawn_sensors(seed: int, n_joints: int) -> DrawnSensors:
    """Return sensors: a meter of class 0.5, thermometers with 1.5 K of standard deviation.

    Args:
        seed: The same seed gives the same sensors.
    """
    random = np.random.default_rng([0x73656E73, seed])
    return DrawnSensors(
        temperature_offset=random.normal(0.0, 1.5, n_joints),
        meter_gain=1.0 + random.uniform(-0.005, 0.005),
        meter_lag=random.uniform(0.05, 0.4),
        meter_delay=random.uniform(0.0, 0.1),
        seed=seed,
    )


def record(
    run: SimulatedRun,
    which: int,
    duration: float,
    robot: DrawnRobot,
    sensors: DrawnSensors,
    path: Path,
) -> RigRecording:
    """Return the account of one robot's run, whose topics are written to a bag.

    Args:
        duration: From the start; what follows is left out. [s]
        path: Of the bag, which is replaced.
    """
    random = np.random.default_rng([sensors.seed, which])
    steps = min(round(duration / STEP), len(run.grid_power))
    blocks = slice(0, -(-steps // BLOCK) + 1)
    grid = run.grid_power[:steps, which]
    encoder = RigEncoder(robot.joint_names)
    joints = _joints(run, which, -(-steps // SAMPLE), robot, random)
    thermometers = _temperatures(run.degc[blocks, which], sensors)
    readings = _readings(grid, sensors, random)
    topics = (
        (JOINT_STATES_TOPIC, JOINT_DELAY_NS, joints, encoder.joint_states(joints)),
        (
            TEMPERATURES_TOPIC,
            TEMPERATURE_DELAY_NS,
            thermometers,
            encoder.temperatures(thermometers),
        ),
        (METER_TOPIC, METER_DELAY_NS, readings, encoder.meter(readings)),
    )
    messages = sorted(
        (time, topic, row.tobytes())
        for topic, delay_ns, block, rows in topics
        for time, row in zip((block.stamp_ns + delay_ns).tolist(), rows, strict=True)
    )
    with BagWriter(path, overwrite=True, origin=ORIGIN) as bag:
        for topic, kind in TYPES.items():
            if topic != DRIVE_POWER_TOPIC:
                bag.add_topic(topic, kind, *([SENSOR_QOS] if topic == JOINT_STATES_TOPIC else []))
        bag.write_in_order(messages)
    ends = run.degc[blocks][[0, -1], which]
    return RigRecording(
        path,
        {topic: len(rows) for topic, _, _, rows in topics},
        float(grid.sum()) * STEP,
        float(grid.max()),
        ends[:, WINDING],
        ends[:, OIL],
        {},
    )


def _stamps(steps: Int) -> Int:
    return START_NS + steps * round(STEP / NANOSECOND)


def _joints(
    run: SimulatedRun, which: int, rows: int, robot: DrawnRobot, random: np.random.Generator
) -> RigJoints:
    ratio, count = robot.arm.gear_ratio, 2.0 * np.pi / COUNTS
    position = np.rint(run.motor_angle[:rows, which] / count) * count / ratio
    velocity = np.diff(position, axis=0, prepend=position[:1]) / (SAMPLE * STEP)
    torque = run.current[:rows, which] * robot.motors.plate_constant
    noise = random.standard_normal(torque.shape) * TORQUE_NOISE * robot.motors.rated_torque
    stamp_ns = _stamps(np.arange(rows, dtype=np.int64) * SAMPLE)
    return RigJoints(stamp_ns, position, velocity, torque + noise, np.full_like(torque, np.nan))


def _temperatures(degc: Float, sensors: DrawnSensors) -> TemperatureBlock:
    """Readings at the start and after every block."""
    reached = WINDING_SHARE * degc[:, WINDING] + (1.0 - WINDING_SHARE) * degc[:, HOUSING]
    shown, kept = reached.copy(), np.exp(-BLOCK * STEP / THERMOMETER_LAG)
    for row in range(1, len(shown)):
        shown[row] = reached[row] + (shown[row - 1] - reached[row]) * kept
    stamp_ns = _stamps(np.arange(len(shown), dtype=np.int64) * BLOCK)
    return TemperatureBlock(stamp_ns, np.rint(shown + sensors.temperature_offset))


def _readings(grid: Float, sensors: DrawnSensors, random: np.random.Generator) -> MeterBlock:
    """Means of the filtered power between readings."""
    from scipy.signal import lfilter

    kept = float(np.exp(-STEP / sensors.meter_lag))
    start = np.array([kept * float(grid[0])])
    seen: Float = np.asarray(lfilter([1.0 - kept], [1.0, -kept], grid, zi=start)[0])
    count = len(seen) // READING
    mean = seen[: count * READING].reshape(count, READING).mean(axis=1)
    noise = 1.0 + METER_NOISE * random.standard_normal(count)
    end_ns = _stamps(np.arange(1, count + 1, dtype=np.int64) * READING)
    return MeterBlock(
        end_ns + round(sensors.meter_delay / NANOSECOND),
        np.rint(mean * sensors.meter_gain * noise),
        np.full(count, np.nan),
        np.full(count, READING * STEP),
        MeterMeaning.MEAN_OVER_INTERVAL,
        MeterLocation.GRID,
    )
