"""The plant's own parameters: what the monitored model does not know.

Shared with the model under test are rigid bodies, gear ratios and rotor inertias of a
shipped model file, nothing else. Motor side throughout. No figure was measured: they are
assumed from neighbouring robots, so the plant is of the KR 16 class, not a KR 16.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from robot_energy.blocks import Float
from robot_energy.errors import RigError
from robot_energy.model import load
from robot_energy.motion import MotionLimits
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.rigid_body import Robot
from robot_energy.rig.lubricant import VG150_MINERAL, VG220_SYNTHETIC, Lubricant


@dataclass(frozen=True)
class SupplyProfile:
    """The cabinet.

    Attributes:
        loss_dc: Constant on the DC bus, without the drives' own losses. [W]
        loss_grid: Constant on the grid side. [W]
        rectifier_efficiency: In (0, 1]. [-]
        capacitance: Of the DC link. [F]
        rectified_voltage: Of the DC link while the grid feeds it. [V]
        chopper_on_voltage: The brake chopper switches on here. [V]
        chopper_off_voltage: And off here. [V]
        brake_resistance: [ohm]
    """

    loss_dc: float
    loss_grid: float
    rectifier_efficiency: float
    capacitance: float
    rectified_voltage: float
    chopper_on_voltage: float
    chopper_off_voltage: float
    brake_resistance: float

    def __post_init__(self) -> None:
        for name in ("capacitance", "brake_resistance", "rectified_voltage"):
            if not 0 < getattr(self, name) < np.inf:
                raise RigError(f"the supply's {name} is {getattr(self, name)}", "a value > 0")
        if not 0 < self.rectifier_efficiency <= 1:
            raise RigError(
                f"the rectifier efficiency is {self.rectifier_efficiency}", "a share in (0, 1]"
            )
        if not self.rectified_voltage < self.chopper_off_voltage < self.chopper_on_voltage:
            raise RigError(
                f"the link is rectified at {self.rectified_voltage} V, the chopper switches off at "
                f"{self.chopper_off_voltage} V and on at {self.chopper_on_voltage} V",
                "rising voltages in this order",
            )


@dataclass(frozen=True)
class PlantProfile:
    """One robot of the rig, motor side, shape (n,) each.

    Attributes:
        body: Name of the shipped model, or path of a model file, whose URDF, payload,
            gear ratios and rotor inertias are used, and nothing else of it.
        lubricant: One oil per axis.
        coulomb: At no load. [N m]
        load_coulomb: Per rigid-body motor torque. [-]
        stribeck: Added at zero speed, falling with ``exp(-(w/stribeck_velocity)^2)``. [N m]
        stribeck_velocity: [rad/s]
        viscous_40: Viscous coefficient with the oil at 40 degC. [N m s/rad]
        torque_constant: At 20 degC. [N m/A rms]
        torque_constant_fall: Relative, per kelvin of magnet temperature. [1/K]
        resistance: Of a phase at 20 degC; copper loss is 3 R I^2. [ohm]
        resistance_rise: Relative, per kelvin. [1/K]
        hysteresis_torque: Iron loss that grows with speed. [N m]
        eddy_viscous: Iron loss that grows with its square. [N m s/rad]
        inverter_linear: Inverter loss per phase current. [W/A]
        inverter_square: Per its square. [W/A^2]
        motor_capacity: Heat capacity of the motor node. [J/K]
        gear_capacity: Of the gear and structure node. [J/K]
        motor_conductance: From motor to gear. [W/K]
        gear_conductance: From gear to ambient. [W/K]
        friction_to_motor: Share of friction that heats the motor node. [-]
        acceleration: For motion generation, joint side. [rad/s^2]
        supply: The cabinet.

    Raises:
        RigError: If shapes differ or a figure is negative.
    """

    body: str
    lubricant: tuple[Lubricant, ...]
    coulomb: Float
    load_coulomb: Float
    stribeck: Float
    stribeck_velocity: Float
    viscous_40: Float
    torque_constant: Float
    torque_constant_fall: Float
    resistance: Float
    resistance_rise: Float
    hysteresis_torque: Float
    eddy_viscous: Float
    inverter_linear: Float
    inverter_square: Float
    motor_capacity: Float
    gear_capacity: Float
    motor_conductance: Float
    gear_conductance: Float
    friction_to_motor: Float
    acceleration: Float
    supply: SupplyProfile

    def __post_init__(self) -> None:
        n_joints = len(self.lubricant)
        positive = {
            "stribeck_velocity",
            "torque_constant",
            "motor_capacity",
            "gear_capacity",
            "motor_conductance",
            "gear_conductance",
            "acceleration",
        }
        for entry in fields(self):
            if entry.type != "Float":
                continue
            values: Float = getattr(self, entry.name)
            if values.shape != (n_joints,):
                raise RigError(
                    f"the profile's {entry.name} has shape {values.shape}",
                    f"one figure for each of {n_joints} axes",
                )
            floor_ok = values > 0 if entry.name in positive else values >= 0
            if not (floor_ok & np.isfinite(values)).all():
                raise RigError(
                    f"the profile's {entry.name} is {values.tolist()}",
                    "finite figures > 0" if entry.name in positive else "figures >= 0",
                )

    @property
    def n_joints(self) -> int:
        """Number of axes."""
        return len(self.lubricant)

    def mechanics(self) -> tuple[Robot, Drivetrain]:
        """Return the rigid bodies and the drivetrain, all that is shared with a model.

        Raises:
            ModelFileError: If there is no such model.
            RigError: If it has another number of joints.
        """
        model = load(self.body)
        if len(model.joints) != self.n_joints:
            raise RigError(
                f"the model '{self.body}' has {len(model.joints)} joints",
                f"{self.n_joints}, as the profile",
            )
        return Robot.from_model(model), Drivetrain.from_model(model)

    def motion_limits(self, robot: Robot, jerk_time: float = 0.05) -> MotionLimits:
        """Return limits for programs of this robot.

        Args:
            robot: Its rigid bodies, for positions and speeds.
            jerk_time: Time over which acceleration builds up. [s]

        Raises:
            MotionError: If the URDF lacks limits.
        """
        return MotionLimits.of_robot(robot, self.acceleration, jerk_time)


def calibrated_viscous(
    lubricant: Lubricant, cold: float, hot: float, cold_degc: float = 20.0, hot_degc: float = 60.0
) -> float:
    """Return the coefficient at 40 degC whose curve passes two targets equally closely.

    Only the scale is free, the oil fixes the shape; the ratio to the target is then ``r``
    at one temperature and ``1/r`` at the other.

    Args:
        lubricant: The oil.
        cold: Target at ``cold_degc``, motor side. [N m s/rad]
        hot: Target at ``hot_degc``, motor side. [N m s/rad]
        cold_degc: Gear temperature. [degC]
        hot_degc: Gear temperature. [degC]

    Returns:
        viscous_40, motor side. [N m s/rad]
    """
    factor = lubricant.friction_factor(np.array([cold_degc, hot_degc]))
    return float(np.sqrt(cold * hot / (factor[0] * factor[1])))


def kr16_profile() -> PlantProfile:
    """Return a plant of the KR 16 class: 16 kg payload, 1.61 m reach.

    Its drag as a controller's torque trace shows it, friction and iron together, is near
    the class profile (Coulomb 0.50 to 0.14 N m, viscous 7.5 to 1.6e-3 N m s/rad at 20
    degC and 2.4 to 0.5e-3 at 60 degC). The two targets per axis meet one free scale; the
    oils leave a residual of about 2 % on A1 to A3 and 8 % on A4 to A6.
    """
    class_coulomb = np.array([0.50, 0.53, 0.43, 0.14, 0.14, 0.15])
    class_cold = np.array([7.5, 10.0, 8.7, 2.2, 2.2, 1.6]) * 1e-3
    class_hot = np.array([2.4, 3.2, 2.8, 0.70, 0.70, 0.50]) * 1e-3
    hysteresis = np.array([0.04, 0.04, 0.03, 0.010, 0.010, 0.010])
    eddy = np.array([2.0, 2.0, 1.5, 0.5, 0.5, 0.4]) * 1e-4
    oils = (VG150_MINERAL,) * 3 + (VG220_SYNTHETIC,) * 3
    viscous = np.array(
        [
            calibrated_viscous(oil, cold - iron, hot - iron)
            for oil, cold, hot, iron in zip(oils, class_cold, class_hot, eddy, strict=True)
        ]
    )
    return PlantProfile(
        body="kr16",
        lubricant=oils,
        coulomb=0.80 * class_coulomb - hysteresis,
        load_coulomb=np.full(6, 0.03),
        stribeck=0.20 * class_coulomb,
        stribeck_velocity=np.full(6, 15.0),
        viscous_40=viscous,
        torque_constant=np.array([1.1, 1.1, 1.1, 0.7, 0.7, 0.7]),
        torque_constant_fall=np.full(6, 0.0011),
        resistance=np.array([0.8, 0.8, 1.2, 4.0, 4.0, 4.0]),
        resistance_rise=np.full(6, 0.0039),
        hysteresis_torque=hysteresis,
        eddy_viscous=eddy,
        inverter_linear=np.full(6, 2.5),
        inverter_square=np.full(6, 0.05),
        motor_capacity=np.array([5.5, 5.0, 4.0, 1.0, 1.0, 1.0]) * 1e3,
        gear_capacity=np.array([21.6, 15.0, 14.6, 4.3, 2.2, 2.2]) * 1e3,
        motor_conductance=np.array([10.0, 10.0, 8.0, 3.0, 3.0, 3.0]),
        gear_conductance=np.array([4.0, 2.8, 2.7, 1.2, 0.6, 0.6]),
        friction_to_motor=np.full(6, 0.1),
        acceleration=np.array([10.9, 8.0, 20.0, 90.0, 88.0, 120.0]),
        supply=SupplyProfile(
            loss_dc=90.0,
            loss_grid=250.0,
            rectifier_efficiency=0.985,
            capacitance=1.5e-3,
            rectified_voltage=566.0,
            chopper_on_voltage=700.0,
            chopper_off_voltage=680.0,
            brake_resistance=30.0,
        ),
    )
