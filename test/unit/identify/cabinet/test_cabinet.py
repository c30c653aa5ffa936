"""Constant losses of the cabinet, from a rig whose losses are known."""

import re
from dataclasses import replace

import numpy as np
import pytest

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import load
from robot_energy.timeline.blocks import MeterLocation, MeterMeaning
from robot_energy_identify.cabinet.cabinet import Level, fit_cabinet, with_cabinet
from robot_energy_identify.cabinet.phase_readings import holding
from robot_energy_identify.data.recordings import Recording, read_recording
from robot_energy_plan.motion import random_program
from robot_energy_rig import RigConfig, Sensors, VirtualRig, load_profile
from robot_energy_rig.record import outputs, record

MODEL = load("kr16")


def rig(dwell, meaning=MeterMeaning.MEAN_OVER_INTERVAL):
    profile = load_profile("kr16")
    limits = profile.motion_limits(profile.mechanics()[0])
    program = random_program(limits, 3, dwell=dwell)
    return VirtualRig(profile, program, RigConfig(sensors=Sensors(meter_meaning=meaning)), 3, 40.0)


def recording(folder, dwell, meaning=MeterMeaning.MEAN_OVER_INTERVAL, duration=60.0):
    record(rig(dwell, meaning), duration, folder)
    return read_recording(folder, MODEL)


def true_hold(dwell):
    """Mean power of the plant over its rests, half a second after each motion. [W]"""
    truth = [output.truth for output in outputs(rig(dwell), 60.0)]
    still = np.concatenate([(part.joint_velocity == 0.0).all(axis=1) for part in truth])
    power = np.concatenate([part.grid_power for part in truth])
    cuts = np.flatnonzero(np.diff(still)) + 1
    rests = [
        part[125:].mean()  # 0.5 s at 250 Hz
        for part, rest in zip(np.split(power, cuts), np.split(still, cuts), strict=True)
        if rest[0] and len(rest) > 250
    ]
    assert len(rests) > 5
    return float(np.mean(rests))


@pytest.mark.parametrize(
    "meaning",
    [MeterMeaning.MEAN_OVER_INTERVAL, MeterMeaning.INSTANTANEOUS, MeterMeaning.CUMULATIVE],
)
def test_both_losses_are_found_whatever_the_meter_reports(tmp_path, meaning):
    """The rig's grid side draws 250 W; its meter is of class 0.5."""
    fit = fit_cabinet([recording(tmp_path / "bag", 2.0, meaning)])
    assert fit.loss_grid == pytest.approx(250.0, rel=0.01)
    assert fit.hold.power == pytest.approx(true_hold(2.0), rel=0.03)
    assert fit.loss_dc == pytest.approx(fit.hold.power - fit.loss_grid)
    assert fit.hold.events > 5
    assert fit.generating.events > 5


def test_readings_while_the_joint_states_stop_are_not_at_rest(tmp_path):
    """They stop in one rest and go on in another; the robot moves meanwhile."""
    whole = recording(tmp_path / "bag", 2.0)
    edges = np.flatnonzero(np.diff(holding(whole).astype(int), prepend=0, append=0))
    middles = edges.reshape(-1, 2).mean(axis=1).astype(int)
    stop, resume = middles[2], middles[-3]
    rows = np.delete(np.arange(len(whole)), slice(stop, resume))
    later = rows >= resume
    torque, power = (
        replace(block[rows], segment=block.segment[rows] + later)
        for block in (whole.torque, whole.power)
    )
    gap = replace(whole, torque=torque, power=power)
    stamp, begin, end = whole.meter.stamp_ns, *whole.power.stamp_ns[[stop, resume]]
    silent = whole.meter[(stamp <= begin) | (stamp >= end)]
    fit, known = (fit_cabinet([part]) for part in (gap, replace(gap, meter=silent)))
    assert fit.hold.readings == known.hold.readings > 20
    assert fit.hold.power == pytest.approx(known.hold.power)
    assert fit.loss_grid == pytest.approx(known.loss_grid)


def test_without_rest_only_the_grid_side_is_said(tmp_path):
    fit = fit_cabinet([recording(tmp_path / "bag", 0.2)])
    assert fit.hold is None
    assert fit.loss_dc is None
    assert fit.loss_grid == pytest.approx(250.0, rel=0.01)
    assert "fewer than 5 readings lie inside rest" in fit.notes[0]
    assert re.search(r"the joints rest \d+\.\d s in all, \d+ times, 0\.\d s", fit.notes[0])
    model = with_cabinet(MODEL, fit, "bag")
    assert model.cabinet.loss_dc == MODEL.cabinet.loss_dc
    assert model.cabinet.loss_grid.tag == "identified"


def test_without_braking_the_sum_is_said_and_the_split_is_said_to_be_kept(tmp_path):
    whole = recording(tmp_path / "bag", 2.0)
    power = whole.power
    tame = Recording(
        whole.path,
        whole.model,
        whole.torque,
        type(power)(**{**power.__dict__, "bus_power": np.abs(power.bus_power)}),
        whole.meter,
        whole.origin,
        whole.problems,
    )
    fit = fit_cabinet([tame])
    assert fit.generating is None
    assert fit.loss_grid == pytest.approx(fit.hold.power - MODEL.cabinet.loss_dc.value)
    assert "HOLD determines the sum" in fit.notes[0]


def test_a_meter_on_the_dc_bus_says_the_dc_side_only(tmp_path):
    whole = recording(tmp_path / "bag", 2.0)
    meter = type(whole.meter)(**{**whole.meter.__dict__, "location": MeterLocation.DC_BUS})
    at_bus = type(whole)(**{**whole.__dict__, "meter": meter})
    fit = fit_cabinet([at_bus])
    assert fit.loss_grid is None
    assert fit.loss_dc == pytest.approx(fit.hold.power)


def test_no_meter_is_refused_with_what_to_record(tmp_path):
    whole = recording(tmp_path / "bag", 0.2, duration=3.0)
    with pytest.raises(NotIdentifiableError, match="no recording has a power meter"):
        fit_cabinet([type(whole)(**{**whole.__dict__, "meter": None})])


def test_rest_is_found_under_noise_as_great_as_the_standstill_velocity(tmp_path):
    """2 mrad/s on every joint, as differentiated encoders give; the phases find hardly any rest."""
    whole = recording(tmp_path / "bag", 2.0)
    quiet = fit_cabinet([whole])
    random = np.random.default_rng(0)
    noise = random.normal(0.0, 2e-3, whole.torque.joint_velocity.shape)
    velocity = whole.torque.joint_velocity + noise
    loud = replace(whole, torque=replace(whole.torque, joint_velocity=velocity))
    assert MODEL.joints[0].standstill_velocity == 2e-3
    assert (np.abs(velocity) < 2e-3).all(axis=1).mean() < 0.1
    fit = fit_cabinet([loud])
    assert fit.hold.events >= quiet.hold.events - 1
    assert fit.hold.power == pytest.approx(quiet.hold.power, rel=2e-3)
    assert fit.loss_dc == pytest.approx(quiet.loss_dc, rel=0.02)


def test_two_measurements_of_one_power_are_joined_by_their_variances():
    """Weights 1/12^2 and 1/19^2 give 465 + 52 * 144 / 505 = 479.83 W; 1 / sqrt(their sum) is
    10.15 W, and chi squared is 52^2 / 505 = 5.35, so that 10.15 * sqrt(5.35) = 23.48 W."""
    hold = Level(465.0, 12.0, 46, 17, 184.6, {"meter": 2.0})
    both = hold.joined(Level(517.0, 19.0, 12, 7, 102.3, {"meter": 3.0}))
    assert both.power == pytest.approx(479.83, abs=0.01)
    assert both.std == pytest.approx(23.48, abs=0.01)
    assert both.moves == {"meter": pytest.approx(2.0 + 144.0 / 505.0)}
    assert (both.readings, both.events) == (58, 24)
    alike = hold.joined(Level(470.0, 19.0, 12, 7, 0.0))
    assert alike.std == pytest.approx(10.15, abs=0.01)  # chi squared is 0.05
    exact = Level(465.0, 0.0, 5, 1, 0.0).joined(Level(517.0, 0.0, 5, 1, 0.0))
    assert (exact.power, exact.std) == (491.0, 26.0)
    unknown = Level(465.0, np.inf, 5, 1, 0.0).joined(Level(517.0, 19.0, 5, 1, 0.0))
    assert (unknown.power, unknown.std) == (517.0, 19.0)
