"""Schema of a model file: what one robot's model holds, validated by pydantic.

Every figure carries a tag that says how it is known, so that a
published number is never taken for an assumed one. Motor side unless the name says ``joint_``.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Mapping
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    Field,
    PrivateAttr,
    model_validator,
)
from pydantic_core import PydanticCustomError

from robot_energy.foundation.described import documented
from robot_energy.foundation.shown import Shown
from robot_energy.model.auxiliary import MAX_LOADS, AuxiliaryLoad
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.model.figure import (
    Figure,
    LateEntry,
    ModelEntry,
    Number,
    PositiveFigure,
    Tag,
)
from robot_energy.model.joint import Joint
from robot_energy.model.payload import Payload
from robot_energy.timeline.blocks import MeterLocation

SCHEMA_VERSION = 1
LATE = ("auxiliary", "meter", "hold", "covariance")  # keys that count in an identity where present


class Coupling(ModelEntry):
    """A wrist coupling: ``motor_velocity[motor] += ratio * joint_velocity[joint]``."""

    motor: Annotated[str, "Joint name whose motor turns along."]
    joint: Annotated[str, "Joint name that makes it turn."]
    ratio: Annotated[Figure, "Motor turns per turn of that joint. [-]"]


class Capacitor(ModelEntry):
    """DC-link capacitor that takes energy between nominal and chopper voltage."""

    capacitance: Annotated[PositiveFigure, "[F]"]
    nominal_voltage: Annotated[PositiveFigure, "Rectified mains. [V]"]
    chopper_voltage: Annotated[PositiveFigure, "Where the brake resistor starts. [V]"]

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


class CabinetFan(LateEntry):
    """A fan on the grid side that the temperature of the warmest motor switches."""

    LATE = ("begins_off_to_degc", "thermometers")

    power: Annotated[PositiveFigure, "While it runs. [W]"]
    on_above_degc: Annotated[
        Figure,
        "It starts when the warmest motor is warmer. Within its deviation the fan counts by the "
        "probability that it runs. [degC]",
    ]
    hysteresis: Annotated[
        PositiveFigure | None,
        "It stops that much below; between the two it stays as it was. Absent: 0. [K]",
    ] = None
    begins_off_to_degc: Annotated[
        Figure | None,
        "Up to this first temperature of the warmest motor it does not run, as recordings that "
        "began there show. Absent: of the fans between stop and start half run at first. [degC]",
    ] = None
    thermometers: Annotated[
        tuple[Number, ...] | None,
        "What the thermometer of each motor shows above the mean of all while they are equally "
        "warm. The warmest motor is that of the highest reading less this. Absent: 0. [K]",
    ] = None


class Cabinet(LateEntry):
    """Supply and constant losses (paper A, section II-A)."""

    LATE = ("fan",)

    loss_grid: Annotated[PositiveFigure, "P_l,grid. [W]"]
    loss_dc: Annotated[PositiveFigure, "P_l,DC. [W]"]
    regeneration_efficiency: Annotated[
        PositiveFigure | None,
        "Share of excess bus power returned to the grid; absent: the supply cannot regenerate. [-]",
    ] = None
    capacitor: Annotated[Capacitor | None, "Optional DC-link capacitor."] = None
    fan: Annotated[CabinetFan | None, "Optional fan, in addition to the constant losses."] = None

    @model_validator(mode="after")
    def _check(self) -> Cabinet:
        if self.regeneration_efficiency is not None and self.regeneration_efficiency.value > 1:
            raise ValueError("regeneration_efficiency must be at most 1")
        return self


class Meter(ModelEntry):
    """How late the power meter shows what is drawn; a counter of energy has neither figure."""

    time_constant: Annotated[
        PositiveFigure | None,
        "T of a low pass in the meter, ``T dy/dt = p - y``; absent: none. [s]",
    ] = None
    delay: Annotated[
        PositiveFigure | None, "Of its readings behind the power; absent: none. [s]"
    ] = None


class Hold(LateEntry):
    """What motors hold at rest in addition to the load, as shares of their static friction.

    ``tau = tau_r - carried sgn(tau_r) min(fs, |tau_r|) + kept fs d`` with the rigid torque tau_r,
    the static friction ``fs = static (fc + load min(|tau_r|, taus))`` and the direction d of the
    last motion, motor side.
    """

    LATE = ("static",)

    kept: Annotated[Figure, "Share that stays in the direction of the last motion, -1 to 1. [-]"]
    carried: Annotated[
        Figure,
        "Share by which friction carries the load; less than 0 where motors hold more than it, -1 "
        "to 1. [-]",
    ]
    static: Annotated[
        tuple[Annotated[Number, Field(ge=0)], ...] | None,
        "Static friction of each joint over its Coulomb torque under the load; absent: 1. [-]",
    ] = None
    std: Annotated[
        float,
        Field(ge=0),
        "Standard deviation of the torque at one place, over the Coulomb torque under the load. "
        "[-]",
    ]

    @model_validator(mode="after")
    def _check(self) -> Hold:
        for key in ("kept", "carried"):
            value = getattr(self, key).value
            if not abs(value) <= 1.0:
                raise ValueError(f"{key} must lie between -1 and 1, found {value}")
        return self


LOSS_TERMS = ("copper", "linear", "quadratic")  # of the losses of one drive
FRICTION_TERMS = ("coulomb", "viscous")  # of the friction of one joint


class Covariance(ModelEntry):
    """Errors of losses and friction that one meter showed: sums known better than their parts.

    Bands take the deviations of these figures from here, and not from the figures' own ``std``.
    """

    figures: Annotated[
        tuple[str, ...],
        Field(min_length=1),
        "``loss_dc``, ``loss_grid``, or a term and its joint, such as ``copper of joint_1``, "
        "``coulomb of joint_1``; motor side. The error of ``viscous of joint_1`` is in standard "
        "deviations of its law, at every temperature.",
    ]
    matrix: Annotated[
        tuple[tuple[Number, ...], ...],
        "Products of their errors, one row for each figure, in the units of both figures.",
    ]
    source: Annotated[str, "Where they come from."] = ""

    def of(self, names: Collection[str]) -> Covariance | None:
        """Return that of some figures, None without any of them."""
        kept = [place for place, name in enumerate(self.figures) if name in names]
        if not kept:
            return None
        rows = tuple(tuple(self.matrix[row][column] for column in kept) for row in kept)
        figures = tuple(self.figures[place] for place in kept)
        return self.model_copy(update={"figures": figures, "matrix": rows})

    @model_validator(mode="after")
    def _check(self) -> Covariance:
        size = len(self.figures)
        if len(set(self.figures)) < size:
            raise ValueError("each figure once")
        if [len(row) for row in self.matrix] != [size] * size:
            raise ValueError(f"matrix must have {size} rows of {size} numbers")
        for place, row in enumerate(self.matrix):
            for other, value in enumerate(row[:place]):
                limit = math.sqrt(max(row[place], 0.0) * max(self.matrix[other][other], 0.0))
                if value != self.matrix[other][place] or not abs(value) <= limit * (1.0 + 1e-6):
                    raise ValueError(
                        f"matrix is not a covariance of {self.figures[other]} and "
                        f"{self.figures[place]}"
                    )
            if row[place] < 0.0:
                raise ValueError(f"the variance of {self.figures[place]} is negative")
        return self


class TemperatureSettings(LateEntry):
    """What to assume where no temperature is known."""

    LATE = ("ambient_degc",)

    fallback_degc: Annotated[
        Number,
        Field(ge=-40, le=150),
        "Reference temperature used before the first and after a stale reading, -40 to 150. [degC]",
    ]
    stale_after: Annotated[Number, Field(gt=0), "Age at which a reading is not used. [s]"] = 60.0
    ambient_degc: Annotated[
        Figure | None,
        "Temperature of the air around the robot, for motors with a thermal network; its "
        "deviation in K, 3 without one. Absent: the fallback temperature. [degC]",
    ] = None


class RobotType(ModelEntry):
    """Which machine the model is for."""

    type: Annotated[str, Field(min_length=1), "Manufacturer and type, for tables and state files."]
    serial: Annotated[
        str, "Distinguishes robots of one type; registers belong to type and serial."
    ] = ""
    description: Annotated[str, "A line for tables."] = ""


class Urdf(ModelEntry):
    """Where kinematics and inertias come from: a file next to the model, text, or a topic."""

    path: Annotated[str | None, "Relative to the model file."] = None
    xml: Annotated[str | None, "The URDF itself."] = None
    topic: Annotated[
        Annotated[str, Field(min_length=1)] | None,
        "Name of the topic on which the robot publishes it, such as ``robot_description``; read "
        "by the nodes, not by a replay.",
    ] = None
    tags: Annotated[
        dict[str, Tag],
        "How kinematics, inertias ... are known, by group; ``torque`` is of bodies and payload "
        "together, as ``identify dynamics`` finds it.",
    ] = Field(default_factory=dict)
    source: Annotated[str, "Where they come from."] = ""

    @model_validator(mode="after")
    def _check(self) -> Urdf:
        if [self.path, self.xml, self.topic].count(None) != 2:
            raise ValueError("give one of path, xml and topic")
        return self


class Provenance(ModelEntry):
    """Where the file comes from."""

    tool_version: Annotated[str, "Release that wrote it."] = ""
    data_date: Annotated[str, "When the recordings behind identified figures were made."] = ""
    bags: Annotated[tuple[str, ...], "Names and hashes of these recordings."] = ()
    notes: Annotated[
        str, "What a reader should know, shown by every command that uses the model."
    ] = ""


def _known_drive(name: str) -> str:
    if name not in DRIVE_MODELS:
        wanted = {"wanted": DRIVE_MODELS.expected, "remedy": DRIVE_MODELS.remedy(name)}
        raise PydanticCustomError("unknown_kind", "{wanted}", wanted)
    return name


@documented
class RobotModel(ModelEntry, Shown):
    """One robot's model file, validated."""

    schema_version: Annotated[Literal[1], "Version of this schema."]
    robot: Annotated[RobotType, "Which machine it is."]
    urdf: Annotated[Urdf, "Kinematics and inertias."]
    gravity: Annotated[
        tuple[Number, Number, Number],
        "In the base frame; it states a mounting on wall or ceiling. [m/s^2]",
    ] = (0.0, 0.0, -9.80665)
    massless_links: Annotated[
        tuple[str, ...],
        "Links that may move without inertia, on purpose (for example a wrist whose mass is "
        "lumped into its neighbour).",
    ] = ()
    joints: Annotated[
        list[Joint],
        Field(min_length=1),
        "The modelled joints, in the order of every table and array.",
    ]
    coupling: Annotated[
        tuple[Coupling, ...], "Wrist couplings, where one joint turns the motor of another."
    ] = ()
    payload: Annotated[
        tuple[Payload, ...],
        "Bodies that the robot carries; the nodes can change them while they run.",
    ] = ()
    drive: Annotated[
        str,
        AfterValidator(_known_drive),
        "Which drive model turns shaft power into electrical power.",
    ] = "ideal"
    cabinet: Annotated[Cabinet, "Supply and constant losses."]
    temperature: Annotated[TemperatureSettings, "What to assume without a motor temperature."]
    provenance: Annotated[Provenance, "Where the file comes from."] = Provenance()
    auxiliary: Annotated[
        Annotated[tuple[AuxiliaryLoad, ...], Field(max_length=MAX_LOADS)] | None,
        "Loads at the outlet, outside of the cabinet, such as a pump; a replay and a prediction "
        "count them.",
    ] = None
    meter: Annotated[
        Meter | None, "How late the power meter shows what is drawn; absent: the monitor finds it."
    ] = None
    hold: Annotated[
        Hold | None, "What the motors hold at rest in addition to the load; absent: the load alone."
    ] = None
    covariance: Annotated[
        Covariance | None,
        "Of losses and friction behind one meter; absent: their errors are independent.",
    ] = None

    _urdf_xml: str = PrivateAttr(default="")
    _source: str = PrivateAttr(default="<memory>")

    def __repr__(self) -> str:
        return f"RobotModel({self.robot.type!r}, {len(self.joints)} joints, id {self.model_id})"

    @model_validator(mode="after")
    def _check(self) -> RobotModel:
        names = self.joint_names
        if repeated := dict.fromkeys(name for name in names if names.count(name) > 1):
            raise ValueError(f"joint names repeat: {', '.join(repeated)}")
        for entry in self.coupling:
            for name in (entry.motor, entry.joint):
                if name not in names:
                    raise ValueError(f"coupling names the unknown joint '{name}'")
            if entry.motor == entry.joint:
                raise ValueError(f"coupling of '{entry.motor}' with itself; use gear_ratio")
        loads = [load.name for load in self.auxiliary or ()]
        if repeated := dict.fromkeys(name for name in loads if loads.count(name) > 1):
            raise ValueError(f"names of auxiliary loads repeat: {', '.join(repeated)}")
        static = None if self.hold is None else self.hold.static
        if static is not None and len(static) != len(names):
            raise ValueError(f"hold.static has {len(static)} figures for {len(names)} joints")
        off = None if self.cabinet.fan is None else self.cabinet.fan.thermometers
        if off is not None and len(off) != len(names):
            raise ValueError(f"fan.thermometers has {len(off)} figures for {len(names)} joints")
        if self.covariance is not None:
            known = self._figures_together()
            if unknown := [name for name in self.covariance.figures if name not in known]:
                raise ValueError(f"covariance names the unknown figure '{unknown[0]}'")
        kind = DRIVE_MODELS[self.drive]
        for joint in self.joints:
            if kind.entry is not None and kind.of(joint) is None:
                raise ValueError(f"drive is {kind.name} but joint '{joint.name}' has no {kind.key}")
        return self

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the modelled joints, in the order of every array."""
        return tuple(joint.name for joint in self.joints)

    @property
    def unmodelled(self) -> frozenset[str]:
        """Registers of the parts that the model lacks: ``drive_loss``, ``capacitor``, or none."""
        lacking = {
            "drive_loss": DRIVE_MODELS[self.drive].lossless,
            "capacitor": self.cabinet.capacitor is None,
        }
        return frozenset(name for name, lacks in lacking.items() if lacks)

    @property
    def urdf_xml(self) -> str:
        """Text of the URDF."""
        return self._urdf_xml

    @property
    def model_id(self) -> str:
        """Short hash over every figure and the URDF: equal ids give equal watts."""
        late = {name for name in LATE if getattr(self, name) is None}
        digest = hashlib.sha256(self.model_dump_json(exclude={"urdf"} | late).encode())
        digest.update(self._urdf_xml.encode())
        return digest.hexdigest()[:12]

    @property
    def source(self) -> str:
        """File this model was read from."""
        return self._source

    def changed(self, **entries: Any) -> RobotModel:
        """Return a copy with other entries and the same URDF.

        A covariance holds for the figures that it came with: those that change leave it.

        Args:
            entries: Values by the name of the entry, already validated.
        """
        if self.covariance is not None and "covariance" not in entries:
            before, after = self._figures_together(), self.model_copy(update=entries)
            kept = {
                name for name, one in after._figures_together().items() if one == before.get(name)
            }
            entries["covariance"] = self.covariance.of(kept)
        return self.model_copy(update=entries).with_urdf(self._urdf_xml, self._source)

    def with_joints(self, entry: str, found: Mapping[str, object]) -> RobotModel:
        """Return a copy with one entry of some joints changed.

        Args:
            entry: Its name.
            found: Its new values, already validated, by the names of the joints.
        """
        joints = [
            joint.model_copy(update={entry: found[joint.name]}) if joint.name in found else joint
            for joint in self.joints
        ]
        return self.changed(joints=joints)

    def _figures_together(self) -> dict[str, object]:
        """The figures that a covariance may hold, by their names in it."""
        cabinet = self.cabinet
        found: dict[str, object] = {"loss_dc": cabinet.loss_dc, "loss_grid": cabinet.loss_grid}
        for joint in self.joints:
            parts = ((joint.losses, LOSS_TERMS), (joint.friction, FRICTION_TERMS))
            for part, terms in parts:
                found |= {f"{term} of {joint.name}": getattr(part, term, None) for term in terms}
        return found

    def with_urdf(self, xml: str, source: str) -> RobotModel:
        """Return this model with the URDF text attached.

        Args:
            xml: The URDF.
            source: Where the model comes from, for messages; usually its file.
        """
        self._urdf_xml = xml
        self._source = source
        return self

    def constant_power(self, location: MeterLocation = MeterLocation.GRID) -> float:
        """Return the losses that flow all the time: of the cabinet, constants of the drives. [W]

        Args:
            location: Of the meter that sees them; at the DC bus the losses before it do not count.
        """
        kind, cabinet = DRIVE_MODELS[self.drive], self.cabinet
        drives = [kind.constant_loss(entry) for entry in kind.entries(self.joints)]
        constant = cabinet.loss_dc.value + math.fsum(drives)
        at_grid = location is not MeterLocation.DC_BUS
        return constant + (cabinet.loss_grid.value if at_grid else 0.0)
