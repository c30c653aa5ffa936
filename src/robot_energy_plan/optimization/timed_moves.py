"""Moves that can follow a time law of their own, and a program of them: it is a trajectory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np

from robot_energy.physics.drives_and_cabinet import FanStage
from robot_energy.timeline.blocks import Float, Int
from robot_energy_plan.motion.ptp import Trajectory
from robot_energy_plan.optimization.chain import TORQUE_SHARE, Candidates, Moves, PowerChain
from robot_energy_plan.optimization.program_form import ProgramForm, WrittenTrajectory
from robot_energy_plan.optimization.time_law import LawLimits, path_power, time_law

PARTS = 60  # of a path
MARGIN = 0.99  # of the acceleration limits: between the places that are looked at [-]
LAW_TORQUE = 0.95  # of the torque that a changed move may use, for the same reason [-]
PRICES = (-0.9, -0.5, 0.0, 1.0, 3.0)  # of a second, over the power at rest, on top of the losses


class _TimedMoves(Moves):
    """Moves of a program, and the same along the same paths under time laws.

    ``base`` gives the paths their own time; ``speed`` is that along the path of each law at its
    nodes, shape (L, PARTS + 1), and ``move`` the move of each law.
    """

    def __init__(self, moves: Moves, base: Candidates, speed: Float, move: Int) -> None:
        self.count = moves.count
        none = np.full(len(move), np.nan)
        self.laws = Candidates(move, none, none, np.arange(len(move)))
        self._moves, self._base = moves, base
        self._path_time = moves.duration(base)[move]
        self._speed = speed
        self._step = self._path_time / PARTS
        part = 2.0 * self._step[:, None] / (speed[:, 1:] + speed[:, :-1])
        self._clock = np.concatenate([np.zeros((len(speed), 1)), np.cumsum(part, axis=1)], axis=1)
        self._rise = np.diff(speed**2, axis=1) / (2.0 * self._step[:, None])

    def duration(self, candidates: Candidates) -> Float:
        found = np.empty(len(candidates))
        timed = candidates.law >= 0
        found[~timed] = self._moves.duration(candidates[np.flatnonzero(~timed)])
        found[timed] = self._clock[candidates.law[timed], -1]
        return found

    def sample(self, candidates: Candidates, place: Int, time: Float) -> Trajectory:
        law = candidates.law[place]
        timed = np.flatnonzero(law >= 0)
        ways = Candidates(  # of a law: any way, as its rows are replaced
            candidates.move,
            np.where(candidates.law < 0, candidates.speed, 1.0),
            np.where(candidates.law < 0, candidates.acceleration, 1.0),
        )
        plain = self._moves.sample(ways, place, time)
        if not len(timed):
            return plain
        along, speed, rise = self._along(law[timed], time[timed])
        move = candidates.move[place[timed]]
        path = self._moves.sample(self._base, move, along)
        fields = (
            (plain.joint_position, path.joint_position),
            (plain.joint_velocity, path.joint_velocity * speed[:, None]),
            (
                plain.joint_acceleration,
                path.joint_acceleration * (speed**2)[:, None] + path.joint_velocity * rise[:, None],
            ),
        )
        for whole, some in fields:
            whole[timed] = some
        return Trajectory(*(whole for whole, _ in fields))

    def _along(self, law: Int, time: Float) -> tuple[Float, Float, Float]:
        """Path time, speed and its rise."""
        part = np.clip((self._clock[law] <= time[:, None]).sum(axis=1) - 1, 0, PARTS - 1)
        left = np.clip(time - self._clock[law, part], 0.0, None)
        speed, rise = self._speed[law, part], self._rise[law, part]
        along = part * self._step[law] + speed * left + 0.5 * rise * left**2
        return np.minimum(along, self._path_time[law]), speed + rise * left, rise


def timed_moves(
    chain: PowerChain,
    moves: Moves,
    base: Candidates,
    limits: LawLimits,
    progress: Callable[[float], None] | None = None,
) -> Moves:
    """Return moves with their cheapest time laws, for several prices of a second.

    A move whose program has no solution has none.

    Args:
        base: How they are made now, in their order.
        progress: Called with the share done, 0 to 1.
    """
    cabinet = chain.model.cabinet
    fan = np.array(
        [FanStage(cabinet, assumed=True).step(one[None]) for one in chain.motor_temperature_degc]
    )
    loss_grid = cabinet.loss_grid.value + float(fan.mean())
    laws: list[Float] = []
    owner: list[int] = []
    length = moves.duration(base)
    for move in range(moves.count):
        step = float(length[move]) / PARTS
        if step <= 0:
            continue
        time = 0.5 * step * np.arange(2 * PARTS + 1)
        along = moves.sample(base, np.full(len(time), move, dtype=np.int64), time)
        places = path_power(chain, along)
        at_rest = cabinet.loss_dc.value + loss_grid + places.constant
        for price in PRICES:
            cost = loss_grid + price * at_rest
            law = time_law(places, step, limits, cabinet.loss_dc.value, cost)
            if law is not None:
                laws.append(law)
                owner.append(move)
        if progress is not None:
            progress((move + 1) / moves.count)
    table = np.array(laws).reshape(-1, PARTS + 1)
    return _TimedMoves(moves, base, table, np.array(owner, dtype=np.int64))


def law_limits(chain: PowerChain, acceleration: Float, jerk: Float) -> LawLimits:
    """Return the limits of laws, with the velocity and torque limits of the URDF.

    Torques of joints are as those of their motors, wrist coupling left out.

    Args:
        acceleration: Joint side, shape (n,). [rad/s^2] or [m/s^2]
        jerk: Joint side, shape (n,). [rad/s^3] or [m/s^3]
    """
    limits = chain.robot.limits
    ratio = np.abs(np.diag(chain.drivetrain.transmission))
    torque = LAW_TORQUE * TORQUE_SHARE * limits.effort / ratio
    return LawLimits(limits.velocity, MARGIN * acceleration, jerk, torque)


def timed_form(form: ProgramForm, moves: Moves) -> WrittenTrajectory:
    """Return a program with time laws."""
    note = "moves with a time law of their own need a controller that follows a trajectory"
    given: dict[str, Any] = {one.name: getattr(form, one.name) for one in fields(ProgramForm)}
    given |= {"moves": moves, "notes": (*form.notes, note)}
    return WrittenTrajectory(**given)
