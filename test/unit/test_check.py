"""The stages of `make test`: what they run, what they print, and the floor of coverage."""

import importlib.util
import json
import sys

import pytest

from places import ROOT


@pytest.fixture(scope="module")
def check():
    spec = importlib.util.spec_from_file_location("check", ROOT / ".ci/check.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(("above", "fails"), [(0.0, False), (5.0, False), (-0.1, True)])
def test_coverage_below_the_floor_fails(check, tmp_path, above, fails):
    report = tmp_path / "coverage.json"
    report.write_text(json.dumps({"totals": {"percent_covered": check.MIN_COVERAGE + above}}))
    assert check.coverage(report).endswith("FAILED") == fails


@pytest.mark.parametrize("text", [None, "", "{}"])
def test_coverage_that_was_not_measured_fails(check, tmp_path, text):
    report = tmp_path / "coverage.json"
    if text is not None:
        report.write_text(text)
    assert check.coverage(report).endswith("FAILED")


@pytest.mark.parametrize(
    ("processors", "lint", "second", "code"),
    [
        (2, "true", "1", 0),
        (1, "true", "1", 0),
        (8, "true", "1", 0),
        (2, "false", "1", 1),
        (1, "false", "1", 1),
        (2, "true", "0", 1),
    ],
)
def test_a_failure_in_any_lane_fails(
    check, tmp_path, monkeypatch, capfd, processors, lint, second, code
):
    for name, value in (("first", "1"), ("second", second)):
        (tmp_path / f"test_{name}.py").write_text(f"def test_it():\n    assert {value}\n")
    settings = ["-c", str(tmp_path / "pytest.ini"), "-p", "no:cacheprovider"]
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    tests = {
        "tests": [*settings, str(tmp_path / "test_first.py")],
        "node tests": [*settings, str(tmp_path / "test_second.py")],
    }
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # they take most of a start
    monkeypatch.setattr(check, "BUILD", tmp_path)
    monkeypatch.setattr(check, "COVERAGE", tmp_path / "coverage.json")
    monkeypatch.setattr(check, "LINT", {"lint": [[lint]]})
    monkeypatch.setattr(check, "TESTS", tests)
    monkeypatch.setattr(check, "coverage", lambda report: "coverage 95.0 %")
    monkeypatch.setattr(check.os, "cpu_count", lambda: processors)
    assert check.main([]) == code
    passed = 1 + int(second)
    assert f"\n{passed} passed, {2 - passed} failed" in capfd.readouterr().out


def test_every_test_is_run_by_one_stage(check):
    for folder in ("test", "ros2_energy_monitor/test"):
        for file in (ROOT / folder).rglob("test_*.py"):
            stages = [name for name, words in check.TESTS.items() if runs(words, file)]
            assert len(stages) == 1, f"{file}: {stages}"


def runs(words, file):
    """Whether pytest with these arguments runs a file."""
    settings = words.index("-c") + 1
    given = [ROOT / word for word in words if not word.startswith("-") and word != words[settings]]
    left = [ROOT / word.removeprefix("--ignore=") for word in words if "--ignore=" in word]
    return any(map(file.is_relative_to, given)) and not any(map(file.is_relative_to, left))


def test_lanes_take_every_stage_that_there_is(check):
    stages = {*check.LINT, *check.TESTS}
    assert {*check.ORDER, *check.WAITING} <= stages
    assert {*check.TESTS} <= {*check.ORDER, *check.WAITING}


def test_stages_keep_compiled_modules(check, monkeypatch):
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    check.STOPPED.clear()  # as every run ends with it
    code = "import sys; sys.exit(sys.dont_write_bytecode)"
    assert check.run("start", [sys.executable, "-c", code]) == 0
