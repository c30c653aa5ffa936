"""Replay of the bundled bags against stored results, field by field.

``pytest -c test/pytest.ini test/golden --update-golden`` writes them again; commit that alone,
with the reason why a number changed.
"""

import json
from pathlib import Path

import pytest

from places import ROOT
from robot_energy.bag import BagReader
from robot_energy.model import load
from robot_energy.physics.friction import with_fixed_friction
from robot_energy.replay.bag_replay import replay
from robot_energy.results.replay import replay_report

BAGS = ("kr16_cold", "kr16_warm")
RELATIVE = 1e-9  # other processors round transcendental functions differently
ELSEWHERE = ("bag", "tool_version", "model.source", "model.notes")  # not results


def flat(value, path=""):
    """Leaves of nested JSON by dotted path."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from flat(item, f"{path}.{key}" if path else key)
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from flat(item, f"{path}.{index}")
    else:
        yield path, value


def differences(found, expected):
    for path in sorted(found.keys() | expected.keys()):
        a, b = found.get(path, "absent"), expected.get(path, "absent")
        if isinstance(a, float) and isinstance(b, float):
            if a != pytest.approx(b, rel=RELATIVE, abs=1e-6):
                yield f"{path}: found {a!r}, stored {b!r}"
        elif a != b:
            yield f"{path}: found {a!r}, stored {b!r}"


@pytest.mark.parametrize("fixed", [None, 60.0])
@pytest.mark.parametrize("name", BAGS)
def test_replay_gives_the_stored_result(name, fixed, request):
    model = load("kr16")
    if fixed is not None:
        model = with_fixed_friction(model, fixed)
    report = replay_report(replay(ROOT / "bags" / name, model)).to_dict()
    result = {path: leaf for path, leaf in flat(report) if path not in ELSEWHERE}
    stored = Path(__file__).parent / f"{name}{'' if fixed is None else '_fixed_60'}.json"
    if request.config.getoption("--update-golden"):
        stored.write_text(json.dumps(result, indent=1) + "\n")
    found = list(differences(result, json.loads(stored.read_text())))
    assert not found, f"{len(found)} fields differ:\n" + "\n".join(found[:20])


def test_temperature_aware_friction_is_what_the_cold_robot_needs():
    """The claim of the first page, on the virtual rig: bands, not exact figures."""
    error = {}
    for name in BAGS:
        for fixed in (False, True):
            model = load("kr16")
            model = with_fixed_friction(model, 60.0) if fixed else model
            comparison = replay(ROOT / "bags" / name, model).account.comparison
            error[name, fixed] = comparison.predicted_energy / comparison.measured_energy - 1
    assert abs(error["kr16_cold", False]) < 0.05
    assert abs(error["kr16_warm", False]) < 0.05
    assert error["kr16_cold", True] < -0.25


@pytest.mark.parametrize("name", BAGS)
def test_bags_say_that_they_are_simulated(name):
    assert "simulated" in BagReader(ROOT / "bags" / name).origin


@pytest.mark.parametrize("name", BAGS)
def test_bags_are_small(name):
    assert sum(path.stat().st_size for path in (ROOT / "bags" / name).iterdir()) < 2_000_000
