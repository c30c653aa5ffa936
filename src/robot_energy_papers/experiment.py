"""The measurements of paper A on the virtual rig: sets of 20 motions at rising temperature.

Two ways to a thermal state. By motion, as in the paper: a set of point-to-point motions,
one minute of warm-up motion, the next set, for hours of the rig's own time, so that gears
lag behind motors and every axis has its own temperature. Soaked: motors, gears and hall
start at one temperature; fast, and kinder to the model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import NANOSECOND, Float
from robot_energy_plan.motion import (
    JointMotion,
    MotionLimits,
    Program,
    Trajectory,
    random_program,
    tool_above,
)
from robot_energy_rig import PlantProfile, RigConfig, VirtualRig
from robot_energy_rig.record import RigRecording, outputs, record

MOVES = 20  # paper A, section IV
WARM_UP = 60.0  # s, paper A, section IV
RATE = 250.0  # Hz, of the joint states
TOOL, MIN_HEIGHT = "tool0", 0.2  # m: programs stay above the floor
# Shares of the joint ranges that let all axes run fast and none overheat.
TRAIN_WARM_UP_ZONE = (0.9, 0.65, 0.75, 0.6, 1.0, 1.0)
TEST_WARM_UP_ZONE = (0.45, 0.25, 0.6, 0.5, 0.65, 0.5)
POSES, POSE_DWELL = 8, 3.0  # of the recording at rest; s
# Rest before a set, until the thermometers (1 Hz) have spoken: no motion is predicted with
# the friction of a temperature that is not known yet.
LEAD, DWELL = 1.2, 0.2  # s
REST = 600.0  # s between two sets while the robot cools
TEST, HOLD, TRAIN_HEAT, TEST_HEAT = 1, 2, 3, 4  # seeds of the other programs
SEED_STEP = 1000  # between the seeds of two studies
FIRST_SEED = 11


class Programs(Described):
    """What the robot does; all begin and end in the same pose."""

    train: Program
    test: Annotated[Program, "Another set, which no fit ever sees."]
    hold: Program
    train_warm_up: Program
    test_warm_up: Program


class MotionSet(Described):
    """One recorded set."""

    recording: Annotated[RigRecording, "The bag, and what was true in it."]
    time: Annotated[float, "Times of its start, since the start of the experiment. [s]"]
    way: Annotated[str, "How its temperature was reached: ``heating``, ``cooling`` or ``soaked``."]

    @property
    def path(self) -> Path:
        """The bag."""
        return self.recording.path

    @property
    def rise(self) -> float:
        """How much the motor that warmed most did so during the set. [K]"""
        motor = self.recording.motor_temperature_degc
        return float((motor[1] - motor[0]).max())

    @property
    def motor_minus_gear(self) -> float:
        """Mean of motor minus gear temperature over axes and time. [K]"""
        recording = self.recording
        return float((recording.motor_temperature_degc - recording.gear_temperature_degc).mean())


class Plan(Described):
    """An experiment by motion."""

    cycles: int
    record_at: Annotated[tuple[float, ...], "Rising, from which on a set is recorded. [degC]"]
    cool_cycles: Annotated[int, "Sets after that, each behind a rest."] = 0
    cool_at: Annotated[tuple[float, ...], "Falling, at which such a set is recorded. [degC]"] = ()
    start_degc: Annotated[float, "Temperature of motors and gears. [degC]"] = 20.0
    ambient_degc: Annotated[float, "[degC]"] = 20.0


class MotionSequence:
    """Motions that follow one another, each from its own start, as a test bench runs them.

    Args:
        parts: Motion and how long it is played; the last one goes on. [s]
    """

    def __init__(self, parts: Sequence[tuple[JointMotion, float]]) -> None:
        times = np.array([time for _, time in parts])
        self._motions: list[JointMotion] = [motion for motion, _ in parts]
        self.begin: Float = np.concatenate([[0.0], np.cumsum(times)[:-1]])  # of each part [s]
        self.duration = float(times.sum())
        self.n_joints = self._motions[0].n_joints

    def sample(self, time: Float) -> Trajectory:
        """Return the motion, joint side.

        Args:
            time: Since the start of the first part, shape (N,). [s]
        """
        part = np.maximum(np.searchsorted(self.begin, time, side="right") - 1, 0)
        found = np.empty((3, len(time), self.n_joints))
        for index, motion in enumerate(self._motions):
            rows = part == index
            path = motion.sample(time[rows] - self.begin[index])
            found[:, rows] = path.joint_position, path.joint_velocity, path.joint_acceleration
        return Trajectory(*found)


def allowed(profile: PlantProfile) -> tuple[MotionLimits, Callable[[Float], bool]]:
    """Return the limits of motions, and whether the tool is above the floor in a pose."""
    robot, _ = profile.mechanics()
    return profile.motion_limits(robot), tool_above(robot, TOOL, MIN_HEIGHT)


def make_programs(profile: PlantProfile, seed: int, moves: int = MOVES) -> Programs:
    """Return all programs of a study."""
    limits, above = allowed(profile)
    first = FIRST_SEED + SEED_STEP * seed

    def measured(program: Program) -> Program:
        return Program(program.via, limits, [LEAD, *(DWELL for _ in program.via[1:])])

    train = measured(random_program(limits, first, moves, accept=above))
    home: Float = train.via[0]

    def other(
        number: int, count: int, zone: float | Sequence[float] = 0.8, dwell: float = DWELL
    ) -> Program:
        return random_program(limits, first + number, count, zone, dwell, accept=above, start=home)

    return Programs(
        train,
        measured(other(TEST, moves)),
        other(HOLD, POSES, dwell=POSE_DWELL),
        other(TRAIN_HEAT, MOVES, TRAIN_WARM_UP_ZONE, dwell=0.0),
        other(TEST_HEAT, MOVES, TEST_WARM_UP_ZONE, dwell=0.0),
    )


def by_motion(
    profile: PlantProfile,
    motion_set: Program,
    warm_up: Program,
    plan: Plan,
    folder: Path,
    name: str,
    seed: int,
    hold: Program | None = None,
    config: RigConfig | None = None,
) -> tuple[list[MotionSet], RigRecording | None]:
    """Return the sets recorded on the way through warm-ups, and the recording at rest.

    The rig is never stopped or set: one stream of motion from the first sample on. Whether
    a set is recorded is decided by the thermometers' readings, as at a real robot.

    Args:
        warm_up: Looped for a minute, and a little more, between two sets.
    """
    heat = warm_up.period * np.ceil(WARM_UP / warm_up.period)
    parts: list[tuple[JointMotion, float]] = [] if hold is None else [(hold, hold.period)]
    parts += [(motion_set, motion_set.period), (warm_up, float(heat))] * plan.cycles
    if plan.cool_cycles:
        rest = Program(motion_set.via[:1], allowed(profile)[0], REST)
        parts += [(rest, REST), (motion_set, motion_set.period)] * plan.cool_cycles
    sequence = MotionSequence(parts)
    rig = VirtualRig(profile, sequence, config, seed, plan.start_degc, plan.ambient_degc)
    origin_ns = rig.stamp_ns
    ends = [*sequence.begin[1:].tolist(), sequence.duration]
    heating, cooling = list(plan.record_at), list(plan.cool_at)
    reading = plan.start_degc
    sets: list[MotionSet] = []
    rest_recording = None
    for (motion, _), begin, end in zip(parts, sequence.begin.tolist(), ends, strict=True):
        left = end - (rig.stamp_ns - origin_ns) * NANOSECOND
        warming = begin <= (sequence.begin[2 * plan.cycles - 1] if plan.cycles else 0.0)
        due = motion is motion_set and (
            bool(heating and reading >= heating[0])
            if warming
            else bool(cooling and reading <= cooling[0])
        )
        if motion is hold:
            rest_recording = record(rig, left, folder / f"{name}_hold", overwrite=True)
        elif due:
            label = f"{name}_{'' if warming else 'cooling_'}{len(sets):02d}_{reading:.0f}degc"
            made = record(rig, left, folder / label, overwrite=True)
            sets.append(MotionSet(made, begin, "heating" if warming else "cooling"))
            waiting = heating if warming else cooling
            while waiting and (reading >= waiting[0] if warming else reading <= waiting[0]):
                waiting.pop(0)
        else:
            for output in outputs(rig, left):
                if output.temperatures is not None and len(output.temperatures):
                    reading = float(output.temperatures.motor_temperature_degc[-1].mean())
    return sets, rest_recording


def soaked(
    profile: PlantProfile,
    motion_set: Program,
    start_degc: Sequence[float],
    folder: Path,
    name: str,
    seed: int,
    config: RigConfig | None = None,
    rate: float = RATE,
) -> list[MotionSet]:
    """Return the set recorded from several temperatures, each with all parts and the hall at it.

    Args:
        start_degc: [degC]
        seed: Seed of every rig: they have the same meter and the same noise.
        rate: Of the joint states. [Hz]
    """
    sets: list[MotionSet] = []
    for degc in start_degc:
        rig = VirtualRig(profile, motion_set, config, seed, degc, degc, rate_hz=rate)
        path = folder / f"{name}_{degc:.0f}degc"
        made = record(rig, motion_set.period, path, overwrite=True)
        sets.append(MotionSet(made, 0.0, "soaked"))
    return sets
