"""The JSON schema of model files and the reference page made from it."""

import json

import jsonschema
import pytest
import yaml

from places import ROOT
from robot_energy.model import shipped_models
from robot_energy_cli import main
from robot_energy_cli.model_reference import json_schema, reference_page

PAGE = ROOT / "src/doc/model_file.md"


def test_the_page_is_the_one_of_the_schema():
    assert PAGE.read_text() == reference_page(), (
        "robot-energy model schema --markdown > src/doc/model_file.md"
    )


def test_every_key_has_a_meaning():
    schema = json_schema()
    for name, entry in {"top": schema, **schema["$defs"]}.items():
        for key, field in entry.get("properties", {}).items():
            assert field.get("description"), f"{name}.{key}"


@pytest.mark.parametrize("path", shipped_models().values(), ids=lambda path: path.stem)
def test_shipped_models_fit_the_schema(path):
    jsonschema.validate(yaml.safe_load(path.read_text()), json_schema())


def test_a_wrong_key_does_not_fit_the_schema():
    data = yaml.safe_load(shipped_models()["kr16"].read_text())
    data["joints"][0]["gear_ration"] = data["joints"][0].pop("gear_ratio")
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(data, json_schema())


def test_the_command_prints_the_schema(capsys):
    assert main(["model", "schema"]) == 0
    jsonschema.Draft202012Validator.check_schema(json.loads(capsys.readouterr().out))
