"""A pump and an extruder next to the simulated robot, with meters and states of their own.

Their powers are functions of time alone: they share nothing with a model. The pump has a meter
that reports means, the extruder a counter of whole joules. States follow by message
when they change.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_energy.blocks import NANOSECOND, Float, Int, MeterBlock, MeterLocation, MeterMeaning

STEP = 1e-3  # s, of the integral of the power
METER_CLASS = 0.005  # gain error of a meter is drawn once within +- this share
PUMP_PERIOD, PUMP_RUNS, PUMP_STARTS = 30.0, 20.0, 5.0  # s
PUMP_OFF, PUMP_ON, PUMP_SWING, SWING_PERIOD = 12.0, 850.0, 0.1, 7.0  # W, W, share, s
EXTRUDER_OFF, EXTRUDER_HEATS, EXTRUDER_WORKS = 5.0, 400.0, 180.0  # W
HEAT_FROM, HEAT_UNTIL = 3.0, 15.0  # s
COUNTER_STEP = 1.0  # J
PUMP_RATE, EXTRUDER_RATE = 1.0, 2.0  # Hz, of the meters


@dataclass(frozen=True)
class LoadRecord:
    """What one load and its meter did.

    Attributes:
        readings: Of its meter.
        changed_ns: When its state changed, the first at the start, shape (K,). [ns]
        state: Number of the state since then, shape (K,).
        energy: True energy. [J]
    """

    readings: MeterBlock
    changed_ns: Int
    state: Int
    energy: float


def auxiliary_loads(start_ns: int, duration: float, seed: int) -> dict[str, LoadRecord]:
    """Return what pump and extruder do during a run of the rig.

    Args:
        start_ns: Of the run. [ns]
        duration: Of the run. [s]
        seed: Of the gain errors of their meters.

    Returns:
        By the names of the loads, ``pump`` and ``extruder``.
    """
    time = np.arange(round(duration / STEP) + 1) * STEP
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
        energy = np.concatenate([[0.0], np.cumsum(power[:-1] * STEP)])
        rate = PUMP_RATE if name == "pump" else EXTRUDER_RATE
        at = np.arange(0, len(time), round(1.0 / (rate * STEP)))
        stamp = start_ns + np.rint(time[at] / NANOSECOND).astype(np.int64)
        counted = energy[at] * gain[place]
        readings = _means(stamp, counted) if name == "pump" else _counter(stamp, counted)
        change = np.concatenate([[0], np.flatnonzero(np.diff(states[name])) + 1])
        changed = start_ns + np.rint(time[change] / NANOSECOND).astype(np.int64)
        found[name] = LoadRecord(readings, changed, states[name][change], float(energy[-1]))
    return found


def _means(stamp: Int, counted: Float) -> MeterBlock:
    interval = np.diff(stamp) * NANOSECOND
    none = np.full(len(interval), np.nan)
    return MeterBlock(
        stamp[1:],
        np.diff(counted) / interval,
        none,
        interval,
        MeterMeaning.MEAN_OVER_INTERVAL,
        MeterLocation.GRID,
    )


def _counter(stamp: Int, counted: Float) -> MeterBlock:
    none = np.full(len(stamp), np.nan)
    steps = COUNTER_STEP * np.floor(counted / COUNTER_STEP)
    return MeterBlock(stamp, none, steps, none, MeterMeaning.CUMULATIVE, MeterLocation.GRID)
