from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robot_energy.foundation.errors import ReportError, ShapeError
from robot_energy_report.replay_figures import Role, Series, power_and_energy

TIME = np.linspace(0.5, 9.5, 10)


def curve(role: Role, power: float) -> Series:
    values = np.full(10, power)
    values[5] = np.nan  # a gap
    return Series(role, role, TIME, values, np.arange(11.0), power * np.arange(11.0))


CURVES = [curve("measured", 50.0), curve("predicted", 47.0), curve("fixed", 40.0)]


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_the_same_curves_give_the_same_bytes(tmp_path: Path, suffix: str) -> None:
    paths = [tmp_path / f"{name}.{suffix}" for name in "ab"]
    for path in paths:
        power_and_energy(CURVES, path, "a title", "the DC bus")
    first, second = (path.read_bytes() for path in paths)
    assert first == second
    assert len(first) > 5000
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"a.{suffix}", f"b.{suffix}"]


def test_axes_say_quantity_and_unit_and_the_residual_needs_a_meter(tmp_path: Path) -> None:
    power_and_energy(CURVES, tmp_path / "with.svg", "", "the DC bus")
    power_and_energy(CURVES[1:], tmp_path / "without.svg", "", "the grid")
    assert len((tmp_path / "without.svg").read_text()) < len((tmp_path / "with.svg").read_text())
    labels = (tmp_path / "with.svg").read_text()
    for text in ("power at the DC bus [W]", "measured [W]", "energy at the DC bus [J]"):
        assert f">{text}<" in labels
    assert "measured [W]" not in (tmp_path / "without.svg").read_text()


def test_the_band_of_the_energy_stands_at_the_end_of_its_curve(tmp_path: Path) -> None:
    banded = [CURVES[0], replace(CURVES[1], energy_half=25.0)]
    power_and_energy(banded, tmp_path / "with.svg")
    power_and_energy(CURVES[:2], tmp_path / "without.svg")
    with_band, without = ((tmp_path / f"{name}.svg").read_text() for name in ("with", "without"))
    assert "25.0 J (90 % band)" in with_band
    assert "band" not in without


def test_bad_requests_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ShapeError, match="0 curves"):
        power_and_energy([], tmp_path / "a.png")
    with pytest.raises(ShapeError, match="2 of them measured"):
        power_and_energy([CURVES[0]] * 2, tmp_path / "a.png")
    with pytest.raises(ReportError, match="no known format"):
        power_and_energy(CURVES, tmp_path / "a.bmp")
    with pytest.raises(ReportError, match="cannot be written"):
        power_and_energy(CURVES, tmp_path / "none" / "a.png")
