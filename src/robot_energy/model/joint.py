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
    """Extra Coulomb torque near standstill, ``torque * exp(-(|w|/velocity)^exponent)``.

    Attributes:
        torque: At zero velocity, motor side. [N m]
        velocity: Motor side. [rad/s]
        exponent: Without unit.
    """

    torque: PositiveFigure
    velocity: PositiveFigure
    exponent: Annotated[Number, Field(gt=0)] = 2.0


class ViscousExponent(ModelEntry):
    """Viscous friction by a power of the speed, ``fv(T) velocity sgn(w) (|w|/velocity)^exponent``.

    Attributes:
        exponent: Less than 1 where friction grows ever more slowly; > 0. [-]
        velocity: At which the exponent changes nothing, > 0, motor side. [rad/s]
    """

    exponent: PositiveFigure
    velocity: PositiveFigure

    @model_validator(mode="after")
    def _check(self) -> ViscousExponent:
        for key in ("exponent", "velocity"):
            if not getattr(self, key).value > 0.0:
                raise ValueError(f"{key} must be > 0, found {getattr(self, key).value}")
        return self


class JointFriction(ModelEntry):
    """Friction of one axis, motor side (paper A, eq. 3 and 8).

    Attributes:
        coulomb: fc, independent of temperature. [N m]
        viscous: The law for fv(T).
        smooth_velocity: w0 of the smooth sign ``tanh(w/w0)``; absent: the plain sign. [rad/s]
        stribeck: Optional Stribeck term.
        load_coulomb: Optional Coulomb torque per rigid motor torque. [-]
        load_saturation: Rigid motor torque beyond which that rises no further; absent: none. [N m]
        viscous_exponent: Optional power of the speed in viscous friction; absent: the first.
    """

    coulomb: PositiveFigure
    viscous: LawEntry  # one of the table of friction laws, see `robot_energy.model.open_schema`
    smooth_velocity: PositiveFigure | None = None
    stribeck: Stribeck | None = None
    load_coulomb: PositiveFigure | None = None
    load_saturation: PositiveFigure | None = None
    viscous_exponent: ViscousExponent | None = None

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

    Attributes:
        capacity: C_m, heat capacity of the motor, > 0. [J/K]
        conductance: G_m, from the motor to the structure, or to the ambient without it. [W/K]
        structure_capacity: C_s, of gear and links around the motor, > 0. [J/K]
        structure_conductance: G_s, from the structure to the ambient. [W/K]
        friction_to_motor: Share of the friction power that heats the motor; without structure
            all of it does. At most 1. [-]
        idle: Heat of the motor while samples come, beyond its losses: brakes, electronics. [W]
        std: Error (RMS) of the temperature of a free run on recordings that the fit has not
            seen. [K]
    """

    capacity: PositiveFigure
    conductance: PositiveFigure
    structure_capacity: PositiveFigure | None = None
    structure_conductance: PositiveFigure | None = None
    friction_to_motor: PositiveFigure | None = None
    idle: PositiveFigure | None = None
    std: Annotated[float, Field(ge=0)] | None = None

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

    Attributes:
        capacity: C, heat capacity of gear and oil, > 0. [J/K]
        motor_conductance: G_m, from the gear to the motor. [W/K]
        ambient_conductance: G_a, from the gear to the air; not both 0. [W/K]
        std: Standard deviation of the temperature that the figures leave open once the start
            is forgotten. [K]
    """

    capacity: PositiveFigure
    motor_conductance: PositiveFigure
    ambient_conductance: PositiveFigure
    std: Annotated[float, Field(ge=0)] | None = None

    @model_validator(mode="after")
    def _check(self) -> JointGear:
        if not self.capacity.value > 0.0:
            raise ValueError(f"capacity must be > 0, found {self.capacity.value}")
        if not self.motor_conductance.value + self.ambient_conductance.value > 0.0:
            raise ValueError("motor_conductance and ambient_conductance are both 0")
        return self


class Joint(ModelEntry):
    """One modelled joint and its drive, in the order of the file.

    Attributes:
        name: As in the URDF and in the joint states.
        gear_ratio: Motor turns per joint turn; its sign is the sense. For a prismatic
            joint: motor radians per metre.
        rotor_inertia: Rotor and fast gear parts, motor side. [kg m^2]
        torque_constant: Motor torque per ampere that the driver reports as effort; only
            the effort ``motor_current`` needs it. Negative where a positive current turns
            the motor backward. [N m/A]
        standstill_velocity: Joint speed below which the joint counts as standing.
            [rad/s] or [m/s]
        friction: Friction of this axis.
        counterbalance: Spring or gas spring that carries part of the weight at this joint.
        thermal: Thermal network of the motor, for its temperature where no sensor measures it.
        gear: Temperature of the gear; absent: friction follows the motor temperature, less surely
            where other joints have one.
        losses: For the drive model ``loss_model``.
        efficiency_map: For the drive model ``efficiency_map``.
        loss_map: For the drive model ``loss_map``. Drive models that are registered add their
            keys, see `robot_energy.model.open_schema`.
    """

    name: Annotated[str, Field(min_length=1)]
    gear_ratio: Figure
    rotor_inertia: PositiveFigure
    torque_constant: Figure | None = None
    standstill_velocity: Annotated[Number, Field(gt=0)] = 2e-3
    friction: JointFriction
    counterbalance: Counterbalance | None = None
    thermal: JointThermal | None = None
    gear: JointGear | None = None
    losses: LossDrive | None = None
    efficiency_map: EfficiencyMap | None = None
    loss_map: LossMap | None = None

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
