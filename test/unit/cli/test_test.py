"""`robot-energy test` on the wheel, whose figures are worked out by hand.

Motor at 30 rad/s with 1.1 N m, by the model: 33 W at the shaft, 83 W at the grid.
"""

import json
import math

import numpy as np
import pytest

import robot_energy as re
import robots
from logbook import WHEEL_MAPPING, mapping, wheel_bag, wheel_csv, wheel_model, write_csv
from pages import read
from places import ROOT
from robot_energy.model import load
from robot_energy.model.schema import CabinetFan
from robot_energy_cli import main
from robot_energy_identify.data.recordings import read_recording
from robot_energy_identify.provenance import sha256_of
from robot_energy_identify.results.evaluation import seen_in_fit
from robot_energy_logs.log_import import import_log
from warm_wheel import SPEED, wheel


@pytest.fixture
def log(tmp_path):
    """1 N m at the motor and 80 W at the meter for 10 s."""
    rows = [(f"{n / 100:.6f}", f"{3 * n / 100:.9f}", 3.0, 1.0, 80.0) for n in range(1001)]
    return write_csv(tmp_path / "wheel.csv", "t,q_axle,w_axle,torque,p", rows)


EFFORT = {"columns": ["torque"], "unit": "newton_metre", "side": "motor"}


def with_effort():
    return {**WHEEL_MAPPING, "joints": {**WHEEL_MAPPING["joints"], "effort": EFFORT}}


def without_meter():
    return {**with_effort(), "power": None}


@pytest.fixture
def bag(tmp_path, log):
    import_log(log, mapping(**with_effort()), tmp_path / "bag")
    return tmp_path / "bag"


def test_errors_of_model_and_zero(tmp_path, bag, capsys):
    outputs = [tmp_path / name for name in ("t.json", "t.html")]
    words = ["test", bag, "--model", wheel_model(tmp_path), "--effort", "motor_torque", "--json",
             outputs[0], "--report", outputs[1]]  # fmt: skip
    assert main([str(word) for word in words]) == 0
    said = capsys.readouterr().out
    assert said.startswith("energy at the meter +3.8 %, power 3 W RMS, motor torque 10.0 % off")
    assert f"wrote {outputs[0]}" in said
    assert f"wrote {outputs[1]}" in said
    found = json.loads(outputs[0].read_text())
    (recording,) = found["recordings"]
    model, fixed, zero = recording["scores"]
    assert [one["name"] for one in recording["scores"]] == ["model", "fixed_friction", "zero"]
    assert found["together"] == recording["scores"]
    assert recording["measured_energy"] == pytest.approx(800.0)
    assert model["energy_error"] == pytest.approx(30.0)
    assert (model["power_error_rms"], zero["power_error_rms"]) == pytest.approx((3.0, 80.0))
    assert zero["energy_relative"] == -1.0
    (joint,) = model["joints"]
    assert joint["torque_rms"] == pytest.approx(0.1)
    assert joint["torque_relative_moving"] == pytest.approx(0.1)
    assert joint["shaft_energy_error"] == pytest.approx(30.0)
    assert joint["shaft_energy_relative"] == pytest.approx(0.1)
    assert zero["joints"][0]["torque_rms"] == pytest.approx(1.0)
    assert zero["joints"][0]["shaft_energy_relative"] == pytest.approx(-1.0)
    assert fixed["change"] == "friction fixed at 25 degC"
    page = read(outputs[1].read_text())
    assert "+3.8 %" in " ".join(page.cells)


def test_noise_above_10_hz_counts_in_the_error_of_the_monitor_alone(tmp_path):
    # 1 N m with 0.5 N m of 40 Hz, model 1.1 N m: sqrt(0.1^2 + 0.5^2 / 2) over
    # sqrt(1 + 0.5^2 / 2), and 0.1 below 10 Hz
    rows = [
        (f"{n / 500:.6f}", f"{3 * n / 500:.9f}", 3.0, 1.0 + 0.5 * math.sin(80 * math.pi * n / 500))
        for n in range(5001)
    ]
    log = write_csv(tmp_path / "noisy.csv", "t,q_axle,w_axle,torque", rows)
    import_log(log, mapping(**without_meter()), tmp_path / "bag")
    report = re.evaluate(tmp_path / "bag", wheel_model(tmp_path), effort="motor_torque")
    (joint,) = report.together[0].joints
    assert joint.torque_relative_moving == pytest.approx((0.135 / 1.125) ** 0.5, rel=0.01)
    assert joint.torque_relative_low_pass == pytest.approx(0.1, rel=0.01)
    assert report.together[-1].joints[0].torque_relative_low_pass == 1.0


def test_a_prediction_does_not_see_the_meter_that_judges_it():
    """Without a meter, a fan of 300 W that may start from -59 to 149 degC counts about half."""
    model, bag = load("kr16"), ROOT / "bags/drawn_test_warm"
    on = {**robots.figure(45.0), "std": 60.0}
    fan = {"power": robots.figure(300.0), "on_above_degc": on, "hysteresis": robots.figure(0.0)}
    update = {"fan": CabinetFan.model_validate(fan)}
    fanned = model.changed(cabinet=model.cabinet.model_copy(update=update))
    plain, off, applied = (
        re.evaluate(bag, fanned, **options).recordings[0].scores[0].energy_relative
        for options in ({}, {"learning": "off"}, {"learning": "apply"})
    )
    assert plain == off
    assert applied < plain - 0.1  # the meter shows that it does not run
    recording = read_recording(bag, fanned)
    found = read_recording(bag, model).with_model(fanned)
    np.testing.assert_array_equal(found.power.grid_power, recording.power.grid_power)


def test_a_meter_that_reads_a_fifth_too_much_moves_no_gear_that_is_judged(tmp_path):
    """With friction alone it is 86 W; all of the fifth is the error, unless learning is applied."""
    joints = {
        **WHEEL_MAPPING["joints"],
        "temperature": {"column": "degc_{joint}", "unit": "celsius"},
    }
    model = wheel()

    def judged(power, **options):
        rows = [
            (f"{n / 10:.6f}", f"{SPEED / 10 * n / 10:.9f}", SPEED / 10, 45.0 + 0.1 * (n % 2), power)
            for n in range(3001)
        ]
        log = write_csv(tmp_path / "warm.csv", "t,q_axle,w_axle,degc_axle,p", rows)
        bag = tmp_path / f"bag_{power:g}"
        import_log(log, mapping(joints=joints), bag, overwrite=True)
        recording = re.evaluate(bag, model, **options).recordings[0]
        return recording, read_recording(bag, model).with_model(wheel(std=0.4)).power

    right, power = judged(86.0)
    wrong, same = judged(103.2)
    energies = [one.scores[0].predicted_energy for one in (right, wrong)]
    assert energies[0] == energies[1] == pytest.approx(86.1 * 300.0, rel=1e-3)
    assert wrong.scores[0].energy_relative == pytest.approx(energies[0] / 300.0 / 103.2 - 1.0)
    np.testing.assert_array_equal(power.grid_power, same.grid_power)
    corrected, _ = judged(103.2, learning="apply")
    assert corrected.scores[0].predicted_energy > energies[0]
    (note,) = (note for note in corrected.notes if "corrected" in note)
    assert "learning: apply" in note
    assert not any("corrected" in note for note in wrong.notes)


def test_readings_within_the_band_are_counted_by_the_figures_of_the_model(tmp_path):
    """The model says 68 W and the meter 300 W; the band that follows the meter soon holds it."""
    bag, model = wheel_bag(tmp_path, 300.0, seconds=40.0, rate=50.0), wheel_model(tmp_path)
    assert re.replay(bag, model=model).report.uncertainty.inside > 0.3
    assert re.evaluate(bag, model).recordings[0].band_inside == 0.0


@pytest.mark.parametrize("gear", [False, True])
def test_torque_that_has_corrected_a_gear_is_said_where_torque_is_judged(bag, gear):
    notes = re.evaluate(bag, wheel(gear), effort="motor_torque").recordings[0].notes
    assert any("torque has corrected" in note for note in notes) is gear
    assert not any(
        "corrected" in note for note in re.evaluate(bag, wheel(gear)).recordings[0].notes
    )


def test_a_longer_window_of_accelerations_is_named_where_it_lowers_the_error(tmp_path):
    # velocities with noise: over 20 ms it is an acceleration of many rad/s^2, over 0.1 s of few
    noise = np.random.default_rng(5).normal(0.0, 0.05, 5001)
    rows = [(f"{n / 500:.6f}", f"{3 * n / 500:.9f}", 3.0 + noise[n], 1.1) for n in range(5001)]
    log = write_csv(tmp_path / "noisy.csv", "t,q_axle,w_axle,torque", rows)
    import_log(log, mapping(**without_meter()), tmp_path / "bag")
    model = wheel_model(tmp_path)

    def tried(**options):
        report = re.evaluate(tmp_path / "bag", model, effort="motor_torque", **options)
        (recording,) = report.recordings
        notes = [note for note in recording.notes if "derivative_window" in note]
        return 100 * report.together[0].all_joints.torque_relative_moving, notes

    error, (note,) = tried()
    lower, none = tried(derivative_window=0.1)
    assert f"from {error:.1f} to {lower:.1f} %: set derivative_window to 0.1" in note
    assert not none


def test_two_recordings_together_are_the_sums_of_both(tmp_path, bag):
    other = tmp_path / "other"
    import_log(wheel_csv(tmp_path / "o.csv", 40.0, seconds=30.0), mapping(), other)
    model = wheel_model(tmp_path)
    report = re.evaluate([bag, other], model, effort="motor_torque")
    together = report.together[0]
    errors = [one.scores[0].energy_error for one in report.recordings]
    assert errors == pytest.approx([10 * 3.0, 30 * 28.0])
    assert together.energy_error == pytest.approx(sum(errors))
    assert together.energy_relative == pytest.approx(870.0 / 2000.0)
    mean_square = (10 * 3.0**2 + 30 * 28.0**2) / 40
    assert together.power_error_rms == pytest.approx(mean_square**0.5, rel=2e-3)
    # the second has no torque: that of the first counts alone
    assert together.joints == report.recordings[0].scores[0].joints
    assert report.recordings[1].scores[0].all_joints is None


def test_a_log_is_tested_as_its_mapping_says(tmp_path, log, capsys):
    path = tmp_path / "mapping.yaml"
    path.write_text(json.dumps(with_effort()))
    words = ["test", "--log", log, "--mapping", path, "--model", wheel_model(tmp_path), "--json",
             tmp_path / "t.json"]  # fmt: skip
    assert main([str(word) for word in words]) == 0
    (recording,) = json.loads((tmp_path / "t.json").read_text())["recordings"]
    assert recording["recording"] == "wheel.csv"
    assert recording["sha256"] == sha256_of(log)
    assert recording["scores"][0]["joints"][0]["torque_rms"] == pytest.approx(0.1)
    assert "motor torque 10.0 % off" in capsys.readouterr().out


def test_a_recording_of_the_fit_is_not_held_out(tmp_path, bag):
    model, sha256 = load(wheel_model(tmp_path)), sha256_of(bag)

    def seen(*bags, source=""):
        joint = model.joints[0]
        coulomb = joint.friction.coulomb.model_copy(update={"tag": "identified", "source": source})
        friction = joint.friction.model_copy(update={"coulomb": coulomb})
        changed = model.changed(
            joints=[joint.model_copy(update={"friction": friction})],
            provenance=model.provenance.model_copy(update={"bags": bags}),
        )
        return seen_in_fit(changed, "bag", sha256)[0]

    assert seen_in_fit(model, "bag", sha256)[0] == "held_out"
    assert seen(f"moved sha256:{sha256}") == "fitted"
    assert seen("bag sha256:000000000000") == "held_out"  # of the same name only
    assert seen(source="cold, bag, warm") == "fitted"
    assert seen(source="cold, bag_2, warm") == "unknown"
    assert seen("cold") == "unknown"


def test_what_measures_nothing_is_refused(tmp_path, capsys):
    bag = wheel_bag(tmp_path, None)
    assert main(["test", str(bag), "--model", str(wheel_model(tmp_path))]) == 2
    assert "neither torque nor power was measured" in capsys.readouterr().err
    assert main(["test", "--model", "kr16"]) == 2
    assert main(["test", str(bag), "--log", "x", "--mapping", "y", "--model", "kr16"]) == 2
