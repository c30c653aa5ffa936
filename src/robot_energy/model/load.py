"""Read, validate and write model files.

A wrong file is refused with the path of the bad key, what was found and what was
expected.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import cast

import yaml
from pydantic import ValidationError

from robot_energy.errors import ModelFileError, UrdfAwaitedError
from robot_energy.model_file.schema import SCHEMA_VERSION, RobotModel, Urdf
from robot_energy.yaml_text import MAX_BYTES, parse_yaml


def _describe(error: ValidationError, source: str) -> ModelFileError:
    """Turn pydantic's report into one sentence about the first bad key."""
    first = error.errors()[0]
    skip = {"constant", "exponential", "table"}
    path = ".".join(str(part) for part in first["loc"] if part not in skip) or "the file"
    found = first.get("input")
    shown = f"{found!r}" if isinstance(found, str | int | float | None) else type(found).__name__
    kind = first["type"]
    more = len(error.errors()) - 1
    tail = f" ({more} more)" if more else ""
    if kind == "missing":
        return ModelFileError(f"{source}: key '{path}' is missing{tail}")
    if kind == "extra_forbidden":
        return ModelFileError(
            f"{source}: key '{path}' is unknown{tail}", "a key of the schema", "check its spelling"
        )
    text = first["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    return ModelFileError(f"{source}: key '{path}' is {shown}{tail}", text)


def validate(data: object, source: str, urdf_xml: str | None = None) -> RobotModel:
    """Validate plain values as a model.

    Args:
        data: What `parse_yaml` returned.
        source: Its name, for messages; a relative URDF path starts at its folder.
        urdf_xml: URDF text that replaces the one named in the file.

    Returns:
        The model with its URDF attached.

    Raises:
        ModelFileError: Naming the key, what was found and what was expected.
        UrdfAwaitedError: If the file leaves its URDF to a topic and none is given.
    """
    if not isinstance(data, dict):
        raise ModelFileError(
            f"{source} holds {type(data).__name__}",
            "a mapping with schema_version, robot, urdf, joints, cabinet, temperature",
        )
    table = cast("dict[str, object]", data)
    version = table.get("schema_version")
    if version != SCHEMA_VERSION:
        raise ModelFileError(
            f"{source} has schema_version {version!r}",
            f"{SCHEMA_VERSION}",
            "use the release that wrote the file, or write it anew",
        )
    try:
        model = RobotModel.model_validate(table)
    except ValidationError as error:
        raise _describe(error, source) from error
    if urdf_xml is None:
        urdf_xml = _read_urdf(model.urdf, source)
    return model.with_urdf(urdf_xml, source)


def _read_urdf(urdf: Urdf, source: str) -> str:
    if urdf.xml is not None:
        return urdf.xml
    if urdf.topic is not None:
        raise UrdfAwaitedError(source, urdf.topic)
    path = Path(source).parent / str(urdf.path)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ModelFileError(f"{path} has over {MAX_BYTES} bytes", "a URDF without meshes")
        if not path.is_file():  # a pipe would be waited for
            raise OSError
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ModelFileError(
            f"{source}: urdf.path '{urdf.path}' cannot be read",
            "a URDF file beside the model file",
            "correct the path or embed the text as urdf.xml",
        ) from error


def shipped_models() -> dict[str, Path]:
    """Return the models that come with the library, by short name."""
    folder = Path(str(resources.files("robot_energy") / "models"))
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def load(name: str | Path, urdf_xml: str | None = None) -> RobotModel:
    """Load a model file, or a shipped model by its short name.

    Args:
        name: Path of a YAML file, or a name such as ``kr16``.
        urdf_xml: URDF text that replaces the one named in the file.

    Returns:
        The validated model.

    Raises:
        ModelFileError: If there is no such file, or it is not a valid model.
        UrdfAwaitedError: If the file leaves its URDF to a topic and none is given.
    """
    path = Path(name)
    if not path.is_file() and str(name) in shipped_models():
        path = shipped_models()[str(name)]
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ModelFileError(f"{path} has over {MAX_BYTES} bytes", "a model file")
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        known = ", ".join(shipped_models())
        raise ModelFileError(
            f"no model file can be read at '{name}'",
            "a YAML file or the name of a shipped model",
            f"shipped models: {known}",
        ) from error
    return validate(parse_yaml(text, str(path)), str(path), urdf_xml)


def save(model: RobotModel, path: str | Path) -> None:
    """Write a model file that `load` reads back equal, with its URDF embedded.

    Args:
        model: The model.
        path: File to write; it is replaced whole or not at all.

    Raises:
        ModelFileError: If the file cannot be written.
    """
    data = model.model_dump(exclude_none=True, exclude_defaults=False, mode="json")
    data["urdf"] = {
        **model.urdf.model_dump(exclude={"path", "xml", "topic"}),
        "xml": model.urdf_xml,
    }
    target = Path(path)
    draft = target.with_suffix(target.suffix + ".part")
    try:
        draft.write_text(yaml.safe_dump(data, sort_keys=False, allow_unicode=True), "utf-8")
        draft.replace(target)
    except OSError as error:
        raise ModelFileError(
            f"the model cannot be written to '{path}': {error.strerror}", "a writable folder"
        ) from error
