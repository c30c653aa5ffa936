"""JSON Schema of the results, made from their dataclasses; and results read back from JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import fields
from enum import StrEnum
from pathlib import Path
from types import GenericAlias
from typing import Any, cast

from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from robot_energy.foundation.described import texts_of
from robot_energy.foundation.errors import ReportError
from robot_energy.foundation.files.regular_file import read_regular
from robot_energy.foundation.shown_text import shown
from robot_energy.model import RobotModel
from robot_energy.results.base import SCHEMA_VERSION, Result, json_value
from robot_energy.results.replay import ReplayReport
from robot_energy_fleet.results.advice import AdviceReport
from robot_energy_fleet.results.fleet import FleetFriction, FleetReport, FleetRunReport
from robot_energy_identify.auxiliary import LoadStatesReport
from robot_energy_identify.cabinet.supply import CabinetReport
from robot_energy_identify.check.finding import CheckReport
from robot_energy_identify.drives.all_drives import DrivesReport
from robot_energy_identify.dynamics.dynamics import DynamicsReport
from robot_energy_identify.excitation.excitation import ExcitationReport
from robot_energy_identify.friction.temperature_study import FrictionStudyReport
from robot_energy_identify.friction_and_thermal import FrictionReport, ThermalReport
from robot_energy_identify.results.evaluation import EvaluationReport
from robot_energy_identify.results.identification import (
    IdentificationReport,
)
from robot_energy_plan.results.optimization import OptimizationReport
from robot_energy_plan.results.prediction import PredictionsReport
from robot_energy_plan.results.shared_bus import SharedBusReport
from robot_energy_report.model import ModelReport

RESULTS: dict[str, type[Result]] = {
    kind.NAME: kind
    for kind in (
        ReplayReport,
        PredictionsReport,
        OptimizationReport,
        SharedBusReport,
        AdviceReport,
        FrictionReport,
        FrictionStudyReport,
        ThermalReport,
        CabinetReport,
        LoadStatesReport,
        DrivesReport,
        DynamicsReport,
        ExcitationReport,
        IdentificationReport,
        ModelReport,
        CheckReport,
        EvaluationReport,
        FleetRunReport,
        FleetReport,
        FleetFriction,
    )
}
READABLE = (ReplayReport, PredictionsReport)  # that a page is made from
MAX_JSON_BYTES = 100_000_000
REFERENCE = re.compile(r'"#/\$defs/(\w+)"')
LOOSE = ConfigDict(arbitrary_types_allowed=True)  # arrays


def schema_of(name: str | None = None) -> dict[str, Any]:
    """Return the JSON Schema of one result, or of all in one."""
    if name is None:
        return _document(f"results of robot-energy, version {SCHEMA_VERSION}", RESULTS.values())
    if name not in RESULTS:
        raise ReportError(f"there is no result '{shown(name)}'", f"one of {', '.join(RESULTS)}")
    return _document(f"robot-energy {name}, version {SCHEMA_VERSION}", [RESULTS[name]])


def _document(title: str, kinds: Iterable[type[Result]]) -> dict[str, Any]:
    wanted: list[Any] = [
        (kind, "serialization", TypeAdapter(cast("Any", GenericAlias(list, kind)), config=LOOSE))
        for kind in kinds
    ]
    found, rest = TypeAdapter.json_schemas(wanted, schema_generator=_Generator)
    choices: list[dict[str, Any]] = []
    for (kind, _), schema in found.items():
        result = cast("type[Result]", kind)
        header = {
            "result": {"const": result.NAME},
            "schema_version": {"const": SCHEMA_VERSION},
            "tool_version": {"type": "string"},
        }
        choices.append({**schema["items"], "properties": header, "required": list(header)})
    needed: set[str] = set()  # what is hidden behind a result has definitions too
    queue = REFERENCE.findall(json.dumps(choices))
    while queue:
        name = queue.pop()
        if name not in needed:
            needed.add(name)
            queue += REFERENCE.findall(json.dumps(rest["$defs"][name]))
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": title,
        "oneOf": choices,
        "$defs": {name: rest["$defs"][name] for name in sorted(needed)},
    }


class _Generator(GenerateJsonSchema):
    """Schema of what `json_value` makes of values, with the words of the docstrings."""

    def encode_default(self, dft: Any) -> Any:
        return json_value(dft)

    def float_schema(self, schema: core_schema.FloatSchema) -> JsonSchemaValue:
        return {"type": ["number", "null"]}  # null: not known

    def is_instance_schema(self, schema: core_schema.IsInstanceSchema) -> JsonSchemaValue:
        return {"type": "array"}

    def enum_schema(self, schema: core_schema.EnumSchema) -> JsonSchemaValue:
        names = [str(e) if isinstance(e, StrEnum) else e.name.lower() for e in schema["members"]]
        return {"enum": names}

    def model_schema(self, schema: core_schema.ModelSchema) -> JsonSchemaValue:
        if schema["cls"] is RobotModel:
            return {"type": "string", "description": "model_id"}
        return {"type": "object", "description": "as in a model file"}

    def dataclass_schema(self, schema: core_schema.DataclassSchema) -> JsonSchemaValue:
        kind = cast("Any", schema["cls"])
        described = texts_of(kind)
        shown_fields = {entry.name for entry in fields(kind) if entry.repr}
        arguments = cast("core_schema.DataclassArgsSchema", schema["schema"])
        properties = {
            entry["name"]: {
                **self.generate_inner(entry["schema"]),
                "description": described.get(entry["name"], ""),
            }
            for entry in arguments["fields"]
            if entry["name"] in shown_fields
        }
        return {
            "type": "object",
            "description": (kind.__doc__ or "").partition("\n")[0],
            "properties": properties,
            "required": list(properties),
        }


def read_result(path: str | Path) -> ReplayReport | PredictionsReport:
    """Return a result of a command from its JSON."""
    place = f"'{shown(str(path))}'"
    try:
        data = json.loads(read_regular(path, MAX_JSON_BYTES))
    except OSError as error:
        raise ReportError(
            f"{place} cannot be read ({error.strerror})", "JSON of replay or predict"
        ) from error
    except (ValueError, RecursionError) as error:
        raise ReportError(f"{place} is no JSON", "JSON of replay or predict") from error
    known = {kind.NAME: kind for kind in READABLE}
    given = cast("dict[str, Any]", data) if isinstance(data, dict) else {}
    kind = known.get(str(given.get("result")))
    if kind is None or given.get("schema_version") != SCHEMA_VERSION:
        found = f"result {given.get('result')!r}, schema_version {given.get('schema_version')!r}"
        raise ReportError(
            f"{place} holds {shown(found)}",
            f"result {' or '.join(known)}, schema_version {SCHEMA_VERSION}",
            "write it again with --json",
        )
    try:
        return TypeAdapter(kind).validate_python(given)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise ReportError(
            f"{place}: {shown(where)} is wrong ({first['msg']})", "its schema"
        ) from None
