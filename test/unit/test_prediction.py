"""Predicted energy of motions that can be worked out by hand, and what is said about it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from robot_energy.certainty.deviation import energy_variances
from robot_energy.foundation.errors import MotionError, UnknownJointError
from robot_energy.model import load
from robot_energy.model.figure import Figure, PositiveFigure
from robot_energy.model.payload import payload
from robot_energy.model.schema import CabinetFan
from robot_energy.physics.rigid_body import Robot
from robot_energy.pipeline import EnergyPipeline
from robot_energy.timeline.blocks import Phase, Quality, TemperatureBlock
from robot_energy_plan.motion import MotionLimits, Program
from robot_energy_plan.motion.planned import SampledMotion, repeated
from robot_energy_plan.motion.ptp_file import ProgramFile, program_for
from robot_energy_plan.prediction import START_NS, predict
from robot_energy_plan.results.prediction import FrictionReach, prediction_report
from robots import G, figure, joint_block, one_wheel, two_link

# The wheel of robots.one_wheel, joint side: inertia 2 + 0.01 10^2 = 3 kg m^2, Coulomb friction
# 0.5 * 10 = 5 N m, viscous friction 0.02 * 10^2 = 2 N m s/rad; 20 W and 30 W constant losses.
INERTIA, COULOMB, VISCOUS = 3.0, 5.0, 2.0
WAY, SPEED = 6.0, 2.0  # rad, rad/s


def wheel(acceleration, dwell=1.0, step=1e-3):
    """There and back by WAY at SPEED, with rests."""
    bounds = (np.array([-9.0]), np.array([9.0]), np.array([SPEED]), np.array([acceleration]))
    program = Program(np.array([[0.0], [WAY]]), MotionLimits(*bounds, jerk_time=0.0), dwell)
    return SampledMotion(program, ("axle",), program.period, step, program.instants.tolist())


def test_a_wheel_that_is_turned_gently_as_worked_out_by_hand():
    """At 1 rad/s^2 friction outweighs the braking torque: all kinetic energy comes back to the
    shaft, and friction takes fc way + fv integral of the squared speed, which is
    v^2 (cruise + 2/3 ramp) for a trapezoid."""
    ramp = SPEED / 1.0
    cruise = WAY / SPEED - ramp
    friction = 2 * (COULOMB * WAY + VISCOUS * SPEED**2 * (cruise + 2 * ramp / 3))
    time = 2 * (1.0 + cruise + 2 * ramp)
    result = predict(one_wheel(), wheel(1.0), 25.0)
    energy = prediction_report(result).energy
    assert result.duration == pytest.approx(time)
    assert energy.friction == pytest.approx(friction, rel=1e-5)
    assert energy.rigid == pytest.approx(0.0, abs=1e-3)
    assert energy.brake == 0.0
    assert energy.loss_dc == pytest.approx(20 * time, rel=1e-9)
    assert energy.loss_grid == pytest.approx(30 * time, rel=1e-9)
    assert energy.grid_import == pytest.approx(friction + 50 * time, rel=1e-6)
    assert energy.balanced
    # Highest: at the end of the ramp up, 3 * 1 * 2 + 5 * 2 + 2 * 2^2 + 50 W.
    assert result.account.counts.peak_power == pytest.approx(6 + 10 + 8 + 50, rel=1e-3)
    assert result.account.phase_time(Phase.HOLD) == pytest.approx(2.0, abs=0.02)


@pytest.mark.parametrize(("degc", "runs"), [(49.0, 1.0), (43.0, 0.5), (39.0, 0.0)])
def test_a_fan_takes_its_power_at_a_motor_temperature_above_its_start(degc, runs):
    """12 W on the grid side, from 45 degC on and until 40: between them half, +- half."""
    known = {"tag": "assumed", "std": 0.0}
    figures = {"power": (12.0, PositiveFigure), "on_above_degc": (45.0, Figure),
               "hysteresis": (5.0, PositiveFigure)}  # fmt: skip
    fan = CabinetFan(**{key: kind(value=value, **known) for key, (value, kind) in figures.items()})
    fan = fan.model_copy(update={"thermometers": (9.0,)})  # of readings, which a plan has not
    model = one_wheel()
    other = model.changed(cabinet=model.cabinet.model_copy(update={"fan": fan}))
    before, after = (predict(one, wheel(1.0), degc) for one in (model, other))
    old, new = (prediction_report(one).energy for one in (before, after))
    assert new.loss_grid - old.loss_grid == pytest.approx(12.0 * runs * after.duration, rel=1e-9)
    assert new.grid_import - old.grid_import == pytest.approx(new.loss_grid - old.loss_grid)
    assert new.balanced
    unsure = [energy_variances(one.account.registers.deviation).sum() for one in (before, after)]
    expected = (12.0 * after.duration) ** 2 * runs * (1.0 - runs)
    assert unsure[1] - unsure[0] == pytest.approx(expected, abs=1e-6 * unsure[0], rel=1e-6)


def test_a_wheel_that_is_stopped_hard_feeds_the_brake_as_worked_out_by_hand():
    """At 20 rad/s^2 the shaft gives 60 - 5 - 2 v N m back; beyond 20 W it is burnt."""
    ramp = SPEED / 20.0

    def burnt(at):
        speed = SPEED - 20.0 * at
        return max((INERTIA * 20.0 - COULOMB - VISCOUS * speed) * speed - 20.0, 0.0)

    expected = 2 * quad(burnt, 0.0, ramp, limit=200)[0]
    # The torque jumps, so the sum over samples is off by up to half a step of the jump.
    result = predict(one_wheel(), wheel(20.0, step=5e-5), 25.0)
    energy = prediction_report(result).energy
    assert expected > 5.0
    assert energy.brake == pytest.approx(expected, rel=1e-3)
    assert energy.balanced


def test_holding_a_weight_takes_nothing_from_ideal_drives_and_lifting_it_takes_m_g_h():
    """Two-link arm, shoulder from 0 to 0.5 rad with the elbow kept: change of potential energy."""
    bounds = (np.full(2, -3.0), np.full(2, 3.0), np.full(2, 1.0), np.full(2, 2.0))
    program = Program(np.array([[0.0, 0.0], [0.5, 0.0]]), MotionLimits(*bounds), 0.3)
    motion = SampledMotion(program, ("shoulder", "elbow"), program.period / 2, 1e-3)
    result = predict(two_link(), motion, 25.0, payload=[payload("fore", 1.0, (0.3, 0, 0))])
    lifted = (4.0 * 0.2 + 2.0 * (0.5 + 0.15) + 1.0 * (0.5 + 0.3)) * np.sin(0.5)
    rigid = prediction_report(result).energy.rigid
    assert rigid == pytest.approx(G * lifted, rel=1e-5)


def test_a_payload_next_to_that_of_the_model_is_said():
    """The model carries 3 kg on the fore arm."""
    model = two_link(payload=[{"link": "fore", "mass": 3.0, "tag": "assumed"}])

    def notes(*bodies):
        return " ".join(predict(model, _rest(1.0), 25.0, payload=bodies).notes)

    assert "3 kg on 'fore' and 2 kg on 'upper', 5 kg in all" in notes(payload("upper", 2.0))
    assert notes() == notes(payload("fore", 2.0)) == ""
    assert notes(payload("upper", 2.0), payload("fore", 0.0)) == ""


def test_a_prediction_equals_a_replay_of_the_same_motion_sampled_finely():
    """One path: the same stages give the same joules where only the derivative differs."""
    from robot_energy.pipeline import EnergyPipeline

    motion = wheel(1.0)
    result = predict(one_wheel(), motion, 25.0)
    pipeline = EnergyPipeline(one_wheel())
    for time, path in motion.blocks():
        pipeline.step(joint_block(1.0 + time, path.joint_position, velocity=path.joint_velocity))
    pipeline.flush()
    live, planned = pipeline.account.registers, result.account.registers
    for name in ("grid_import", "loss_dc"):
        assert planned.cabinet(name) == pytest.approx(live.cabinet(name), rel=1e-4)
    assert planned.joints("friction") == pytest.approx(live.joints("friction"), rel=1e-4)


def test_repetition_repeats_the_energy():
    once, thrice = (predict(one_wheel(), wheel(20.0), 25.0, repeat=n) for n in (1, 3))
    assert thrice.duration == pytest.approx(3 * once.duration)
    for name in ("grid_import", "brake"):
        one, three = (r.account.registers.cabinet(name) for r in (once, thrice))
        assert three == pytest.approx(3 * one, abs=3e-6)


@settings(max_examples=15, deadline=None)
@given(st.floats(20.0, 80.0), st.floats(0.3, 20.0), st.floats(0.0, 2.0))
def test_the_parts_sum_and_friction_falls_with_temperature(degc, acceleration, dwell):
    law = {
        "law": "exponential",
        "a": figure(0.01),
        "b": figure(0.05),
        "c": figure(20.0),
        "fitted_degc": [20.0, 80.0],
    }
    model = one_wheel()
    data = model.model_dump(mode="json", exclude_none=True)
    data["joints"][0]["friction"]["viscous"] = law
    warm = one_wheel(joints=data["joints"])
    motion = wheel(acceleration, dwell)
    found, cold = (prediction_report(predict(warm, motion, t)) for t in (degc, 20.0))
    assert found.energy.balanced
    assert found.problems == ()
    assert found.quality.counts == {}
    assert found.energy.friction <= cold.energy.friction * (1 + 1e-12)


def test_long_rests_are_never_stale_or_stuck():
    """A held temperature is an assumption; the model calls readings stale after 5 s."""
    result = predict(two_link(), _rest(600.0), 40.0)
    assert not result.account.counts.quality
    assert result.means is not None
    assert len(result.means) <= 1502
    assert result.account.registers.cabinet("grid_import") == pytest.approx(50.0 * 600.0)


def test_an_assumed_temperature_is_not_taken_for_a_stuck_thermometer():
    """Twenty minutes of work at one temperature; a replay would call such a reading stuck."""
    data = one_wheel().model_dump(mode="json", exclude_none=True)
    data["joints"][0]["friction"]["coulomb"] = figure(5.0)
    stiff = one_wheel(joints=data["joints"])
    motion = wheel(1.0, 0.0, 0.02)
    result = predict(stiff, motion, 25.0, repeat=150)
    assert result.duration > 1200
    assert not result.account.counts.quality
    replayed = EnergyPipeline(stiff)
    for time, path in repeated(motion, 150):
        states = joint_block(time, path.joint_position, path.joint_velocity)
        replayed.step(states, TemperatureBlock(states.stamp_ns, np.full((len(time), 1), 25.0)))
    assert replayed.account.counts.quality[Quality.TEMPERATURE_STUCK]


def _rest(time):
    bounds = (np.full(2, -3.0), np.full(2, 3.0), np.full(2, 1.0), np.full(2, 2.0))
    program = Program(np.zeros((1, 2)), MotionLimits(*bounds), time)
    return SampledMotion(program, ("shoulder", "elbow"), time, 0.05)


def test_the_use_of_limits_as_worked_out_by_hand():
    """Shoulder: 4 rad/s and 100 N m. Held level it needs G (4 0.2 + 2 (0.5 + 0.15)) N m."""
    held = predict(two_link(), _rest(1.0), 25.0)
    assert held.limits.torque[0] == pytest.approx(G * 2.1 / 100)
    assert np.isnan(held.limits.torque[1])  # the URDF gives no limit
    assert held.limits.sentences() == []
    bounds = (np.full(2, -9.0), np.full(2, 9.0), np.array([5.0, 1.0]), np.array([90.0, 2.0]))
    program = Program(np.array([[0.0, 0.0], [4.0, 0.0]]), MotionLimits(*bounds), 0.1)
    motion = SampledMotion(program, ("shoulder", "elbow"), program.period)
    result = predict(two_link(), motion, 25.0)
    assert result.limits.speed[0] == pytest.approx(1.25)
    problems = prediction_report(result).problems
    assert "joint 'shoulder' is 1 rad beyond its range" in problems[0]
    assert "joint 'shoulder' needs 125 % of its speed limit" in problems[1]
    assert "of its torque limit" in problems[2]


@pytest.mark.parametrize(
    ("unit", "last", "asked"), [("deg", 1.57, True), ("deg", 7.0, False), ("rad", 0.05, False)]
)
def test_a_program_in_radians_that_says_degrees_is_asked_about(unit, last, asked):
    limits = Robot.from_model(load("kr16")).limits
    via = [dict.fromkeys(limits.joint_names, angle) for angle in (0.0, last)]
    file = ProgramFile(schema_version=1, motion="point_to_point", angle_unit=unit, via=via)
    notes = program_for(file, limits, "moves").notes
    said = f"no joint of moves is further than {last} deg from zero: is its angle_unit rad?"
    assert [note for note in notes if "angle_unit" in note] == [said] * asked


def test_times_in_milliseconds_are_asked_about():
    def asked(speed):
        bounds = (np.full(2, -9.0), np.full(2, 9.0), np.full(2, speed), np.full(2, 2.0))
        program = Program(np.array([[0.0, 0.0], [0.1, 0.0]]), MotionLimits(*bounds), 0.1)
        motion = SampledMotion(program, ("shoulder", "elbow"), program.period)
        notes = prediction_report(predict(two_link(), motion, 25.0)).notes
        return [one for one in notes if one.endswith("are the times of the motion in seconds?")]

    (note,) = asked(0.01)  # of 4 rad/s
    assert note.startswith("no joint is faster than 0.25 % of its speed limit")
    assert not asked(1.0)
    resting = prediction_report(predict(two_link(), _rest(1.0), 25.0)).notes
    assert "no joint moves: this is the energy of holding one pose" in resting
    assert not any("in seconds?" in one for one in resting)


def test_temperatures_that_no_law_covers_are_said():
    """The shoulder was fitted from 20 to 80 degC; the elbow has one value for all."""
    result = predict(two_link(), _rest(1.0), [10.0, 30.0])
    report = prediction_report(result)
    assert result.extrapolated == ("shoulder",)
    assert report.friction == FrictionReach(("shoulder",), ("elbow",))
    assert any(note.startswith("EXTRAPOLATED: the friction of shoulder") for note in report.notes)
    assert result.account.counts.quality[int(Quality.EXTRAPOLATED)] == result.account.counts.samples
    assert report.motor_temperature_degc == {"shoulder": 10.0, "elbow": 30.0}


def test_joints_are_matched_by_name():
    """The same motion with its joints in another order."""
    bounds = (np.full(2, -3.0), np.full(2, 3.0), np.array([1.0, 2.0]), np.array([2.0, 3.0]))
    via = np.array([[0.0, 0.1], [0.5, -0.7]])
    one = Program(via, MotionLimits(*bounds), 0.1)
    other = Program(via[:, ::-1], MotionLimits(*(b[::-1] for b in bounds)), 0.1)
    energies = [
        predict(two_link(), SampledMotion(p, names, p.period), 25.0).account.registers.microjoule
        for p, names in ((one, ("shoulder", "elbow")), (other, ("elbow", "shoulder")))
    ]
    np.testing.assert_array_equal(*energies)


def test_progress_rises_to_one():
    shares = []
    predict(one_wheel(), wheel(1.0), 25.0, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_stamps_begin_above_zero():
    assert predict(one_wheel(), wheel(1.0), 25.0).account.registers.time.start_ns == START_NS


@pytest.mark.parametrize(
    ("changes", "error", "text"),
    [
        ({"motor_temperature_degc": [1.0, 2.0]}, MotionError, "2 motor temperatures"),
        ({"motor_temperature_degc": 300.0}, MotionError, "-40 to 200 degC"),
        ({"motor_temperature_degc": float("nan")}, MotionError, "-40 to 200 degC"),
        ({"repeat": 0}, MotionError, "0 repetitions"),
        ({"repeat": 1_000_000_0}, MotionError, "repetitions"),
        ({"model": two_link()}, UnknownJointError, "lacks shoulder"),
    ],
)
def test_what_cannot_be_predicted_is_refused(changes, error, text):
    given = {"model": one_wheel(), "motion": wheel(1.0), "motor_temperature_degc": 25.0}
    with pytest.raises(error, match=text):
        predict(**{**given, **changes})


def test_a_prediction_knows_its_samples_before_it_is_made():
    motion = wheel(1.0)
    made = sum(len(time) for time, _ in motion.blocks())
    assert made <= motion.sample_count <= made + 10
    with pytest.raises(MotionError, match=f"{3 * motion.sample_count} samples"):
        predict(one_wheel(), motion, 25.0, repeat=3, max_samples=3 * motion.sample_count - 1)
    predict(one_wheel(), motion, 25.0, repeat=3, max_samples=3 * motion.sample_count)


def test_short_turns_are_handed_out_together():
    """A motion of some samples, 1,000 times, is not 1,000 steps of the pipeline."""
    program = Program(
        np.array([[0.0], [1e-3]]),
        MotionLimits(np.array([-9.0]), np.array([9.0]), np.array([SPEED]), np.array([1.0]), 0.0),
        0.0,
    )
    motion = SampledMotion(program, ("axle",), program.period, program.period / 4)
    parts = list(repeated(motion, 1000))
    assert len(parts) == 1
    assert len(parts[0][0]) == 4001
    assert (np.diff(parts[0][0]) > 0).all()
