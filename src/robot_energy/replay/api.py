"""Replay of bags: where their energy went, and what they teach of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from numbers import Real
from pathlib import Path
from typing import Annotated, Any, Literal, Unpack

import numpy as np

from robot_energy.certainty.friction_certainty import FrictionCertainty
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import BagError, ParameterError
from robot_energy.foundation.options import takes
from robot_energy.foundation.shown import Shown
from robot_energy.model import RobotModel
from robot_energy.physics.friction import FrictionModel, with_fixed_friction
from robot_energy.pipeline import Output
from robot_energy.replay import bag_replay
from robot_energy.replay.bag_replay import Replay
from robot_energy.replay.options import ReplayOptions
from robot_energy.replay.power_table import power_table
from robot_energy.replay.setup import ModelName, ReplaySetup, model_of
from robot_energy.results.energy import EnergyBreakdown, JointEnergy, MeterComparison, PhaseEnergy
from robot_energy.results.replay import (
    ConditionReport,
    ReplayReport,
    condition_report,
    replay_report,
)
from robot_energy.timeline.pieces import Compared
from robot_energy.timeline.time_series import TimeSeries

FALLBACK = "fallback"  # instead of a temperature: the model's
FRICTION_DEGC = (-60.0, 250.0)  # at which friction can be fixed; the command refuses the same


class ReplayResult(Described, Shown):
    """Where the energy of a bag went."""

    bag: Annotated[Path, "The bag."]
    model: Annotated[RobotModel, "The model used."]
    power: Annotated[
        TimeSeries,
        "Power over time, one row per sample or averaging period: predicted grid power, "
        "measured power, predicted power at the meter, residual (predicted minus measured), bus "
        "power, rigid, friction and drive loss of all joints, constant losses, brake, "
        "capacitor, phase (`Phase`), quality (bits of `Quality`); and per joint shaft, rigid "
        "and friction power, drive loss, motor velocity, torque and temperature.",
    ]
    energy: Annotated[EnergyBreakdown, "Where the energy went."]
    joints: Annotated[tuple[JointEnergy, ...], "The same per joint, in model order."]
    comparison: Annotated[MeterComparison, "Predicted and measured over the same intervals."]
    phases: Annotated[
        dict[str, PhaseEnergy], "Time and energy by phase: ``hold``, ``motion``, ``generating``."
    ]
    notes: Annotated[
        tuple[str, ...], "What a user should know of inputs and figures, one sentence each."
    ]
    problems: Annotated[
        tuple[str, ...], "What was wrong with the bag or the accounts, one sentence each."
    ]
    report: Annotated[ReplayReport, "All figures, those above among them."] = field(repr=False)
    replay: Annotated[Replay, "The accounting behind the figures: registers, inputs, topics."] = (
        field(repr=False)
    )

    def __repr__(self) -> str:
        compared, span = self.comparison, self.report.time.observed_time
        text = f"{self.bag.name}, {self.model.robot.type}: {self.energy.net:.0f} J in {span:.1f} s"
        if compared.predicted_minus_measured_relative is not None:
            text += f", {compared.predicted_minus_measured_relative:+.1%} against the meter"
        return f"ReplayResult({text})"

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values: the JSON of ``robot-energy replay``."""
        return self.report.to_dict()


@takes(ReplayOptions)
def replay(
    bag: str | Path,
    model: ModelName,
    *,
    temperature: float | Literal["fallback"] | None = None,
    **options: Unpack[ReplayOptions],
) -> ReplayResult:
    """Run a recorded bag through the model of its robot.

    Args:
        bag: MCAP file or rosbag2 folder.
        model: A model, its file, or the name of a shipped one.
        temperature: Fix friction at this temperature, whatever was measured, or at that which
            the model assumes without measurement (``fallback``). [degC]
        **options: What is read and how: see `ReplayOptions`.

    Returns:
        Power over time, energies, comparison with the meter. Power has one row per sample, about
        0.5 kB each for six joints, or the means of each ``power_period``.

    Raises:
        BagError: If the bag cannot be read or holds no usable joint state, or nothing of it can
            be predicted.
        MissingTopicError: If a topic is missing or ambiguous.
        UnknownJointError: If the joint states lack joints of the model.
        RobotEnergyError: If the model or an option cannot be used.
    """
    used = model_of(model)
    change = None
    if temperature is not None:
        used, change = fixed_friction(used, temperature)
    by_period = options.get("power_period") is not None
    blocks: list[Any] = []

    def take(output: Output) -> None:
        block = output.means if by_period else output.power
        if block is not None:
            blocks.append(block)

    setup = ReplaySetup.of(options)
    pieces: list[Compared] = []
    result = bag_replay.replay(bag, used, setup, on_output=take, on_compared=pieces.append)
    compared, names = pieces if result.topics.meter else None, used.joint_names
    power = power_table(blocks, names, compared, used.unmodelled)
    report = replay_report(result, change)
    return ReplayResult(
        bag=result.bag,
        model=used,
        power=power,
        energy=report.energy,
        joints=report.joints,
        comparison=report.comparison,
        phases=report.phases,
        notes=report.notes,
        problems=report.problems,
        report=report,
        replay=result,
    )


@takes(ReplayOptions)
def condition_over(
    bags: Sequence[str | Path], model: ModelName, **options: Unpack[ReplayOptions]
) -> ConditionReport:
    """Return what recordings of one robot teach, each going on from the one before.

    Args:
        bags: MCAP files or rosbag2 folders, oldest first.
        model: A model, its file, or the name of a shipped one.
        **options: What is read and how: see `ReplayOptions`.

    Raises:
        BagError: If there is none, or one cannot be read.
        RobotEnergyError: If the model or an option cannot be used.
    """
    if not bags:
        raise BagError("no recording was given", "one or more, oldest first")
    used, learner = model_of(model), None
    for bag in bags:
        learner = bag_replay.replay(bag, used, ReplaySetup.of(options)).pipeline.condition
        options["learned"] = learner.state()
    assert learner is not None
    return condition_report(learner, used)


def fixed_friction(
    model: RobotModel, temperature: float | Literal["fallback"]
) -> tuple[RobotModel, str]:
    """Return a model whose friction stays at one temperature, and what was changed.

    Args:
        temperature: The operating point, or ``fallback`` for that of the model. [degC]
    """
    degc = model.temperature.fallback_degc if temperature == FALLBACK else temperature
    low, high = FRICTION_DEGC
    if not (isinstance(degc, Real) and low <= degc <= high):
        raise ParameterError(
            f"friction is to be fixed at {degc!r} degC",
            f"{low:g} to {high:g} degC, or '{FALLBACK}'",
        )
    everywhere = np.full(len(model.joints), degc)
    std, _ = FrictionCertainty(model).std(everywhere[None])
    change = f"friction fixed at {degc:g} degC"
    beyond = FrictionModel.from_model(model).extrapolated(everywhere)
    if beyond.any():
        names = [name for name, is_out in zip(model.joint_names, beyond, strict=True) if is_out]
        of = "" if beyond.all() else f" of {', '.join(names)}"
        change += f", outside the fitted temperatures{of}"
    return with_fixed_friction(model, degc, std[0]), change
