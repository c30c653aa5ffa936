"""A drive's power that arrives late or early is found and brought back."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import drive_reports
from drive_reports import contents
from robot_energy_cli.main import main
from robot_energy_identify.drives.delays import estimate_power_delay, with_delay_undone
from robot_energy_identify.drives.drive_data import drive_data_of_logs
from robot_energy_identify.drives.drives import fit_drives
from robot_energy_logs.recording import FileAccount, LogBlock, write_bag

PERIOD = 0.004  # s, of the rig's joint states


@pytest.fixture(scope="module")
def runs():
    """Two runs of the virtual rig, every effect on, with the power its drives report."""
    found = []
    for seed in (1, 2):
        rig, output = drive_reports.run(seed, 20.0)
        power = drive_reports.reported(drive_reports.electrical(output.truth), seed)
        found.append((rig.joint_names, drive_reports.log_block(output, power, motor_side=True)))
    return found


def late(block, samples):
    """The same log with the power so many samples late; what is not yet known is missing."""
    power = np.full_like(block.drive_power, np.nan)
    if samples >= 0:
        power[samples:] = block.drive_power[: len(power) - samples]
    else:
        power[:samples] = block.drive_power[-samples:]
    return replace(block, drive_power=power)


def samples_of(runs, delay=0):
    return drive_data_of_logs(
        [(contents(names), [late(block, delay)]) for names, block in runs], "newton_metre"
    )


@pytest.mark.parametrize("samples", [-4, 1, 5, 13])
def test_a_known_delay_is_found_to_a_tenth_of_a_sample_and_undone(runs, samples):
    data = samples_of(runs, samples)
    found = estimate_power_delay(data)
    assert found.value == pytest.approx(samples * PERIOD, abs=0.1 * PERIOD)
    assert abs(found.value - samples * PERIOD) < max(10.0 * found.std, 0.02 * PERIOD)
    assert found.applied == found.value
    back = with_delay_undone(data, samples * PERIOD)
    error = np.abs(back.drive_power - samples_of(runs).drive_power)[20:4900]
    assert np.median(error) < 0.05  # W; stamps jitter, so noise and peaks move a little
    assert np.quantile(error, 0.9) < 1.0


def test_recordings_of_other_sample_periods_do_not_change_a_delay(runs):
    (names, block), (others, other) = runs
    every_second = late(other, 6)[::2]
    data = drive_data_of_logs(
        [(contents(names), [late(block, 6)]), (contents(others), [every_second])], "newton_metre"
    )
    assert estimate_power_delay(data).value == pytest.approx(6 * PERIOD, abs=0.1 * PERIOD)


def test_power_in_time_is_left_as_it_is(runs):
    data = samples_of(runs)
    found = estimate_power_delay(data)
    assert abs(found.value) < 0.05 * PERIOD
    assert found.applied == 0.0
    assert with_delay_undone(data, found.applied) is data


@pytest.mark.long
def test_undoing_a_delay_gives_back_the_quality_of_the_fit(runs):
    def rms(data):
        return fit_drives(data).comparisons[0].scores["losses"].rms

    one = runs[:1]
    data = samples_of(one, 8)
    best = rms(samples_of(one))
    assert rms(data) > 1.5 * best
    assert rms(with_delay_undone(data, estimate_power_delay(data).applied)) < 1.05 * best


def test_a_delay_beyond_the_range_is_said_and_not_half_undone(runs):
    found = estimate_power_delay(samples_of(runs, 60))
    assert found.at_edge
    assert found.applied == 0.0


def test_noise_alone_has_no_delay(runs):
    data = samples_of(runs)
    noise = np.random.default_rng(0).normal(scale=50.0, size=data.drive_power.shape)
    assert estimate_power_delay(replace(data, drive_power=noise)).applied == 0.0


def test_too_few_samples_say_no_delay(runs):
    names, block = runs[0]
    parts = {
        name: value if value is None else value[:150] for name, value in block.__dict__.items()
    }
    data = drive_data_of_logs([(contents(names), [LogBlock(**parts)])], "newton_metre")
    assert estimate_power_delay(data) is None


def test_seconds_of_motion_are_not_asked_for_long_delays(runs):
    names, block = runs[0]
    parts = {
        name: value if value is None else value[:1000] for name, value in block.__dict__.items()
    }
    data = drive_data_of_logs([(contents(names), [LogBlock(**parts)])], "newton_metre")
    assert estimate_power_delay(data).span == pytest.approx(0.04, rel=0.01)  # of 4 s


def test_gaps_are_not_bridged(runs):
    data = samples_of(runs)
    power = data.drive_power.copy()
    power[1000:1100, 2] = np.nan
    back = with_delay_undone(replace(data, drive_power=power), 5 * PERIOD).drive_power
    assert np.isnan(back[994:1096, 2]).sum() >= 100
    assert np.isfinite(back[994:1096, 1]).all()


@pytest.mark.long
def test_the_command_reports_the_delay_of_a_bag(tmp_path, capsys):
    """Messages of the array are recorded 32 ms after the joint states that they belong to."""
    rig, output = drive_reports.run(1, 20.0)
    power = drive_reports.reported(drive_reports.electrical(output.truth), 1)
    block = late(drive_reports.log_block(output, power, motor_side=False), 8)
    bag, report = tmp_path / "bag", tmp_path / "report.json"
    write_bag(bag, contents(rig.joint_names), [block], [FileAccount(path=Path("rig.csv"))])
    words = ["identify", "drives", str(bag), "--model", "kr16", "--effort", "motor_torque"]
    words += ["--drive-power", "/drive_power"]
    assert main([*words, "--json", str(report)]) == 0
    assert "would lower the held-out error by" in capsys.readouterr().out
    found = json.loads(report.read_text())["delay"]
    assert found["value"] == pytest.approx(8 * PERIOD, abs=PERIOD)
    assert found["applied"] == found["value"]
