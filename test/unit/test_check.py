"""The coverage that `make test` prints, and its floor."""

import importlib.util
import json

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
    [(2, "true", "1", 0), (1, "true", "1", 0), (2, "false", "1", 1), (2, "true", "0", 1)],
)
def test_a_failure_in_either_lane_fails(
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
    monkeypatch.setattr(check, "BUILD", tmp_path)
    monkeypatch.setattr(check, "COVERAGE", tmp_path / "coverage.json")
    monkeypatch.setattr(check, "LINT", {"lint": [[lint]]})
    monkeypatch.setattr(check, "TESTS", tests)
    monkeypatch.setattr(check, "coverage", lambda report: "coverage 95.0 %")
    monkeypatch.setattr(check.os, "cpu_count", lambda: processors)
    assert check.main([]) == code
    passed = 1 + int(second)
    assert f"\n{passed} passed, {2 - passed} failed" in capfd.readouterr().out
