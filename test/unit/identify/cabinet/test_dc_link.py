"""Energy of the DC link: links solved by hand, what is refused, and the virtual rig."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import robots
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import load, save, validate
from robot_energy.timeline.blocks import EffortMeaning, MeterBlock, MeterLocation, MeterMeaning
from robot_energy_identify.cabinet.dc_link import fit_link, with_link
from robot_energy_identify.data.bags import Bag, folds_of
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.run_all import identify_everything
from robot_energy_identify.stats.held_out_energy import held_out_energy
from robot_energy_plan.motion import random_program, tool_above
from robot_energy_rig import RigConfig, VirtualRig, load_profile
from robot_energy_rig.record import record

PERIOD = 0.002  # s
LOSS_GRID, LOSS_DC = 200.0, 100.0
DRIVE, BRAKE, AGAIN = 900.0, -1100.0, 400.0  # W at the bus: demand 1000, -1000, 500
REST_DEMAND = LOSS_DC


def model_of(**cabinet):
    data = robots.two_link_data()
    data["cabinet"] = {
        "loss_grid": robots.figure(LOSS_GRID),
        "loss_dc": robots.figure(LOSS_DC),
        **cabinet,
    }
    return validate(data, "test")


def solved_by_hand(energy, braking, rests, interval=0.1):
    """One recording: drive 0.6 s, brake, drive 0.5 s, rest; the grid's power worked out.

    While braking the link takes 1000 W until it is full; the grid gives the loss of its own
    side alone. Then the link gives 500 W, and at rest 100 W, until it is empty.
    """
    bus, grid = [], []  # (seconds, watt)
    for seconds, rest in zip(braking, rests, strict=True):
        bus += [(0.6, DRIVE), (seconds, BRAKE), (0.5, AGAIN), (rest, 0.0)]
        stored = min(1000.0 * seconds, energy)
        first = min(0.5, stored / 500.0)
        second = min(rest, (stored - 500.0 * first) / REST_DEMAND)
        assert stored <= 500.0 * first + REST_DEMAND * second + 1e-9  # empty before it drives on
        grid += [
            (0.6, LOSS_GRID + 1000.0),
            (seconds + first, LOSS_GRID),
            (0.5 - first, LOSS_GRID + 500.0),
            (second, LOSS_GRID),
            (rest - second, LOSS_GRID + REST_DEMAND),
        ]
    time = np.arange(0.0, sum(part for part, _ in bus), PERIOD)
    edges = np.cumsum([part for part, _ in bus])
    power = np.asarray([value for _, value in bus])[np.searchsorted(edges, time, side="right")]
    edges = np.cumsum([0.0, *(part for part, _ in grid)])
    counter = np.cumsum([0.0, *(part * value for part, value in grid)])
    ends = np.arange(interval, time[-1], interval)
    drawn = np.interp(ends, edges, counter) - np.interp(ends - interval, edges, counter)
    unknown = np.full(len(ends), np.nan)
    meter = MeterBlock(
        np.rint(ends * 1e9).astype(np.int64),
        drawn / interval,
        unknown,
        np.full(len(ends), interval),
        MeterMeaning.MEAN_OVER_INTERVAL,
        MeterLocation.GRID,
    )
    samples = SimpleNamespace(
        stamp_ns=np.rint(time * 1e9).astype(np.int64),
        segment=np.zeros(len(time), dtype=np.int64),
        bus_power=power,
        rigid_power=np.stack([power, 0.0 * power], axis=1),
        friction_power=np.zeros((len(time), 2)),
        motor_velocity=np.zeros((len(time), 2)),
        motor_torque=np.zeros((len(time), 2)),
        motor_temperature_degc=np.full((len(time), 2), np.nan),
    )
    return Recording(Path("hand"), model_of(), None, samples, meter, "", ())  # pyright: ignore


def pulses(energy, count=16, seed=0, longest=0.5, interval=0.1):
    random = np.random.default_rng(seed)
    braking = np.round(random.uniform(0.25, longest, count), 2)
    rests = np.round(random.uniform(0.8, 1.6, count), 2)
    return solved_by_hand(energy, braking, rests, interval)


def test_the_energy_of_a_link_solved_by_hand_is_found():
    """120 J: braking of 250 to 500 J fills it, then 500 W empty it in 0.24 s."""
    fit = fit_link([pulses(120.0, seed=1), pulses(120.0, seed=2)])
    assert fit.energy == pytest.approx(120.0, abs=1.5)  # a sample is 1 or 2 J
    assert fit.events == 32
    assert abs(fit.loss_dc_shift) < 1.0
    assert fit.held_out == "recordings"
    assert fit.identified.rms < 0.1 * fit.given.rms
    assert fit.reason == ""
    # without the link every cycle burns 120 J that the meter does not see
    measured = np.concatenate([pulses(120.0, seed=s).meter.power for s in (1, 2)]).sum() * 0.1
    assert fit.given.energy_error == pytest.approx(32 * 120.0 / measured, rel=0.03)


@settings(max_examples=6, deadline=None)
@given(st.floats(40.0, 240.0), st.integers(0, 1000))
def test_any_energy_that_braking_fills_is_found(energy, seed):
    fit = fit_link([pulses(energy, 10, seed)])
    assert fit.held_out == "blocks"
    assert fit.energy == pytest.approx(energy, abs=2.0)


def test_the_constant_does_not_stand_in_for_the_link():
    """A wrong constant of the DC side is said next to it, and stays as the model has it."""
    part = pulses(120.0)
    wrong = part.model.cabinet.model_copy(
        update={"loss_dc": part.model.cabinet.loss_dc.model_copy(update={"value": 60.0})}
    )
    fit = fit_link([part], wrong)
    assert fit.loss_dc_shift == pytest.approx(40.0, abs=1.0)
    assert fit.energy == pytest.approx(120.0, abs=2.0)


def test_means_over_seconds_still_say_it_if_the_motion_varies():
    """A reading of 1 s holds all that the link gave in it; the number of stops varies."""
    fit = fit_link([pulses(120.0, 40, interval=1.0)])
    assert fit.spacing == pytest.approx(1.0)
    assert fit.energy == pytest.approx(120.0, abs=4.0)
    low, high = fit.interval
    assert low < 120.0 < high


@pytest.mark.long
def test_a_meter_as_slow_as_the_cycle_is_refused_with_the_interval_that_would_do():
    part = solved_by_hand(120.0, [0.4] * 40, [1.0] * 40, interval=2.5)
    noise = np.random.default_rng(0).normal(0.0, 2.0, len(part.meter))
    part = replace(part, meter=replace(part.meter, power=part.meter.power + noise))
    with pytest.raises(NotIdentifiableError, match=r"a reading every 0\.\d+ s or faster"):
        fit_link([part])


def test_braking_that_never_fills_the_link_is_refused():
    with pytest.raises(NotIdentifiableError, match=r"was full [01] times.*stop hard"):
        fit_link([pulses(1000.0, longest=0.26)])


def test_without_braking_it_is_refused():
    part = pulses(120.0)
    part.power.bus_power = np.abs(part.power.bus_power)
    with pytest.raises(NotIdentifiableError, match="never feed back more"):
        fit_link([part])


def test_other_meters_and_supplies_are_refused():
    part = pulses(120.0)
    with pytest.raises(NotIdentifiableError, match="no recording has a power meter"):
        fit_link([replace(part, meter=None)])
    with pytest.raises(NotIdentifiableError, match="not at the grid"):
        fit_link([replace(part, meter=replace(part.meter, location=MeterLocation.DC_BUS))])
    with pytest.raises(NotIdentifiableError, match="back to the grid"):
        fit_link([part], model_of(regeneration_efficiency=robots.figure(0.9)).cabinet)


def test_a_link_that_is_known_already_is_not_replaced():
    part = pulses(120.0)
    known, _ = with_link(part.model, fit_link([part]), "hand")
    fit = fit_link([part], known.cabinet)
    assert "stays as given" in fit.reason


def test_capacitance_follows_from_the_voltages_that_are_known(tmp_path):
    part = pulses(120.0)
    fit = fit_link([part])
    assumed, note = with_link(part.model, fit, "hand")
    link = assumed.cabinet.capacitor
    assert link.swing == pytest.approx(fit.energy)
    assert link.capacitance.value == pytest.approx(2.0 * fit.energy / (700.0**2 - 566.0**2))
    assert (link.capacitance.tag, link.nominal_voltage.tag) == ("identified", "assumed")
    assert "assumed" in note
    determined, note = with_link(part.model, fit, "hand", (48.0, 60.0))
    link = determined.cabinet.capacitor
    assert link.capacitance.value == pytest.approx(2.0 * fit.energy / (60.0**2 - 48.0**2))
    assert link.capacitance.std == pytest.approx(2.0 * fit.std / (60.0**2 - 48.0**2))
    again, note = with_link(determined, fit, "hand")
    assert again.cabinet.capacitor == determined.cabinet.capacitor
    assert "as in the model file" in note
    save(determined, tmp_path / "m.yaml")
    assert load(tmp_path / "m.yaml").cabinet.capacitor == determined.cabinet.capacitor


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Runs of the KR 16 class rig, every effect on, warming up; the last for the test alone."""
    folder = tmp_path_factory.mktemp("link")
    profile = load_profile("kr16")
    robot = profile.mechanics()[0]
    limits, high = profile.motion_limits(robot), tool_above(robot, "tool0", 0.2)
    for seed, degc in enumerate((30.0, 45.0, 30.0, 36.0), 1):
        program = random_program(limits, seed, dwell=1.2, accept=high)
        rig = VirtualRig(profile, program, RigConfig(thermal_speedup=8.0), seed, degc, rate_hz=100)
        record(rig, 30.0, folder / f"run_{seed}")
    return [Bag(path, EffortMeaning.MOTOR_TORQUE) for path in sorted(folder.iterdir())]


@pytest.mark.long
def test_on_the_virtual_rig_the_energy_is_found_and_held_out_energies_get_better(bags):
    """The chopper leaves the link between 680 and 700 V: 106 to 127 J, 117 J on the average."""
    supply = load_profile("kr16").supply
    off, on = (
        0.5 * supply.capacitance * (voltage**2 - supply.rectified_voltage**2)
        for voltage in (supply.chopper_off_voltage, supply.chopper_on_voltage)
    )
    whole = identify_everything(bags[:3], load("kr16"), ("dynamics",))  # its bodies are right
    step = whole.step("capacitor")
    assert step.taken
    assert off < step.found.energy < on
    low, high = step.found.interval
    assert low < 0.5 * (off + on) < high
    assert whole.meter_delay is not None
    assert whole.meter_delay.applied == 0.0
    capacitance = whole.model.cabinet.capacitor.capacitance
    assert (capacitance.tag, capacitance.std > 0.0) == ("identified", True)
    kind, folds = folds_of(bags[:3], bags[3:], [])
    test = held_out_energy(kind, folds, whole)
    (entry,) = test.metered
    assert abs(entry.error("capacitor")) < 0.02
    assert abs(entry.error("capacitor")) < 0.5 * abs(entry.error("drives"))
    assert entry.predictions["capacitor"].rms < 0.55 * entry.predictions["drives"].rms
    assert test.less_power_error
