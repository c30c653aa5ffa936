"""What the user says of a meter holds in identification as it does live and in replay.

One run of the virtual rig is written with its meter spoken in several ways; every way must
identify the same cabinet and the same energy behind the drives.
"""

from __future__ import annotations

import numpy as np
import pytest

from robot_energy.bag import BagReader, BagWriter
from robot_energy.bag.cdr.types import typestore
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.inputs.meter.meter import MeterIngest
from robot_energy.messages.fields import METER_TOPIC
from robot_energy.model import load
from robot_energy.timeline.blocks import MeterBlock
from robot_energy_identify.cabinet.cabinet import fit_cabinet
from robot_energy_identify.data.recordings import read_recording
from robot_energy_identify.drives.drive_data import drive_data
from robot_energy_identify.drives.total_sums import sums
from robot_energy_plan.motion import random_program
from robot_energy_rig import RigConfig, VirtualRig, load_profile
from robot_energy_rig.record import record

FLOAT64 = "std_msgs/msg/Float64"
STORE = typestore()
MODEL = load("kr16")
SECONDS, DWELL, INTERVAL = 160.0, 8.0, 0.1
WRAP = 20e3  # J
MEAN = f"meaning: mean_over_interval, interval: {INTERVAL}, unit: W"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run with long rests: its folder, its messages but those of the meter, its readings."""
    folder = tmp_path_factory.mktemp("meter_settings")
    profile = load_profile("kr16")
    program = random_program(profile.motion_limits(profile.mechanics()[0]), 3, dwell=DWELL)
    record(
        VirtualRig(profile, program, RigConfig(), 3, 40.0, rate_hz=100.0), SECONDS, folder / "rig"
    )
    reader = BagReader(folder / "rig")
    ingest = MeterIngest()
    readings = [ingest.step([part[METER_TOPIC]]) for part in reader.parts([METER_TOPIC])]
    others = {name: info.msgtype for name, info in reader.topics.items() if name != METER_TOPIC}
    rows = [
        (int(time), topic, batch.row(row))
        for part in reader.parts(list(others))
        for topic, batch in part.items()
        for row, time in enumerate(batch.log_time_ns)
    ]
    return folder, others, rows, MeterBlock.concatenate([part for part in readings if part])


def recording(run, name, meter, values, every=1, node=""):
    """The run with its meter as numbers, read with the parameter file of a node."""
    folder, others, rows, readings = run
    kind = STORE.types[FLOAT64]
    numbers = [
        (int(stamp), "/number", bytes(STORE.serialize_cdr(kind(float(value)), FLOAT64)))
        for stamp, value in list(zip(readings.stamp_ns, values, strict=True))[::every]
    ]
    with BagWriter(folder / name) as bag:
        for topic, msgtype in {**others, "/number": FLOAT64}.items():
            bag.add_topic(topic, msgtype)
        for time, topic, row in sorted([*rows, *numbers]):
            bag.write(topic, np.array([time]), [row])
    file = folder / f"{name}.yaml"
    file.write_text(
        "/**:\n  ros__parameters:\n"
        f"    meter: {{topic: /number, type: {FLOAT64}, location: grid, {meter}}}\n{node}"
    )
    inputs, notes = read_inputs(file)
    assert not notes
    return read_recording(folder / name, MODEL, inputs=inputs)


def counted(run):
    return np.cumsum(run[3].power * INTERVAL)


def same_cabinet(one, other, rel):
    """Both losses and what they rest on; what is not determined is said by neither."""
    found, expected = (
        [np.nan if value is None else value for value in (fit.loss_grid, fit.loss_dc)]
        for fit in (fit_cabinet([one]), fit_cabinet([other]))
    )
    assert found == pytest.approx(expected, rel=rel, nan_ok=True)
    holds = [fit_cabinet([each]).hold for each in (one, other)]
    assert holds[0].power == pytest.approx(holds[1].power, rel=rel)
    assert holds[0].events == holds[1].events


def behind_drives(recording):
    """Mean power that the meter shows while the drives are known. [W]"""
    found = sums(drive_data([recording], [None], measured_torque=False), MODEL)
    return float(found.measured @ found.duration / found.duration.sum())


def compared(recording):
    """Energy that is compared once the readings were moved, which compares them again."""
    return sum(part.measured.sum() for part in recording.with_meter_earlier(1e-6).compared)


def test_a_counter_that_wraps_is_no_counter_that_resets(run):
    """Each reset would leave a hole of the five seconds that confirm it."""
    plain = recording(run, "plain", "unit: J", counted(run))
    wrapping = recording(run, "wrapping", f"unit: J, wraps_at: {WRAP}", np.mod(counted(run), WRAP))
    assert counted(run)[-1] > 3 * WRAP
    same_cabinet(wrapping, plain, 0.03)  # five seconds around each wrap are one reading
    assert behind_drives(wrapping) == pytest.approx(behind_drives(plain), rel=0.02)
    assert compared(wrapping) == pytest.approx(compared(plain), rel=1e-9)


def test_a_slow_meter_is_bridged_as_far_as_the_user_says(run):
    """A counter that is read every five seconds is a meter of means over five seconds."""
    energy, every = counted(run), 50
    slow = recording(run, "slow", "unit: J", energy, every, "    meter_max_gap: 6.0\n")
    means = np.diff(energy[::every], prepend=energy[0]) / (every * INTERVAL)
    same = recording(
        run,
        "means",
        f"unit: W, meaning: mean_over_interval, interval: {every * INTERVAL}",
        np.repeat(means, every)[: len(energy)],
        every,
    )
    same_cabinet(slow, same, 1e-6)
    assert compared(slow) == pytest.approx(compared(same), rel=1e-6)


def test_a_meter_with_turned_sign_and_a_scale_is_the_same_meter(run):
    power = run[3].power
    straight = recording(run, "straight", MEAN, power)
    turned = recording(run, "turned", f"{MEAN}, sign: load_negative, scale: 2.0", -0.5 * power)
    same_cabinet(turned, straight, 1e-9)


def test_readings_above_the_greatest_power_are_refused_as_in_replay(run):
    power = run[3].power.copy()
    straight = recording(run, "clean", MEAN, power)
    power[::40] = 90e3
    spoilt = recording(run, "spoilt", f"{MEAN}, max_power: 50000.0", power)
    same_cabinet(spoilt, straight, 0.02)
    assert behind_drives(spoilt) == pytest.approx(behind_drives(straight), rel=0.02)
