"""Read, validate and write model files."""

from __future__ import annotations

import os
from importlib import resources
from pathlib import Path
from typing import Any, Union, cast

import yaml
from pydantic.fields import FieldInfo

from robot_energy.foundation.config_file import parse_yaml, read_text, validated
from robot_energy.foundation.errors import ModelFileError, UrdfAwaitedError
from robot_energy.foundation.files.output_files import COMMENT, TEXT, write_file
from robot_energy.foundation.files.regular_file import xml_encoding
from robot_energy.foundation.schema_errors import forget_schemas
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.model.friction_laws import FRICTION_LAWS
from robot_energy.model.joint import Joint, JointFriction
from robot_energy.model.schema import SCHEMA_VERSION, RobotModel


def validate(data: object, source: str, urdf_xml: str | None = None) -> RobotModel:
    """Return plain values as a model, with its URDF attached.

    Args:
        source: Its name, for messages; a relative URDF path starts at its folder.

    Raises:
        ModelFileError: Naming the key, what was found and what was expected.
        UrdfAwaitedError: If the file leaves its URDF to a topic and none is given.
    """
    table = cast("dict[str, object]", data if isinstance(data, dict) else {})
    version = table.get("schema_version")
    if isinstance(version, int) and version != SCHEMA_VERSION:
        raise ModelFileError(
            f"{source} has schema_version {version!r}",
            f"{SCHEMA_VERSION}",
            "use the release that wrote the file, or write it again",
        )
    model = validated(cast("object", data), RobotModel, source)
    if urdf_xml is None:
        if model.urdf.topic is not None:
            raise UrdfAwaitedError(source, model.urdf.topic)
        urdf_xml = model.urdf.xml
    if urdf_xml is None:
        urdf_xml = read_text(
            Path(source).parent / str(model.urdf.path),
            ModelFileError,
            f"URDF of {source}",
            expected="a URDF file next to the model file",
            remedy="correct urdf.path or embed the text as urdf.xml",
            encoding_of=xml_encoding,
        )
    return model.with_urdf(urdf_xml, source)


def shipped_models() -> dict[str, Path]:
    """Return the models that come with the library, by short name."""
    folder = Path(str(resources.files("robot_energy") / "models"))
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def load(name: str | Path, urdf_xml: str | None = None) -> RobotModel:
    """Return the validated model of a file, or a shipped model by its short name.

    Args:
        name: Path of a YAML file, or a name such as ``kr16``.
        urdf_xml: URDF text that replaces the one named in the file.

    Raises:
        ModelFileError: If there is no such file, or it is not a valid model.
        UrdfAwaitedError: If the file leaves its URDF to a topic and none is given.
    """
    path = Path(name)
    if not os.path.isfile(path) and str(name) in shipped_models():
        path = shipped_models()[str(name)]
    text = read_text(
        path,
        ModelFileError,
        "model file",
        expected="a YAML file or the name of a shipped model",
        remedy=f"shipped models: {', '.join(shipped_models())}",
    )
    if text.lstrip().startswith("<"):
        raise ModelFileError(
            f"{path} is XML, as of a URDF",
            "a model file",
            "begin one from it with `robot-energy model init`",
        )
    return validate(parse_yaml(text, str(path)), str(path), urdf_xml)


class _Row(list[float]):
    """Numbers that stand side by side."""


class _Dumper(yaml.SafeDumper):
    """As `yaml.SafeDumper`, with rows in one line."""


_Dumper.add_representer(
    _Row,
    lambda dumper, row: dumper.represent_sequence("tag:yaml.org,2002:seq", row, flow_style=True),
)


def save(model: RobotModel, path: str | Path) -> None:
    """Write a model file that `load_model` reads back equal, with its URDF embedded.

    Args:
        model: The model.
        path: File to write; a model file of this tool is replaced whole or not at all.

    Raises:
        ModelFileError: If the file cannot be written.
    """
    data = model.model_dump(exclude_none=True, exclude_defaults=False, mode="json")
    data["urdf"] = {
        **model.urdf.model_dump(exclude={"path", "xml", "topic"}),
        "xml": model.urdf_xml,
    }
    if "covariance" in data:  # a row of many numbers is a line
        data["covariance"]["matrix"] = [_Row(row) for row in data["covariance"]["matrix"]]
    text = COMMENT + yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True)
    encoded = text.encode("utf-8", "backslashreplace")
    write_file(path, encoded, TEXT, "the model file", ModelFileError)


OWN_KEYS = frozenset(Joint.model_fields)  # declared in the class
OWN_LATE = Joint.LATE


def follow_tables() -> None:
    """Let model files hold the entries of every kind that the tables have now."""
    fields = Joint.model_fields
    for key in [key for key in fields if key not in OWN_KEYS]:
        del fields[key]
    for kind in DRIVE_MODELS.values():
        if kind.key and kind.key not in OWN_KEYS:
            annotation: Any = kind.entry | None if kind.entry is not None else None
            fields[kind.key] = FieldInfo(annotation=annotation, default=None)
    Joint.LATE = (*OWN_LATE, *(k.key for k in DRIVE_MODELS.values() if not k.in_identity))
    laws: Any = Union[tuple(kind.entry for kind in FRICTION_LAWS.values())]  # noqa: UP007 (made of a table)
    JointFriction.model_fields["viscous"] = FieldInfo(annotation=laws, discriminator="law")
    for model in (JointFriction, Joint, RobotModel):
        model.model_rebuild(force=True)
    forget_schemas()


DRIVE_MODELS.on_change(follow_tables)
FRICTION_LAWS.on_change(follow_tables)
