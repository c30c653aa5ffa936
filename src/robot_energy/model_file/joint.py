"""Entries of one joint in a model file: gears, rotor, friction, drive. Motor side."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from robot_energy.model_file.figure import Entry, Figure, Number, PositiveFigure, Tag


def without_absent(entries: dict[str, Any], key: str) -> dict[str, Any]:
    """Leave out a key that came later than the files that lack it, where it says nothing."""
    return {name: value for name, value in entries.items() if name != key or value is not None}


class ConstantLaw(Entry):
    """Viscous friction that does not know temperature.

    Attributes:
        viscous: fv, motor side. [N m s/rad]
    """

    law: Literal["constant"]
    viscous: PositiveFigure


class ExponentialLaw(Entry):
    """fv(T) = a + b exp(-T/c), T in degC, motor side (paper A, section III).

    Attributes:
        a: Hot limit. [N m s/rad]
        b: Amplitude at 0 degC. [N m s/rad]
        c: Temperature scale. [K]
        fitted_degc: Range of temperatures behind the fit; outside, the edge is held.
        std: Greatest standard deviation of fv(T) in that range, where identification gave
            one; those of a, b and c alone do not tell it, since they go together. [N m s/rad]
    """

    law: Literal["exponential"]
    a: PositiveFigure
    b: PositiveFigure
    c: Annotated[PositiveFigure, Field()]
    fitted_degc: tuple[Number, Number]
    std: Annotated[float, Field(ge=0)] | None = None

    @model_validator(mode="after")
    def _check(self) -> ExponentialLaw:
        if self.c.value <= 0:
            raise ValueError(f"c must be > 0 K, found {self.c.value}")
        if not self.fitted_degc[0] < self.fitted_degc[1]:
            raise ValueError(f"fitted_degc must rise, found {list(self.fitted_degc)}")
        return self

    @model_serializer(mode="wrap")
    def _dump(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out an absent deviation: a model without one keeps its identity."""
        return without_absent(dump(self), "std")


class TableLaw(Entry):
    """fv at identified temperatures, "saved directly" in paper A; monotone between them.

    Attributes:
        motor_temperature_degc: Strictly rising, at least two. [degC]
        viscous: Same length, motor side. [N m s/rad]
        std: Standard deviations, same length. [N m s/rad]
        tag: How the points are known.
        source: Where they come from.
    """

    law: Literal["table"]
    motor_temperature_degc: Annotated[list[Number], Field(min_length=2)]
    viscous: Annotated[list[Annotated[Number, Field(ge=0)]], Field(min_length=2)]
    std: list[Annotated[float, Field(ge=0)]] | None = None
    tag: Tag
    source: str = ""

    @model_validator(mode="after")
    def _check(self) -> TableLaw:
        temperature = self.motor_temperature_degc
        if len(temperature) != len(self.viscous):
            raise ValueError(
                f"{len(temperature)} temperatures but {len(self.viscous)} viscous values"
            )
        if any(a >= b for a, b in pairwise(temperature)):
            raise ValueError("motor_temperature_degc must rise strictly")
        if self.std is not None and len(self.std) != len(self.viscous):
            raise ValueError(f"{len(self.viscous)} viscous values but {len(self.std)} std")
        return self


class Stribeck(Entry):
    """Extra Coulomb torque near standstill, ``torque * exp(-(|w|/velocity)^exponent)``.

    Attributes:
        torque: At zero velocity, motor side. [N m]
        velocity: Motor side. [rad/s]
        exponent: Without unit.
    """

    torque: PositiveFigure
    velocity: PositiveFigure
    exponent: Annotated[Number, Field(gt=0)] = 2.0


class JointFriction(Entry):
    """Friction of one axis, motor side (paper A, eq. 3 and 8).

    Attributes:
        coulomb: fc, independent of temperature. [N m]
        viscous: The law for fv(T).
        smooth_velocity: w0 of the smooth sign ``tanh(w/w0)``; absent: the plain sign. [rad/s]
        stribeck: Optional Stribeck term.
        load_coulomb: Optional Coulomb torque per rigid motor torque. [-]
    """

    coulomb: PositiveFigure
    viscous: Annotated[ConstantLaw | ExponentialLaw | TableLaw, Field(discriminator="law")]
    smooth_velocity: PositiveFigure | None = None
    stribeck: Stribeck | None = None
    load_coulomb: PositiveFigure | None = None


class LossDrive(Entry):
    """P_el = P_mech + c0 + c1 |w| + c2 w^2 + copper (1 + alpha (T - 20)) tau^2, motor side.

    Attributes:
        constant: c0. [W]
        linear: c1. [W s/rad]
        quadratic: c2. [W s^2/rad^2]
        copper: Copper loss per squared motor torque with windings at 20 degC. [W/(N m)^2]
        copper_temperature_coefficient: alpha. [1/K]
    """

    constant: PositiveFigure
    linear: PositiveFigure
    quadratic: PositiveFigure
    copper: PositiveFigure
    copper_temperature_coefficient: PositiveFigure = PositiveFigure(
        value=0.0039, tag="assumed", source="copper, usual textbook figure"
    )


class EfficiencyMap(Entry):
    """Reduced efficiency map of one drive (paper B, section 6): points in four quadrants.

    Attributes:
        motor_velocity: Speeds of the points. [rad/s]
        motor_torque: Torques of the points. [N m]
        efficiency: P_mech / P_el at the points, not 0; above 1 in the generating
            quadrants. [-]
        reach: Standardised distance to the nearest point beyond which the result is
            flagged as extrapolated. [-]
    """

    motor_velocity: Annotated[list[Number], Field(min_length=1)]
    motor_torque: Annotated[list[Number], Field(min_length=1)]
    efficiency: Annotated[list[Number], Field(min_length=1)]
    reach: Annotated[Number, Field(gt=0)] = 0.5
    tag: Tag
    source: str = ""

    @model_validator(mode="after")
    def _check(self) -> EfficiencyMap:
        lengths = {len(self.motor_velocity), len(self.motor_torque), len(self.efficiency)}
        if len(lengths) != 1:
            raise ValueError("motor_velocity, motor_torque and efficiency differ in length")
        if any(abs(value) < 1e-3 for value in self.efficiency):
            raise ValueError("an efficiency of 0 gives no finite electrical power")
        return self


class Joint(Entry):
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
        losses: For the drive model ``loss_model``.
        efficiency_map: For the drive model ``efficiency_map``.
    """

    name: Annotated[str, Field(min_length=1)]
    gear_ratio: Figure
    rotor_inertia: PositiveFigure
    torque_constant: Figure | None = None
    standstill_velocity: Annotated[Number, Field(gt=0)] = 2e-3
    friction: JointFriction
    losses: LossDrive | None = None
    efficiency_map: EfficiencyMap | None = None

    @model_validator(mode="after")
    def _check(self) -> Joint:
        if self.gear_ratio.value == 0:
            raise ValueError("gear_ratio must not be 0")
        if self.torque_constant is not None and self.torque_constant.value == 0:
            raise ValueError("torque_constant must not be 0")
        return self

    @model_serializer(mode="wrap")
    def _dump(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out an absent torque constant: a model without one keeps its identity."""
        return without_absent(dump(self), "torque_constant")
