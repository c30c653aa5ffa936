"""What plant the rig plays, in the figures that paper A gives of its KR 16.

Truth of the rig throughout: no model and no meter takes part.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import Float
from robot_energy_papers.experiment import FIRST_SEED, SEED_STEP, allowed
from robot_energy_plan.motion import random_program
from robot_energy_rig import PlantProfile, RigConfig, VirtualRig
from robot_energy_rig.plant import PlantDrives, Supply
from robot_energy_rig.record import outputs

POSES, POSE_SHARE = 300, 0.9  # of every joint range
HOLDING_DEGC = 60.0
PROGRAM_DEGC = (20.0, 22.0, 60.0, 80.0)
FLOWS = (
    "rigid_power", "friction_power", "iron_loss", "copper_loss", "inverter_loss", "rectifier_loss",
    "brake_power", "capacitor_power", "loss_dc", "loss_grid", "grid_power",
)  # fmt: skip
ELECTRICAL = ("iron_loss", "copper_loss", "inverter_loss", "rectifier_loss")


class Holding(Described):
    """Grid power at rest over poses, drives on."""

    mean: Annotated[float, "Over random poses. [W]"]
    least: Annotated[float, "[W]"]
    greatest: Annotated[float, "[W]"]
    poses: int

    @classmethod
    def of(cls, power: Float) -> Holding:
        """Return the spread of the power of poses.

        Args:
            power: Shape (N,). [W]
        """
        return cls(float(power.mean()), float(power.min()), float(power.max()), len(power))

    @property
    def deviation(self) -> float:
        """Greatest deviation from the mean, relative to it. [-]"""
        return max(self.greatest - self.mean, self.mean - self.least) / self.mean


class Calibration(Described):
    """The plant in figures."""

    mean_power: Annotated[Float, "By program and start temperature, shape (programs, K). [W]"]
    peak_power: Annotated[Float, "The same, greatest power. [W]"]
    start_degc: Annotated[Float, "The start temperatures, shape (K,). [degC]"]
    holding: Holding
    flows: Annotated[dict[float, dict[str, float]], "Of every flow, by temperature. [W]"]

    def ratio(self, cold: float, hot: float) -> Float:
        """Return the energy at one temperature over that at another, shape (programs,). [-]

        Args:
            cold: Start temperature above the line. [degC]
            hot: Start temperature below the line. [degC]
        """
        column = self.start_degc.tolist()
        return self.mean_power[:, column.index(cold)] / self.mean_power[:, column.index(hot)]

    def electrical_over_mechanical(self, degc: float) -> float:
        """Return the losses of motors, inverters and rectifier over those of friction. [-]

        Args:
            degc: Start temperature. [degC]
        """
        flow = self.flows[degc]
        return sum(flow[name] for name in ELECTRICAL) / flow["friction_power"]


def holding_power(profile: PlantProfile, joint_position: Float, motor_degc: float) -> Float:
    """Return the grid power while the drives hold poses, shape (N,). [W]

    At rest friction and iron take nothing; copper and inverter carry gravity.

    Args:
        joint_position: Poses, shape (N, n). [rad]
        motor_degc: Temperature of every winding. [degC]
    """
    robot, drivetrain = profile.mechanics()
    still = np.zeros_like(joint_position)
    torque = drivetrain.motor_torque_from_joint(robot.joint_torque(joint_position, still, still))
    return carrying_power(profile, torque, motor_degc)


def carrying_power(profile: PlantProfile, motor_torque: Float, motor_degc: float) -> Float:
    """Return the grid power while motors at rest carry torques, shape (N,). [W]

    Args:
        motor_torque: Shape (N, n). [N m]
        motor_degc: Temperature of every winding. [degC]
    """
    config = RigConfig()
    flows = PlantDrives(profile, config).flows(
        np.zeros_like(motor_torque), motor_torque, np.full(profile.n_joints, float(motor_degc))
    )
    bus = (flows.copper_loss + flows.inverter_loss).sum(axis=1)
    return Supply(profile, config, 1.0).step(bus).grid_power


def random_poses(profile: PlantProfile, seed: int, share: float = POSE_SHARE) -> Float:
    """Return random poses with the tool above the floor, shape (`POSES`, n). [rad]

    Args:
        share: Of every joint range that they span. [-]
    """
    limits, above = allowed(profile)
    generator = np.random.default_rng(seed)
    drawn: list[Float] = []
    while len(drawn) < POSES:
        pose: Float = generator.uniform(share * limits.lower, share * limits.upper)
        if above(pose):
            drawn.append(pose)
    return np.stack(drawn)


def calibrate(profile: PlantProfile, seed: int, programs: int, moves: int) -> Calibration:
    """Return what a plant does with random programs, and while it holds random poses.

    Args:
        programs: How many programs of the kind of the experiment; >= 1.
    """
    limits, above = allowed(profile)
    first = FIRST_SEED + SEED_STEP * seed
    mean, peak = np.empty((2, programs, len(PROGRAM_DEGC)))
    flows: dict[float, dict[str, float]] = {}
    for number in range(programs):
        program = random_program(limits, first + number, moves, accept=above)
        for column, degc in enumerate(PROGRAM_DEGC):
            rig = VirtualRig(profile, program, None, seed, degc)
            truth = [piece.truth for piece in outputs(rig, program.period)]
            samples = sum(len(part) for part in truth)
            flow = {
                name: float(sum(getattr(part, name).sum() for part in truth)) / samples
                for name in FLOWS
            }
            mean[number, column] = flow["grid_power"]
            peak[number, column] = max(float(part.grid_power.max()) for part in truth)
            if number == 0:
                flows[degc] = flow
    holding = Holding.of(holding_power(profile, random_poses(profile, seed), HOLDING_DEGC))
    return Calibration(mean, peak, np.asarray(PROGRAM_DEGC), holding, flows)
