"""What a model file holds: what is modelled, and how its figures are known."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar, cast, get_args

from robot_energy.model import RobotModel
from robot_energy.model.figure import Tag
from robot_energy.physics.plausibility import implausible
from robot_energy.physics.rigid_body import Robot
from robot_energy.results.base import Result

TAGS: tuple[str, ...] = get_args(Tag)


@dataclass(frozen=True)
class ModelUsed(Result):
    """The model behind a result.

    Attributes:
        model_id: Of its content.
        source: File, or name of a shipped model.
        robot: Type.
        serial: Of the robot; None if it has none.
        drive: Drive model.
        fallback_temperature_degc: Taken where no motor temperature is known. [degC]
        figures: Count of its figures by how they are known.
        change: What was changed about it, such as fixed friction; None for nothing.
        notes: Of its provenance.
    """

    model_id: str
    source: str
    robot: str
    serial: str | None
    drive: str
    fallback_temperature_degc: float
    figures: dict[str, int]
    change: str | None
    notes: str | None


@dataclass(frozen=True)
class JointOfModel(Result):
    """One joint of a model file, motor side.

    Attributes:
        name: Of the joint.
        gear_ratio: Motor turns per joint turn. [-]
        rotor_inertia: [kg m^2]
        coulomb: Coulomb friction. [N m]
        viscous_law: Kind of the law of viscous friction.
        fitted_degc: Temperatures of its fit, shape (2,); None for any. [degC]
    """

    name: str
    gear_ratio: float
    rotor_inertia: float
    coulomb: float
    viscous_law: str
    fitted_degc: tuple[float, float] | None


@dataclass(frozen=True)
class ModelReport(ModelUsed):
    """What a model file holds.

    Attributes:
        description: Of the robot.
        joints: In model order.
        locked_joints: Joints of the URDF that are held.
        inventory: Joints and links of the URDF, one sentence each.
        coupling: Motors that turn with another joint.
        moving_mass: Payload included. [kg]
        payload_mass: [kg]
        loss_dc: Constant loss on the DC side. [W]
        loss_grid: Constant loss on the grid side. [W]
        regenerates: Whether braking energy returns to the grid.
        capacitor: Whether the DC-link capacitor is modelled.
        stale_after: Age from which a temperature counts as unknown. [s]
        remarks: What contradicts the rest, as figures in wrong units do, one sentence each.
    """

    NAME: ClassVar[str] = "model"

    description: str | None
    joints: tuple[JointOfModel, ...]
    locked_joints: tuple[str, ...]
    inventory: tuple[str, ...]
    coupling: tuple[str, ...]
    moving_mass: float
    payload_mass: float
    loss_dc: float
    loss_grid: float
    regenerates: bool
    capacitor: bool
    stale_after: float
    remarks: tuple[str, ...]


def count_tags(model: RobotModel) -> dict[str, int]:
    """Count the figures of a model by how they are known.

    Every tagged number counts once, a table or map once as a whole, and every group of
    the URDF (kinematics, masses ...) once.

    Args:
        model: The model.

    Returns:
        Count for each tag, zeros included.
    """
    counts: Counter[str] = Counter(model.urdf.tags.values())
    _count(model.model_dump(exclude={"urdf"}, exclude_none=True), counts)
    return {tag: counts[tag] for tag in TAGS}


def _count(value: object, counts: Counter[str]) -> None:
    if isinstance(value, dict):
        entries = cast("dict[str, object]", value)
        tag = entries.get("tag")
        if isinstance(tag, str):
            counts[tag] += 1
        for entry in entries.values():
            _count(entry, counts)
    elif isinstance(value, list | tuple):
        for entry in cast("Iterable[object]", value):
            _count(entry, counts)


def model_used(model: RobotModel, change: str | None = None) -> ModelUsed:
    """Return what a result says of its model.

    Args:
        model: The model.
        change: What was changed about it.
    """
    return ModelUsed(
        model_id=model.model_id,
        source=model.source,
        robot=model.robot.type,
        serial=model.robot.serial or None,
        drive=model.drive,
        fallback_temperature_degc=model.temperature.fallback_degc,
        figures=count_tags(model),
        change=change,
        notes=model.provenance.notes or None,
    )


def model_report(model: RobotModel, robot: Robot) -> ModelReport:
    """Return what a model holds.

    Args:
        model: The model.
        robot: Its rigid bodies, which were built from it.
    """
    cabinet = model.cabinet
    return ModelReport(
        **vars(model_used(model)),
        description=model.robot.description or None,
        joints=tuple(
            JointOfModel(
                joint.name,
                joint.gear_ratio.value,
                joint.rotor_inertia.value,
                joint.friction.coulomb.value,
                joint.friction.viscous.law,
                _range(joint.friction.viscous),
            )
            for joint in model.joints
        ),
        locked_joints=tuple(robot.inventory.locked_joints),
        inventory=tuple(robot.inventory.sentences()),
        coupling=tuple(f"{entry.motor} turns with {entry.joint}" for entry in model.coupling),
        moving_mass=robot.moving_mass,
        payload_mass=sum(body.mass for body in model.payload),
        loss_dc=cabinet.loss_dc.value,
        loss_grid=cabinet.loss_grid.value,
        regenerates=cabinet.regeneration_efficiency is not None,
        capacitor=cabinet.capacitor is not None,
        stale_after=model.temperature.stale_after,
        remarks=tuple(implausible(model, robot)),
    )


def _range(law: object) -> tuple[float, float] | None:
    fitted = getattr(law, "fitted_degc", None) or getattr(law, "motor_temperature_degc", None)
    return None if fitted is None else (float(fitted[0]), float(fitted[-1]))
