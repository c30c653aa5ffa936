from array import array
from dataclasses import dataclass

import pytest

from robot_energy.foundation.errors import ParameterError
from robot_energy.inputs.parameters import (
    Parameter,
    assemble,
    group,
    named_groups,
    parameter,
)
from robot_energy.inputs.sources import Inputs as AllInputs


@dataclass(frozen=True, kw_only=True)
class Probe:
    topic: str = parameter("Where.", "probe")
    depth: int = parameter("How many [-].", 10, (1, 100))

    def __post_init__(self):
        if self.topic == "bad":
            raise ParameterError("topic is bad", "a good one")


@dataclass(frozen=True, kw_only=True)
class Rates:
    rate: float = parameter("How often [1/s].", 5.0, (1.0, 10.0))


@dataclass(frozen=True, kw_only=True)
class Inputs:
    unit: str = parameter("Unit.", "degc", choices=("degc", "kelvin"))
    names: tuple[str, ...] = parameter("Names.", ())
    loud: bool = parameter("Whether.", False)
    meter: Probe = group(Probe)
    rates: Rates = group(Rates)
    probes: dict[str, Probe] = named_groups(Probe, "Names of probes.", "one")  # noqa: RUF009


def build(**given):
    asked = []

    def value_of(entry):
        asked.append(entry.name)
        return entry.check(given.get(entry.name, entry.default), "node")

    return assemble(Inputs, value_of, "node"), asked


def test_defaults_stand_where_nothing_is_given():
    built, asked = build()
    assert built == Inputs()
    assert built.probes == {"one": Probe()}
    assert asked == [
        "unit", "names", "loud", "meter.topic", "meter.depth", "rates.rate", "probes", "one.topic",
        "one.depth",
    ]  # fmt: skip


def test_groups_take_their_parameters_by_full_name():
    built, asked = build(
        **{
            "meter.topic": "m",
            "rates.rate": 7,
            "probes": ["a", "b"],
            "b.depth": 3,
            "names": ["x", ""],
        }
    )
    assert built == Inputs(
        meter=Probe(topic="m"),
        rates=Rates(rate=7.0),
        names=("x",),
        probes={"a": Probe(), "b": Probe(depth=3)},
    )
    assert isinstance(built.rates.rate, float)
    assert "a.topic" in asked
    assert "one.topic" not in asked


def test_an_empty_list_of_groups_is_none():
    assert build(probes=[])[0].probes == {}


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("unit", "celsius", ("'unit' of node is 'celsius'", "one of degc, kelvin")),
        ("names", "x", ("'names' of node is 'x'", "a list of texts")),
        ("names", [1], ("'names' of node is [1]", "a list of texts")),
        ("loud", 1, ("'loud' of node is 1", "true or false")),
        ("meter.depth", 0, ("'meter.depth' of node is 0", "an integer from 1 to 100")),
        ("meter.depth", True, ("'meter.depth' of node is True", "an integer")),
        ("one.depth", 1.5, ("'one.depth' of node is 1.5", "an integer from 1 to 100")),
        ("rates.rate", float("nan"), ("'rates.rate' of node is nan", "a number from 1.0 to 10.0")),
        ("rates.rate", True, ("'rates.rate' of node is True", "a number from 1.0 to 10.0")),
        ("one.topic", "bad", ("'one' of node: topic is bad", "a good one")),
        ("meter.topic", "bad", ("'meter' of node: topic is bad", "a good one")),
        ("probes", ["a", "a"], ("'a' twice", "each once")),
        ("probes", ["a.b"], ("'a.b' which cannot name a group",)),
        ("probes", ["meter"], ("'meter' which cannot name a group",)),
        ("probes", ["unit"], ("'unit' which cannot name a group",)),
    ],
)
def test_wrong_values_are_refused_in_one_sentence(name, value, words):
    with pytest.raises(ParameterError) as caught:
        build(**{name: value})
    for word in words:
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def names_of(cls) -> list[str]:
    asked: list[str] = []

    def value_of(entry):
        asked.append(entry.name)
        return entry.default

    assemble(cls, value_of, "node")
    return asked


def test_every_input_names_the_source_of_its_stamps_alike():
    asked = []
    assemble(AllInputs, lambda entry: asked.append(entry) or entry.default, "node")
    sources = {entry.name: entry.choices for entry in asked if "stamp_source" in entry.name}
    assert sources == {
        "joint_states.stamp_source": ("header", "receive"),
        "motors.stamp_source": ("header", "receive"),
        "meter.stamp_source": ("by_type", "header", "receive"),
    }


@pytest.mark.parametrize("kind", [list, tuple, lambda items: array("d", items)])
def test_numbers_come_as_any_list(kind):
    """Files bring lists, services of ROS arrays."""
    entry = Parameter("sign", tuple[float, ...], (1.0,), "Sign [-].", (-1.0, 1.0), ())
    assert entry.check(kind([1.0, -1.0]), "node") == (1.0, -1.0)
    with pytest.raises(ParameterError):
        entry.check(kind([2.0]), "node")
