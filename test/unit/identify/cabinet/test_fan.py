"""A fan by its step in the power at rest."""

import io
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import load
from robot_energy.model.schema import CabinetFan
from robot_energy.timeline.blocks import MeterLocation
from robot_energy_identify import run_all
from robot_energy_identify.api.identify import identify_all, identify_cabinet, identify_friction
from robot_energy_identify.cabinet import fan as fan_module
from robot_energy_identify.cabinet.cabinet import CabinetFit
from robot_energy_identify.cabinet.fan import FanFit, Rests, fan_of, runs_at_begin, with_begin
from robot_energy_identify.cabinet.thermometers import Thermometers
from robot_energy_identify.drives.all_drives import DrivesReport
from robot_energy_identify.stats.cross_validation import EnergyScore
from robot_energy_identify.stats.systematic import DEFAULT_LIMITS
from robot_energy_identify.steps import Step, fan_refused
from robot_energy_plan.motion import random_program
from robot_energy_report.document import Document
from robot_energy_report.identification import losses_section
from robot_energy_report.printing import print_document
from robot_energy_rig import RigConfig, VirtualRig, random_profile
from robot_energy_rig.record import record

SEED = 6
COUNT, FIRST = 100, 60  # rests; the one before which the fan starts


def rests(step, noise=0.0, seed=0, at=FIRST, slope=0.01):
    """A rest every 4 s, 20 to 45 degC; windings that warm up add a slope, poses copper losses."""
    random = np.random.default_rng(seed)
    time = 4.0 * np.arange(COUNT)
    heat = random.uniform(0.0, 8.0, (COUNT, 3)) * (1.0, 1.0, 0.0)  # an upright axis holds nothing
    power = 100.0 + slope * time + heat @ (6.0, 2.0, 3.0) + step * (np.arange(COUNT) >= at)
    power += random.normal(0.0, noise, COUNT) if noise else 0.0
    return Rests(time, power, 20.0 + 0.25 * np.arange(COUNT), heat, np.zeros(COUNT))


def and_cooling(warm_up, stops, seed=1):
    """The warm-up, then as long a cool-down, with a step of the power after some rests of it."""
    random = np.random.default_rng(seed)
    level = 100.0 + 0.01 * warm_up.time[-1] + np.where(np.arange(COUNT) < stops, 30.0, 0.0)
    return Rests(
        4.0 * np.arange(2 * COUNT),
        np.append(warm_up.power, level + random.normal(0.0, 1.0, COUNT)),
        np.append(warm_up.warmest_degc, np.full(COUNT, warm_up.warmest_degc[-1])),
        np.append(warm_up.heat, np.zeros((COUNT, 3)), axis=0),
        np.append(warm_up.fall, 0.25 * np.arange(COUNT)),
    )


def test_a_step_of_30_watts_is_a_fan_of_30_watts_from_the_temperature_before_it():
    found = fan_of([rests(30.0)], 1.5)
    assert found.power == pytest.approx(30.0, abs=1e-6)
    assert found.on_above_degc == pytest.approx(20.0 + 0.25 * (FIRST - 0.5))
    assert found.on_std == pytest.approx(np.hypot(0.25 * 11 / np.sqrt(12.0), 1.5))
    assert found.recordings == 1
    entry = found.entry("bag")
    assert entry.power.tag == entry.on_above_degc.tag == "identified"
    assert entry.hysteresis.tag == "assumed"


def test_the_deviation_of_a_step_is_that_of_its_scatter():
    """Over 400 draws the step is off by its deviation."""
    draws = [rests(30.0, 8.0, seed).step(FIRST) for seed in range(400)]
    scores = np.array([(one.power - 30.0) / one.std for one in draws])
    assert scores.std() == pytest.approx(1.0, abs=0.1)
    assert abs(scores.mean()) < 0.2


def test_rests_that_the_dc_link_feeds_do_not_count():
    """Every seventh rest comes after hard braking, and the meter shows up to 90 W less."""
    known = rests(30.0, 1.0)
    fed = np.arange(COUNT) % 7 == 3
    less = np.random.default_rng(2).uniform(40.0, 90.0, COUNT) * fed
    found = fan_of([replace(known, power=known.power - less)], 1.5)
    assert found.power == pytest.approx(30.0, abs=1.5)
    assert found.std < 1.0
    assert found.rests == 48 + (~fed[FIRST:]).sum()


FAN = CabinetFan.model_validate(
    {
        "power": {"value": 30.0, "tag": "identified", "std": 1.0},
        "on_above_degc": {"value": 44.0, "tag": "identified", "std": 1.0},
        "hysteresis": {"value": 5.0, "tag": "assumed", "std": 2.0},
    }
)


def begun(power, count=20, degc=40.0):
    """Rests at one temperature."""
    noise, same = np.random.default_rng(3).normal(0.0, 2.0, count), np.full(count, degc)
    return Rests(4.0 * np.arange(count), power + noise, same, np.zeros((count, 3)), 0.0 * same)


def test_rests_before_its_start_show_whether_a_fan_runs():
    """100 W are the constants; 30 W of a fan would be in rests at 40 degC, below 44 - 1.4."""
    assert runs_at_begin(begun(103.0), FAN, 100.0) is False
    assert runs_at_begin(begun(127.0), FAN, 100.0) is True
    assert runs_at_begin(begun(115.0), FAN, 100.0) is None  # neither is sure
    assert runs_at_begin(begun(103.0, 5), FAN, 100.0) is None
    assert runs_at_begin(begun(103.0, degc=43.0), FAN, 100.0) is None  # it may have started


def test_the_warmest_begin_without_a_fan_is_written_where_the_model_leaves_it_open(monkeypatch):
    """It stops from 35 to 43 degC and starts from 42 to 46: at 30 degC no fan runs anyway."""
    cabinet = load("ur10e").cabinet.model_copy(update={"fan": FAN})
    constant = cabinet.loss_dc.value + cabinet.loss_grid.value

    def part(degc, power):
        warmest = SimpleNamespace(motor_temperature_degc=np.array([[np.nan], [degc], [degc]]))
        model, rests = SimpleNamespace(cabinet=cabinet), begun(constant + power, degc=degc)
        return SimpleNamespace(model=model, power=warmest, rests=rests)

    monkeypatch.setattr(fan_module, "_usable", lambda part: True)
    monkeypatch.setattr(fan_module, "_rests", lambda part, _: part.rests)
    recordings = [part(30.0, 0.0), part(38.0, 0.0), part(40.0, 1.0), part(41.0, 30.0)]
    found = with_begin(FAN, recordings, "bags")
    assert (found.begins_off_to_degc.value, found.begins_off_to_degc.source) == (40.0, "bags")
    assert found.model_copy(update={"begins_off_to_degc": None}) == FAN
    assert with_begin(FAN, [recordings[0], recordings[-1]], "bags") == FAN
    cooled = part(38.5, 30.0)  # from where it ran
    assert with_begin(FAN, [*recordings, cooled], "bags").begins_off_to_degc.value == 38.0
    assert with_begin(FAN, [recordings[2], cooled], "bags") == FAN
    warming = part(38.0, 0.0)  # to 44 degC, but from 42.6 degC on it may have started
    warming.rests = replace(warming.rests, warmest_degc=np.linspace(38.0, 44.0, 21)[:20])
    assert with_begin(FAN, [warming], "bags").begins_off_to_degc.value == pytest.approx(42.5)


@pytest.mark.parametrize(
    ("every", "why"),
    [
        ([rests(0.0, 8.0, slope=0.1)], "no step of the power at rest is 5 deviations high"),
        ([rests(30.0, 8.0), rests(0.0, 0.8)], "no step of the power at rest is 5 deviations"),
        ([rests(30.0, 2.0), rests(-20.0, 2.0, 1, 30)], "and one of -"),
        ([rests(-30.0, 2.0)], "no step of the power"),
        ([], "no recording has 24 rests"),
    ],
)  # fmt: skip
def test_what_is_no_fan_is_refused(every, why):
    """A slope; a warm-up through the same temperature without a step; a load that stops."""
    with pytest.raises(NotIdentifiableError, match=why):
        fan_of(every, 1.5)


def test_a_fan_that_also_stops_while_the_robot_cools_is_found():
    """In the recording of its start or in another one; not while motors are as warm as before."""
    warm_up = rests(30.0, 1.0)
    both = and_cooling(warm_up, 60)
    cooling = Rests(*(getattr(both, name)[COUNT:] for name in both.__dataclass_fields__))
    for every in ([both], [warm_up, cooling]):
        assert fan_of(every, 1.5).power == pytest.approx(30.0, abs=1.0)
    with pytest.raises(NotIdentifiableError, match="and one of -"):
        fan_of([replace(both, fall=np.zeros(2 * COUNT))], 1.5)


def test_the_power_of_a_fan_that_stops_soon_after_its_start_is_that_of_its_start():
    """The robot cools from rest 100 on, and the fan stops at rest 110."""
    found = fan_of([and_cooling(rests(30.0, 1.0, at=84), 10)], 1.5)
    assert found.power == pytest.approx(30.0, abs=1.0)
    assert found.on_above_degc == pytest.approx(20.0 + 0.25 * 83.5)


def test_a_step_while_no_motor_warms_up_is_no_fan():
    still = replace(rests(30.0, 1.0), warmest_degc=np.full(COUNT, 40.0))
    with pytest.raises(NotIdentifiableError, match="no motor warms up: the warmest by 0 K"):
        fan_of([still], 1.5)


@pytest.mark.parametrize(("joints", "enough"), [(20, 24), (21, 26), (30, 34)])
def test_rests_are_more_than_what_is_fitted_to_them(joints, enough):
    """Constant, slope, step and the copper loss of each joint; at least one rest more."""
    random = np.random.default_rng(0)

    def first(count):
        heat = random.uniform(0.0, 1.0, (count, joints))
        power, degc = random.normal(100.0, 1.0, count), np.arange(count)
        return Rests(10.0 * np.arange(count), power, degc, heat, np.zeros(count))

    assert first(enough).step(enough // 2).std > 0.0
    with pytest.raises(NotIdentifiableError, match=f"no recording has {enough} rests"):
        fan_of([first(enough - 1)], 1.5)
    with pytest.raises(NotIdentifiableError, match="no step"):
        fan_of([first(enough)], 1.5)


def test_a_fan_is_taken_where_held_out_readings_are_predicted_better_with_it():
    """Power 2 % better, of all readings or at rest; of all neither power nor energy is worse."""

    old = EnergyScore(20.0, 0.03, 0.05)

    def reason(rms, energy, *at_rest):
        test = [(EnergyScore(rms, energy, energy), old)] if rms else []
        total = SimpleNamespace(fan_test=[*test, *at_rest])
        return fan_refused(
            Step("drives", DrivesReport("", None, None, total, ()), "", load("kr16"))
        )

    assert reason(15.0, 0.02) == ""
    assert "without 3.0 % and 20 W" in reason(19.9, 0.02)
    assert "6.0 % off and 15 W" in reason(15.0, 0.06)
    rests = EnergyScore(3.0, 0.01, 0.01), EnergyScore(5.0, 0.02, 0.02)
    assert reason(19.9, 0.02, rests) == reason(20.0, 0.032, rests) == ""
    assert "and 20.1 W" in reason(20.1, 0.02, rests)  # what rests gain, motion must not lose
    assert "4.0 % off" in reason(19.9, 0.04, rests)
    assert "and 19.9 W" in reason(19.9, 0.02, (old, old))
    assert "cannot be tested" in reason(None, 0.02)
    assert "cannot be tested" in fan_refused(Step("drives", None, "too few readings", load("kr16")))


def test_every_turn_of_cabinet_and_drives_begins_with_the_fan_of_its_step(monkeypatch):
    """Drives fit its power to all readings; from turn to turn it would leave the step.

    Which readings show the drives is seen with this fan and the constants of the turn before.
    """
    model, powers, constants = load("ur10e"), [], []

    def with_power(watts):
        power = FAN.power.model_copy(update={"value": watts})
        update = {"fan": FAN.model_copy(update={"power": power}), "loss_dc": power}
        return model.changed(cabinet=model.cabinet.model_copy(update=update))

    def drives_step(bags, model, source, seen):
        powers.append(seen.cabinet.fan.power.value)
        constants.append(seen.cabinet.loss_dc.value)
        return Step("drives", DrivesReport("", None, None, None, ()), "", with_power(20.0))

    def cabinet_step(model, fit, source):
        powers.append(model.cabinet.fan.power.value)
        return Step("cabinet", None, "", model)

    monkeypatch.setattr(run_all, "read_all", lambda bags, model: [])
    monkeypatch.setattr(run_all, "fit_cabinet", lambda recordings: None)
    monkeypatch.setattr(run_all, "cabinet_step", cabinet_step)
    monkeypatch.setattr(run_all, "drives_step", drives_step)
    cabinet = Step("cabinet", None, "", with_power(15.0))
    run_all.in_turns(cabinet, Step("drives", None, "", with_power(18.0)), [], model, "bags")
    assert set(powers) == {15.0}
    assert constants[:2] == [18.0, 20.0]


def rig(*without, start=20.0, on=23.0, capacity=1.0):
    """Eight minutes of a small robot that warms up by itself; the fan starts on the way."""
    drawn = random_profile("ur10e", SEED)
    profile = replace(
        drawn,
        motor_capacity=capacity * drawn.motor_capacity,
        hard=replace(drawn.hard, fan_power=30.0, fan_on_degc=on, fan_off_degc=19.0),
    )
    limits = profile.motion_limits(profile.mechanics()[0])
    program = random_program(limits, SEED, dwell=1.0)
    config = RigConfig.hard().without(*without)
    return VirtualRig(profile, program, config, SEED, start, 20.0, rate_hz=25.0)


def test_the_fan_of_the_rig_is_found_and_none_without_it(tmp_path):
    """The rig shares no code with the term; its thermometers lag behind the motors."""
    model = load("ur10e")
    bag = record(
        rig(),
        480.0,
        tmp_path / "fan",
    ).path
    found = identify_cabinet(bag, model)
    fan = found.model.cabinet.fan
    assert fan.power.value == pytest.approx(30.0, abs=2.0 * fan.power.std)
    assert fan.on_above_degc.value == pytest.approx(23.0, abs=2.0 * fan.on_above_degc.std)
    assert found.found.losses.fan.power == fan.power.value
    assert fan.thermometers is None  # one begin shows no thermometer
    others = ("dynamics", "friction", "drives", "capacitor", "thermal")
    untested = identify_all(bag, model, skip=others, held_out=False)
    assert untested.model.cabinet.fan is None
    cabinet = next(step for step in untested.found.steps if step.subject == "cabinet")
    assert "cannot be tested" in cabinet.found.fan_reason
    bag = record(rig("fan"), 480.0, tmp_path / "none").path
    without = identify_cabinet(bag, model)
    assert without.model.cabinet.fan is None
    assert "no step of the power at rest" in without.found.losses.fan_reason
    constant = found.model.cabinet.loss_grid.value + found.model.cabinet.loss_dc.value
    other = without.model.cabinet.loss_grid.value + without.model.cabinet.loss_dc.value
    assert constant == pytest.approx(other, abs=3.0)


def test_a_fan_that_starts_in_no_recording_is_found_by_their_levels(tmp_path):
    """It runs in those at 45 and 60 degC; a warm-up of light motors ends at 32 degC."""
    light = {"on": 38.0, "capacity": 0.15}
    bags = [record(rig(**light), 200.0, tmp_path / "warm_up").path]
    bags += [
        record(rig(start=degc, **light), 60.0, tmp_path / f"{degc:.0f}").path
        for degc in (22.0, 45.0, 60.0)
    ]
    model = identify_friction(bags, "ur10e", "motor_torque").model
    fan = identify_cabinet(bags, model).model.cabinet.fan
    assert fan.power.source.startswith("levels of recordings")
    assert fan.power.value == pytest.approx(30.0, abs=2.0 * fan.power.std)
    assert fan.on_above_degc.value == pytest.approx(38.0, abs=fan.on_above_degc.std)
    off = rig(**light)._thermometer._offset
    np.testing.assert_allclose(fan.thermometers, off - off.mean(), atol=0.6)


def test_the_start_is_as_sure_as_two_thermometers_are_known():
    """By limits of +-2 K, uniform; else by 0.4 K of each and 0.3 K of its readings."""
    recording = SimpleNamespace(sensors=DEFAULT_LIMITS)
    assert fan_module._between([recording], None) == pytest.approx((2.0 * 4.0 / 3.0) ** 0.5)
    known = Thermometers((1.0, -1.0), 0.4)
    assert fan_module._between([recording], known) == pytest.approx(0.5 * 2.0**0.5)


@pytest.mark.parametrize(("thermometers", "says"), [(None, True), ((1.0, -1.0), False)])
def test_the_report_says_how_to_show_which_motor_is_the_warmest(thermometers, says):
    fan = FanFit(30.0, 1.0, 44.0, 1.6, 1, 60, thermometers)
    fit = CabinetFit(MeterLocation.GRID, None, None, 250.0, 1.0, 150.0, 2.0, (), fan=fan)
    page, shown = Document(), io.StringIO()
    losses_section(fit, page)
    print_document(page, Console(file=shown, width=400))
    assert ("begin two recordings after hours at rest" in shown.getvalue()) is says
