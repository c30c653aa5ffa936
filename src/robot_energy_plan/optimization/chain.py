"""Candidates: each move in every way that is compared; energy, time, peak and limits of each.

A candidate is one move under a share of the speed and acceleration limits. All are laid end to end
in one array of samples, so that the power chain runs over thousands of them at once.

Torque, friction, drives and cabinet are those of live operation (`robot_energy.physics`); motor
temperatures are given and held. Energy that the DC link has taken by the end of a move is counted
as given back: the rest after it or the next move uses it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import field, replace
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.model import RobotModel
from robot_energy.physics.drives_and_cabinet import CabinetStage, FanStage, drive_from_model
from robot_energy.physics.drivetrain import Drivetrain, motor_standstill
from robot_energy.physics.friction import FrictionModel
from robot_energy.physics.hold_torque import HoldTorque
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, Rows
from robot_energy_plan.motion.ptp import MotionLimits, Profile, Program, Trajectory
from robot_energy_plan.optimization.deviations import EnergyDeviations

STEP = 4e-3  # s between samples
SAMPLES = 250  # of one candidate, at most: slow motion changes slowly
LONG_STEP = 0.02  # s between samples of moves that are longer than these
ROWS = 60_000  # samples that are worked on at a time
SPEEDS = np.array([10, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60, 70, 80, 90, 100]) / 100  # [-]
ACCELERATIONS = np.array([5, 10, 20, 30, 45, 65, 100]) / 100  # [-]


class Candidates(Rows):
    """Moves, each with its way of being made, shape (P,) each."""

    move: Int
    speed: Annotated[Float, "Share of the speed limits. [-]"]
    acceleration: Annotated[Float, "Share of the acceleration limits. [-]"]
    law: Annotated[Int, "Time law of its own, -1 for none; left out: none at all."] = field(
        default_factory=lambda: np.zeros(0, dtype=np.int64)
    )

    def __post_init__(self) -> None:
        if len(self.law) != len(self.move):
            object.__setattr__(self, "law", np.full(len(self.move), -1))


class Samples(Described):
    """Motion of several candidates, end to end."""

    first: Annotated[Int, "Row at which each candidate begins, shape (P,)."]
    step: Annotated[Float, "Time between the samples of each candidate, shape (P,). [s]"]
    path: Annotated[Trajectory, "Motion, shape (N, n) each."]


class Moves(ABC):
    """Moves from rest to rest that can be made faster or slower.

    Attributes:
        laws: Candidates with time laws of their own; None for moves without any.
    """

    count: int
    laws: Candidates | None = None

    @abstractmethod
    def duration(self, candidates: Candidates) -> Float:
        """Return how long each candidate lasts, shape (P,). [s]"""

    @abstractmethod
    def sample(self, candidates: Candidates, place: Int, time: Float) -> Trajectory:
        """Return the motion, joint side.

        Args:
            place: Candidate of each row, shape (N,).
            time: Since the start of the move, shape (N,). [s]
        """

    def instants(self, candidates: Candidates, place: int) -> Float:
        """Return when one candidate has the points of a trajectory, from 0 on, shape (K,). [s]"""
        length = float(self.duration(candidates)[place])
        return np.linspace(0.0, length, max(2, int(np.ceil(length / STEP)) + 1))


class PtpMoves(Moves):
    """Synchronised point-to-point moves.

    Args:
        start: Configuration before each move, shape (K, n). [rad] or [m]
        goal: Configuration after it, shape (K, n). [rad] or [m]
    """

    def __init__(self, start: Float, goal: Float, limits: MotionLimits) -> None:
        self.count = len(start)
        self._start, self._distance, self._limits = start, goal - start, limits

    @classmethod
    def of_program(cls, program: Program, limits: MotionLimits) -> PtpMoves:
        """Return the moves of a program, which can be as fast as its limits without an override.

        The jerk time is that of the program as it runs, so that what is left alone does not change.
        """
        bounds = replace(limits, jerk_time=program.limits.jerk_time)
        return cls(program.via, np.roll(program.via, -1, axis=0), bounds)

    def _profile(self, candidates: Candidates) -> Profile:
        ways = self._distance[candidates.move]
        return Profile(ways, self._limits, candidates.speed, candidates.acceleration)

    def duration(self, candidates: Candidates) -> Float:
        """Return the same as in `Moves.duration`."""
        return self._profile(candidates).duration

    def sample(self, candidates: Candidates, place: Int, time: Float) -> Trajectory:
        """Return the same as in `Moves.sample`."""
        value, velocity, acceleration = self._profile(candidates).sample(place, time)
        move = candidates.move[place]
        ways = self._distance[move]
        return Trajectory(
            self._start[move] + value[:, None] * ways,
            velocity[:, None] * ways,
            acceleration[:, None] * ways,
        )


def grid(moves: Moves, speed: Float = SPEEDS, acceleration: Float = ACCELERATIONS) -> Candidates:
    """Return every move with every pair of shares, S times A of each, move by move.

    Of two that last equally long it is the one with less speed.

    Args:
        speed: Shares of the speed limits, shape (S,). [-]
        acceleration: Shares of the acceleration limits, shape (A,). [-]
    """
    pairs = len(speed) * len(acceleration)
    move = np.repeat(np.arange(moves.count), pairs)
    fast = np.tile(np.repeat(speed, len(acceleration)), moves.count)
    rise = np.tile(acceleration, len(speed) * moves.count)
    found = Candidates(move, fast, rise)
    # A short move never cruises: a higher speed changes nothing.
    key = np.stack([move.astype(np.float64), rise, np.round(moves.duration(found), 9)], axis=1)
    _, kept = np.unique(key, axis=0, return_index=True)
    return found[np.sort(kept)]


def blocks(
    moves: Moves, candidates: Candidates, samples: int = SAMPLES
) -> Iterator[tuple[slice, Samples]]:
    """Yield the samples of all candidates, a bounded number at a time: which, and their motion."""
    duration = moves.duration(candidates)
    fine, coarse = (np.ceil(duration / step - 1e-9).astype(np.int64) for step in (STEP, LONG_STEP))
    count = np.maximum(np.clip(fine, 1, samples), coarse) + 1
    total = np.cumsum(count)
    begin = 0
    while begin < len(candidates):
        before = int(total[begin - 1]) if begin else 0
        end = max(begin + 1, int(np.searchsorted(total, before + ROWS, side="right")))
        part = slice(begin, end)
        sizes = count[part]
        first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        step = duration[part] / (sizes - 1)
        place = np.repeat(np.arange(end - begin), sizes)
        time = (np.arange(int(sizes.sum())) - first[place]) * step[place]
        yield part, Samples(first, step, moves.sample(candidates[part], place, time))
        begin = end


TORQUE_SHARE = 0.95
"""Of the torque limits that a changed move may use: friction is not known exactly. [-]"""


class Use(Rows):
    """What candidates or rests need; the mean over the temperatures, of P candidates."""

    duration: Annotated[Float, "Shape (P,). [s]"]
    energy: Annotated[Float, "From the grid, shape (P,). [J]"]
    peak: Annotated[Float, "Greatest power from the grid at any temperature, shape (P,). [W]"]
    brake: Annotated[Float, "Energy into the brake resistor, shape (P,). [J]"]
    columns: Annotated[Float, "Change of the energy by each figure's error, shape (P, K). [J]"]
    torque_use: Annotated[Float, "Greatest share of a torque limit, shape (P,); 0: no limits. [-]"]
    by_temperature: Annotated[Float, "Energy at each temperature, shape (P, T). [J]"]


class PowerChain:
    """From motion to energy, for one robot at given temperatures.

    Args:
        motor_temperature_degc: At which the program runs, shape (T, n). [degC]
    """

    def __init__(self, model: RobotModel, motor_temperature_degc: Float) -> None:
        self.model = model
        self.motor_temperature_degc = motor_temperature_degc
        self.robot = Robot.from_model(model)
        self.drivetrain = Drivetrain.from_model(model)
        self.friction = FrictionModel.from_model(model)
        self.drive = drive_from_model(model)
        self._deviations = EnergyDeviations(model)
        self._hold = HoldTorque(model)
        self._standstill = motor_standstill(model)

    def moves(
        self,
        moves: Moves,
        candidates: Candidates,
        progress: Callable[[float], None] | None = None,
        samples: int = SAMPLES,
    ) -> Use:
        """Return what candidates need.

        Args:
            progress: Called with the share done, 0 to 1.
        """
        found: list[Use] = []
        for part, motion in blocks(moves, candidates, samples):
            found.append(self._use(motion, moves.duration(candidates[part])))
            if progress is not None:
                progress(part.stop / len(candidates))
        return Use.concatenate(found)

    def rests(self, joint_position: Float, holding: bool = True) -> Use:
        """Return what one second at rest needs.

        Args:
            joint_position: Where, shape (P, n). [rad] or [m]
        """
        still = np.zeros_like(joint_position)
        first = np.arange(len(joint_position))
        motion = Samples(first, np.ones(len(first)), Trajectory(joint_position, still, still))
        return self._use(motion, np.ones(len(first)), holding=holding)

    @np.errstate(invalid="ignore", over="ignore")
    def _use(self, motion: Samples, duration: Float, holding: bool = True) -> Use:
        path = motion.path
        joint_torque = self.robot.joint_torque(
            path.joint_position, path.joint_velocity, path.joint_acceleration
        )
        speed = self.drivetrain.motor_velocity_from_joint(path.joint_velocity)
        rigid = self.drivetrain.motor_torque_from_joint(
            joint_torque
        ) + self.drivetrain.rotor_torque(path.joint_acceleration)
        rigid = rigid * holding
        standing = np.abs(speed) <= self._standstill
        moving = np.where(standing, 0.0, speed)
        held = self._hold.typical(rigid) if holding else rigid
        held_std = np.where(standing & holding, self._hold.std(held), 0.0)
        weight, place = _weights(motion, len(speed))
        shape, first = speed.shape, motion.first

        def at(degc: Float) -> tuple[Float, Float, Float, Float, Float]:
            """Energy, peak, brake energy, columns, use of the torque limits at a temperature."""
            coulomb = np.broadcast_to(self.friction.coulomb, shape)
            viscous = np.broadcast_to(self.friction.viscous(degc), shape)
            friction = self.friction.torque(
                speed, coulomb, viscous, motor_torque_rigid=rigid, standing=standing
            )
            torque = np.where(standing, held, rigid + friction)
            rigid_power, friction_power = rigid * speed, friction * speed
            shaft = rigid_power + friction_power
            winding = np.broadcast_to(degc, shape).copy()
            electrical, _ = self.drive.input_power(shaft, speed, torque, winding)
            stamp = np.rint(np.cumsum(weight) / NANOSECOND).astype(np.int64)
            fan = FanStage(self.model.cabinet, assumed=True)
            stage = CabinetStage(self.model.cabinet)
            balance = stage.step(stamp, place, electrical.sum(axis=1), fan.step(winding))
            returned = self.model.cabinet.regeneration_efficiency
            share = 0.0 if returned is None else returned.value
            excess = np.maximum(
                -(electrical.sum(axis=1) + balance.loss_dc + balance.capacitor_power), 0
            )
            columns = self._deviations.columns(
                moving,
                torque,
                rigid_power,
                friction_power,
                electrical - shaft,
                self._hold.loss_std(self.drive, torque, held_std, winding),
                degc,
                excess,
                fan.powers,
            )
            columns = self._deviations.at_grid(columns, np.where(excess > 0, share, 1.0))
            use = np.abs(self.drivetrain.joint_torque_from_motor(torque)) / self.robot.limits.effort
            lasting = balance.grid_power - balance.capacitor_power
            return (
                np.add.reduceat(lasting * weight, first),
                np.maximum.reduceat(balance.grid_power, first),
                np.add.reduceat(balance.brake_power * weight, first),
                np.add.reduceat(columns * weight[:, None], first),
                np.maximum.reduceat(np.nan_to_num(use).max(axis=1), first),
            )

        uses = [at(degc) for degc in self.motor_temperature_degc]
        energy = np.stack([use[0] for use in uses], axis=1)
        return Use(
            duration=duration,
            energy=energy.mean(axis=1),
            peak=np.max([use[1] for use in uses], axis=0),
            brake=np.mean([use[2] for use in uses], axis=0),
            columns=np.mean([use[3] for use in uses], axis=0),
            torque_use=np.max([use[4] for use in uses], axis=0),
            by_temperature=energy,
        )


def _weights(motion: Samples, rows: int) -> tuple[Float, Int]:
    """Weight of each sample in the trapezoidal rule [s], and its candidate; shape (N,) each."""
    ends = np.append(motion.first[1:], rows)
    place = np.repeat(np.arange(len(motion.first)), ends - motion.first)
    weight = motion.step[place].copy()
    if rows > len(motion.first):
        weight[motion.first] *= 0.5
        weight[ends - 1] *= 0.5
    return weight, place
