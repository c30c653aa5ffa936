"""Loss model and maps of drives, from drives whose losses are known."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import drive_reports
import robots
from drive_reports import contents
from driver_messages import Driver
from places import ROOT
from robot_energy.foundation.errors import LogFormatError, MissingTopicError, NotIdentifiableError
from robot_energy.model import load
from robot_energy.replay.bag_replay import replay
from robot_energy.timeline.blocks import MeterLocation
from robot_energy_cli.main import main
from robot_energy_identify.drives.drive_data import drive_data_of_logs
from robot_energy_identify.drives.drive_power import drive_topics
from robot_energy_identify.drives.drives import AxisSamples, fit_drives, with_drives
from robot_energy_identify.drives.efficiency_map import fitted_efficiency
from robot_energy_identify.drives.losses import (
    KNOTS,
    MIN_SHARE,
    fit_loss_map,
    fit_losses,
    loss_columns,
)
from robot_energy_identify.drives.total_power import fit_total, held_out_powers, with_total
from robot_energy_identify.drives.total_sums import sums
from robot_energy_identify.stats.regression import independent
from robot_energy_logs.recording import FileAccount, LogBlock, RecordingContents, write_bag
from robot_energy_rig import RigConfig, load_profile

TRUE = {"constant": 4.0, "copper": 5.0, "linear": 0.05, "quadratic": 4e-4}
SECONDS, RATE = 60.0, 200.0


def hand_made(seed=0, seconds=SECONDS, noise=2.0, torque_noise=0.0):
    """One drive with known losses, windings that warm up, and a noisy report."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 1.0 / RATE)
    phase = rng.uniform(0, 6, 4)
    velocity = 80 * np.sin(0.9 * time + phase[0]) + 60 * np.sin(2.3 * time + phase[1])
    torque = 1.5 * np.sin(1.7 * time + phase[2]) + 0.8 * np.sin(0.4 * time + phase[3])
    degc = 20.0 + time
    columns = loss_columns(velocity, torque, degc)
    loss = columns @ np.array(
        [TRUE[name] for name in ("constant", "copper", "linear", "quadratic")]
    )
    power = torque * velocity + loss + rng.normal(scale=noise, size=len(time))
    peaks = rng.random(len(time)) < 0.002
    power = power + np.where(peaks, 500.0, 0.0)
    torque = torque + rng.normal(scale=torque_noise, size=len(time))
    stamp = np.rint((1.0 + 1000.0 * seed + time) * 1e9).astype(np.int64)
    wide = [values[:, None] for values in (velocity, velocity, torque, degc)]
    return LogBlock(stamp, *wide, power + 30.0, power[:, None])


def data(*seeds, **options):
    held = contents(("axle",))
    logs = [(held, [hand_made(seed, **options)]) for seed in seeds]
    return drive_data_of_logs(logs, "newton_metre")


def test_known_losses_lie_inside_their_intervals():
    """Coverage of the stated 95 % over 15 noisy runs, every coefficient counted."""
    inside = total = 0
    for seed in range(15):
        losses = fit_drives(data(seed), compare=False).axes[0].losses
        for name, true in TRUE.items():
            total += 1
            inside += abs(losses.values[name] - true) <= losses.confidence[name]
            assert losses.values[name] == pytest.approx(true, abs=4.5 * losses.std[name])
    assert inside / total > 0.85


def test_noise_of_the_torque_does_not_hide_the_copper_loss():
    """At 0.3 of 1.7 N m (RMS 1.2) every sample by itself would read it 20 % low."""
    losses = fit_drives(data(1, torque_noise=0.3)).axes[0].losses
    assert losses.values["copper"] == pytest.approx(TRUE["copper"], rel=0.08)


def test_a_robot_at_one_speed_does_not_say_the_speed_terms_apart():
    block = hand_made()
    steady = replace(block, joint_velocity=np.full_like(block.joint_velocity, 50.0))
    losses = fit_drives(drive_data_of_logs([(contents(("axle",)), [steady])], "newton_metre"))
    axis = losses.axes[0]
    assert set(axis.losses.undetermined) == {"linear", "quadratic"}
    assert "linear, quadratic are not separated" in axis.notes[0]
    entry = axis.losses.entry("bag")
    assert entry.linear.tag == "assumed"
    assert entry.copper.tag == "identified"


def test_a_negative_loss_is_set_to_zero_and_named():
    columns = loss_columns(*np.random.default_rng(0).normal(size=(2, 400)), np.full(400, 20.0))
    target = columns @ np.array([3.0, 2.0, -1.0, 0.5])
    block = np.arange(400) // 20
    found = fit_losses(columns, target, block, ("constant", "copper", "linear", "quadratic"), "x")
    assert "linear" in found.negative
    assert found.values["linear"] == 0.0
    assert min(found.values.values()) >= 0.0


def test_independent_names_columns_that_others_explain():
    first = np.random.default_rng(2).normal(size=(50, 2))
    columns = np.column_stack([first, first @ [1.0, 2.0], np.zeros(50)])
    least = MIN_SHARE * np.linalg.norm(columns, axis=0)
    assert independent(columns, least) == [0, 1]
    assert independent(columns[:, [2, 1, 0, 3]], least) == [0, 1]


def test_without_a_comparison_the_fits_are_the_same():
    whole, quick = fit_drives(data(1)), fit_drives(data(1), compare=False)
    assert whole.comparisons
    assert not quick.comparisons
    assert quick.axes[0].losses.values == whole.axes[0].losses.values
    assert quick.chosen == "loss_model"


def test_without_measured_power_nothing_is_identified():
    block = hand_made()
    empty = replace(block, drive_power=np.full_like(block.drive_power, np.nan))
    with pytest.raises(NotIdentifiableError, match="expected measured electrical power"):
        fit_drives(drive_data_of_logs([(contents(("axle",)), [empty])], "newton_metre"))


def test_a_log_of_currents_is_refused():
    with pytest.raises(LogFormatError, match="no effort that is a torque"):
        drive_data_of_logs([(contents(("axle",)), [hand_made()])], "ampere")


@pytest.fixture(scope="module")
def rig():
    """Two runs of the rig with every effect on, drives that report with noise and peaks."""
    return drive_reports.drive_data([1, 2], duration=30.0, rate=100.0)


@pytest.fixture(scope="module")
def rig_fit(rig):
    return fit_drives(rig)


def test_the_rig_gives_the_order_of_the_paper_beyond_the_excited_range(rig_fit):
    """No efficiency is worst, then constant, maps, and the loss model best (paper B, 7.3)."""
    fit = rig_fit
    for comparison in fit.comparisons:
        scores = comparison.scores
        order = [scores[way].rms for way in ("none", "constant", "map", "losses")]
        assert order == sorted(order, reverse=True), comparison.split
        assert scores["losses"].accuracy > scores["none"].accuracy
    assert {c.split for c in fit.comparisons} == {"blocks", "recordings", "beyond"}
    assert fit.chosen == "loss_model"
    blocks = fit.comparisons[0].scores
    assert blocks["losses"].accuracy > 0.98


def test_the_rig_s_copper_loss_is_recovered_within_its_stated_confidence():
    """With what the loss model has no term for switched off; torque and speed stay noisy."""
    config = RigConfig().without("inverter", "demagnetisation")
    profile = load_profile("kr16")
    true = 3.0 * profile.resistance / profile.torque_constant**2
    inside = 0
    for seeds in ((5, 6), (7, 8)):
        fit = fit_drives(drive_reports.drive_data(list(seeds), config, duration=30.0, rate=100.0))
        for axis, copper in zip(fit.axes, true, strict=True):
            error = abs(axis.losses.values["copper"] - copper)
            inside += error <= axis.losses.confidence["copper"]
            assert error < 0.25 * copper
    assert inside >= 9  # of 12


def test_held_out_data_do_not_reach_the_fit(rig, rig_fit):
    """What lies in the held-out recording cannot change the prediction of it."""
    before = next(c for c in rig_fit.comparisons if c.split == "recordings").scores
    second = rig.recording == 1
    power = np.where(second[:, None], rig.drive_power + 1000.0, rig.drive_power)
    changed = fit_drives(replace(rig, drive_power=power))
    after = next(c for c in changed.comparisons if c.split == "recordings").scores
    # each recording is now predicted by a fit that is 1000 W off: errors of 1000 W in both
    assert after["losses"].rms == pytest.approx(1000.0, rel=0.05)
    assert before["losses"].rms < 50.0


def test_one_meter_for_all_drives_says_their_sum():
    """One axis with 30 W next to it: constants add up, the rest is the drive's own."""
    both = sums(data(1, 2), None)
    fit = fit_total(both)
    assert fit.constant == pytest.approx(30.0 + TRUE["constant"], abs=1.0)
    assert fit.coefficients[0, 0] == pytest.approx(TRUE["copper"], rel=0.05)
    held_out = held_out_powers(both, None)
    scores = held_out.scores()
    assert held_out.kind == "recordings"
    assert scores["identified"].rms < 0.5 * scores["shaft"].rms < 0.5 * scores["constant"].rms
    assert abs(scores["identified"].worst) < 0.03  # the peaks alone are 2 % of the energy


def test_the_held_out_recording_does_not_reach_the_fit_of_the_meter():
    both = sums(data(1, 2), None)
    shifted = replace(both, measured=both.measured + np.where(both.recording == 1, 500.0, 0.0))
    scores = held_out_powers(shifted, None).scores()
    assert scores["identified"].rms == pytest.approx(500.0, rel=0.1)


def test_a_drive_that_stands_in_the_rest_is_left_out_of_the_comparison():
    """The second axis moves in one recording only: the others cannot predict that one."""
    blocks = [hand_made(seed) for seed in (1, 2, 3)]
    for number, block in enumerate(blocks):
        columns = {
            name: np.hstack([value, value if number == 2 else np.zeros_like(value)])
            for name, value in block.__dict__.items()
            if value is not None and value.ndim == 2
        }
        blocks[number] = replace(block, **columns)
    held = contents(("axle", "lazy"))
    fit = fit_drives(drive_data_of_logs([(held, [block]) for block in blocks], "newton_metre"))
    found = next(c for c in fit.comparisons if c.split == "recordings")
    assert found.samples == 5 * len(blocks[0])  # lazy is not predicted in the third
    assert np.isfinite(found.scores["losses"].rms)


def test_the_order_of_the_array_is_that_of_the_named_joints(bags):
    names = load("kr16").joint_names
    plain = drive_topics("/drive_power").read(bags[0], names)
    turned = drive_topics("/drive_power", names[::-1]).read(bags[0], names)
    np.testing.assert_array_equal(turned.power, plain.power[:, ::-1])
    rotated = drive_topics("/drive_power", (*names[1:], names[0])).read(bags[0], names)
    np.testing.assert_array_equal(rotated.power[:, 0], plain.power[:, -1])
    with pytest.raises(MissingTopicError, match="lacks joint_a6"):
        drive_topics("/drive_power", names[:5]).read(bags[0], names)


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drives")
    return [drive_reports.record(folder / f"run_{seed}", seed, 20.0) for seed in (1, 2)]


def test_a_meter_at_the_dc_bus_gives_a_model_that_predicts_it(rig):
    model = load("kr16")
    total = sums(rig, model)
    fit = fit_total(total)
    written, notes = with_total(model, fit, MeterLocation.DC_BUS, "rig")
    assert "one sum" in notes[0]
    again = sums(rig, written)
    predicted = again.given + written.cabinet.loss_dc.value
    np.testing.assert_allclose(
        predicted,
        again.shaft + fit.constant + np.einsum("krj,rj->k", total.terms, fit.coefficients),
        rtol=1e-9,
    )
    assert np.sum(predicted) == pytest.approx(np.sum(total.measured), rel=0.02)


@pytest.mark.long
def test_the_command_writes_a_model_that_the_monitor_runs(bags, tmp_path, capsys):
    out, plot = tmp_path / "robot.yaml", tmp_path / "maps.png"
    words = ["identify", "drives", *map(str, bags), "--model", "kr16", "--effort", "motor_torque"]
    words += ["--drive-power", "/drive_power", "--out", str(out), "--plot", str(plot)]
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert "constant 87.5 %" in printed
    assert "measured drives and a constant" in printed
    assert plot.read_bytes().startswith(b"\x89PNG")
    model = load(out)
    assert model.drive == "loss_model"
    assert {joint.losses.copper.tag for joint in model.joints} == {"identified"}
    assert replay(bags[0], model).account.registers.cabinet("grid_import") > 0


def test_the_command_finds_and_undoes_the_low_pass_of_a_meter(tmp_path):
    """The meter of the drawn plant has one of 0.3 s."""
    report = tmp_path / "report.json"
    bags = [str(ROOT / "bags" / f"drawn_train_{name}") for name in ("cold", "warm")]
    words = ["identify", "drives", *bags, "--model", "kr16", "--effort", "motor_torque"]
    assert main([*words, "--json", str(report)]) == 0
    total = json.loads(report.read_text())["total"]
    assert total["meter_time_constant"]["applied"] == pytest.approx(0.3, abs=0.02)
    assert total["ways"]["identified"]["rms"] < 0.5 * total["ways"]["shaft"]["rms"]


def test_the_command_takes_the_low_pass_of_the_maps(tmp_path):
    report, bag = tmp_path / "report.json", drive_reports.record(tmp_path / "bag", 1, 4.0)
    words = ["identify", "drives", str(bag), "--model", "kr16", "--effort", "motor_torque"]
    words += ["--drive-power", "/drive_power", "--json", str(report)]
    maps = []
    for cutoff, options in ((5.0, []), (1.0, ["--cutoff", "1"])):
        assert main([*words, *options]) == 0
        found = json.loads(report.read_text())["drives"]
        assert found["cutoff"] == cutoff
        maps.append(found["axes"][0]["map"])
    assert maps[0] != maps[1]


def test_the_map_is_written_where_it_is_better(rig_fit):
    fit = replace(rig_fit, chosen="efficiency_map")
    model = with_drives(load("kr16"), fit, "rig")
    assert model.drive == "efficiency_map"
    assert all(len(joint.efficiency_map.efficiency) <= 500 for joint in model.joints)


def moved(seed=3, size=20000):
    """Speeds and torques of one drive; windings at 20 degC."""
    rng = np.random.default_rng(seed)
    velocity, torque = rng.uniform(-100.0, 100.0, size), rng.uniform(-3.0, 3.0, size)
    return velocity, torque, np.full(size, 20.0), np.arange(size) // 5


def test_a_loss_map_finds_losses_of_any_form():
    """An inverter's loss in |I|, iron loss in |w|^1.5, and a step the loss model cannot have."""
    velocity, torque, degc, window = moved()

    def loss(speed, load):
        return 4.0 + 6.0 * load + 0.05 * speed**1.5 + 8.0 * np.clip(load - 1.0, 0.0, 0.5)

    noise = np.random.default_rng(4).normal(scale=3.0, size=len(velocity))
    power = torque * velocity + loss(np.abs(velocity), np.abs(torque)) + noise
    found = fit_loss_map(AxisSamples(velocity, torque, degc, power, window))
    at = np.asarray(found.motor_velocity)[:, None], np.asarray(found.motor_torque)[None, :]
    error = np.asarray(found.loss) - loss(*at)
    assert np.abs(error).max() < 2.0  # at a corner of the map, of losses up to 76 W
    assert abs(error[0, 0]) < 1.0  # at rest without load
    assert np.sqrt(np.mean(error**2)) < 0.8


@pytest.mark.parametrize("of", ["speed", "torque"])
def test_a_loss_map_never_falls_where_noise_does(of):
    """Losses that fall are not physical: the fit under bounds is a constant, their mean."""
    velocity, torque, degc, window = moved()
    falling = 20.0 - (0.1 * np.abs(velocity) if of == "speed" else 5.0 * np.abs(torque))
    power = torque * velocity + falling
    loss = np.asarray(fit_loss_map(AxisSamples(velocity, torque, degc, power, window)).loss)
    np.testing.assert_allclose(loss, falling.mean(), atol=0.1)
    assert (np.diff(loss, axis=0) >= 0.0).all()
    assert (np.diff(loss, axis=1) >= 0.0).all()


def test_a_loss_map_competes_and_takes_over_only_where_it_is_better():
    """Losses of the loss model's own form leave it in place; a loss in |tau| does not."""
    own = data(1, 2, torque_noise=0.02)
    fit = fit_drives(own)
    assert fit.chosen == "loss_model"
    assert fit.comparisons[0].scores["loss_map"].rms < 1.1 * fit.comparisons[0].scores["losses"].rms
    added = 40.0 * np.abs(np.round(own.motor_torque))  # steps of the load, no parabola
    other = replace(own, drive_power=own.drive_power + added)
    fit = fit_drives(other)
    assert fit.chosen == "loss_map"
    model = with_drives(robots.two_link().changed(joints=robots.two_link().joints[:1]), fit, "test")
    assert model.drive == "loss_map"
    assert len(model.joints[0].loss_map.loss) == KNOTS
    given = model.cabinet.loss_dc.value + model.cabinet.loss_grid.value
    assert model.constant_power() == given + model.joints[0].loss_map.loss[0][0]


def test_a_drive_that_stands_has_no_loss_map():
    velocity, torque, degc, window = moved()
    still = np.zeros_like(velocity)
    with pytest.raises(NotIdentifiableError, match="loss map"):
        fit_loss_map(AxisSamples(still, torque, degc, torque, window))
    with pytest.raises(NotIdentifiableError, match="loss map"):
        fit_loss_map(AxisSamples(*(each[:50] for each in (velocity, torque, degc, torque, window))))


def test_an_array_of_another_length_is_refused_by_name(bags, capsys):
    words = ["identify", "drives", str(bags[0]), "--model", "kr16", "--drive-power", "/drive_power"]
    assert main([*words, "--drive-joints", *load("kr16").joint_names, "tool"]) == 2
    assert "expected 7 values, one per drive" in capsys.readouterr().err


def test_a_bag_without_any_power_says_what_to_record(tmp_path, capsys):
    rig, output = drive_reports.run(1, 3.0)
    block = drive_reports.log_block(output, drive_reports.electrical(output.truth), False)
    bag = tmp_path / "bag"
    account = FileAccount(path=Path("rig.csv"))
    write_bag(bag, RecordingContents(rig.joint_names, True, True, True), [block], [account])
    assert main(["identify", "drives", str(bag), "--model", "kr16"]) == 2
    assert "Name the topic of the drives with --drive-power" in capsys.readouterr().err


def test_the_fair_baseline_is_the_constant_that_fits_best():
    """From power made with an efficiency of 0.6, both ways."""
    shaft = np.linspace(-40.0, 100.0, 500)
    power = np.where(shaft > 0.0, shaft / 0.6, shaft * 0.6)
    assert fitted_efficiency(shaft, power) == pytest.approx(0.6, abs=1e-4)
    scores = {part.split: part.scores for part in fit_drives(data(0, 1)).comparisons}
    for split in ("blocks", "recordings"):
        ways = scores[split]
        assert ways["constant_fitted"].rms <= 1.001 * ways["constant"].rms


def test_a_log_and_a_model_are_refused_together(capsys):
    words = ["identify", "drives", "--log", "x.csv", "--mapping", "m.yaml", "--model", "kr16"]
    assert main(words) == 2
    assert "a log is used without a model" in capsys.readouterr().err


def test_a_test_bench_without_positions_and_times_is_enough(tmp_path):
    """Speed, torque and power of one drive, row after row at a rate: the loss model behind them is
    found, P = tau w + 4 + 0.02 |w| + 0.7 tau^2 (copper and friction of the drive)."""
    rng = np.random.default_rng(5)
    rows = []
    for _ in range(40):  # steady points, half a second each
        speed, torque = rng.uniform(-200, 200), rng.uniform(-5, 5)
        power = torque * speed + 4 + 0.02 * abs(speed) + 0.7 * torque**2
        rows += [f"{speed:.6f};{torque:.6f};{power:.6f}"] * 50
    log, mapping = tmp_path / "bench.csv", tmp_path / "bench.yaml"
    log.write_text("\n".join(rows))
    mapping.write_text(
        "schema_version: 1\ncolumn_names: [w, tau, p]\ntime: {rate: 100}\njoints:\n"
        "  names: [drive]\n  velocity: {columns: [w], unit: rad_per_s}\n"
        "  effort: {columns: [tau], unit: newton_metre}\n"
        "  drive_power: {columns: [p], unit: W}\n"
    )
    report = tmp_path / "report.json"
    words = ["identify", "drives", "--log", str(log), "--mapping", str(mapping)]
    assert main([*words, "--json", str(report)]) == 0
    (axis,) = json.loads(report.read_text())["drives"]["axes"]
    expected = {"constant": 4.0, "linear": 0.02, "quadratic": 0.0, "copper": 0.7}
    assert axis["losses"]["values"] == pytest.approx(expected, rel=1e-5, abs=1e-9)
    assert main(["identify", "dynamics", *words[2:]]) == 2


def test_currents_and_voltages_of_a_log_are_its_drive_power(tmp_path):
    """The same drive twice: with its power, and with ``P = 3/2 (i_q u_q + i_d u_d)``, paper B
    eq. 1, split in d and q at random and in other units."""
    rng = np.random.default_rng(6)
    rows = []
    for _ in range(40):
        speed, torque = rng.uniform(-200, 200), rng.uniform(1, 5)
        power = torque * speed + 4 + 0.02 * abs(speed) + 0.7 * torque**2
        current_d, voltage_d, current_q = rng.uniform(-1, 1), rng.uniform(-40, 40), torque / 0.6
        voltage_q = (power / 1.5 - current_d * voltage_d) / current_q
        values = (speed, torque, power, 1e3 * current_d, current_q, voltage_d, voltage_q)
        rows += [";".join(f"{value:.9g}" for value in values)] * 50
    log = tmp_path / "bench.csv"
    log.write_text("\n".join(rows))
    quantities = {
        "power": "  drive_power: {columns: [p], unit: W}\n",
        "dq": "  current_d: {columns: [id], unit: milliampere}\n"
        "  current_q: {columns: [iq], unit: ampere}\n"
        "  voltage_d: {columns: [ud], unit: V}\n"
        "  voltage_q: {columns: [uq], unit: V}\n",
    }
    quantities["half"] = "".join(quantities["dq"].splitlines(keepends=True)[:2])
    found = {}
    for name, lines in quantities.items():
        mapping, report = tmp_path / f"{name}.yaml", tmp_path / f"{name}.json"
        mapping.write_text(
            "schema_version: 1\ncolumn_names: [w, tau, p, id, iq, ud, uq]\ntime: {rate: 100}\n"
            "joints:\n  names: [drive]\n  velocity: {columns: [w], unit: rad_per_s}\n"
            "  effort: {columns: [tau], unit: newton_metre}\n" + lines
        )
        words = ["identify", "drives", "--log", str(log), "--mapping", str(mapping)]
        code = main([*words, "--json", str(report)])
        assert code == (2 if name == "half" else 0)
        if code == 0:
            (axis,) = json.loads(report.read_text())["drives"]["axes"]
            found[name] = axis["losses"]["values"]
    assert found["dq"] == pytest.approx(found["power"], rel=1e-6, abs=1e-6)


def test_currents_and_voltages_of_a_bag_are_its_drive_power(bags, tmp_path):
    """Four topics that were made from the power of a recording give that power back."""
    names = load("kr16").joint_names
    plain = drive_topics("/drive_power").read(bags[0], names)
    direct, across = 0.3 * plain.power, 0.7 * plain.power
    values = {"/i_d": np.full_like(direct, -2.0), "/i_q": np.full_like(direct, 5.0)}
    values |= {"/u_d": direct / (1.5 * -2.0), "/u_q": across / (1.5 * 5.0)}
    driver = Driver(names)
    stamps = plain.stamp_ns.tolist()
    bag = driver.write(
        tmp_path,
        [
            driver.array(stamp, topic, row, "std_msgs")
            for topic, rows in values.items()
            for stamp, row in zip(stamps, rows, strict=True)
        ],
    )
    computed = drive_topics(tuple(values)).read(bag, names)
    assert np.ptp(computed.stamp_ns - plain.stamp_ns) == 0
    assert computed.power == pytest.approx(plain.power, rel=1e-9)
    rms = drive_topics(tuple(values), scaling="rms").read(bag, names)
    assert rms.power == pytest.approx(2.0 * plain.power, rel=1e-9)
    with pytest.raises(MissingTopicError):
        drive_topics(("/i_d", "/i_q"))
