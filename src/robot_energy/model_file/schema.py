"""Schema of a model file: what one robot's model holds, validated by pydantic.

Every figure carries a tag that says how it is known, so that a reader can tell a
published number from an assumed one. Motor side unless the name says ``joint_``.
"""

from __future__ import annotations

import hashlib
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PrivateAttr, model_validator

SCHEMA_VERSION = 1

Tag = Literal["published", "identified", "derived", "assumed"]


def _not_boolean(value: object) -> object:
    if isinstance(value, bool):
        raise ValueError("expected a number, not true/false")
    return value


Number = Annotated[float, BeforeValidator(_not_boolean), Field(allow_inf_nan=False)]


class Entry(BaseModel):
    """Base of all parts: unknown keys are refused, values cannot be changed."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Figure(Entry):
    """One number and how it is known.

    Attributes:
        value: In the unit that the owning key documents.
        tag: How the value is known.
        std: Standard deviation in the same unit, where identification gave one.
        source: Where it comes from, in words.
    """

    value: Number
    tag: Tag
    std: Annotated[float, Field(ge=0)] | None = None
    source: str = ""


class PositiveFigure(Figure):
    """A figure that must be >= 0."""

    value: Annotated[Number, Field(ge=0)]


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
    """

    law: Literal["exponential"]
    a: PositiveFigure
    b: PositiveFigure
    c: Annotated[PositiveFigure, Field()]
    fitted_degc: tuple[Number, Number]

    @model_validator(mode="after")
    def _check(self) -> ExponentialLaw:
        if self.c.value <= 0:
            raise ValueError(f"c must be > 0 K, found {self.c.value}")
        if not self.fitted_degc[0] < self.fitted_degc[1]:
            raise ValueError(f"fitted_degc must rise, found {list(self.fitted_degc)}")
        return self


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
        value=0.0039, tag="published", source="copper"
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
        standstill_velocity: Joint speed below which the joint counts as standing.
            [rad/s] or [m/s]
        friction: Friction of this axis.
        losses: For the drive model ``loss_model``.
        efficiency_map: For the drive model ``efficiency_map``.
    """

    name: Annotated[str, Field(min_length=1)]
    gear_ratio: Figure
    rotor_inertia: PositiveFigure
    standstill_velocity: Annotated[Number, Field(gt=0)] = 2e-3
    friction: JointFriction
    losses: LossDrive | None = None
    efficiency_map: EfficiencyMap | None = None

    @model_validator(mode="after")
    def _check(self) -> Joint:
        if self.gear_ratio.value == 0:
            raise ValueError("gear_ratio must not be 0")
        return self


class Coupling(Entry):
    """A wrist coupling: ``motor_velocity[motor] += ratio * joint_velocity[joint]``.

    Attributes:
        motor: Joint name whose motor turns along.
        joint: Joint name that makes it turn.
        ratio: Motor turns per turn of that joint. [-]
    """

    motor: str
    joint: str
    ratio: Figure


class Payload(Entry):
    """A rigid body fixed to a link.

    Attributes:
        link: Link or frame of the URDF that carries it.
        mass: [kg]
        centre_of_mass: In the frame of ``link``. [m]
        inertia: Ixx, Iyy, Izz, Ixy, Ixz, Iyz about the centre of mass. [kg m^2]
        tag: How these are known.
        source: Where they come from.
    """

    link: str
    mass: Annotated[Number, Field(ge=0)]
    centre_of_mass: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)
    inertia: tuple[Number, Number, Number, Number, Number, Number] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    tag: Tag
    source: str = ""


class Capacitor(Entry):
    """DC-link capacitor that takes energy between nominal and chopper voltage.

    Attributes:
        capacitance: [F]
        nominal_voltage: Rectified mains. [V]
        chopper_voltage: Where the brake resistor starts. [V]
    """

    capacitance: PositiveFigure
    nominal_voltage: PositiveFigure
    chopper_voltage: PositiveFigure

    @model_validator(mode="after")
    def _check(self) -> Capacitor:
        if not self.nominal_voltage.value < self.chopper_voltage.value:
            raise ValueError("chopper_voltage must be above nominal_voltage")
        return self

    @property
    def swing(self) -> float:
        """Energy between the two voltages. [J]"""
        squares = self.chopper_voltage.value**2 - self.nominal_voltage.value**2
        return 0.5 * self.capacitance.value * squares


class Cabinet(Entry):
    """Supply and constant losses (paper A, section II-A).

    Attributes:
        loss_grid: P_l,grid. [W]
        loss_dc: P_l,DC. [W]
        regeneration_efficiency: Share of excess bus power returned to the grid; absent:
            the supply cannot regenerate. [-]
        capacitor: Optional DC-link capacitor.
    """

    loss_grid: PositiveFigure
    loss_dc: PositiveFigure
    regeneration_efficiency: PositiveFigure | None = None
    capacitor: Capacitor | None = None

    @model_validator(mode="after")
    def _check(self) -> Cabinet:
        if self.regeneration_efficiency is not None and self.regeneration_efficiency.value > 1:
            raise ValueError("regeneration_efficiency must be at most 1")
        return self


class Temperature(Entry):
    """What to assume where no temperature is known.

    Attributes:
        fallback_degc: Reference temperature used before the first and after a stale
            reading. [degC]
        stale_after: Age at which a reading is no longer used. [s]
    """

    fallback_degc: Number
    stale_after: Annotated[Number, Field(gt=0)] = 60.0


class RobotType(Entry):
    """Which machine the model is for."""

    type: Annotated[str, Field(min_length=1)]
    serial: str = ""
    description: str = ""


class Urdf(Entry):
    """Where the kinematics and inertias come from: a file beside the model, or text.

    Attributes:
        path: Relative to the model file.
        xml: The URDF itself.
        tags: How kinematics, inertias ... are known, by group.
        source: Where they come from.
    """

    path: str | None = None
    xml: str | None = None
    tags: dict[str, Tag] = {}
    source: str = ""

    @model_validator(mode="after")
    def _check(self) -> Urdf:
        if (self.path is None) == (self.xml is None):
            raise ValueError("give either path or xml")
        return self


class Provenance(Entry):
    """Where the file comes from."""

    tool_version: str = ""
    data_date: str = ""
    bags: list[str] = []
    notes: str = ""


class RobotModel(Entry):
    """One robot's model file, validated.

    Attributes:
        drive: Which drive model turns shaft power into electrical power.
        massless_links: Links that may move without inertia, on purpose (for example a
            wrist whose mass is lumped into its neighbour).
        gravity: In the base frame, so that ceiling mounting can be said. [m/s^2]
    """

    schema_version: Literal[1]
    robot: RobotType
    urdf: Urdf
    gravity: tuple[Number, Number, Number] = (0.0, 0.0, -9.80665)
    massless_links: list[str] = []
    joints: Annotated[list[Joint], Field(min_length=1)]
    coupling: list[Coupling] = []
    payload: list[Payload] = []
    drive: Literal["ideal", "efficiency_map", "loss_model"] = "ideal"
    cabinet: Cabinet
    temperature: Temperature
    provenance: Provenance = Provenance()

    _urdf_xml: str = PrivateAttr(default="")
    _source: str = PrivateAttr(default="<memory>")

    @model_validator(mode="after")
    def _check(self) -> RobotModel:
        names = self.joint_names
        if len(set(names)) != len(names):
            raise ValueError(f"joint names repeat: {list(names)}")
        for entry in self.coupling:
            for name in (entry.motor, entry.joint):
                if name not in names:
                    raise ValueError(f"coupling names the unknown joint '{name}'")
            if entry.motor == entry.joint:
                raise ValueError(f"coupling of '{entry.motor}' with itself; use gear_ratio")
        for joint in self.joints:
            if self.drive == "loss_model" and joint.losses is None:
                raise ValueError(f"drive is loss_model but joint '{joint.name}' has no losses")
            if self.drive == "efficiency_map" and joint.efficiency_map is None:
                raise ValueError(
                    f"drive is efficiency_map but joint '{joint.name}' has no efficiency_map"
                )
        return self

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the modelled joints, in the order of every array."""
        return tuple(joint.name for joint in self.joints)

    @property
    def urdf_xml(self) -> str:
        """Text of the URDF."""
        return self._urdf_xml

    @property
    def model_id(self) -> str:
        """Short hash over every figure and the URDF: equal ids give equal watts."""
        digest = hashlib.sha256(self.model_dump_json(exclude={"urdf"}).encode())
        digest.update(self._urdf_xml.encode())
        return digest.hexdigest()[:12]

    @property
    def source(self) -> str:
        """File this model was read from."""
        return self._source

    def with_urdf(self, xml: str, source: str) -> RobotModel:
        """Return this model with the URDF text attached."""
        self._urdf_xml = xml
        self._source = source
        return self
