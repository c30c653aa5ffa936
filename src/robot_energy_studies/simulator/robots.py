"""K equal robots at work, each with a motion and temperatures of its own.

MuJoCo integrates bodies, rotors and gears (semi-implicit Euler). Each step a cascade of position
and speed, with acceleration fed forward, gives the torque of each motor; friction and iron brake
the rotor. Torques of a step act on mean speeds of the step, so that work and kinetic energy agree.
Temperatures are held for a second and then advanced by its mean heat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_energy.foundation.errors import RigError
from robot_energy.timeline.blocks import Float, Int
from robot_energy_plan.motion.ptp import SampledPath
from robot_energy_studies.simulator.cabinet import DcLink
from robot_energy_studies.simulator.drawn import DrawnRobot
from robot_energy_studies.simulator.gear_friction import SlidingGears
from robot_energy_studies.simulator.heat import CASTING, HOUSING, OIL, WINDING

STEP = 1e-3  # s
BLOCK = 1000  # steps over which temperatures are held
SAMPLE = 4  # steps between joint states
POSITION_GAIN, SPEED_GAIN, INTEGRAL_GAIN = 12.0, 40.0, 10.0  # 1/s
TORQUE_LIMIT = 4.0  # of the rated torque
BRISTLE_DAMPING = 0.3  # of the critical damping of bristles and rotor
LOSSES = (
    "friction",
    "gear_damping",
    "iron",
    "copper",
    "inverter",
    "brake",
    "rectifier",
    "link_load",
    "grid_load",
)


@dataclass(frozen=True)
class SimulatedRun:
    """What K robots did, N steps long."""

    motor_angle: Float  # at every `SAMPLE`th step, shape (N / SAMPLE, K, n) [rad]
    motor_velocity: Float  # likewise [rad/s]
    joint_position: Float  # of the links, likewise [rad]
    current: Float  # likewise [A]
    grid_power: Float  # means over the steps, shape (N, K) [W]
    degc: Float  # of winding, housing, oil and casting, shape (blocks + 1, K, 4, n) [degC]
    energy: dict[str, Float]  # by `LOSSES`, ``grid`` and ``stored``, shape (K,) each [J]
    node_heat: Float  # mean heat into every node, shape (K, 4, n) [W]

    @property
    def imbalance(self) -> Float:
        """Grid energy less losses and stored energy, relative to it, shape (K,). [-]"""
        spent = sum(self.energy[name] for name in (*LOSSES, "stored"))
        return 1.0 - spent / self.energy["grid"]


class Robots:
    """Robots that start at rest at the beginning of their motions.

    Args:
        motions: Of the joints, one for each robot.
        degc: Temperatures at the start, shape (K, 4, n). [degC]
        hall_degc: Of the hall of each robot, shape (K,). [degC]
    """

    def __init__(
        self, robot: DrawnRobot, motions: Sequence[SampledPath], degc: Float, hall_degc: Float
    ) -> None:
        self._robot = robot
        self._motions = motions
        self._degc = degc.copy()
        self._hall = hall_degc[:, None]
        arm, rated = robot.arm, robot.motors.rated_torque
        self._model, self._joints, self._rotors = arm.compiled(STEP)
        self._data, inertia, holding = self._start()
        bristle = robot.friction.boundary / robot.friction.bristle
        damping = 2.0 * BRISTLE_DAMPING * np.sqrt(bristle * arm.rotor_inertia)
        self._gears = SlidingGears(robot.friction, STEP, degc[:, OIL], damping)
        self._link = DcLink(robot.cabinet, len(motions), STEP)
        self._inertia = arm.rotor_inertia + inertia / arm.gear_ratio**2
        self._integral = holding / arm.gear_ratio
        self._limit = TORQUE_LIMIT * rated
        self._fan = np.zeros(len(motions), dtype=bool)

    def _start(self) -> tuple[list[Any], Float, Float]:
        """Robots at rest, the inertia of every joint [kg m^2] and what each must hold [N m]."""
        import mujoco

        arm, model = self._robot.arm, self._model
        data: list[Any] = []
        torques: list[Float] = []
        unit, matrix = np.eye(model.nv), np.zeros((model.nv, model.nv))
        for motion in self._motions:
            one: Any = mujoco.MjData(model)
            start = motion.sample(np.zeros(1)).joint_position[0]
            one.qpos[self._joints] = start
            one.qpos[self._rotors] = start * arm.gear_ratio
            mujoco.mj_forward(model, one)
            torques.append(one.qfrc_bias[self._joints].copy())
            for place in self._joints:
                mujoco.mj_mulM(model, one, matrix[place], unit[place])
            # Motors stand where the motion begins; the links hang below them.
            one.qpos[self._joints] = start - torques[-1] / arm.stiffness
            data.append(one)
        return data, np.diag(matrix)[self._joints], np.array(torques)

    def run(self, duration: float) -> SimulatedRun:
        """Return what the robots do in the next time, in whole blocks.

        Args:
            duration: [s]
        """
        stored = self._stored()
        blocks = [self._block(first * BLOCK) for first in range(int(np.ceil(duration)))]
        energy = {
            name: np.array([block[2][name] for block in blocks]).sum(axis=0)
            for name in blocks[0][2]
        }
        energy["stored"] = energy["stored"] + self._stored() - stored
        columns = [np.concatenate(column) for column in zip(*(b[0] for b in blocks), strict=True)]
        return SimulatedRun(
            *columns,
            degc=np.stack([blocks[0][1], *(b[3] for b in blocks)]),
            energy=energy,
            node_heat=np.mean([b[4] for b in blocks], axis=0),
        )

    def _stored(self) -> Float:
        """Energy of bodies, gears and bristles, shape (K,). [J]"""
        import mujoco

        found: list[float] = []
        for one in self._data:
            mujoco.mj_forward(self._model, one)
            mujoco.mj_energyPos(self._model, one)
            mujoco.mj_energyVel(self._model, one)
            found.append(float(one.energy.sum()))
        return np.array(found) + self._gears.stored.sum(axis=-1)

    def _block(self, first: int) -> Any:
        """Advance by a block and its temperatures."""
        robot, motors, arm = self._robot, self._robot.motors, self._robot.arm
        before = self._degc
        position, velocity, torque, friction, drag = self._moved(first)
        rotor = velocity[:, :, self._rotors]
        speed = 0.5 * (rotor[1:] + rotor[:-1])
        twist = velocity[:, :, self._rotors] / arm.gear_ratio - velocity[:, :, self._joints]
        damped = arm.damping * twist[:-1] * 0.5 * (twist[1:] + twist[:-1])
        current = motors.current(torque, before[:, HOUSING])
        copper = motors.copper_loss(current, speed, before[:, WINDING])
        conduction = motors.conduction_loss(current)
        iron, rubbed = drag * speed, friction * speed
        power = (torque * speed + copper + conduction).sum(axis=-1)
        flows = self._link.run(power, (motors.switching * np.abs(current)).sum(axis=-1))
        cabinet = robot.cabinet
        limit = np.where(self._fan, cabinet.fan_off_degc, cabinet.fan_on_degc)
        self._fan = before[:, HOUSING].max(axis=-1) > limit
        outside = cabinet.grid_load + cabinet.fan * self._fan
        grid = flows.link + flows.rectifier_loss + outside
        share = robot.friction_to_housing
        heat = np.zeros_like(before)
        heat[:, WINDING] = copper.mean(axis=0)
        heat[:, HOUSING] = iron.mean(axis=0) + share * rubbed.mean(axis=0)
        heat[:, OIL] = (1.0 - share) * rubbed.mean(axis=0) + damped.mean(axis=0)
        self._degc = robot.heat.step(before, heat, self._hall, BLOCK * STEP)
        self._gears.set_oil(self._degc[:, OIL])
        watts = {
            "friction": rubbed.sum(axis=-1),
            "gear_damping": damped.sum(axis=-1),
            "iron": iron.sum(axis=-1),
            "copper": copper.sum(axis=-1),
            "inverter": conduction.sum(axis=-1) + flows.switching_loss,
            "brake": flows.brake,
            "rectifier": flows.rectifier_loss,
            "link_load": np.full_like(grid, cabinet.link_load),
            "grid_load": np.broadcast_to(outside, grid.shape),
            "stored": flows.stored,
            "grid": grid,
        }
        energy = {name: STEP * values.sum(axis=0) for name, values in watts.items()}
        at = slice(0, BLOCK, SAMPLE)
        rows = (
            position[at][..., self._rotors],
            rotor[:-1][at],
            position[at][..., self._joints],
            current[at],
            grid,
        )
        return rows, before, energy, self._degc, heat

    def _moved(self, first: int) -> tuple[Float, ...]:
        """Positions and velocities of all coordinates and the torques of every step of a block."""
        import mujoco

        arm, motors, gears = self._robot.arm, self._robot.motors, self._gears
        ratio, joints, rotors = arm.gear_ratio, self._joints, self._rotors
        stiffness, damping = arm.stiffness / ratio, arm.damping / ratio
        inverse = 1.0 / ratio
        robots, model = range(len(self._data)), self._model
        wanted = self._wanted(first)
        size = (len(self._data), model.nv)
        position, velocity = np.empty((2, BLOCK + 1, *size))
        torque, friction, drag = np.empty((3, BLOCK, len(self._data), len(ratio)))
        views = [(one.qpos, one.qvel, one.qfrc_applied) for one in self._data]
        applied = np.zeros(size)
        gain, integral_gain = SPEED_GAIN * self._inertia, INTEGRAL_GAIN * STEP
        integral, step, data = self._integral, mujoco.mj_step, self._data
        lowest, highest = -self._limit, self._limit
        for k in robots:
            position[0, k], velocity[0, k] = views[k][:2]
        for row in range(BLOCK):
            angle, speed = position[row].take(rotors, 1), velocity[row].take(rotors, 1)
            twist = angle * inverse - position[row].take(joints, 1)
            twisting = speed * inverse - velocity[row].take(joints, 1)
            slip = wanted[0][row] - POSITION_GAIN * angle - speed
            push = gain * slip
            integral = integral + integral_gain * push
            drive = np.minimum(np.maximum(push + integral + wanted[1][row], lowest), highest)
            rub = gears.torque(speed, stiffness * twist + damping * twisting)
            iron = motors.drag(speed, drive)
            applied[:, rotors] = drive - rub - iron
            torque[row], friction[row], drag[row] = drive, rub, iron
            for k in robots:
                now_position, now_velocity, force = views[k]
                force[:] = applied[k]
                step(model, data[k])
                position[row + 1, k], velocity[row + 1, k] = now_position, now_velocity
        self._integral = integral
        if any(one.warning.number.any() for one in data):
            raise RigError(
                f"the second simulator became unstable within {first * STEP + 1:g} s",
                "robots whose gears vibrate at less than a third of the steps",
            )
        return position, velocity, torque, friction, drag

    def _wanted(self, first: int) -> tuple[Float, Float]:
        """Speed with the position behind it [rad/s] and torque fed forward [N m] of a block."""
        ratio = self._robot.arm.gear_ratio
        index: Int = np.arange(first, first + BLOCK)
        paths = [motion.sample(index * STEP) for motion in self._motions]
        angle, speed, acceleration = (
            np.stack([getattr(path, f"joint_{name}") for path in paths], axis=1) * ratio
            for name in ("position", "velocity", "acceleration")
        )
        return speed + POSITION_GAIN * angle, self._inertia * acceleration


def even(robots: int, degc: float, n_joints: int) -> Float:
    """Return temperatures of robots all of whose parts are equally warm, shape (K, 4, n). [degC]

    Args:
        degc: Of all parts. [degC]
    """
    return np.full((robots, CASTING + 1, n_joints), degc)
