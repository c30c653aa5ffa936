"""Entries of one joint in a model file: gears, rotor, friction, drive. Motor side."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from robot_energy.model.counterbalance import Counterbalance
from robot_energy.model.drive_models import DRIVE_MODELS, EfficiencyMap, LossDrive, LossMap
from robot_energy.model.figure import Figure, ModelEntry, Number, PositiveFigure, without_absent
from robot_energy.model.friction_laws import LawEntry


class Stribeck(ModelEntry):
    """Extra Coulomb torque near standstill, ``torque * exp(-(|w|/velocity)^exponent)``."""

    torque: Annotated[PositiveFigure, "At zero velocity, motor side. [N m]"]
    velocity: Annotated[PositiveFigure, "Motor side. [rad/s]"]
    exponent: Annotated[Number, Field(gt=0), "Without unit."] = 2.0


class ViscousExponent(ModelEntry):
    """Viscous friction by a power of speed, ``fv(T) velocity sgn(w) (|w|/velocity)^exponent``."""

    exponent: Annotated[
        PositiveFigure, "Less than 1 where friction grows ever more slowly; > 0. [-]"
    ]
    velocity: Annotated[
        PositiveFigure, "At which the exponent changes nothing, > 0, motor side. [rad/s]"
    ]

    @model_validator(mode="after")
    def _check(self) -> ViscousExponent:
        for key in ("exponent", "velocity"):
            if not getattr(self, key).value > 0.0:
                raise ValueError(f"{key} must be > 0, found {getattr(self, key).value}")
        return self


class JointFriction(ModelEntry):
    """Friction of one axis, motor side (paper A, eq. 3 and 8)."""

    coulomb: Annotated[PositiveFigure, "fc, independent of temperature. [N m]"]
    # One of the table of friction laws, see `robot_energy.model.open_schema`.
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

    @model_serializer(mode="wrap")
    def _dump(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out a key that came later, as `Joint` does."""
        return without_absent(dump(self), "load_saturation", "viscous_exponent")


class JointThermal(ModelEntry):
    """Thermal network of one motor: motor - structure - ambient, or motor - ambient.

    ``C_m dT_m/dt = P_m - G_m (T_m - T_s)`` and
    ``C_s dT_s/dt = P_s + G_m (T_m - T_s) - G_s (T_s - T_a)`` with the heat
    ``P_m = drive loss + share * friction power + idle`` and ``P_s`` the rest of the friction power;
    without structure ``T_s`` is the ambient.
    """

    capacity: Annotated[PositiveFigure, "C_m, heat capacity of the motor, > 0. [J/K]"]
    conductance: Annotated[
        PositiveFigure, "G_m, from the motor to the structure, or to the ambient without it. [W/K]"
    ]
    structure_capacity: Annotated[
        PositiveFigure | None, "C_s, of gear and links around the motor, > 0. [J/K]"
    ] = None
    structure_conductance: Annotated[
        PositiveFigure | None, "G_s, from the structure to the ambient. [W/K]"
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
        above = ("capacity", "conductance", "structure_capacity", "structure_conductance")
        for key in above:
            figure = getattr(self, key)
            if figure is not None and not figure.value > 0.0:
                raise ValueError(f"{key} must be > 0, found {figure.value}")
        return self


class JointGear(ModelEntry):
    """Temperature of one gear, which its friction then follows instead of that of the motor.

    ``C dT_g/dt = P_f - G_m (T_g - T_m) - G_a (T_g - T_a)`` with the friction power P_f, the
    temperature T_m of the motor, measured or estimated, and T_a of the air.
    """

    capacity: Annotated[PositiveFigure, "C, heat capacity of gear and oil, > 0. [J/K]"]
    motor_conductance: Annotated[PositiveFigure, "G_m, from the gear to the motor. [W/K]"]
    ambient_conductance: Annotated[
        PositiveFigure, "G_a, from the gear to the air; not both 0. [W/K]"
    ]
    std: Annotated[
        Annotated[float, Field(ge=0)] | None,
        "Standard deviation of the temperature that the figures leave open once the start is "
        "forgotten. [K]",
    ] = None

    @model_validator(mode="after")
    def _check(self) -> JointGear:
        if not self.capacity.value > 0.0:
            raise ValueError(f"capacity must be > 0, found {self.capacity.value}")
        if not self.motor_conductance.value + self.ambient_conductance.value > 0.0:
            raise ValueError("motor_conductance and ambient_conductance are both 0")
        return self


class Joint(ModelEntry):
    """One modelled joint and its drive, in the order of the file."""

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
        "`robot_energy.model.open_schema`.",
    ] = None

    @model_validator(mode="after")
    def _check(self) -> Joint:
        if self.gear_ratio.value == 0:
            raise ValueError("gear_ratio must not be 0")
        if self.torque_constant is not None and self.torque_constant.value == 0:
            raise ValueError("torque_constant must not be 0")
        return self

    @model_serializer(mode="wrap")
    def _dump(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out absent keys that came later: a model without them keeps its identity."""
        late = [kind.key for kind in DRIVE_MODELS.values() if not kind.in_identity]
        optional = ("torque_constant", "counterbalance", "thermal", "gear")
        return without_absent(dump(self), *optional, *late)
