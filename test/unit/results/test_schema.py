"""The published schema: every command's JSON fits it, and the shipped file is what code makes."""

import json
import re
import shutil
from dataclasses import fields
from itertools import product

import numpy as np
import pytest

from fleets import dataset
from logbook import wheel_bag, wheel_model, write_csv
from places import ROOT
from robot_energy.foundation.described import texts_of
from robot_energy.foundation.errors import ReportError
from robot_energy.results.base import SCHEMA_VERSION, json_value
from robot_energy.timeline.blocks import EffortMeaning, MeterLocation
from robot_energy_cli.main import main
from robot_energy_cli.result_schema import READABLE, RESULTS, read_result, schema_of
from robot_energy_report.document import Document
from terminal_tables import TERMINALS, lost_figures, recorded_documents

ROWS = Document.rows
SHIPPED = ROOT / "src/doc/results.schema.json"
BAG, MOVES = ROOT / "bags/kr16_cold", ROOT / "src/examples/programs/kr16_pick_and_place.yaml"
CELL = ROOT / "src/examples/auxiliary/mantis_cell.yaml"
FAST = ["--starts", "1", "--iterations", "1", "--harmonics", "2", "--no-floor"]
COMMANDS = {
    "replay": ["replay", BAG, "--model", "kr16", "--effort", "motor_torque"],
    "replay, no meter": ["replay", "wheel", "--model", "wheel.yaml", "--compare", "20"],
    "prediction": ["predict", MOVES, "--model", "kr16", "--temperature", "30", "--payload", "2"],
    "optimization": ["optimize", MOVES, "--model", "kr16", "--temperature", "20..50",
                     "--cycle-time", "60", "--standby", "--regenerative"],
    "shared_bus": ["shared-bus", MOVES, MOVES, "--model", "kr16", "--cycle-time", "40"],
    "advice": ["advise", BAG, "--model", "kr16", "--price", "0.3", "--co2", "0.4"],
    "friction": ["identify", "friction", BAG, "--model", "kr16", "--effort", "motor_torque"],
    "friction_study": ["identify", "friction", "--log", "runs.csv", "--mapping", "runs.yaml",
                       "--train", "40:", "--test", ":35"],
    "thermal": ["identify", "thermal", "--log", "heat.csv", "--mapping", "heat.yaml"],
    "auxiliary": ["identify", "auxiliary", "cell", "--model", CELL],
    "cabinet": ["identify", "cabinet", BAG, "--model", "kr16"],
    "drives": ["identify", "drives", BAG, "--model", "kr16", "--effort", "motor_torque"],
    "dynamics": ["identify", "dynamics", BAG, "--model", "kr16", "--effort", "motor_torque"],
    "excitation": ["identify", "excitation", "--model", "kr16", *FAST, "--out", "motion"],
    "identification": ["identify", "all", BAG, "--model", "kr16", "--no-test", "--skip", "dynamics",
                       "drives", "capacitor"],
    "check": ["check", BAG, "--model", "kr16", "--effort", "motor_torque"],
    "test": ["test", BAG, "--model", "kr16", "--effort", "motor_torque"],
    "model": ["models", "check", "kr16"],
    "fleet_run": ["fleet", "run", "wheel", "--model", "wheel.yaml", "--workers", 0, "--out", "d"],
    "fleet_report": ["fleet", "report", "fleet"],
    "fleet_friction": ["fleet", "identify", "fleet", "--model", "kr16"],
}  # fmt: skip
TYPES = {
    "object": dict, "array": list, "string": str, "boolean": bool, "null": type(None),
    "integer": int, "number": (int, float),
}  # fmt: skip


def runs(folder):
    """A log of one joint that warms up from 20 to 70 degC; its friction falls meanwhile."""
    degc = np.repeat(np.arange(20.0, 71.0, 2.0), 200)
    time = 0.02 * np.arange(len(degc))
    speed = 2.0 * np.sin(2.0 * np.pi * time) + np.sin(2.0 * np.pi * time / 2.7)
    noise = np.random.default_rng(1).normal(0.0, 0.01, len(degc))
    torque = 0.5 * np.sign(speed) + (0.1 + np.exp(-degc / 20.0)) * speed + noise
    write_csv(
        folder / "runs.csv",
        "t,q_axle,w_axle,i_axle,c_axle,run",
        np.column_stack([time, 0.02 * np.cumsum(speed), speed, torque, degc, degc]).tolist(),
    )
    mapping = {
        "schema_version": 1,
        "time": {"column": "t", "unit": "s", "start": "2024-05-06T07:08:09Z", "run": "run"},
        "joints": {
            "names": ["axle"],
            "position": {"column": "q_{joint}", "unit": "rad"},
            "velocity": {"column": "w_{joint}", "unit": "rad_per_s"},
            "effort": {"column": "i_{joint}", "unit": "ampere"},
            "temperature": {"column": "c_{joint}", "unit": "celsius"},
        },
    }
    (folder / "runs.yaml").write_text(json.dumps(mapping))
    # Two hours of a motor of 1000 A^2 s/K and 20 min, at 22 degC, in steps of 10 s.
    time, degc = np.arange(0.0, 7200.0, 10.0), [22.0]
    current = np.where(time % 3000.0 < 1800.0, 5.0, 1.0)
    for heat in current[:-1] ** 2:
        degc.append(degc[-1] + 10.0 * (heat - (degc[-1] - 22.0) / 1.2) / 1000.0)
    rows = np.column_stack([time, 0.0 * time, 0.0 * time, current, degc, 0.0 * time])
    write_csv(folder / "heat.csv", "t,q_axle,w_axle,i_axle,c_axle,run", rows.tolist())
    (folder / "heat.yaml").write_text(json.dumps(mapping))


def misfit(value, schema, definitions, where="$"):
    """Where a value does not fit a schema; empty if it does. The keywords that we use."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        found = misfit(value, definitions[name], definitions, where)
        if found:
            return found
    if "oneOf" in schema or "anyOf" in schema:
        choices = schema.get("oneOf") or schema["anyOf"]
        found = [misfit(value, choice, definitions, where) for choice in choices]
        fitting = found.count("")
        if not fitting or ("oneOf" in schema and fitting != 1):
            return f"{where}: {fitting} choices fit: {found}"
    kinds = schema.get("type", [])
    kinds = [kinds] if isinstance(kinds, str) else kinds
    if kinds and not any(
        isinstance(value, TYPES[kind]) and (kind == "boolean" or not isinstance(value, bool))
        for kind in kinds
    ):
        return f"{where}: {value!r} is not {kinds}"
    if "const" in schema and value != schema["const"]:
        return f"{where}: {value!r}"
    if "enum" in schema and value not in schema["enum"]:
        return f"{where}: {value!r}"
    if isinstance(value, dict):
        parts = schema.get("properties", {})
        missing = set(schema.get("required", ())) - set(value)
        if missing:
            return f"{where}: lacks {sorted(missing)}"
        more = schema.get("additionalProperties", {})
        for key, item in value.items():
            other = more if isinstance(more, dict) else {}
            if found := misfit(item, parts.get(key, other), definitions, f"{where}.{key}"):
                return found
    if isinstance(value, list):
        first = schema.get("prefixItems", [])
        for place, item in enumerate(value):
            own = first[place] if place < len(first) else schema.get("items") or {}
            if found := misfit(item, own, definitions, f"{where}.{place}"):
                return found
    return ""


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    """What most commands read."""
    folder = tmp_path_factory.mktemp("given")
    wheel_bag(folder, power=None).rename(folder / "wheel")
    wheel_model(folder)
    runs(folder)
    return folder


@pytest.fixture(scope="module")
def whole_schema():
    return schema_of()


def checked_rows(document, title, columns, rows, total=""):
    """Add a table of objects whose units are those that the fields state."""
    texts = texts_of(type(rows[0])) if rows else {}
    for column in columns:
        unit = texts.get(column.value, "").partition("[")[2].rstrip("]").replace("] or [", " or ")
        if unit and column.unit:
            assert column.unit == unit or unit == "J" == column.unit[-1], (title, column.name)
    ROWS(document, title, columns, rows, total)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_fits_the_schema_and_the_terminal(
    name, given, whole_schema, tmp_path, monkeypatch, capsys
):
    """Its JSON is as the schema says; no digit of what it prints is lost at usual widths."""
    shutil.copytree(given, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Document, "rows", checked_rows)
    if name.startswith("fleet"):
        dataset(tmp_path / "fleet", 2, faults=False, days=1)
    if name == "auxiliary":
        simulate = ["simulate", "--robot", "mantis", "--auxiliary", "--duration", "40"]
        assert main([*simulate, "--out", "cell"]) == 0
    with recorded_documents() as documents:
        assert main([*map(str, COMMANDS[name]), "--json", "x.json"]) == 0
    assert documents or name in ("check", "fleet_run")  # which print lines without tables
    for document, width, terminal in product(documents, TERMINALS, (True, False)):
        assert not lost_figures(document, width, terminal), (width, terminal)
    data = json.loads((tmp_path / "x.json").read_text())
    own = schema_of(data["result"])
    for schema in (own, whole_schema):
        assert not misfit(data, schema, schema["$defs"])
    keys = list(data)
    assert keys[:4] == ["generator", "result", "schema_version", "tool_version"]
    described = own["$defs"][RESULTS[data["result"]].__name__]["properties"]
    assert set(keys[4:]) == set(described)
    data["schema_version"] += 1
    assert misfit(data, own, own["$defs"])
    data["schema_version"] -= 1
    del data[keys[-1]]
    assert misfit(data, own, own["$defs"])


def test_every_result_has_a_command_above():
    assert {name.partition(",")[0] for name in COMMANDS} == set(RESULTS)


def test_the_shipped_schema_is_what_the_code_makes(capsys):
    assert main(["schema"]) == 0
    assert SHIPPED.read_text() == capsys.readouterr().out, (
        f"robot-energy schema > {SHIPPED.relative_to(ROOT)}"
    )


def test_the_schema_is_json_of_the_standard():
    """Parsers other than Python's refuse NaN and Infinity."""

    def refuse(word):
        raise AssertionError(word)

    json.loads(SHIPPED.read_text(), parse_constant=refuse)


def test_one_result_alone_and_an_unknown_one(capsys):
    assert main(["schema", "replay"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema["oneOf"][0]["properties"]["schema_version"]["const"] == SCHEMA_VERSION
    assert "ReplayReport" in schema["$defs"]
    assert "FrictionFit" not in schema["$defs"]
    assert main(["schema", "nothing"]) == 2


def test_every_field_of_a_result_is_documented(whole_schema):
    found = whole_schema["$defs"]
    lacking = {
        f"{name}.{key}"
        for name, schema in found.items()
        for key, part in schema.get("properties", {}).items()
        if not part.get("description")
    }
    assert not lacking


@pytest.mark.parametrize("name", ["replay", "prediction"])
def test_a_result_is_read_back_as_it_was(name, tmp_path, capsys):
    path = tmp_path / "x.json"
    assert main([*map(str, COMMANDS[name]), "--json", str(path)]) == 0
    result = read_result(path)
    assert isinstance(result, READABLE)
    assert json.loads(path.read_text()) == {"generator": "robot-energy", **result.to_dict()}


@pytest.mark.parametrize(
    "text",
    [
        "", "[]", "{", "null", '{"result": "replay"}',
        f'{{"result": "replay", "schema_version": {SCHEMA_VERSION}}}',
        f'{{"result": "cabinet", "schema_version": {SCHEMA_VERSION}}}',
        '{"result": "replay", "schema_version": 99}', "[" * 100_000,
    ],
)  # fmt: skip
def test_what_is_no_result_is_refused(text, tmp_path, capsys):
    path = tmp_path / "x.json"
    path.write_text(text)
    with pytest.raises(ReportError):
        read_result(path)
    assert main(["report", str(path), "--out", str(tmp_path / "x.html")]) == 2
    assert not (tmp_path / "x.html").exists()


def test_plain_values():
    value = {
        "a": np.array([1.0, np.nan]), "b": (np.int64(3), float("inf")), "c": MeterLocation.DC_BUS,
        "d": EffortMeaning.MOTOR_TORQUE, 5: np.bool_(True),
    }  # fmt: skip
    expected = {"a": [1.0, None], "b": [3, None], "c": "dc_bus", "d": "motor_torque", "5": True}
    assert json.loads(json.dumps(json_value(value), allow_nan=False)) == expected


def test_a_number_that_is_not_finite_is_not_known():
    kind = RESULTS["model"]
    names = [entry.name for entry in fields(kind)]
    report = kind(**dict.fromkeys(names, float("nan")))
    assert all(getattr(report, name) is None for name in names)
    assert re.fullmatch(r"\w+", report.NAME)
