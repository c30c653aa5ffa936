"""What a model file holds: what is modelled, and how its figures are known."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, cast, get_args

from robot_energy.model import RobotModel
from robot_energy.model.figure import Tag
from robot_energy.physics.plausibility import implausible
from robot_energy.physics.rigid_body import Robot
from robot_energy.results.base import Result, Texts

TAGS: tuple[str, ...] = get_args(Tag)


class ModelUsed(Result):
    """The model behind a result."""

    model_id: Annotated[str, "Hash of its content."]
    source: Annotated[str, "File, or name of a shipped model."]
    robot: Annotated[str, "Type of the robot."]
    serial: Annotated[str | None, "Serial of the robot; None if the model file states none."]
    drive: Annotated[str, "Drive model."]
    fallback_temperature_degc: Annotated[float, "Taken where no motor temperature is known. [degC]"]
    figures: Annotated[dict[str, int], "Count of its figures by how they are known."]
    change: Annotated[
        str | None, "What was changed about it, such as fixed friction; None for nothing."
    ]
    notes: Annotated[str | None, "Notes of its provenance."]


class JointOfModel(Result):
    """One joint of a model file, motor side."""

    name: Annotated[str, "Name of the joint."]
    gear_ratio: Annotated[float, "Motor turns per joint turn. [-]"]
    rotor_inertia: Annotated[float, "[kg m^2]"]
    coulomb: Annotated[float, "Coulomb friction. [N m]"]
    viscous_law: Annotated[str, "Kind of the law of viscous friction."]
    fitted_degc: Annotated[
        tuple[float, float] | None, "Temperatures of its fit, shape (2,); None for any. [degC]"
    ]


class ModelReport(ModelUsed, name="model"):
    """What a model file holds."""

    description: Annotated[str | None, "Description of the robot."]
    joints: Annotated[tuple[JointOfModel, ...], "Joints in model order."]
    locked_joints: Annotated[Texts, "Joints of the URDF that are held."]
    inventory: Annotated[Texts, "Joints and links of the URDF, one sentence each."]
    coupling: Annotated[Texts, "Motors that turn with another joint."]
    moving_mass: Annotated[float, "Moving mass, payload included. [kg]"]
    payload_mass: Annotated[float, "[kg]"]
    loss_dc: Annotated[float, "Constant loss on the DC side. [W]"]
    loss_grid: Annotated[float, "Constant loss on the grid side. [W]"]
    regenerates: Annotated[bool, "Whether braking energy returns to the grid."]
    capacitor: Annotated[bool, "Whether the DC-link capacitor is modelled."]
    fan: Annotated[bool, "Whether a fan of the cabinet is modelled."]
    stale_after: Annotated[float, "Age from which a temperature counts as unknown. [s]"]
    remarks: Annotated[
        Texts, "What contradicts the rest, as figures in wrong units do, one sentence each."
    ]


def count_tags(model: RobotModel) -> dict[str, int]:
    """Return how many figures of a model have each tag, zeros included.

    Every tagged number counts once, a table or map once as a whole, and every group of
    the URDF (kinematics, masses ...) once.
    """
    entries = tagged_entries(model.model_dump(exclude={"urdf"}, exclude_none=True))
    counts = Counter([*model.urdf.tags.values(), *(entry["tag"] for entry in entries)])
    return {tag: counts[tag] for tag in TAGS}


def tagged_entries(value: object) -> Iterator[Mapping[str, Any]]:
    """Yield every entry of a model that says by a ``tag`` how it is known."""
    if isinstance(value, Mapping):
        entries = cast("Mapping[str, Any]", value)
        if isinstance(entries.get("tag"), str):
            yield entries
        value = list(entries.values())
    if isinstance(value, list | tuple):
        for entry in cast("Sequence[object]", value):
            yield from tagged_entries(entry)


def model_used(model: RobotModel, change: str | None = None) -> ModelUsed:
    """Return what a result says of its model."""
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
    """Return what a model holds."""
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
        fan=cabinet.fan is not None,
        stale_after=model.temperature.stale_after,
        remarks=tuple(implausible(model, robot)),
    )


def _range(law: object) -> tuple[float, float] | None:
    fitted = getattr(law, "fitted_degc", None) or getattr(law, "motor_temperature_degc", None)
    return None if fitted is None else (float(fitted[0]), float(fitted[-1]))
