"""What a model file says about itself: what is modelled, and how its figures are known."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any, cast, get_args

from robot_energy.model import RobotModel
from robot_energy.model.figure import Tag
from robot_energy.physics.rigid_body import Robot

TAGS: tuple[str, ...] = get_args(Tag)


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


def summarise_model(model: RobotModel, robot: Robot) -> dict[str, Any]:
    """Return what a model holds as plain values.

    Args:
        model: The model.
        robot: Its rigid bodies, which were built from it.

    Returns:
        Plain values for JSON; SI units, others with a suffix.
    """
    cabinet = model.cabinet
    return {
        "model_id": model.model_id,
        "source": model.source,
        "robot": model.robot.type,
        "serial": model.robot.serial or None,
        "description": model.robot.description or None,
        "joints": [
            {
                "name": joint.name,
                "gear_ratio": joint.gear_ratio.value,
                "rotor_inertia": joint.rotor_inertia.value,
                "coulomb": joint.friction.coulomb.value,
                "viscous_law": joint.friction.viscous.law,
                "fitted_degc": _range(joint.friction.viscous),
            }
            for joint in model.joints
        ],
        "locked_joints": list(robot.inventory.locked_joints),
        "inventory": robot.inventory.sentences(),
        "coupling": [f"{entry.motor} turns with {entry.joint}" for entry in model.coupling],
        "moving_mass": robot.moving_mass,
        "payload_mass": sum(body.mass for body in model.payload),
        "drive": model.drive,
        "loss_dc": cabinet.loss_dc.value,
        "loss_grid": cabinet.loss_grid.value,
        "regenerates": cabinet.regeneration_efficiency is not None,
        "capacitor": cabinet.capacitor is not None,
        "fallback_temperature_degc": model.temperature.fallback_degc,
        "stale_after": model.temperature.stale_after,
        "figures": count_tags(model),
        "notes": model.provenance.notes or None,
    }


def _range(law: object) -> list[float] | None:
    fitted = getattr(law, "fitted_degc", None) or getattr(law, "motor_temperature_degc", None)
    return None if fitted is None else [float(fitted[0]), float(fitted[-1])]
