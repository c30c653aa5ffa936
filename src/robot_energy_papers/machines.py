"""The wall of paper B printed by its three machines: energy, and where it goes.

The shipped models predict (the machines are not available), through the stages of the monitor.
One layer is played on the virtual rigs as well, whose friction and losses are others.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Annotated, Any

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.model import RobotModel, load
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.equations import trapezoid_energy
from robot_energy.physics.rigid_body import Robot
from robot_energy.pipeline import EnergyPipeline, Output, Settings
from robot_energy.timeline.blocks import Float, PowerBlock, TemperatureBlock
from robot_energy_papers.mantis import Smooth
from robot_energy_papers.wall import Wall
from robot_energy_plan.motion import InverseKinematics, Trajectory
from robot_energy_plan.motion.gcode import read_gcode
from robot_energy_plan.motion.tool_motion import TimedPath, ToolLimits, ToolMotion, ToolPlacement
from robot_energy_plan.prediction import START_NS, planned_block
from robot_energy_rig import RigOutput, VirtualRig, load_profile
from robot_energy_rig.record import outputs

QUARTER = 0.5 * np.pi
MOTOR_DEGC = 25.0
ARM = "irb4600"
PARTS = {
    "friction": "friction",
    "holding": "copper, holding the weight",
    "copper": "copper, the rest",
    "iron": "iron",
    "amplifier": "amplifiers, constant",
}
"""Where the energy goes, as the models have it; what is lifted comes back."""


class Machine(Described):
    """A machine and how it stands to the wall."""

    name: str
    model: str
    link: str
    start: tuple[float, ...]
    placement: ToolPlacement
    options: dict[str, Any]
    paper: Annotated[float | None, "Energy over that of the arm minus 1, paper B; None: arm. [-]"]


# The wall is 1.2 m along x and 0.3 m along y of the program. Arms stand before its long side.
MACHINES = {
    "mantis_held": Machine(
        "Mantis, 1 held", "mantis", "tool0", (0.0, -1.2, 1.8),
        ToolPlacement(0.6, -1.9, 0.0, QUARTER), {"held": ("joint_1",), "lifted": True}, -0.93,
    ),
    "mantis_all": Machine(
        "Mantis, all", "mantis", "tool0", (0.0, -1.2, 1.8),
        ToolPlacement(0.6, -1.9, 0.0, QUARTER),
        {"weight": np.array([0.05, 1.0, 1.0]), "lifted": True}, -0.92,
    ),
    "testbed": Machine(
        "gantry", "testbed", "tool0", (1.0, 0.4, 0.0), ToolPlacement(-1.15, -0.4, 0.0), {},
        -0.77,
    ),
    "irb4600": Machine(
        "arm", "irb4600", "nozzle", (0.1, 0.3, 0.2, 0.0, 1.07, 0.0),
        ToolPlacement(0.6, -1.3, -0.2, QUARTER), {"orientation": np.diag([-1.0, 1.0, -1.0])}, None,
    ),
}  # fmt: skip


def wall_motion(
    machine: Machine,
    layers: int = 1,
    height: float = 0.0,
    infill: int = 0,
    limits: ToolLimits | None = None,
) -> ToolMotion:
    """Return the motion of a machine's joints that prints the wall.

    Args:
        height: Height of the first one above the bottom of the wall. [m]
    """
    place = machine.placement
    robot = Robot.from_model(load(machine.model))
    program = Wall(layers=layers, infill=infill).gcode()
    timed = TimedPath(read_gcode(program, "wall").path, limits)
    kinematics = InverseKinematics(robot, machine.link, **machine.options)
    return ToolMotion(
        timed,
        kinematics,
        np.array(machine.start),
        robot.limits,
        ToolPlacement(place.x, place.y, place.z - height, place.yaw),
        anchored=kinematics.structure == "planar",
    )


@cache
def layer(key: str) -> tuple[tuple[Float, Trajectory], ...]:
    """Return the motion of one layer at the bottom of the wall, which is planned once."""
    return tuple(wall_motion(MACHINES[key]).blocks())


class Energies(Described):
    """Energy of one machine for one motion, motor side unless stated. [J]"""

    duration: Annotated[float, "[s]"]
    net: Annotated[Float, "Energy of each joint's shaft, braking negative, shape (n,)."]
    positive: Annotated[Float, "Energy of each joint's shaft while it drives, shape (n,)."]
    absolute: Annotated[Float, "Magnitude of each joint's shaft power, shape (n,)."]
    electrical: Annotated[Float, "Into each drive, braking negative, shape (n,)."]
    parts: Annotated[dict[str, float], "By the keys of `PARTS`, of all joints; empty for a rig."]
    cabinet: float

    def __add__(self, other: Energies) -> Energies:
        """Return the sum of two time spans."""
        sums = {
            name: value + getattr(other, name)
            for name, value in vars(self).items()
            if name != "parts"
        }
        return Energies(
            **sums, parts={key: self.parts[key] + other.parts[key] for key in self.parts}
        )

    @property
    def figures(self) -> dict[str, float]:
        """What machines are compared by. [J]"""
        return {
            "mechanical, net": float(self.net.sum()),
            "mechanical, positive": float(self.positive.sum()),
            "mechanical, magnitude": float(self.absolute.sum()),
            "electrical, drives": float(self.electrical.sum()),
        }


class Curve(Described):
    """Power of one machine over one layer, all joints together."""

    time: Annotated[Float, "Shape (N,). [s]"]
    net: Annotated[Float, "Energy of the shafts, shape (N,). [W]"]
    positive: Annotated[Float, "Energy of the shafts that drive, shape (N,). [W]"]
    electrical: Annotated[Float, "Energy of the drives, shape (N,). [W]"]
    joint_position: Annotated[Float, "Shape (N, n). [rad] or [m]"]


def predicted(
    model: RobotModel, blocks: Iterable[tuple[Float, Trajectory]]
) -> tuple[Energies, Curve]:
    """Return energies and power of a motion by a model, motors at 25 degC throughout.

    Args:
        blocks: Times, shape (N,) [s], and joints of the motion, as of `ToolMotion.blocks`.
    """
    pipeline = EnergyPipeline(model, Settings(power_period=None, temperature_assumed=True))
    warm: TemperatureBlock | None = TemperatureBlock(
        np.array([START_NS]), np.full((1, len(model.joints)), MOTOR_DEGC)
    )
    times: list[Float] = []
    paths: list[Trajectory] = []
    powers: list[PowerBlock] = []
    for time, path in blocks:
        _keep(powers, pipeline.step(planned_block(time, path), warm, planned=True))
        warm = None
        times.append(time)
        paths.append(path)
    _keep(powers, pipeline.flush())  # the last samples wait for temperatures still to come
    time = np.concatenate(times)
    position = np.concatenate([path.joint_position for path in paths])
    power = PowerBlock.concatenate(powers)
    shaft = power.rigid_power + power.friction_power
    electrical = shaft + power.drive_loss
    loss = trapezoid_energy(time, _losses(model, position, power))
    friction = float(trapezoid_energy(time, power.friction_power.sum(axis=1)))
    parts = dict(zip(PARTS, [friction, *loss.tolist()], strict=True))
    constant = power.loss_dc + power.loss_grid
    return _found(time, float(time[-1]), shaft, electrical, parts, constant, position)


def played(
    machine: Machine, blocks: Iterable[tuple[Float, Trajectory]], seed: int
) -> tuple[Energies, Curve]:
    """Return energies and power of a motion on the machine's virtual rig: its truth.

    Args:
        blocks: Times, shape (N,) [s], and joints of the motion, as of `ToolMotion.blocks`.
    """
    smooth = Smooth(blocks)
    profile = load_profile(machine.model)
    rig = VirtualRig(profile, smooth, None, seed, MOTOR_DEGC, MOTOR_DEGC)
    truth = RigOutput.concatenate(list(outputs(rig, smooth.duration))).truth
    time = (truth.stamp_ns - truth.stamp_ns[0]) * 1e-9
    shaft, electrical = truth.shaft_power, truth.drive_power
    constant = truth.loss_dc + truth.loss_grid
    return _found(time, smooth.duration, shaft, electrical, {}, constant, truth.joint_position)


def _losses(model: RobotModel, joint_position: Float, power: PowerBlock) -> Float:
    """Copper loss of gravity, other copper, iron and amplifier loss, shape (N, 4). [W]"""
    losses = [joint.losses for joint in model.joints if joint.losses is not None]
    warm = [1.0 + e.copper_temperature_coefficient.value * (MOTOR_DEGC - 20.0) for e in losses]
    per_torque = np.array([e.copper.value for e in losses]) * warm
    still = np.zeros_like(joint_position)
    weight = Robot.from_model(model).joint_torque(joint_position, still, still)
    holding = per_torque * Drivetrain.from_model(model).motor_torque_from_joint(weight) ** 2
    copper = per_torque * power.motor_torque**2
    amplifier = np.broadcast_to([entry.constant.value for entry in losses], copper.shape)
    parts = holding, copper - holding, power.drive_loss - copper - amplifier, amplifier
    return np.stack([part.sum(axis=1) for part in parts], axis=1)


def _found(
    time: Float,
    duration: float,
    shaft: Float,
    electrical: Float,
    parts: dict[str, float],
    constant: Float,
    position: Float,
) -> tuple[Energies, Curve]:
    driving = np.maximum(shaft, 0.0)
    energies = Energies(
        duration,
        trapezoid_energy(time, shaft),
        trapezoid_energy(time, driving),
        trapezoid_energy(time, np.abs(shaft)),
        trapezoid_energy(time, electrical),
        parts,
        float(trapezoid_energy(time, constant)),
    )
    net, positive, drives = (power.sum(axis=1) for power in (shaft, driving, electrical))
    return energies, Curve(time, net, positive, drives, position)


def _keep(powers: list[PowerBlock], output: Output) -> None:
    if output.power is not None:
        powers.append(output.power)
