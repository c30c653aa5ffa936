"""Options are said once: flags, checks, signatures and docstrings are made of them."""

import inspect
from dataclasses import fields

import pytest

import robot_energy as re
from robot_energy.foundation.options import options_of
from robot_energy.inputs.meter.source import MeterInputs
from robot_energy.inputs.options import InputOptions
from robot_energy.inputs.sources import GapInputs, JointStateSource
from robot_energy.replay.options import PartOptions, ReplayOptions
from robot_energy.timeline.blocks import EffortMeaning, Learning
from robot_energy_cli.main import build_parser
from robot_energy_fleet.options import AdviseOptions, FleetOptions
from robot_energy_identify.options import SUBJECTS, IdentifyOptions
from robot_energy_identify.steps import SUBJECTS as STEPS
from robot_energy_plan.options import OptimizeOptions, PredictOptions, SharedBusOptions

VERBS = {
    "replay": (re.replay, ReplayOptions),
    "test": (re.evaluate, ReplayOptions),
    "predict": (re.predict, PredictOptions),
    "optimize": (re.optimize, OptimizeOptions),
    "shared-bus": (re.shared_bus, SharedBusOptions),
    "advise": (re.advise, AdviseOptions),
    "fleet run": (re.fleet_run, FleetOptions),
    "identify all": (re.identify_all, IdentifyOptions),
}
# What these verbs have of a replay from Python alone.
PYTHON = {
    "test": {"jobs", "processes", "out", "overwrite", "power_period"},
    "shared-bus": {"robot", "jobs", "processes", "out", "overwrite", "power_period"},
    "advise": {"jobs", "processes", "out", "overwrite", "power_period", "look_at_speeds"},
    "fleet run": {"processes"},
    "identify all": {"held_out"},
}


def flags_of(command: str) -> dict:
    parser = build_parser()
    for word in command.split():
        parser = next(a for a in parser._actions if isinstance(a.choices, dict)).choices[word]
    return {flag: action for action in parser._actions for flag in action.option_strings}


@pytest.mark.parametrize("command", VERBS)
def test_each_option_is_a_flag_a_keyword_and_a_line_of_the_docstring(command):
    verb, options = VERBS[command]
    flags, shown = flags_of(command), inspect.signature(verb).parameters
    for name, option in options_of(options).items():
        flag = flags.get(f"--{name.replace('_', '-')}")
        assert (flag is None) == (name in PYTHON.get(command, ())), name
        if flag is not None:
            assert flag.help == option.help, name
            assert tuple(flag.choices or ()) == option.choices, name
        assert shown[name].default == option.default
        assert f"    {name}: {option}" in options.__doc__


@pytest.mark.parametrize("kind", [JointStateSource, MeterInputs, GapInputs])
def test_a_parameter_of_a_node_that_is_an_option_as_well_says_the_same(kind):
    names = {"topics": "joint_states", "effort_meaning": "effort"}
    options, found = options_of(InputOptions), []
    for field in fields(kind):
        option = options.get(names.get(field.name, field.name))
        if option is not None and "description" in field.metadata:
            found.append(field.name)
            assert field.metadata["description"][1:].startswith(option.text[1:])
            assert tuple(field.metadata["choices"]) == option.choices
    assert found


def test_texts_allowed_are_those_of_the_enumerations():
    known = options_of(ReplayOptions)
    assert set(known["effort"].choices) == set(EffortMeaning)
    assert known["learning"].choices == tuple(Learning)
    assert SUBJECTS == STEPS


def test_options_of_a_part_are_options_of_a_replay():
    assert options_of(PartOptions).items() <= options_of(ReplayOptions).items()


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("skip", ["friction", "bodies"]), ("dq_scaling", "mean"),
    ],
)  # fmt: skip
def test_a_value_that_is_not_allowed_is_refused_before_anything_is_read(option, value):
    with pytest.raises(re.ParameterError, match=f"'{option}' of identify_all is"):
        re.identify_all("no bag", "kr16", **{option: value})


@pytest.mark.parametrize("value", ["no", 1, ["sleep"]])
def test_a_switch_is_true_or_false(value):
    with pytest.raises(
        re.ParameterError, match=r"'standby' of optimize is .*; expected True or False"
    ):
        re.optimize("no bag", "kr16", 30.0, standby=value)
    with pytest.raises(re.ParameterError, match="'held_out' of identify_all is"):
        re.identify_all("no bag", "kr16", held_out=value)
