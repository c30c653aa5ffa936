"""Identified models on motions that no fit has used: grid energy compared with the meter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import RigError
from robot_energy.model import RobotModel
from robot_energy.replay.bag_replay import replay
from robot_energy.timeline.blocks import NANOSECOND, EffortMeaning, Float, Quality
from robot_energy_identify.data.recordings import read_recording
from robot_energy_papers.experiment import MotionSet


class SetRow(Described):
    """One set."""

    bag: str
    way: str
    robot_degc: Annotated[
        float, "Mean over the motors of their mean temperature in the set. [degC]"
    ]
    coldest_degc: Annotated[float, "The coldest motor. [degC]"]
    warmest_degc: Annotated[float, "The warmest motor. [degC]"]
    rise: Annotated[float, "Rise of temperature of the motor that warmed most in the set. [K]"]
    lag: Annotated[float, "Mean motor minus gear temperature, truth. [K]"]
    measured_energy: Annotated[float, "By the meter, over the compared time. [J]"]
    compared: Annotated[float, "That time. [s]"]
    peak_power: Annotated[float, "Truth. [W]"]
    predicted: Annotated[dict[str, float], "Energy over the same time, by model. [J]"]
    extrapolated: Annotated[
        float, "Share of the samples in which a friction law was used outside its fitted range. [-]"
    ]

    @property
    def mean_power(self) -> float:
        """Measured energy over the compared time. [W]"""
        return self.measured_energy / self.compared

    def error(self, model: str) -> float:
        """Return predicted over measured energy, less 1. [-]"""
        return self.predicted[model] / self.measured_energy - 1.0


def held_out(
    sets: Sequence[MotionSet], models: Mapping[str, RobotModel], reference: str
) -> list[SetRow]:
    """Return one row per set, replayed with every model."""
    return [_row(entry, models, reference) for entry in sets]


def _row(entry: MotionSet, models: Mapping[str, RobotModel], reference: str) -> SetRow:
    predicted: dict[str, float] = {}
    measured = compared = extrapolated = 0.0
    for name, model in models.items():
        result = replay(entry.path, model)
        comparison = result.account.comparison
        if not comparison.measured_energy > 0:
            raise RigError(f"in {entry.path} the meter covers nothing", "readings during the set")
        predicted[name] = comparison.predicted_energy
        if name == reference:
            measured = comparison.measured_energy
            compared = comparison.compared_ns * NANOSECOND
            held = result.account.counts.quality.get(int(Quality.EXTRAPOLATED), 0)
            extrapolated = held / max(result.account.counts.samples, 1)
    truth = entry.recording.motor_temperature_degc.mean(axis=0)
    return SetRow(
        entry.path.name,
        entry.way,
        float(truth.mean()),
        float(truth.min()),
        float(truth.max()),
        entry.rise,
        entry.lag,
        measured,
        compared,
        entry.recording.peak_power,
        predicted,
        extrapolated,
    )


def worst(rows: Sequence[SetRow], model: str) -> float:
    """Return the greatest error of a model in size, with its sign. [-]"""
    errors = [row.error(model) for row in rows]
    return max(errors, key=abs)


def normalised(rows: Sequence[SetRow], degc: float) -> float:
    """Return the measured mean power at one temperature, straight between the sets. [W]

    Args:
        degc: Mean motor temperature; held at the ends. [degC]
    """
    order = sorted(rows, key=lambda row: row.robot_degc)
    return float(
        np.interp(degc, [row.robot_degc for row in order], [row.mean_power for row in order])
    )


def shaft_power(bag: Path, model: RobotModel, axis: int) -> tuple[Float, Float]:
    """Return time [s] and measured shaft power [W] of one axis, shape (N,) each.

    Traced torque times speed, since the first sample.

    Args:
        bag: A recording with motor torque in the effort.
        model: Its bodies and gears.
        axis: Index of the joint.
    """
    torque = read_recording(bag, model, EffortMeaning.MOTOR_TORQUE).torque
    time = (torque.stamp_ns - torque.stamp_ns[0]) * NANOSECOND
    return time, torque.motor_torque_measured[:, axis] * torque.motor_velocity[:, axis]
