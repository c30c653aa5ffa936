"""Replay of a bag: where its energy went."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, field, replace
from numbers import Real
from pathlib import Path
from typing import Any, Literal, TypedDict, Unpack

import numpy as np

from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.averaging import MeanBlock
from robot_energy.bag.time_range import TimeRange
from robot_energy.certainty.friction_certainty import FrictionCertainty
from robot_energy.condition.learner import ConditionRecord
from robot_energy.foundation.errors import ParameterError
from robot_energy.foundation.shown import Shown
from robot_energy.foundation.signature import check_options, lists
from robot_energy.inputs.parameters import HEADER, RECEIVE, Parameter
from robot_energy.inputs.sources import JointStateSource
from robot_energy.model import RobotModel
from robot_energy.physics.friction import FrictionModel, with_fixed_friction
from robot_energy.pipeline import Output, Settings
from robot_energy.replay import bag_replay
from robot_energy.replay.bag_replay import Replay
from robot_energy.replay.inputs import (
    ModelName,
    driver_inputs,
    effort_meaning,
    member_named,
    model_of,
)
from robot_energy.replay.power_table import empty_table, period_table, sample_table
from robot_energy.replay.recorded_jobs import load_jobs
from robot_energy.replay.replay_topics import Topics
from robot_energy.results.energy import EnergyBreakdown, JointEnergy, MeterComparison, PhaseEnergy
from robot_energy.results.replay import ReplayReport, replay_report
from robot_energy.timeline.blocks import Learning, PowerBlock
from robot_energy.timeline.time_series import TimeSeries

NONE = "none"  # instead of a topic: use none of the bag's
FALLBACK = "fallback"  # instead of a temperature: the model's
FRICTION_DEGC = (-60.0, 250.0)  # at which friction can be fixed; the command refuses the same
SETTINGS = ("derivative_window", "temperature_wait", "max_gap", "meter_max_gap", "power_period")
CHECKED = (
    *(Parameter(name, float, MISSING, low=1e-6, high=1e6)
      for name in ("power_period", "derivative_window", "meter_max_gap")),
    *(Parameter(name, float, MISSING, low=0.0, high=1e6)
      for name in ("temperature_wait", "max_gap")),
    *(Parameter(name, float, MISSING, low=-1e9, high=1e9) for name in ("start", "end")),
    Parameter("reorder_window", float, MISSING, low=0.0, high=0.5),
    Parameter("stamp_source", str, MISSING, choices=(HEADER, RECEIVE)),
    Parameter("processes", int, MISSING, low=1, high=3),
)  # fmt: skip


class ReplayOptions(TypedDict, total=False):
    """What is read and how, under the names of the command's options; all may be left out.

    Attributes:
        joint_states: Topic of joint states; several where each brings some of the joints.
        temperatures: Topics of motor temperatures; ``none`` to use none of the bag's.
        meter: Topic of the power meter.
        payload: Topic of payloads set at run time; ``none`` to use none of the bag's.
        inputs: Parameter file of a monitor: read the bag as that node reads its topics.
        robot: Name of a robot whose driver is known (`robot-energy kinds` lists them): its
            inputs count where ``inputs`` says nothing.
        effort: What the effort in the joint states is: ``none``, ``motor_current``,
            ``motor_torque`` or ``joint_torque``.
        stamp_source: What dates joint states: ``header`` or ``receive``.
        reorder_window: Window in which joint states that overtook each other are sorted. [s]
        derivative_window: Window behind an acceleration; 2.5 times as long without velocities. [s]
        temperature_wait: How long torque waits for late temperatures. [s]
        max_gap: Longest time between two joint states that is bridged; 0: five times their
            usual period, 0.1 s to 1 s. [s]
        meter_max_gap: Longest time between meter readings that is bridged. [s]
        start: Read the bag from here on: after its start, negative: before its end. [s]
        end: Read the bag up to here, likewise. [s]
        jobs: File of jobs and cycles to count.
        learning: What is learned of friction and constant losses: ``off``, ``observe`` (default)
            or ``apply``, to predict with it.
        learned: What an earlier recording has taught, the `state` of its learner.
        processes: 2: a process of its own reads the bag and computes torque, ahead of this one;
            3: reading and torque are two. No figure changes.
        out: Folder of a new bag for the energy topics.
        overwrite: Whether an existing ``out`` may be replaced.
        progress: Called with the share done, 0 to 1.
    """

    joint_states: str | Sequence[str] | None
    temperatures: str | Sequence[str] | None
    meter: str | None
    payload: str | None
    inputs: str | Path | None
    robot: str | None
    effort: str | None
    stamp_source: str | None
    reorder_window: float | None
    derivative_window: float | None
    temperature_wait: float | None
    max_gap: float | None
    meter_max_gap: float | None
    learning: str | None
    learned: ConditionRecord | None
    start: float | None
    end: float | None
    jobs: str | Path | None
    processes: int
    out: str | Path | None
    overwrite: bool
    progress: Callable[[float], None] | None


@dataclass(frozen=True)
class ReplayResult(Shown):
    """Where the energy of a bag went.

    Attributes:
        bag: The bag.
        model: The model used.
        power: Power over time, one row per sample or averaging period: predicted grid power,
            measured power, predicted power at the meter, residual (predicted minus measured),
            bus power, rigid, friction and drive loss of all joints, constant losses, brake,
            capacitor, phase (`Phase`), quality (bits of `Quality`); and per joint shaft, rigid
            and friction power, drive loss, motor velocity, torque and temperature.
        energy: Where the energy went.
        joints: The same per joint, in model order.
        comparison: Predicted and measured over the same intervals.
        phases: Time and energy by phase: ``hold``, ``motion``, ``generating``.
        notes: What a user should know of inputs and figures, one sentence each.
        problems: What was wrong with the bag or the accounts, one sentence each.
        report: All figures, those above among them.
        replay: The accounting behind the figures: registers, inputs, topics.
    """

    bag: Path
    model: RobotModel
    power: TimeSeries
    energy: EnergyBreakdown
    joints: tuple[JointEnergy, ...]
    comparison: MeterComparison
    phases: dict[str, PhaseEnergy]
    notes: tuple[str, ...]
    problems: tuple[str, ...]
    report: ReplayReport = field(repr=False)
    replay: Replay = field(repr=False)

    def __repr__(self) -> str:
        compared, span = self.comparison, self.report.time.observed_time
        text = f"{self.bag.name}, {self.model.robot.type}: {self.energy.net:.0f} J in {span:.1f} s"
        if compared.predicted_minus_measured_relative is not None:
            text += f", {compared.predicted_minus_measured_relative:+.1%} against the meter"
        return f"ReplayResult({text})"

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values: the JSON of ``robot-energy replay``."""
        return self.report.to_dict()


@lists(ReplayOptions)
def replay(
    bag: str | Path,
    model: ModelName,
    *,
    temperature: float | Literal["fallback"] | None = None,
    power_period: float | None = None,
    **options: Unpack[ReplayOptions],
) -> ReplayResult:
    """Run a recorded bag through the model of its robot.

    Args:
        bag: MCAP file or rosbag2 folder.
        model: A model, its file, or the name of a shipped one.
        temperature: Fix friction at this temperature, whatever was measured, or at that which
            the model assumes without measurement (``fallback``). [degC]
        power_period: Average the power over periods of this length; None: one row per sample,
            about 0.5 kB each for six joints. [s]
        **options: What is read and how: see `ReplayOptions`.

    Returns:
        Power over time, energies, comparison with the meter.

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
    blocks: list[PowerBlock] = []
    means: list[MeanBlock] = []

    def take(output: Output) -> None:
        if power_period is None and output.power is not None:
            blocks.append(output.power)
        if power_period is not None and output.means is not None:
            means.append(output.means)

    result = run_replay(
        bag, used, **options, power_period=power_period, on_output=take, keep_compared=True
    )
    compared, names = result.compared if result.topics.meter else None, used.joint_names
    if blocks:
        power = sample_table(PowerBlock.concatenate(blocks), names, compared, used.unmodelled)
    elif means:
        power = period_table(MeanBlock.concatenate(means), names, compared, used.unmodelled)
    else:
        power = empty_table(names)
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
            f"friction is to be fixed at {degc} degC",
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


def run_replay(
    bag: str | Path,
    model: RobotModel,
    *,
    power_period: float | None = None,
    keep_curves: bool = False,
    keep_compared: bool = False,
    on_output: Callable[[Output], None] | None = None,
    on_reading: Callable[[EnergyAccount, int], None] | None = None,
    **options: Unpack[ReplayOptions],
) -> Replay:
    """Return the accounting of a replay with the options of the command.

    Args:
        power_period: Averaging period; None: that of the pipeline. [s]
        keep_curves: Whether to keep energies over time for figures.
        keep_compared: Whether to keep all that was compared with the meter.
        on_reading: Called with the account as it stands at each UTC minute, and at the end.

    Raises:
        OptionError: For an option that a replay does not have.
        RobotEnergyError: If bag, model or an option cannot be used.
    """
    check_options("replay", options, ReplayOptions.__annotations__)
    every: dict[str, Any] = {**options, "power_period": power_period}
    given = {name: value for name, value in every.items() if value is not None}
    for option in CHECKED:
        if option.name in given:
            option.check(given[option.name], "replay")
    read, notes = driver_inputs(given.get("inputs"), given.get("robot"))
    settings: dict[str, Any] = {name: given[name] for name in SETTINGS if name in given}
    if "learning" in given:
        settings["learning"] = member_named(Learning, "learning", given["learning"])
    if read is not None:
        settings = {"max_gap": read.max_gap, "meter_max_gap": read.meter_max_gap, **settings}
    effort = given.get("effort") or (NONE if read is None else read.joint_states.effort_meaning)
    states = replace(
        JointStateSource() if read is None else read.joint_states,
        **{name: given[name] for name in ("stamp_source", "reorder_window") if name in given},
    )
    temperatures, payload = given.get("temperatures"), given.get("payload")
    result = bag_replay.replay(
        bag,
        model,
        topics=Topics(
            _topics(given.get("joint_states")) or None,
            None if temperatures is None else tuple(t for t in _topics(temperatures) if t != NONE),
            given.get("meter"),
            "" if payload == NONE else payload,
        ),
        settings=Settings(effort=effort_meaning(effort), **settings),
        out=given.get("out"),
        overwrite=given.get("overwrite", False),
        keep_curves=keep_curves,
        keep_means=power_period is not None,
        keep_compared=keep_compared,
        progress=given.get("progress"),
        inputs=read,
        states=states,
        on_output=on_output,
        on_reading=on_reading,
        time_range=TimeRange(given.get("start"), given.get("end")),
        learned=given.get("learned"),
        jobs=load_jobs(jobs) if (jobs := given.get("jobs")) else (),
        processes=given.get("processes", 1),
    )
    result.notes[:0] = notes
    return result


def _topics(names: str | Sequence[str] | None) -> tuple[str, ...]:
    return (names,) if isinstance(names, str) else tuple(names or ())
