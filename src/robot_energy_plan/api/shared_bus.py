"""Robots on one DC bus: what one brakes, another uses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any, Unpack

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import MotionError
from robot_energy.foundation.options import takes
from robot_energy.foundation.shown import Shown
from robot_energy.model import RobotModel
from robot_energy.physics.rigid_body import Robot
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.setup import ModelName, ReplaySetup, model_of
from robot_energy.timeline.blocks import Float, Learning
from robot_energy_plan.motion.joint_trajectory import holds_trajectory
from robot_energy_plan.motion.load_motion import BAG, load_motion
from robot_energy_plan.options import SharedBusOptions
from robot_energy_plan.results.shared_bus import SharedBusReport, shared_bus_report
from robot_energy_plan.shared_bus import (
    BusRobot,
    planned_exchange,
    planned_robot,
    recorded_exchange,
)

MAX_ROBOTS = 50
OF_PROGRAMS, OF_BOTH = {"cycle_time", "temperature"}, {"topic", "tool", "progress"}


class SharedBusResult(Described, Shown):
    """What several robots save on one DC bus."""

    report: Annotated[SharedBusReport, "All figures."]
    robots: Annotated[tuple[BusRobot, ...], "Each with its power over time."] = field(repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values: the JSON of ``robot-energy shared-bus``."""
        return self.report.to_dict()


@takes(SharedBusOptions)
def shared_bus(
    motions: Sequence[str | Path],
    models: ModelName | Sequence[ModelName],
    temperature: float | Sequence[float] | Float | None = None,
    **options: Unpack[SharedBusOptions],
) -> SharedBusResult:
    """Return what robots save if they share one DC bus instead of having a supply each.

    Args:
        motions: One of each robot: bags of recorded joint states, all of them, or programs, which
            repeat in a common cycle.
        models: Of each robot, or one for all.
        temperature: Of all motors, for programs; None: the fallback of each model. [degC]
        **options: What the robots do, and how bags are read: see `SharedBusOptions`.

    Returns:
        Energies apart and on one bus, and the saving with its band.

    Raises:
        MotionError: If there are not two robots at least, or recordings and programs are mixed.
        RobotEnergyError: If a motion or model cannot be used.
    """
    topic, same_start = options.get("topic"), options.get("same_start", False)
    named: list[ModelName] = (
        [models] if isinstance(models, str | Path | RobotModel) else list(models)
    )
    if not 2 <= len(motions) <= MAX_ROBOTS:
        raise MotionError(
            f"the number of motions is {len(motions)}", f"2 to {MAX_ROBOTS}, one for each robot"
        )
    if len(named) not in (1, len(motions)):
        raise MotionError(
            f"{len(named)} models for {len(motions)} robots", "one for all, or one for each"
        )
    used = [model_of(name) for name in named] * (len(motions) if len(named) == 1 else 1)
    recorded = [_is_recording(path, topic) for path in motions]
    if any(recorded) and not all(recorded):
        bag, program = motions[recorded.index(True)], motions[recorded.index(False)]
        raise MotionError(
            f"'{bag}' is a recording and '{program}' a program", "recordings alone, or programs"
        )
    every: dict[str, object] = {**options, "temperature": temperature}
    given = {name for name, value in every.items() if value is not None and value is not False}
    foreign = given & OF_PROGRAMS if all(recorded) else given - OF_BOTH - OF_PROGRAMS
    if unused := sorted(foreign):
        kind = "recordings" if all(recorded) else "programs"
        raise MotionError(f"{unused[0].replace('_', ' ')} does not apply to {kind}", "leave it out")
    if all(recorded):
        setup = ReplaySetup.of(options)
        if setup.settings.learning is Learning.APPLY:
            raise MotionError(
                "learning is apply, so a meter corrects the constants and the fan of a robot",
                "observe or off: on one bus they are those of the models",
            )
        robots = [BusRobot(str(path), model) for path, model in zip(motions, used, strict=True)]
        for robot, path in zip(robots, motions, strict=True):
            found = replay(path, robot.model, setup, on_output=robot.take)
            robot.problems += found.problems
            if not found.topics.temperatures:
                robot.notes.append(f"no motor temperatures were recorded in {path}")
        notes = [
            "the recordings were made at different times and count as begun at once"
        ] * same_start
        report = shared_bus_report(robots, recorded_exchange(robots, same_start), notes)
        return SharedBusResult(report, tuple(robots))
    robots: list[BusRobot] = []
    for path, model in zip(motions, used, strict=True):
        motion = load_motion(path, Robot.from_model(model), options.get("tool"), topic)
        degc = model.temperature.fallback_degc if temperature is None else temperature
        robots.append(planned_robot(motion.name, model, motion.motion, degc, motion.repeat))
    report = shared_bus_report(robots, planned_exchange(robots, options.get("cycle_time")))
    return SharedBusResult(report, tuple(robots))


def _is_recording(path: str | Path, topic: str | None) -> bool:
    place = Path(path)
    if not place.exists():
        raise MotionError(f"there is no program or bag '{path}'", "a file or a bag")
    return (place.suffix.lower() in BAG or place.is_dir()) and not holds_trajectory(place, topic)
