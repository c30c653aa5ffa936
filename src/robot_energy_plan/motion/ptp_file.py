"""Point-to-point programs as YAML files, validated by pydantic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from robot_energy.foundation.config_file import load
from robot_energy.foundation.errors import MotionError
from robot_energy.model.figure import ModelEntry, Number
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.timeline.blocks import Float
from robot_energy_plan.motion.ptp import DEFAULT_JERK_TIME, MotionLimits, Program

MAX_VIAS = 10_000
MAX_RADIANS = 2.0 * np.pi  # that a program in radians states; one in degrees goes further
RAMP = 0.5  # s to full speed, where nobody gave an acceleration
DEGREE = np.pi / 180.0  # rad
Positive = Annotated[Number, Field(gt=0)]
Time = Annotated[Number, Field(ge=0, le=86_400)]
Share = Annotated[Number, Field(gt=0, le=1)]
Name = Annotated[str, Field(min_length=1)]


class ProgramFile(ModelEntry):
    """A loop of synchronised point-to-point moves.

    The robot rests at each configuration for its dwell time and moves on to the next one,
    after the last back to the first.

    Attributes:
        angle_unit: Unit of revolute joints; prismatic ones are in m.
        via: Configurations, each a mapping of all joints by name.
        dwell: Rest at every configuration, one value or one for each. [s]
        override: Share of full speed, in (0, 1]; it stretches the whole motion. [-]
        speed_share: Share of the speed under the override, in (0, 1], of the move to the next
            configuration: one value or one for each, as `$VEL.AXIS` or `v` of robot languages. [-]
        acceleration_share: The same of the acceleration, as `$ACC.AXIS` or `AccSet`. [-]
        acceleration: Greatest, one value or by joint name, in the unit per s^2; absent: full
            speed in 0.5 s, assumed.
        jerk_time: Time over which acceleration builds up. [s]
    """

    schema_version: Literal[1]
    motion: Literal["point_to_point"]
    angle_unit: Literal["rad", "deg"]
    via: Annotated[list[dict[Name, Number]], Field(min_length=1, max_length=MAX_VIAS)]
    dwell: Time | list[Time] = 0.2
    override: Share = 1.0
    speed_share: Share | list[Share] = 1.0
    acceleration_share: Share | list[Share] = 1.0
    acceleration: Positive | dict[Name, Positive] | None = None
    jerk_time: Annotated[Number, Field(ge=0, le=10)] = DEFAULT_JERK_TIME
    repeat: Annotated[int, Field(ge=1, le=100_000, strict=True)] = 1

    @model_validator(mode="after")
    def _check(self) -> ProgramFile:
        names = set(self.via[0])
        if not names:
            raise ValueError("the first configuration names no joint")
        for index, configuration in enumerate(self.via, start=1):
            if other := names ^ set(configuration):
                raise ValueError(
                    f"configuration {index} of via and the first differ in {sorted(other)[0]!r}; "
                    "every one needs all joints"
                )
        for what, given in (
            ("dwell times", self.dwell),
            ("speed shares", self.speed_share),
            ("acceleration shares", self.acceleration_share),
        ):
            if isinstance(given, list) and len(given) != len(self.via):
                raise ValueError(f"{len(given)} {what} for {len(self.via)} configurations")
        if isinstance(self.acceleration, dict) and set(self.acceleration) != names:
            raise ValueError("acceleration needs the same joints as via")
        return self


@dataclass(frozen=True)
class LoadedProgram:
    """A program for one robot."""

    program: Program
    repeat: int
    notes: tuple[str, ...]


def read_program(path: str | Path) -> ProgramFile:
    """Return a validated program file."""
    return load(path, ProgramFile, MotionError, "program file", "see src/examples/programs")


def program_for(file: ProgramFile, limits: JointLimits, name: str = "the program") -> LoadedProgram:
    """Return the loop of a program file for one robot, and what was assumed."""
    _same_joints(set(file.via[0]), limits.joint_names, name)
    factor = np.where(limits.prismatic, 1.0, DEGREE if file.angle_unit == "deg" else 1.0)
    via = np.array([[row[joint] for joint in limits.joint_names] for row in file.via]) * factor
    notes: list[str] = []
    if not np.isfinite(limits.velocity).all():
        joint = limits.joint_names[int(np.argmin(np.isfinite(limits.velocity)))]
        raise MotionError(
            f"{name}: the URDF gives no velocity limit for joint '{joint}'",
            "one on every joint, as moves run at a share of it",
        )
    turned = np.abs(via[:, ~limits.prismatic])
    if file.angle_unit == "deg" and 0.0 < turned.max(initial=0.0) <= MAX_RADIANS * DEGREE:
        notes.append(
            f"no joint of {name} is further than {turned.max() / DEGREE:.3g} deg from zero: is its "
            "angle_unit rad?"
        )
    acceleration: Float = limits.velocity / RAMP
    if file.acceleration is None:
        notes.append(
            f"{name} gives no acceleration: full speed in {RAMP:g} s is assumed on every joint"
        )
    elif isinstance(file.acceleration, dict):
        given = file.acceleration
        acceleration = np.array([given[joint] for joint in limits.joint_names]) * factor
    else:
        acceleration = np.full(len(via[0]), file.acceleration) * factor
    bounds = MotionLimits(limits.lower, limits.upper, limits.velocity, acceleration, file.jerk_time)
    try:
        program = Program(
            via, bounds, file.dwell, file.override, file.speed_share, file.acceleration_share
        )
    except MotionError as error:
        raise MotionError(f"{name}: {error.found}", error.expected, error.remedy) from error
    return LoadedProgram(program, file.repeat, tuple(notes))


def _same_joints(found: set[str], expected: Sequence[str], name: str) -> None:
    missing = [joint for joint in expected if joint not in found]
    foreign = sorted(found - set(expected))
    if missing or foreign:
        raise MotionError(
            f"{name} moves {', '.join(sorted(found))}",
            f"the joints of the model, {', '.join(expected)}",
            "write the program for this robot: "
            + (
                f"it lacks {missing[0]}" if missing else f"{foreign[0]} is not a joint of the model"
            ),
        )
