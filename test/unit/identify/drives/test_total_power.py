"""Losses of the drives behind a meter at the grid (virtual rig), not at the DC bus."""

import json
from dataclasses import replace

import numpy as np
import pytest

from robot_energy.model import load
from robot_energy.model.figure import Figure, PositiveFigure
from robot_energy.model.schema import CabinetFan
from robot_energy.timeline.blocks import EffortMeaning, MeterLocation
from robot_energy_cli.main import main
from robot_energy_identify.data.bags import Bag
from robot_energy_identify.data.recordings import read_recording
from robot_energy_identify.drives.all_drives import fan_known, fan_test, find_drives
from robot_energy_identify.drives.drive_data import drive_data, held_energy
from robot_energy_identify.drives.total_power import (
    STRUCTURES,
    fit_structure,
    fit_total,
    held_out_powers,
    predict,
    with_total,
)
from robot_energy_identify.drives.total_sums import resting, sums
from robot_energy_identify.steps import drives_step
from robot_energy_plan.motion import random_program
from robot_energy_rig import RigConfig, VirtualRig, load_profile
from robot_energy_rig.record import record

PROFILE = load_profile("kr16")
MODEL = load("kr16")


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Three runs with every effect on: DC link, rectifier, chopper, noise, gain of the meter."""
    folder = tmp_path_factory.mktemp("grid")
    limits = PROFILE.motion_limits(PROFILE.mechanics()[0])
    for seed in (1, 2, 3):
        program = random_program(limits, seed, dwell=0.3)
        rig = VirtualRig(PROFILE, program, RigConfig(), seed, 40.0, rate_hz=100.0)
        record(rig, 30.0, folder / str(seed))
    return sorted(folder.iterdir())


@pytest.fixture(scope="module")
def data(bags):
    recordings = [read_recording(bag, MODEL, EffortMeaning.MOTOR_TORQUE) for bag in bags]
    return drive_data(recordings, [None] * len(bags), measured_torque=True)


def test_energy_held_in_the_dc_link_by_hand():
    """100 W fed back for 2 s last for 4 s at 50 W; a new segment starts with nothing."""
    demand = np.array([80.0, -100.0, -100.0, 50.0, 50.0, 50.0, 50.0, 50.0, -60.0, 20.0])
    stamp = np.arange(10, dtype=np.int64) * 1_000_000_000
    segment = np.repeat([0, 1], [9, 1])
    expected = [0.0, 100.0, 200.0, 150.0, 100.0, 50.0, 0.0, 0.0, 60.0, 0.0]
    np.testing.assert_allclose(held_energy(demand, stamp, segment), expected)


def test_drives_found_before_say_which_rests_the_dc_link_feeds(tmp_path):
    """Where nothing is drawn at rest, all that was fed back is held until the next motion."""
    program = random_program(PROFILE.motion_limits(PROFILE.mechanics()[0]), 1, dwell=2.0)
    rig = VirtualRig(PROFILE, program, RigConfig(), 1, 40.0, rate_hz=50.0)
    bags = [Bag(record(rig, 90.0, tmp_path / "bag").path, EffortMeaning.MOTOR_TORQUE)]
    none = MODEL.cabinet.loss_dc.model_copy(update={"value": 0.0})
    model = MODEL.changed(cabinet=MODEL.cabinet.model_copy(update={"loss_dc": none}))
    without, known = (drives_step(bags, model, "bags", seen).found.total for seen in (None, MODEL))
    rests = [resting(one.data, model).mean() for one in (without, known)]
    assert rests[0] < 0.05 < 0.3 < rests[1]
    true = PROFILE.supply.loss_dc + PROFILE.supply.loss_grid
    assert true < known.fit.constant < true + 25.0


def test_readings_while_the_dc_link_gives_are_left_out(data):
    """They read too low: with them the constant came out at 236 instead of 340 W."""
    total = sums(data, MODEL)
    assert total.location is MeterLocation.GRID
    assert 0.3 < data.braking.mean() < 0.5
    fit = fit_total(total)
    supply = PROFILE.supply
    true = supply.loss_dc + supply.loss_grid  # rectifier and inverters come on top
    assert true < fit.constant < true + 25.0
    everything = replace(data, braking=np.zeros_like(data.braking))
    assert fit_total(sums(everything, MODEL)).constant < true - 50.0


def fan_of(power, std, tag="identified", source="bags"):
    known = {"tag": tag, "source": source}
    on = Figure(value=45.0, **known)
    fan = CabinetFan(power=PositiveFigure(value=power, std=std, **known), on_above_degc=on)
    return MODEL.changed(cabinet=MODEL.cabinet.model_copy(update={"fan": fan}))


def runs(stamp_ns):
    """A fan in every second 5 s."""
    return stamp_ns // 5_000_000_000 % 2 == 1


def seen_with_fan(data, step):
    """Readings with a fan of 60 W; the step showed another power."""
    meters = [replace(one, power=one.power + 60.0 * runs(one.stamp_ns)) for one in data.meters]
    return replace(data, meters=tuple(meters), fan_power=step * runs(data.stamp_ns))


@pytest.mark.parametrize(("step", "std", "expected"), [(50.0, 10.0, 60.0), (50.0, 3.0, 50.0)])
def test_the_power_of_a_fan_is_that_of_all_readings_unless_its_step_contradicts_it(
    data, step, std, expected
):
    """60 W in every second 5 s; the step showed 50 W, which is all that counts if it is surer."""
    seen, model = seen_with_fan(data, step), fan_of(step, std)
    found = find_drives(seen, model, "bags", in_time=True)
    written, notes = found.write(model, "bags")
    assert any("(50.0 W before)" in note for note in notes) == (expected != step)
    assert written.cabinet.fan.power.value == pytest.approx(expected, rel=0.1)
    assert written.cabinet.fan.power.std == std
    if expected == 60.0:
        without = find_drives(data, MODEL, "bags", in_time=True).total.fit
        assert found.total.fit.constant == pytest.approx(without.constant, abs=3.0)
        assert all(new.rms < old.rms for new, old in found.total.fan_test)


@pytest.mark.parametrize(("tag", "source"), [("assumed", "bags"), ("identified", "others")])
def test_a_fan_of_another_source_stays_as_given(data, tag, source):
    seen, model = seen_with_fan(data, 50.0), fan_of(50.0, 10.0, tag, source)
    found = find_drives(seen, model, "bags", in_time=True)
    assert found.write(model, "bags")[0].cabinet.fan == model.cabinet.fan
    assert found.total.fan_test == ()


def test_readings_with_a_fan_that_may_run_or_not_do_not_count(data):
    """60 W in every fourth 5 s; in others half of it is expected, and it does not run."""

    def seen(stamp_ns, of_open):
        quarter = stamp_ns // 5_000_000_000 % 4
        return np.select([quarter == 1, quarter == 3], [60.0, of_open], 0.0)

    meters = [replace(one, power=one.power + seen(one.stamp_ns, 0.0)) for one in data.meters]
    half = replace(data, meters=tuple(meters), fan_power=seen(data.stamp_ns, 30.0))
    found, without = (
        find_drives(one, model, "bags", in_time=True).total
        for one, model in ((half, fan_of(60.0, 3.0)), (data, MODEL))
    )
    assert found.fit.constant == pytest.approx(without.fit.constant, abs=1.5)
    one = sums(half, MODEL)
    assert not fan_known(one, fan_of(60.0, 3.0)).all()
    assert fan_known(one, fan_of(60.0, 3.0, source="levels of recordings: bags")).all()
    few = one[np.flatnonzero(one.fan == 30.0)[:15]]
    assert fan_known(few, fan_of(60.0, 3.0)).all()


def test_a_fan_that_is_small_next_to_the_errors_of_motion_is_seen_at_rest(data):
    """12 W in half of the blocks, errors of 3 W at rest and of 150 W in motion."""
    one, random = sums(data, MODEL), np.random.default_rng(0)
    rest = resting(one, MODEL)
    assert np.abs(one.shaft[rest]).max() < 10.0 < np.median(np.abs(one.shaft))
    more = np.sort(np.append(np.arange(len(one)), np.repeat(np.flatnonzero(rest), 20)))
    one, rest, power = one[more], rest[more], predict(one, fit_total(one))[more]
    fan = 12.0 * (one.block % 2)
    power = power + random.normal(0.0, np.where(rest, 3.0, 150.0))
    without = held_out_powers(replace(one, measured=power + fan), None)
    known = held_out_powers(replace(one, measured=power, fan=fan), None)
    (new, old), (new_at_rest, old_at_rest) = fan_test(known, without, rest)
    assert not new.beats(old)
    assert new_at_rest.beats(old_at_rest)
    wrong = held_out_powers(replace(one, measured=power - fan, fan=fan), None)
    without = held_out_powers(replace(one, measured=power), None)
    assert not any(new.beats(old) for new, old in fan_test(wrong, without, rest))
    assert len(fan_test(wrong, without, rest & (np.cumsum(rest) < 20))) == 1


def test_energies_are_compared_with_those_of_the_whole_reading(data):
    """A fan of any constant power leaves the same errors, in W and over the same energy."""
    whole = sums(data, MODEL)
    known = replace(whole, measured=whole.measured - 50.0, fan=np.full(len(whole), 50.0))
    score, expected = (held_out_powers(one, None).score("constant") for one in (known, whole))
    assert score.energy_error == pytest.approx(expected.energy_error)
    assert score.rms == pytest.approx(expected.rms)


def test_blocks_that_the_fit_predicted_are_not_predicted_again(data):
    one = sums(data, MODEL)
    one = one[one.recording == 0]
    fit = fit_total(one)
    scores = held_out_powers(one, MODEL, fit).scores()
    assert scores == held_out_powers(one, MODEL).scores()
    worse = {name: values + 1e3 for name, values in fit.predicted.items()}
    changed = held_out_powers(one, MODEL, replace(fit, predicted=worse)).scores()
    assert {name for name in scores if changed[name] != scores[name]} == {*STRUCTURES, "identified"}


def test_whole_recordings_are_predicted_to_a_percent(data):
    held_out = held_out_powers(sums(data, MODEL), MODEL)
    scores = held_out.scores()
    assert held_out.kind == "recordings"
    assert scores["identified"].energy_error < 0.01
    assert scores["identified"].rms < 0.2 * scores["shaft"].rms < 0.2 * scores["constant"].rms
    assert scores["identified"].rms < 0.2 * scores["given"].rms


def test_losses_of_each_axis_hardly_differ_where_no_deviations_are_wanted(data):
    """Weights of outliers settle less closely there."""
    whole = sums(data, MODEL)
    fits = [fit_structure(replace(whole, deviations=want), "axis") for want in (True, False)]
    assert np.isfinite(fits[0].coefficients).all()
    np.testing.assert_allclose(fits[0].coefficients, fits[1].coefficients, rtol=5e-3)


def test_copper_losses_of_the_strong_axes_are_those_of_the_rig(data):
    """Inverters, rectifier and weak magnets of the rig add some percent, which copper takes."""
    fit = fit_total(sums(data, MODEL))
    assert fit.structure in ("axis_copper", "axis")
    true = 3.0 * PROFILE.resistance / PROFILE.torque_constant**2
    assert (np.abs(fit.coefficients[0, :3] / true[:3] - 1.0) < 0.2).all()


def test_the_grid_side_keeps_its_loss_and_the_dc_side_takes_the_rest(bags, tmp_path, capsys):
    out, report = tmp_path / "robot.yaml", tmp_path / "report.json"
    words = ["identify", "drives", *map(str, bags), "--model", "kr16", "--effort", "motor_torque"]
    assert main([*words, "--out", str(out), "--json", str(report)]) == 0
    assert "Measured power at the grid" in capsys.readouterr().out
    found = json.loads(report.read_text())["total"]
    cabinet = load(out).cabinet
    assert cabinet.loss_grid == MODEL.cabinet.loss_grid
    assert cabinet.loss_dc.value == pytest.approx(found["constant"] - cabinet.loss_grid.value)
    # the grid side is not identified, so neither is the rest of the sum
    assert (cabinet.loss_dc.tag, cabinet.loss_dc.std) == ("derived", None)
    assert "only the sum of the constants of both sides" in cabinet.loss_dc.source


def test_a_constant_below_the_grid_loss_is_not_made_negative(data):
    fit = fit_total(sums(data, MODEL))
    written, notes = with_total(
        MODEL, replace(fit, constant=100.0), MeterLocation.GRID, "virtual rig"
    )
    assert written.cabinet.loss_grid.value == 100.0
    assert written.cabinet.loss_dc.value == 0.0
    assert "less 100 W of the grid side" in notes[0]
