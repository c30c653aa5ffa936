"""The model file described from its own schema: JSON schema for editors, and a reference page."""

from __future__ import annotations

from typing import Any, cast

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from robot_energy.foundation.described import section_of, texts_of
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.model.friction_laws import FRICTION_LAWS
from robot_energy.model.schema import SCHEMA_VERSION, RobotModel

_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_FIGURE = ("Figure", "PositiveFigure")
_OPENING = """\
# Reference of the model file

One YAML file per robot. Every key of the schema stands here, made from it by
`robot-energy model schema --markdown`; `robot-energy model schema` prints the same as JSON schema
for editors. An unknown key is refused with the nearest known one.

A **figure** is a number with the way it is known:
`{value: 0.5, tag: identified, std: 0.02, source: "..."}`.
"""


def json_schema() -> dict[str, Any]:
    """Return the JSON schema (2020-12) of model files with registered kinds, all keys described."""
    schema = RobotModel.model_json_schema(schema_generator=_Generator)
    schema["properties"]["drive"]["enum"] = list(DRIVE_MODELS)
    return {"$schema": _DIALECT, **schema, "title": f"Model file, version {SCHEMA_VERSION}"}


class _Generator(GenerateJsonSchema):
    def model_schema(self, schema: core_schema.ModelSchema) -> JsonSchemaValue:
        found, kind = super().model_schema(schema), schema["cls"]
        prose = (kind.__doc__ or "").removesuffix(section_of(kind))
        found["description"] = " ".join(prose.split())
        texts = texts_of(kind)
        for key, field in found.get("properties", {}).items():
            field.pop("title", None)
            if "gt" in field:  # as pydantic writes a bound behind a validator of its own
                field["exclusiveMinimum"] = field.pop("gt")
            if key in texts:
                field["description"] = texts[key]
        return found


def reference_page() -> str:
    """Return the reference page of model files in Markdown."""
    schema = json_schema()
    definitions: dict[str, Any] = schema["$defs"]
    order = ["RobotModel", *_reached(schema, definitions)]
    parts = [_OPENING]
    titles = _titles()
    for name in order:
        entry = schema if name == "RobotModel" else definitions[name]
        if entry.get("type") != "object" or name == "PositiveFigure":
            continue
        parts.append(f"\n## {titles.get(name, name)}\n\n{_prose(entry['description'])}\n")
        rows = [
            f"| `{key}` | {_kind(field, titles)} | {_default(key, entry, field)} "
            f"| {_prose(field.get('description', ''))} |"
            for key, field in entry.get("properties", {}).items()
        ]
        if rows:
            parts.append("\n| key | value | default | meaning |\n|---|---|---|---|\n")
            parts.append("\n".join(rows) + "\n")
    return "".join(parts)


def _titles() -> dict[str, str]:
    """Headings that name the key under which an entry stands."""
    titles = {
        "RobotModel": "Top level",
        "RobotType": "`robot`",
        "Urdf": "`urdf`",
        "Payload": "`payload`",
        "Joint": "`joints`",
        "JointFriction": "`friction` of a joint",
        "TorsionSpring": "`counterbalance` with `kind: spring`",
        "LeverSpring": "`counterbalance` with `kind: lever`",
        "GasSpring": "`counterbalance` with `kind: gas_spring`",
        "JointThermal": "`thermal` of a joint",
        "JointGear": "`gear` of a joint",
        "Stribeck": "`stribeck` of the friction",
        "ViscousExponent": "`viscous_exponent` of the friction",
        "Coupling": "`coupling`",
        "Cabinet": "`cabinet`",
        "Capacitor": "`capacitor` of the cabinet",
        "CabinetFan": "`fan` of the cabinet",
        "TemperatureSettings": "`temperature`",
        "Provenance": "`provenance`",
        "Figure": "A figure",
    }
    for law in FRICTION_LAWS.values():
        titles[law.entry.__name__] = f"`viscous` with `law: {law.name}`"
    for drive in DRIVE_MODELS.values():
        if drive.entry is not None:
            titles[drive.entry.__name__] = f"`{drive.key}` of a joint, for `drive: {drive.name}`"
    return titles


def _reached(schema: dict[str, Any], definitions: dict[str, Any]) -> list[str]:
    """Names of the definitions in the order in which a reader meets them; figures last."""
    order: list[str] = []

    def visit(node: Any) -> None:
        if isinstance(node, dict):
            table = cast("dict[str, Any]", node)
            if "$ref" in table:
                name = str(table["$ref"]).rsplit("/", 1)[-1]
                if name not in order:
                    order.append(name)
                    visit(definitions[name])
            for key, value in table.items():
                if key != "$defs":
                    visit(value)
        elif isinstance(node, list):
            for value in cast("list[Any]", node):
                visit(value)

    visit(schema)
    return sorted(order, key=lambda name: name in _FIGURE)


def _kind(field: dict[str, Any], titles: dict[str, str]) -> str:
    if "$ref" in field:
        name = str(field["$ref"]).rsplit("/", 1)[-1]
        return {"Figure": "figure", "PositiveFigure": "figure >= 0"}.get(
            name, titles.get(name, name)
        )
    for union in ("anyOf", "oneOf"):
        if union in field:
            kinds = [_kind(part, titles) for part in field[union] if part.get("type") != "null"]
            return " or ".join(dict.fromkeys(kinds))
    if "const" in field:
        return f"`{field['const']}`"
    if "enum" in field:
        return ", ".join(f"`{value}`" for value in field["enum"])
    if field.get("type") == "array":
        items: dict[str, Any] = field.get("items") or field["prefixItems"][0]
        count = f"{field['maxItems']} x " if "maxItems" in field else "list of "
        return f"{count}{_kind(items, titles)}"
    if field.get("type") == "object":
        return "mapping"
    words = {"string": "text", "number": "number", "integer": "integer", "boolean": "true, false"}
    bounds = [f"> {field['exclusiveMinimum']:g}"] if "exclusiveMinimum" in field else []
    bounds += [f">= {field['minimum']:g}"] if "minimum" in field else []
    return " ".join([words.get(str(field.get("type")), "any"), *bounds])


def _default(key: str, entry: dict[str, Any], field: dict[str, Any]) -> str:
    if key in entry.get("required", ()):
        return "required"
    default: Any = field.get("default")
    if isinstance(default, dict):
        default = cast("dict[str, Any]", default).get("value")
    if default in (None, "", [], {}):
        return "-"
    return f"`{default}`"


def _prose(text: str) -> str:
    """Double backquotes to single ones; a bar would end the cell."""
    return text.replace("``", "`").replace("|", "\\|")
