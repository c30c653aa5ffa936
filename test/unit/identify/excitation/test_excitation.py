"""Motions that determine parameters: limits, rest, and what identification makes of them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import robots
from robot_energy.foundation.errors import MotionError, RobotDescriptionError
from robot_energy.model import load
from robot_energy.physics.rigid_body import Robot
from robot_energy_identify.data.observations import stretches
from robot_energy_identify.dynamics.dynamics import DynamicsSettings, identify_dynamics
from robot_energy_identify.dynamics.torque_model import standard_columns
from robot_energy_identify.excitation.excitation import (
    ExcitationCriterion,
    ExcitationSettings,
    optimise_excitation,
)
from robot_energy_identify.excitation.limits import ExcitationLimits, Floor
from robot_energy_identify.stats.regression import SCATTER
from robot_energy_plan.motion import (
    FourierBasis,
    FourierMotion,
    MotionLimits,
    Trajectory,
    random_program,
    tool_above,
)
from robot_energy_rig import RigConfig, VirtualRig, load_profile

QUICK = ExcitationSettings(harmonics=4, period=6.0, starts=1, iterations=50)
LIMITED = '<limit lower="-2.5" upper="2.5" effort="40" velocity="2"/>\n  </joint>\n</robot>'


def arm(**changes):
    """The two-link arm with all its limits known."""
    model = robots.two_link(**changes)
    xml = model.urdf_xml.replace('"elbow" type="continuous"', '"elbow" type="revolute"')
    before, mark, _ = xml.rpartition("</joint>")
    assert mark
    return model.with_urdf(before + LIMITED, "two_link")


LIMITS = ExcitationLimits(arm(), np.array([6.0, 9.0]), floor=Floor("fore", -0.3))


@pytest.fixture(scope="module")
def found():
    """Optimised for both criteria."""
    return {
        name: optimise_excitation(arm(), LIMITS, replace(QUICK, criterion=name))
        for name in ("condition", "determinant")
    }


@pytest.mark.parametrize("criterion", ["condition", "determinant"])
def test_limits_of_the_urdf_are_kept_with_their_margin(found, criterion):
    """Against figures of the URDF itself, five times finer than the last check."""
    time = np.linspace(0.0, 6.0, 30_001)
    path = found[criterion].motion.sample(time)
    model = arm()
    slack = 1.0 + 1e-4
    assert np.abs(path.joint_position[:, 0]).max() <= 0.9 * 3.0 * slack
    assert np.abs(path.joint_position[:, 1]).max() <= 0.9 * 2.5 * slack
    assert (np.abs(path.joint_velocity).max(axis=0) <= 0.9 * np.array([4.0, 2.0]) * slack).all()
    assert (np.abs(path.joint_acceleration).max(axis=0) <= np.array([5.4, 8.1]) * slack).all()
    motion = path
    rigid = Robot.from_model(model).joint_torque(
        motion.joint_position, motion.joint_velocity, motion.joint_acceleration
    )
    torque = ExcitationLimits(model, 6.0).joint_torque(motion)
    assert (np.abs(torque).max(axis=0) <= 0.9 * np.array([100.0, 40.0]) * slack).all()
    assert (np.abs(torque - rigid).max(axis=0) > 1.0).all()  # friction and rotors are in it
    height = -robots.L1 * np.sin(-path.joint_position[:, 0])  # the elbow: where 'fore' begins
    assert height.min() >= -0.3 - 1e-4
    ends = found[criterion].motion.sample(np.array([0.0, 6.0]))
    assert np.abs(ends.joint_velocity).max() < 1e-9
    assert np.abs(ends.joint_acceleration).max() < 1e-9


def test_each_criterion_wins_by_its_own_measure(found):
    least, greatest = found["condition"], found["determinant"]
    assert least.after.condition < 0.6 * least.before.condition
    assert greatest.after.log_determinant > greatest.before.log_determinant + 0.5
    assert least.after.condition < greatest.after.condition
    assert greatest.after.log_determinant > least.after.log_determinant
    assert least.after.not_excited == ()


def test_the_same_seed_gives_the_same_motion(found):
    again = optimise_excitation(arm(), LIMITS, QUICK)
    assert np.array_equal(again.motion.weights, found["determinant"].motion.weights)


@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    seed=st.integers(0, 10_000),
    margin=st.floats(0.5, 1.0),
    harmonics=st.integers(2, 6),
    period=st.floats(2.0, 20.0),
    acceleration=st.floats(2.0, 30.0),
)
def test_no_search_breaks_a_limit(seed, margin, harmonics, period, acceleration):
    limits = ExcitationLimits(arm(), acceleration, margin)
    choice = ExcitationSettings(
        harmonics=harmonics, period=period, starts=1, iterations=3, seed=seed
    )
    result = optimise_excitation(arm(), limits, choice)
    motion = result.motion.sample(np.linspace(0.0, period, 5_000))
    assert max(use.max() for use in limits.largest(motion).values()) <= 1.0 + 1e-3
    uses = [use for joint in result.joints for use in joint.use.values() if use is not None]
    assert max(uses) <= margin


def stepped(motion, order, step):
    """The motion with position, velocity or acceleration of the second joint moved."""
    channels = [motion.joint_position, motion.joint_velocity, motion.joint_acceleration]
    channels[order] = channels[order] + [0.0, step]
    return Trajectory(*channels)


def test_slopes_are_those_of_the_cost():
    """Analytic through one decomposition, next to plain differences of the whole."""
    limits = ExcitationLimits(arm(), 8.0)
    judge = ExcitationCriterion(arm(), limits, standard_columns(0.5))
    basis = FourierBasis(3, 5.0)
    weights = np.random.default_rng(4).normal(size=(basis.size, 2))
    motion = FourierMotion(basis, weights).sample(np.arange(60) / 12.0)
    for criterion in ("condition", "determinant"):
        slope = judge.slopes(motion, criterion)
        for order in range(3):
            step = 1e-4 * (limits.reach, limits.velocity, limits.acceleration)[order][1]
            up, down = (
                judge.cost(stepped(motion, order, sign * step), criterion) for sign in (1, -1)
            )
            plain = (up - down) / (2 * step)
            assert slope[order, :, 1].sum() == pytest.approx(plain, rel=1e-2, abs=1e-4)


def test_smooth_use_is_never_below_the_true_one():
    limits = ExcitationLimits(arm(), 8.0, floor=Floor("fore", -0.2))
    basis = FourierBasis(5, 8.0)
    random = np.random.default_rng(5)
    for _ in range(20):
        motion = FourierMotion(basis, random.normal(size=(basis.size, 2))).sample(
            np.arange(100) * 0.08
        )
        smooth, parts = limits.smooth(motion)
        largest = limits.largest(motion)
        for value, (kind, joint, _) in zip(smooth, parts, strict=True):
            assert largest[kind][joint] <= value <= largest[kind][joint] + 0.06


def test_payload_that_the_torque_cannot_lift_far_is_kept_low():
    """A torque limit binds: the same search without it uses more."""
    heavy = [{"link": "fore", "mass": 6.0, "centre_of_mass": [0.3, 0, 0], "tag": "assumed"}]
    bound = optimise_excitation(
        arm(payload=heavy), ExcitationLimits(arm(payload=heavy), 6.0), replace(QUICK, starts=1)
    )
    assert max(joint.use["torque"] for joint in bound.joints) <= bound.margin
    free = arm(payload=heavy)
    xml = free.urdf_xml.replace('effort="40"', 'effort="0"').replace('effort="100"', 'effort="0"')
    unbound = ExcitationLimits(free.with_urdf(xml, "two_link"), 6.0)
    assert np.isinf(unbound.torque).all()
    use = unbound.largest(bound.motion.sample(np.linspace(0, 6, 100)))
    assert use["torque"].max() == 0.0


def test_joint_without_end_stays_within_a_turn():
    limits = ExcitationLimits(load("ur3e"), 5.0)
    assert limits.reach[5] == pytest.approx(0.9 * np.pi)
    assert limits.middle[5] == 0.0


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"margin": 0.0}, "share of the limits"),
        ({"margin": 1.1}, "share of the limits"),
        ({"acceleration": np.array([1.0, 2.0, 3.0])}, "acceleration limits"),
        ({"acceleration": -1.0}, "acceleration limits"),
        ({"acceleration": np.nan}, "acceleration limits"),
        ({"floor": Floor("fore", np.nan)}, "height"),
    ],
)
def test_senseless_limits_are_refused(change, text):
    with pytest.raises(MotionError, match=text):
        ExcitationLimits(arm(), **change)


def test_robot_without_velocity_limit_is_refused_by_name():
    with pytest.raises(MotionError, match="'elbow' has no velocity limit"):
        ExcitationLimits(robots.two_link())


def test_unknown_tool_is_refused():
    with pytest.raises(RobotDescriptionError, match="no link 'gripper'"):
        ExcitationLimits(arm(), floor=Floor("gripper", 0.0))


def test_floor_that_no_motion_can_keep_is_refused():
    limits = ExcitationLimits(arm(), 6.0, floor=Floor("fore", 2.0))
    with pytest.raises(MotionError, match="no allowed motion"):
        optimise_excitation(arm(), limits, QUICK)


@pytest.mark.parametrize("change", [{"starts": 0}, {"iterations": 0}, {"seed": -1}])
def test_senseless_searches_are_refused(change):
    with pytest.raises(MotionError):
        ExcitationSettings(**change)


def kr16_limits() -> ExcitationLimits:
    acceleration = load_profile("kr16").acceleration
    return ExcitationLimits(load("kr16"), acceleration, floor=Floor("tool0", 0.2))


@pytest.fixture(scope="module")
def six_axes():
    """The search for the rig's robot from one start, to its end.

    After a few steps only, results differ with the rounding of the processor.
    """
    return {
        name: optimise_excitation(
            load("kr16"), kr16_limits(), ExcitationSettings(criterion=name, starts=1)
        )
        for name in ("condition", "determinant")
    }


@pytest.mark.long
def test_six_axes(six_axes):
    """58 base parameters; the condition number falls to less than a fifth."""
    for result in six_axes.values():
        assert len(result.base_parameters) == 58
        assert result.after.condition < 0.2 * result.before.condition
        assert result.least_height >= 0.2


def deviations(motion):
    """Scatter that identification finds from ten seconds on the rig, without constant errors."""
    config = replace(RigConfig.plain(), encoder=True, torque_noise=True)
    rig = VirtualRig(load_profile("kr16"), motion, config, seed=3, start_temperature_degc=40.0)
    joints = rig.step(250 * 10).joints
    parts = stretches(
        joints.stamp_ns,
        np.zeros(len(joints), dtype=np.int64),
        joints.joint_position,
        joints.measured_motor_torque,
    )
    choice = DynamicsSettings(columns=standard_columns(0.01), delay_span=0.0)
    return identify_dynamics(parts, load("kr16"), choice).fit.parts[SCATTER]


@pytest.mark.long
def test_excited_motion_says_more_than_random_programs_of_the_same_length(six_axes):
    """The programs keep position, speed and acceleration; torque they exceed, to their good."""
    limits = kr16_limits()
    allowed = MotionLimits(
        limits.middle - limits.reach,
        limits.middle + limits.reach,
        limits.velocity,
        limits.acceleration,
    )
    accept = tool_above(limits.robot, "tool0", 0.2)
    excited = {name: deviations(result.motion) for name, result in six_axes.items()}
    for seed in range(2):
        random = deviations(random_program(allowed, seed, accept=accept))
        for name, std in excited.items():
            ratio = std / random
            assert np.exp(np.log(ratio).mean()) < 0.5, f"{name}, program {seed}"
            assert (ratio < 1.0).mean() > 0.9, f"{name}, program {seed}"
