"""A robot that warms up: friction that follows its gears, and friction that follows its motors.

Plants of the virtual rig, drawn at random, with effects that no model has a term for and with gears
lighter and heavier than drawn, are identified from three short recordings and one warm-up of an
hour. Then they work for an hour from cold with two other programs, one of them with a rest of half
an hour, and start once with gears warmer than their motors. Simulated throughout: nothing was
measured on a robot.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from robot_energy.foundation.errors import MotionError
from robot_energy.model import RobotModel
from robot_energy.pipeline import EnergyPipeline, Output, Settings
from robot_energy.timeline.blocks import EffortMeaning, Float, Learning
from robot_energy_identify.api.identify import identify_all, identify_friction
from robot_energy_plan.motion import JointMotion, Program, Trajectory, random_program, tool_above
from robot_energy_rig import PlantProfile, RigConfig, VirtualRig, random_profile
from robot_energy_rig.config import RigOutput
from robot_energy_rig.record import outputs, record
from robot_energy_studies.learning_study import joint_block

RATE = 50.0  # Hz
AMBIENT = 20.0  # degC
HOTTEST = 110.0  # degC, beyond which a plant is worked slower
WARM_UP, SHORT, REST = 3600.0, 60.0, 1800.0  # s
SOAKED = (20.0, 40.0, 60.0)  # degC
STARTED, OFF = 38.0, 8.0  # degC of motors, K of their gears above them
SPAN = 300.0  # s of a window
GEARS = (0.4, 1.0, 2.5)  # heat capacity of the gears over that drawn
BODIES = ("kr16", "ur10e", "irb4600")
MODELS = ("motor", "gear", "all")
PROGRAMS = range(7)  # numbers of those that a plant works


@dataclass(frozen=True)
class WarmRun:
    """One run with one model.

    Attributes:
        error: Of the whole energy. [-]
        windows: Of the energy of every five minutes, shape (W,). [-]
        friction: RMS over five minutes of the error of each joint's friction power, over its
            mean, shape (n,); the drag of the iron counts as friction, as it does in measured
            torque. [-]
    """

    plant: str
    run: str
    model: str
    error: float
    windows: Float
    friction: Float


class _Interrupted:
    """A program that stands still for a while."""

    def __init__(self, program: Program, after: float, pause: float) -> None:
        self.n_joints = program.n_joints
        self._program, self._pause = program, pause
        times = np.arange(round(after), round(after) + 60, 0.02)
        still = np.abs(program.sample(times).joint_velocity).max(axis=1) == 0.0
        self._at = float(times[int(np.argmax(still))])

    def sample(self, time: Float) -> Trajectory:
        """See `JointMotion.sample`."""
        own = np.where(time > self._at, np.maximum(time - self._pause, self._at), time)
        return self._program.sample(own)


class WarmPlant:
    """One drawn plant, its recordings and models.

    Args:
        gears: Factor on the heat capacity of the gears. [-]
    """

    def __init__(self, folder: Path, body: str, seed: int, gears: float, config: RigConfig) -> None:
        drawn = random_profile(body, seed)
        self.profile: PlantProfile = replace(drawn, gear_capacity=gears * drawn.gear_capacity)
        self.name = f"{body} {seed}, gears x{gears:g}"
        self._folder, self._seed, self.body = folder / f"{body}_{seed}", seed, body
        self._config = config
        robot, _ = self.profile.mechanics()
        self._limits = self.profile.motion_limits(robot)
        self._accept = tool_above(robot, "tool0", 0.0) if robot.n_joints == 6 else None
        self.override = self._bearable()

    def program(self, number: int, dwell: float, override: float) -> Program:
        """Return a program of its own number.

        Args:
            dwell: After each motion. [s]
            override: Share of the greatest speed. [-]
        """
        via = random_program(self._limits, 100 * self._seed + number, 60, accept=self._accept).via
        return Program(via, self._limits, dwell, override)

    def rig(
        self, number: int, motion: JointMotion, degc: float, gear_degc: float | None = None
    ) -> VirtualRig:
        """Return the plant at the start of a run.

        Args:
            degc: Of motors and gears. [degC]
            gear_degc: Of the gears where they are not as warm as the motors. [degC]
        """
        return VirtualRig(
            self.profile, motion, self._config, 10 * self._seed + number, degc, AMBIENT,
            rate_hz=RATE, device_seed=self._seed, start_gear_degc=gear_degc,
        )  # fmt: skip

    def _bearable(self) -> float:
        """The highest speed at which no motor gets too hot."""
        for override in (1.0, 0.6, 0.35):
            rig = self.rig(0, self.program(0, 1.0, override), AMBIENT)
            pieces = list(outputs(rig, WARM_UP / 2, 60.0))
            if pieces[-1].truth.motor_temperature_degc.max() < HOTTEST:
                return override
        return 0.2

    def models(self, names: Sequence[str] = MODELS) -> dict[str, RobotModel]:
        """Return the models by what they follow.

        ``motor`` and ``gear`` are what friction follows, with drives and constants of the short
        recordings; ``all`` has them and a fan from the warm-up as well.
        """
        bags = [
            record(
                self.rig(number, self.program(number, 0.5, 1.0), degc), SHORT,
                self._folder / f"soaked_{degc:.0f}",
            ).path
            for number, degc in enumerate(SOAKED, 2)
        ]  # fmt: skip
        rig = self.rig(0, self.program(0, 1.0, self.override), AMBIENT)
        warm_up = record(rig, WARM_UP, self._folder / "warm_up").path
        found: dict[str, RobotModel] = {}
        if "motor" in names or "gear" in names:
            found["motor"] = self._identified(bags)
        if "gear" in names:
            gear = identify_friction([*bags, warm_up], found["motor"], "motor_torque")
            found["gear"] = gear.model
        if "all" in names:
            found["all"] = self._identified([*bags, warm_up])
        return {name: found[name] for name in names}

    def _identified(self, bags: Sequence[Path]) -> RobotModel:
        return identify_all(
            list(bags), self.body, "motor_torque", held_out=False, skip=["thermal"]
        ).model

    def runs(self) -> Iterator[tuple[str, list[RigOutput]]]:
        """Yield the runs of the test by name."""
        slower = 0.9 * self.override
        busy, calm = self.program(5, 0.3, slower), self.program(6, 2.0, self.override)
        yield "hour, busy", list(outputs(self.rig(5, busy, AMBIENT), WARM_UP, 20.0))
        rested = _Interrupted(calm, WARM_UP / 2, REST)
        yield "hour with a rest", list(outputs(self.rig(6, rested, AMBIENT), 1.5 * WARM_UP, 20.0))
        off = self.rig(7, busy, STARTED, STARTED + OFF)
        yield "gears 8 K above motors", list(outputs(off, WARM_UP / 2, 20.0))


def judged(
    plant: str, run: str, name: str, model: RobotModel, pieces: Sequence[RigOutput],
    effort: bool = False, meter: bool = False,
) -> WarmRun:  # fmt: skip
    """Return the errors of a model over a run; with a meter learned figures are applied."""
    meaning = EffortMeaning.MOTOR_TORQUE if effort else EffortMeaning.NONE
    learning = Learning.APPLY if meter else Learning.OBSERVE
    pipeline = EnergyPipeline(model, Settings(effort=meaning, learning=learning))
    start = int(pieces[0].truth.stamp_ns[0])
    columns = 1 + len(model.joints)
    count = round(sum(len(piece.truth) for piece in pieces) / RATE / SPAN)
    predicted, true, seen = (np.zeros((count, columns)) for _ in range(3))

    def add(to: Float, stamp_ns: np.ndarray, grid: Float, friction: Float) -> None:
        place = np.minimum((stamp_ns - start) // round(SPAN * 1e9), count - 1)
        np.add.at(to, np.maximum(place, 0), np.column_stack([grid, friction]))

    def take(output: Output) -> None:
        power = output.power
        if power is not None:
            add(predicted, power.stamp_ns, power.grid_power, power.friction_power)
            add(
                seen, power.stamp_ns, 1.0 + 0.0 * power.grid_power, 1.0 + 0.0 * power.friction_power
            )

    for piece in pieces:
        truth = piece.truth
        add(true, truth.stamp_ns, truth.grid_power, truth.friction_power + truth.iron_loss)
        readings = piece.meter if meter else None
        take(pipeline.step(joint_block(piece.joints), piece.temperatures, readings))
    take(pipeline.flush())
    error = predicted / np.maximum(true, 1e-9) - 1.0
    mean = true[:, 1:].mean(axis=0)
    moving = true[:, 1:] > 0.2 * mean
    squares = np.where(moving, error[:, 1:] ** 2, 0.0).sum(axis=0)
    friction = np.sqrt(squares / np.maximum(moving.sum(axis=0), 1))
    whole = predicted.sum(axis=0)[0] / true.sum(axis=0)[0] - 1.0
    return WarmRun(plant, run, name, float(whole), error[:, 0], friction)


def gear_study(
    folder: Path, plants: Sequence[int], config: RigConfig, names: Sequence[str] = MODELS
) -> Iterator[WarmRun]:
    """Yield every run of every plant with these models, robots in turn; some have no program."""
    for number, seed in enumerate(plants):
        gears = GEARS[(number // 2) % len(GEARS)]
        body = BODIES[number % len(BODIES)]
        try:
            plant = WarmPlant(folder, body, seed, gears, config)
            for program in PROGRAMS:
                plant.program(program, 0.0, 1.0)
        except MotionError as error:
            print(f"{body} {seed} is left out: {error}", flush=True)
            continue
        models = plant.models(names)
        for run, pieces in plant.runs():
            for name, model in models.items():
                yield judged(plant.name, run, name, model, pieces)
            for name in models if run.startswith("gears") else ():
                for way in ("effort", "meter") if name != "motor" else ():
                    title, read = f"{name}, {way} read", {way: True}
                    yield judged(plant.name, run, title, models[name], pieces, **read)
