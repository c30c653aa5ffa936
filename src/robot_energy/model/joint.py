"""Entries of one joint in a model file: gears, rotor, friction, drive; motor side.

Counterbalances are joint side. Each has a potential energy U(q), so it takes nothing over a
closed path, and the drive adds ``dU/dq``.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from robot_energy.model.drive_models import EfficiencyMap, LossDrive, LossMap
from robot_energy.model.figure import (
    AboveZero,
    Figure,
    LateEntry,
    ModelEntry,
    Number,
    PositiveFigure,
)
from robot_energy.model.friction_laws import LawEntry

MAX_FALL = 0.005  # 1/K of a torque constant: magnets of ferrite lose 0.002


class Stribeck(ModelEntry):
    """Extra Coulomb torque near standstill, ``torque * exp(-(|w|/velocity)^exponent)``."""

    torque: Annotated[PositiveFigure, "At zero velocity, motor side. [N m]"]
    velocity: Annotated[PositiveFigure, "Motor side. [rad/s]"]
    exponent: Annotated[Number, Field(gt=0), "Without unit."] = 2.0


class ViscousExponent(ModelEntry):
    """Viscous friction by a power of speed, ``fv(T) velocity sgn(w) (|w|/velocity)^exponent``."""

    exponent: Annotated[AboveZero, "Less than 1 where friction grows ever more slowly; > 0. [-]"]
    velocity: Annotated[
        AboveZero, "At which the exponent changes nothing, > 0, motor side. [rad/s]"
    ]


class JointFriction(LateEntry):
    """Friction of one axis, motor side (paper A, eq. 3 and 8)."""

    LATE = ("load_saturation", "viscous_exponent")

    coulomb: Annotated[PositiveFigure, "fc, independent of temperature. [N m]"]
    # One of the table of friction laws, see `robot_energy.model.load`.
    viscous: Annotated[LawEntry, "The law for fv(T)."]
    smooth_velocity: Annotated[
        PositiveFigure | None,
        "w0 of the smooth sign ``tanh(w/w0)``; absent: the plain sign. [rad/s]",
    ] = None
    stribeck: Annotated[Stribeck | None, "Optional Stribeck term."] = None
    load_coulomb: Annotated[
        PositiveFigure | None, "Optional Coulomb torque per rigid motor torque. [-]"
    ] = None
    load_saturation: Annotated[
        PositiveFigure | None,
        "Rigid motor torque beyond which that rises no further; absent: none. [N m]",
    ] = None
    viscous_exponent: Annotated[
        ViscousExponent | None,
        "Optional power of the speed in viscous friction; absent: the first.",
    ] = None


class JointThermal(ModelEntry):
    """Thermal network of one motor: motor - structure - ambient, or motor - ambient.

    ``C_m dT_m/dt = P_m - G_m (T_m - T_s)`` and
    ``C_s dT_s/dt = P_s + G_m (T_m - T_s) - G_s (T_s - T_a)`` with the heat
    ``P_m = drive loss + share * friction power + idle`` and ``P_s`` the rest of the friction power;
    without structure ``T_s`` is the ambient.
    """

    capacity: Annotated[AboveZero, "C_m, heat capacity of the motor, > 0. [J/K]"]
    conductance: Annotated[
        AboveZero, "G_m, from the motor to the structure, or to the ambient without it. [W/K]"
    ]
    structure_capacity: Annotated[
        AboveZero | None, "C_s, of gear and links around the motor, > 0. [J/K]"
    ] = None
    structure_conductance: Annotated[
        AboveZero | None, "G_s, from the structure to the ambient. [W/K]"
    ] = None
    friction_to_motor: Annotated[
        PositiveFigure | None,
        "Share of the friction power that heats the motor; without structure all of it does. At "
        "most 1. [-]",
    ] = None
    idle: Annotated[
        PositiveFigure | None,
        "Heat of the motor while samples come, beyond its losses: brakes, electronics. [W]",
    ] = None
    std: Annotated[
        Annotated[float, Field(ge=0)] | None,
        "Error (RMS) of the temperature of a free run on recordings that the fit has not seen. [K]",
    ] = None

    @model_validator(mode="after")
    def _check(self) -> JointThermal:
        if (self.structure_capacity is None) != (self.structure_conductance is None):
            raise ValueError("structure_capacity and structure_conductance: both or neither")
        if self.friction_to_motor is not None and self.structure_capacity is None:
            raise ValueError("friction_to_motor needs a structure that takes the rest")
        if self.friction_to_motor is not None and self.friction_to_motor.value > 1.0:
            raise ValueError(f"friction_to_motor <= 1, found {self.friction_to_motor.value}")
        return self


class JointGear(LateEntry):
    """Temperature of one gear, which its friction then follows instead of that of the motor.

    ``C dT_g/dt = P_f - G_m (T_g - T_m) - G_a (T_g - T_a)`` with the friction power P_f, the
    temperature T_m of the motor, measured or estimated, and T_a of the air.
    """

    LATE = ("ambient_offset",)

    capacity: Annotated[AboveZero, "C, heat capacity of gear and oil, > 0. [J/K]"]
    motor_conductance: Annotated[PositiveFigure, "G_m, from the gear to the motor. [W/K]"]
    ambient_conductance: Annotated[
        PositiveFigure, "G_a, from the gear to the air; not both 0. [W/K]"
    ]
    std: Annotated[
        Annotated[float, Field(ge=0)] | None,
        "Standard deviation of the temperature that the figures leave open once the start is "
        "forgotten. [K]",
    ] = None
    ambient_offset: Annotated[
        Number | None,
        "What the thermometer of the motor shows above ``ambient_degc`` while the joint is as warm "
        "as the air; absent: 0. [K]",
    ] = None

    @model_validator(mode="after")
    def _check(self) -> JointGear:
        if not self.motor_conductance.value + self.ambient_conductance.value > 0.0:
            raise ValueError("motor_conductance and ambient_conductance are both 0")
        return self


class TorsionSpring(ModelEntry):
    """A spring about the axis of a joint: the drive adds ``stiffness (q - rest)``."""

    kind: Annotated[Literal["spring"], "``spring``."]
    stiffness: Annotated[PositiveFigure, "k. [N m/rad] or [N/m]"]
    rest: Annotated[Figure, "q0, position of the joint at which the spring is slack. [rad] or [m]"]


class LeverSpring(ModelEntry):
    """A tension spring on a lever, its force proportional to its length.

    The drive adds ``moment cos(q - angle)``. A weight has the same form; a spring that carries
    one has the opposite angle. With a stiffness k between two points at distances a and b from
    the axis the moment is k a b.
    """

    kind: Annotated[Literal["lever"], "``lever``."]
    moment: Annotated[PositiveFigure, "Greatest torque. [N m]"]
    angle: Annotated[
        Figure, "Position of the joint at which the drive adds the whole moment. [rad]"
    ]


class GasSpring(ModelEntry):
    """A gas spring between the link before a joint and the one behind it.

    Its length is ``l = sqrt(a^2 + b^2 - 2 a b cos(q - angle))``; it pushes its ends apart with
    ``F = force + rate (length - l)``, so the drive adds ``-F dl/dq`` with ``dl/dq = (a b / l)
    sin(q - angle)``.
    """

    kind: Annotated[Literal["gas_spring"], "``gas_spring``."]
    a: Annotated[AboveZero, "Distance of its fixed end from the axis. [m]"]
    b: Annotated[AboveZero, "Distance of its moved end from the axis. [m]"]
    angle: Annotated[
        Figure,
        "Position of the joint at which both ends lie on one side of the axis, in line with it: "
        "the gas spring is shortest there. [rad]",
    ]
    force: Annotated[PositiveFigure, "F at `length`. [N]"]
    rate: Annotated[PositiveFigure, "Rise of F per length that the gas is pressed together. [N/m]"]
    length: Annotated[PositiveFigure, "Length that `force` is stated for, usually extended. [m]"]

    @model_validator(mode="after")
    def _check(self) -> GasSpring:
        if self.a.value == self.b.value:
            raise ValueError("a and b must differ, or the spring can have no length")
        return self


Counterbalance = Annotated[TorsionSpring | LeverSpring | GasSpring, Field(discriminator="kind")]


class Joint(LateEntry):
    """One modelled joint and its drive, in the order of the file."""

    LATE = ("torque_constant", "torque_constant_fall", "counterbalance", "thermal", "gear")

    name: Annotated[str, Field(min_length=1), "As in the URDF and in the joint states."]
    gear_ratio: Annotated[
        Figure,
        "Motor turns per joint turn; its sign is the sense. For a prismatic joint: motor radians "
        "per metre.",
    ]
    rotor_inertia: Annotated[PositiveFigure, "Rotor and fast gear parts, motor side. [kg m^2]"]
    torque_constant: Annotated[
        Figure | None,
        "Motor torque per ampere that the driver reports as effort; only the effort "
        "``motor_current`` needs it. Negative where a positive current turns the motor backward. "
        "[N m/A]",
    ] = None
    torque_constant_fall: Annotated[
        PositiveFigure | None,
        "beta: share of the torque constant that is lost per kelvin of the motor above 20 degC, as "
        "warm magnets are weaker. A torque known by its current is multiplied by ``1 - beta (T - "
        "20)``; copper losses follow the torque over that. At most 0.005; absent: none. [1/K]",
    ] = None
    standstill_velocity: Annotated[
        Number,
        Field(gt=0),
        "Joint speed below which the joint counts as standing. [rad/s] or [m/s]",
    ] = 2e-3
    friction: Annotated[JointFriction, "Friction of this axis."]
    counterbalance: Annotated[
        Counterbalance | None, "Spring or gas spring that carries part of the weight at this joint."
    ] = None
    thermal: Annotated[
        JointThermal | None,
        "Thermal network of the motor, for its temperature where no sensor measures it.",
    ] = None
    gear: Annotated[
        JointGear | None,
        "Temperature of the gear; absent: friction follows the motor temperature, less surely "
        "where other joints have one.",
    ] = None
    losses: Annotated[LossDrive | None, "For the drive model ``loss_model``."] = None
    efficiency_map: Annotated[EfficiencyMap | None, "For the drive model ``efficiency_map``."] = (
        None
    )
    loss_map: Annotated[
        LossMap | None,
        "For the drive model ``loss_map``. Drive models that are registered add their keys, see "
        "`robot_energy.model.load`.",
    ] = None

    @model_validator(mode="after")
    def _check(self) -> Joint:
        if self.gear_ratio.value == 0:
            raise ValueError("gear_ratio must not be 0")
        if self.torque_constant is not None and self.torque_constant.value == 0:
            raise ValueError("torque_constant must not be 0")
        fall = self.torque_constant_fall
        if fall is not None and fall.value > MAX_FALL:
            raise ValueError(f"torque_constant_fall <= {MAX_FALL:g} 1/K, found {fall.value:g}")
        return self
