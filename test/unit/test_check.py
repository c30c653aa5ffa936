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
