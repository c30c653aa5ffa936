"""A pump and an extruder next to the simulated robot, with meters and states of their own.

Their powers are functions of time alone: they share nothing with a model. The pump has a meter
that reports means, the extruder a counter of whole joules. States follow by message
when they change.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import NANOSECOND, Int, MeterBlock, MeterLocation, MeterMeaning

LOADS = ("pump", "extruder")
STEP = 1e-3  # s, of the integral of the power
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

    Args:
        start_ns: Of the run. [ns]
        duration: Of the run, or of the part. [s]
        begin: Where the part begins. [s]
        used: True energy of each load before. [J]
    """
    time = begin + np.arange(round(duration / STEP) + 1) * STEP
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
        energy = np.concatenate([[0.0], np.cumsum(power[:-1] * STEP)]) + (used or {}).get(name, 0.0)
        rate = PUMP_RATE if name == "pump" else EXTRUDER_RATE
        at = np.arange(0, len(time), round(1.0 / (rate * STEP)))
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
    """Pump and extruder next to a rig that runs without an end.

    Args:
        start_ns: Stamp of its begin. [ns]
    """

    def __init__(self, start_ns: int, seed: int) -> None:
        self._start_ns, self._seed = start_ns, seed
        self._parts = 0  # of one period of the pump each
        self._due = auxiliary_loads(start_ns, 0.0, seed)
        self._end_ns = start_ns
        self._used: dict[str, float] = {}

    def step_until(self, stamp_ns: int) -> dict[str, LoadRecord]:
        """Return what meters and states have said since the last call, by the names of the loads.

        Args:
            stamp_ns: Until when. [ns]
        """
        while self._end_ns <= stamp_ns:
            begin, self._parts = self._parts * PUMP_PERIOD, self._parts + 1
            self._end_ns = self._start_ns + round(self._parts * PUMP_PERIOD / NANOSECOND)
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
