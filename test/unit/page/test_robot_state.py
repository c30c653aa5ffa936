"""The page says what the messages say: stale, unknown, estimated, and never invented."""

import json
import math

import numpy as np
import pytest

from page_messages import JOINTS, power_states, recorded, registers
from robot_energy.timeline.blocks import Quality
from robot_energy_report.page.alarms import (
    OUTSIDE_FIT,
    QUALITY_REMEDIES,
    REMEDY_KEY,
    SUBJECT_REMEDIES,
    PageFinding,
)
from robot_energy_report.page.hub import MAX_ROBOTS, PageHub
from robot_energy_report.page.json_numbers import json_text
from robot_energy_report.page.robot_state import RobotState
from robot_energy_report.page.settings import PageSettings
from robot_energy_report.page.stale import STALE_AFTER


@pytest.fixture
def state():
    return RobotState("robot1", PageSettings(price_per_kwh=0.5, co2_kg_per_kwh=0.4))


def test_powers_are_those_of_the_newest_message(state):
    state.take_power(power_states([1.0, 1.1, 1.2], [100.0, 200.0, 300.0], measured=280.0), 5.0)
    found = state.power(5.1)
    assert found["predicted_grid_power"] == 300.0
    assert found["measured_power"] == 280.0
    assert not found["stale"]
    assert state.snapshot(5.1)["means"]["predicted_grid_power"] == 200.0
    assert state.snapshot(5.1)["joints"][0]["friction_power"] == 200.0
    assert state.snapshot(5.1)["flow"]["net"] * state.snapshot(5.1)["flow"]["unit"] == 200.0


@pytest.mark.parametrize("bits", [Quality.OK, Quality.LEARNED])
def test_power_and_registers_say_whether_learned_figures_corrected_them(state, bits):
    state.take_power(power_states([1.0], [100.0], quality=np.uint32(bits)), 5.0)
    state.take_registers(registers(7200.0, predicted_energy_learned=30.0 * bits))
    assert state.power(5.1)["corrected"] is bool(bits)
    assert state.snapshot(5.1)["registers"]["predicted_energy_learned"] == 30.0 * bits
    assert state.snapshot(5.1)["alarms"] == []


def test_what_is_stale_is_not_shown_as_a_figure(state):
    state.take_power(power_states([1.0], [100.0]), 5.0)
    state.take_registers(registers(7200.0))
    late = 5.0 + STALE_AFTER + 0.01
    assert not state.stale(late - 0.02)
    found = state.snapshot(late)
    assert found["power"]["stale"]
    live = [
        found["power"]["predicted_grid_power"],
        found["flow"],
        found["means"],
        found["coverage"],
    ]
    assert live == [None] * 4
    for joint in found["joints"]:
        assert {joint[name] for name in ("friction_power", "motor_torque", "viscous")} == {None}
    assert found["registers"]["predicted_import_energy"] == 7200.0  # a counter stays a fact
    assert found["alarms"][0]["level"] == "STALE"
    state.take_power(power_states([9.0], [100.0]), late)
    assert state.snapshot(late)["power"]["predicted_grid_power"] == 100.0


def test_a_monitor_that_publishes_seldom_is_not_stale_in_between(state):
    state.take_power(power_states([10.0], [100.0], period=10.0), 5.0)
    assert not state.stale(20.0)
    assert state.stale(36.0)


def test_unknown_is_none_and_json_has_no_nan(state):
    state.take_power(power_states([1.0, 1.1], [math.nan, math.inf]), 5.0)
    found = state.snapshot(5.0)
    assert found["power"]["measured_power"] is None
    assert found["flow"] is None
    json.loads(json_text([found, state.history()]))


@pytest.mark.parametrize("period", [0.1, 1e308])
def test_numbers_that_no_robot_has_do_not_end_the_page(state, period):
    """Each is finite, their sums are not."""
    state.take_power(power_states([1.0, 1.1, 1.2], [1e308] * 3, period=period), 5.0)
    state.take_registers(registers(1e308))
    assert state.snapshot(5.0)["power"]["predicted_grid_power"] in (None, 1e308)
    state.take_power(power_states([1.3, 1.4], [100.0, 100.0]), 5.1)
    found = state.snapshot(5.1)
    assert found["power"]["predicted_grid_power"] == 100.0
    json.loads(json_text([found, state.history()]))


def test_headline_and_registers(state):
    state.take_registers(registers(3.6e6))
    found = state.snapshot(0.0)
    assert found["headline"]["cost"] == pytest.approx(0.5)
    assert found["headline"]["co2"] == pytest.approx(0.4)
    assert found["registers"]["measured_energy"] is None
    assert [joint["name"] for joint in found["registers"]["joints"]] == list(JOINTS)
    flow = found["energy_flow"]
    assert flow["net"] * flow["unit"] == pytest.approx(1000.0)  # Wh


def test_registers_that_observed_no_time_show_no_energy(state):
    """Joint states of which no sample was usable, or one: 0 J would be a result."""
    state.take_registers(registers(0.0, observed_time=0.0))
    found = state.snapshot(0.0)
    assert found["registers"]["observed_time"] == 0.0
    assert found["registers"]["predicted_import_energy"] is None
    assert found["registers"]["joints"][0]["friction_energy"] is None
    assert found["headline"]["energy"] is None
    assert found["headline"]["cost"] is None
    assert found["headline"]["co2"] is None
    assert found["energy_flow"] is None


def test_a_gap_is_not_covered_and_edges_are(state):
    state.take_power(power_states([0.07, 0.17], [100.0, 100.0]), 5.0)
    assert state.snapshot(5.0)["spans"]["live"]["coverage"] == pytest.approx(1.0)
    state.take_power(power_states([0.37], [100.0]), 5.0)
    assert state.snapshot(5.0)["spans"]["live"]["coverage"] == pytest.approx(0.75)


def test_quality_bits_become_alarms_with_a_remedy(state):
    bits = np.uint32(Quality.TEMPERATURE_STALE | Quality.EXTRAPOLATED)
    state.take_power(power_states([1.0], [100.0], quality=bits), 5.0)
    alarms = state.snapshot(5.0)["alarms"]
    assert [alarm["name"] for alarm in alarms] == ["TEMPERATURE_STALE", "EXTRAPOLATED"]
    assert all(alarm["remedy"] for alarm in alarms)


def test_an_extrapolation_is_one_alarm_with_motor_range_and_remedy(state):
    bits = np.uint32(Quality.EXTRAPOLATED)
    remedy = QUALITY_REMEDIES[Quality.EXTRAPOLATED][1]
    said = "the motor of a1 is at 66.2 degC, fitted from 22 to 63 degC"
    values = {f"{OUTSIDE_FIT}a1": "66.2 degC", f"{REMEDY_KEY}1": remedy, "findings": "1"}
    name = "friction_monitor: motor temperatures"
    finding = PageFinding.of_status(1, name, f"{remedy}: {said}", values)
    state.take_power(power_states([1.0], [100.0], quality=bits), 5.0)
    state.take_findings([finding])
    (alarm,) = state.snapshot(5.0)["alarms"]
    assert (alarm["name"], alarm["message"], alarm["remedy"]) == (name, said, remedy)
    state.take_findings([PageFinding.of_status(0, name, "all is well", {})])
    assert [one["name"] for one in state.snapshot(5.0)["alarms"]] == ["EXTRAPOLATED"]


def test_what_to_do_is_that_of_the_finding_and_the_general_words_are_for_others():
    name, own = "power_monitor: energy", "give all monitors the same model file"
    said = "all 1 messages on /energy/joint_friction rejected"
    values = {f"{REMEDY_KEY}1": own, "findings": "1", "received": "7"}
    alarm = PageFinding.of_status(2, name, f"{own}: {said}", values)
    assert (alarm.message, alarm.remedy) == (said, own)
    assert alarm.values == {"findings": "1", "received": "7"}
    more = PageFinding.of_status(2, name, f"{own}: {said}; other", values | {"findings": "2"})
    assert more.message == f"{said}; other"
    assert more.remedy == f"{SUBJECT_REMEDIES['energy']}; {own}"


def test_every_quality_bit_that_asks_for_something_has_a_remedy():
    harmless = {Quality.ACCELERATION_INCOMPLETE, Quality.LEARNED}
    assert set(QUALITY_REMEDIES) == set(Quality) - {Quality.OK} - harmless


def test_findings_are_bounded_and_safe(state):
    state.take_findings(
        [PageFinding.of_status(2, f"n{k}: x", "\x1b[31m" * 2000, {"k": "\n"}) for k in range(500)]
    )
    found = state.snapshot(0.0)["findings"]
    assert len(found) == 64
    assert "\x1b" not in json_text(found)
    assert PageFinding.of_status(99, "a", "b", {}).level == "ERROR"


def test_phases_are_those_that_the_registers_count(state):
    counted = {"phase_ns": [[0, 3 * 10**9, 0, 10**9]], "phase_microjoule": [[0, 9 * 10**8, 0, 0]]}
    state.take_registers(registers(900.0, **{k: np.array(v) for k, v in counted.items()}))
    assert state.snapshot(0.0)["phases"] == [
        {"name": "HOLD", "seconds": 3.0, "energy": 900.0, "mean": 300.0},
        {"name": "GENERATING", "seconds": 1.0, "energy": 0.0, "mean": 0.0},
    ]


def test_malformed_and_huge_messages_change_nothing(state):
    good = power_states([1.0], [100.0])
    many = power_states([2.0], [50.0], names=tuple(f"j{k}" for k in range(200)))
    cut = type(good)(
        good.topic, good.msgtype, good.log_time_ns, good.buffer[:-40].copy(), good.offset,
        good.length - 40,
    )  # fmt: skip
    state.take_power(good, 1.0)
    before = state.snapshot(1.0)
    state.take_power(many, 1.0)
    state.take_power(cut, 1.0)
    assert state.snapshot(1.0) == before


def test_other_joints_replace_the_old_ones(state):
    state.take_power(power_states([1.0], [100.0]), 1.0)
    state.take_power(power_states([1.1], [100.0], names=("x", "y", "z")), 1.0)
    assert [joint["name"] for joint in state.snapshot(1.0)["joints"]] == ["x", "y", "z"]


def test_a_page_has_a_bounded_number_of_robots():
    hub = PageHub("", PageSettings())
    for number in range(MAX_ROBOTS + 5):
        hub.robot(f"r{number}")
    assert len(hub.robots) == MAX_ROBOTS


def test_a_recording_shows_the_totals_of_its_replay():
    page, result = recorded()
    robot = page.state()["robots"][0]
    cabinet = result.account.registers.cabinet
    assert robot["registers"]["predicted_import_energy"] == cabinet("grid_import")
    assert robot["registers"]["brake_energy"] == cabinet("brake")
    assert robot["registers"]["measured_energy"] == result.account.comparison.measured_energy
    assert robot["meter"] == "GRID"
    span = robot["spans"]["all"]
    assert span["energy"] == pytest.approx(cabinet("grid_import"), rel=1e-9)
    assert sum(phase["energy"] for phase in robot["phases"]) == pytest.approx(
        span["energy"], rel=1e-6
    )
    assert not robot["power"]["stale"]
    assert robot["joints"][0]["temperature_source"] == "MEASURED"
    flow = robot["energy_flow"]
    assert flow["net"] * flow["unit"] * 3600 == pytest.approx(cabinet("grid_import"), abs=36.0)
