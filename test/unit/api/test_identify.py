"""Recordings count once in an identification, and never in its own test; figures of the cabinet."""

import shutil

import numpy as np
import pytest

import robot_energy as re
from places import ROOT
from robot_energy.foundation.errors import BagError
from robot_energy_cli.main import main
from robot_energy_identify.cabinet import supply
from robot_energy_identify.provenance import require_distinct
from robot_energy_identify.stats.lag import Delay

BAG = ROOT / "bags/kr16_cold"
ONE_KIND = (
    re.identify_friction,
    re.identify_dynamics,
    re.identify_cabinet,
    re.identify_thermal,
    re.identify_auxiliary,
    re.identify_all,
)
FAST = ("dynamics", "friction", "drives", "capacitor", "thermal")
TORQUE = ("--effort", "motor_torque")


@pytest.fixture
def copy(tmp_path):
    """The same messages under another name."""
    return shutil.copytree(BAG, tmp_path / "another_day")


@pytest.mark.parametrize("identify", ONE_KIND)
def test_a_copy_of_a_recording_is_refused(identify, copy):
    with pytest.raises(BagError, match=r"named twice, the second time as .*another_day"):
        identify([BAG, copy], "kr16")
    with pytest.raises(BagError, match=r"kr16_cold is named twice; expected every recording once"):
        identify([BAG, BAG], "kr16")


@pytest.mark.parametrize("identify", ONE_KIND)
def test_no_recording_is_refused(identify):
    with pytest.raises(BagError, match="no recording; expected one or more"):
        identify([], "kr16")


def test_a_copy_of_a_fitted_recording_is_no_test(copy):
    with pytest.raises(BagError, match="a test on a recording of the fit shows nothing"):
        re.identify_all([BAG], "kr16", test=[copy], skip=FAST)


@pytest.mark.parametrize(
    "words",
    [
        ["friction", "BAG", "COPY", *TORQUE],
        ["friction", "BAG", "COPY", *TORQUE, "--train", "40:", "--test", ":35"],
        ["dynamics", "BAG", "COPY", *TORQUE],
        ["drives", "BAG", "BAG", *TORQUE],
        ["cabinet", "BAG", "COPY"],
        ["thermal", "BAG", "COPY"],
        ["auxiliary", "BAG", "COPY"],
        ["all", "BAG", "COPY"],
        ["all", "BAG", "--test", "COPY"],
    ],
    ids=" ".join,
)
def test_every_command_refuses_a_copy_in_one_sentence(words, copy, capsys):
    places = {"BAG": str(BAG), "COPY": str(copy)}
    words = [places.get(word, word) for word in words]
    assert main(["identify", *words, "--model", "kr16"]) == 2
    found = capsys.readouterr().err
    assert found.count("\n") == 1
    assert "is named twice" in found


def test_a_log_counts_once(tmp_path, capsys):
    log = tmp_path / "runs.csv"
    log.write_text("time,speed\n0,1\n")
    words = ["identify", "drives", "--log", str(log), str(log), "--mapping", "none.yaml"]
    assert main(words) == 2
    assert "runs.csv is named twice" in capsys.readouterr().err


def test_what_cannot_be_read_is_left_to_those_who_read_it(tmp_path):
    require_distinct([tmp_path / "none", tmp_path / "none"], [tmp_path / "none"])
    require_distinct([tmp_path, tmp_path])  # folders without messages
    with pytest.raises(BagError, match="none"):
        re.identify_cabinet([tmp_path / "none"] * 2, "kr16")


def test_hard_braking_shows_the_loss_on_the_grid_side():
    """Behind a meter with a low pass of 0.3 s; the plant was recorded with 348 W."""
    losses = re.identify_cabinet(ROOT / "bags/drawn_train_cold", "kr16").found.losses
    assert losses.loss_grid == pytest.approx(348.0, rel=0.05)
    assert losses.loss_dc > 0.0


def test_without_a_dc_loss_the_grid_side_is_the_mean_of_both_phases(monkeypatch):
    """Both phases show the grid side alone: with the variances a and b of HOLD and GENERATING
    (b HOLD + a GENERATING) / (a + b), and they agree here with a low pass that is too short."""
    short = Delay(0.2525, 0.02, 0.4, 0.2525, False, 1.0)
    monkeypatch.setattr(supply, "meter_lags", lambda _: (short, None))
    result = re.identify_cabinet(ROOT / "bags/drawn_train_cold", "kr16")
    losses, cabinet = result.found.losses, result.model.cabinet
    hold, braking = losses.hold, losses.generating
    assert losses.loss_dc == pytest.approx(hold.power - braking.power)
    assert losses.loss_dc < 0.0
    assert cabinet.loss_dc.value == 0.0
    a, b = hold.std**2, braking.std**2
    mean = (b * hold.power + a * braking.power) / (a + b)
    assert cabinet.loss_grid.value == pytest.approx(mean)
    assert mean == pytest.approx(470.2, abs=1.0)
    assert (hold.power - braking.power) ** 2 < a + b
    scatter = np.sqrt(a * b / (a + b))
    assert losses.parts["loss_grid"]["scatter"] == pytest.approx(scatter)
    assert losses.parts["sum"] == losses.parts["loss_grid"]
    assert cabinet.loss_grid.std >= scatter
    assert any("their weighted mean" in note for note in losses.notes)
