"""The model behind a result, and how its figures are known."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, cast, get_args

from robot_energy.model import RobotModel
from robot_energy.model.figure import Tag
from robot_energy.results.base import Result

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
