"""A replay as it is set up, from the options of the verbs or by the library itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from robot_energy.accounting.record import Calibrated
from robot_energy.bag.reader import TimeRange
from robot_energy.condition.learner import ConditionRecord
from robot_energy.inputs.sources import Inputs, JointStateSource
from robot_energy.pipeline import Settings
from robot_energy.replay.inputs import driver_inputs, effort_meaning, member_named
from robot_energy.replay.options import NONE, ReplayOptions
from robot_energy.replay.recorded_jobs import Job, load_jobs
from robot_energy.replay.replay_topics import Topics
from robot_energy.timeline.blocks import Learning

GAPS = ("max_gap", "meter_max_gap")


@dataclass(frozen=True, kw_only=True)
class ReplaySetup:
    """What is read of a bag and how, and what is made of it; see `ReplayOptions` for the rest.

    Attributes:
        topics: Topics to use where they cannot be found by type.
        inputs: What the inputs of a live monitor are, to read the bag in the same way.
        states: What the joint states mean, instead of what ``inputs`` says of them.
        time_range: Part of the bag; None for all. Temperatures are read from as long before it as
            they stay in use, payloads from the beginning.
        calibration: Of the bands, from an earlier account of the same model and meter.
    """

    topics: Topics = field(default_factory=Topics)
    settings: Settings = field(default_factory=Settings)
    inputs: Inputs | None = None
    notes: tuple[str, ...] = ()
    states: JointStateSource | None = None
    time_range: TimeRange | None = None
    jobs: Sequence[Job] = ()
    learned: ConditionRecord | None = None
    calibration: Calibrated | None = None
    processes: int = 1
    out: str | Path | None = None
    overwrite: bool = False
    progress: Callable[[float], None] | None = None

    @classmethod
    def of(cls, options: ReplayOptions) -> ReplaySetup:
        """Return what options mean; without ``power_period`` there are no means unless needed."""
        given: dict[str, Any] = {key: one for key, one in options.items() if one is not None}

        def chosen(*names: str) -> dict[str, Any]:
            return {name: given[name] for name in names if name in given}

        inputs, notes = driver_inputs(given.get("inputs"), given.get("robot"))
        states = JointStateSource() if inputs is None else inputs.joint_states
        gaps = {} if inputs is None else {name: getattr(inputs, name) for name in GAPS}
        joints, heat = (_topics(given.get(name)) for name in ("joint_states", "temperatures"))
        payload = given.get("payload")
        return cls(
            topics=Topics(
                joint_states=joints or None,
                temperatures=heat and tuple(topic for topic in heat if topic != NONE),
                meter=given.get("meter"),
                payload="" if payload == NONE else payload,
            ),
            settings=Settings(
                power_period=given.get("power_period"),
                effort=effort_meaning(given.get("effort") or states.effort_meaning),
                learning=member_named(Learning, "learning", given.get("learning", "observe")),
                **{**gaps, **chosen("derivative_window", "temperature_wait", *GAPS)},
            ),
            inputs=inputs,
            notes=tuple(notes),
            states=replace(states, **chosen("stamp_source", "reorder_window")),
            time_range=TimeRange(given.get("start"), given.get("end")),
            jobs=load_jobs(given["jobs"]) if "jobs" in given else (),
            **chosen("learned", "processes", "out", "overwrite", "progress"),
        )


def _topics(names: str | Sequence[str] | None) -> tuple[str, ...] | None:
    return (names,) if isinstance(names, str) else None if names is None else tuple(names)
