"""Springs at joints: torque by hand, energy without loss, and a weight that is carried."""

import pickle

import numpy as np
import pytest

import robots
from excited import fourier_motion
from robot_energy.model import validate
from robot_energy.model.joint import GasSpring, LeverSpring, TorsionSpring
from robot_energy.physics.counterbalance import (
    coefficients,
    counterbalance_torque,
    torque_columns,
)
from robot_energy.physics.rigid_body import Robot
from robots import figure

SPRING = {"kind": "spring", "stiffness": figure(40.0), "rest": figure(0.25)}
LEVER = {"kind": "lever", "moment": figure(30.0), "angle": figure(np.pi)}
GAS = {
    "kind": "gas_spring", "a": figure(0.3), "b": figure(0.4), "angle": figure(0.5),
    "force": figure(1000.0), "rate": figure(2000.0), "length": figure(0.6),
}  # fmt: skip
ENTRIES = [
    TorsionSpring.model_validate(SPRING),
    LeverSpring.model_validate(LEVER),
    GasSpring.model_validate(GAS),
]


def with_spring(entry, joint=0, **changes):
    data = {**robots.two_link_data(), **changes}
    data["joints"][joint]["counterbalance"] = entry
    return validate(data, "with a spring")


def energy_of(entry, q):
    """U up to a constant: k (q - q0)^2 / 2; M sin(q - angle); F s + k s^2 / 2 of a gas spring."""
    match entry:
        case TorsionSpring():
            return 0.5 * entry.stiffness.value * (q - entry.rest.value) ** 2
        case LeverSpring():
            return entry.moment.value * np.sin(q - entry.angle.value)
        case GasSpring():
            a, b = entry.a.value, entry.b.value
            length = np.sqrt(a * a + b * b - 2.0 * a * b * np.cos(q - entry.angle.value))
            pressed = entry.length.value - length
            return entry.force.value * pressed + 0.5 * entry.rate.value * pressed**2


def test_torque_by_hand():
    """k (q - q0); M cos(q - angle); gas spring at a right angle: 3-4-5 triangle of 0.5 m."""
    q = np.array([0.5 + np.pi / 2])
    spring, lever, gas = (float(counterbalance_torque(entry, q)[0]) for entry in ENTRIES)
    assert spring == pytest.approx(40.0 * (q[0] - 0.25), rel=1e-14)
    assert lever == pytest.approx(30.0 * np.cos(q[0] - np.pi), rel=1e-14)
    # F = 1000 + 2000 (0.6 - 0.5) = 1200 N, lever arm a b / l = 0.24 m, pushing towards larger q
    assert gas == pytest.approx(-1200.0 * 0.24, rel=1e-12)


@pytest.mark.parametrize("entry", ENTRIES)
def test_torque_is_the_slope_of_the_energy_and_linear_in_two_figures(entry):
    q, step = np.linspace(-2.0, 2.4, 50), 1e-6
    slope = energy_of(entry, q + step) - energy_of(entry, q - step)
    torque = counterbalance_torque(entry, q)
    np.testing.assert_allclose(torque, slope / (2.0 * step), rtol=1e-6, atol=1e-5)
    np.testing.assert_allclose(torque_columns(entry, q) @ coefficients(entry), torque)


def test_a_lever_spring_carries_the_weight_it_is_made_for():
    """Upper arm with the forearm stretched out along it: M g c cos q, taken off at every angle."""
    moment = robots.G * (robots.M1 * robots.C1 + robots.M2 * (robots.L1 + robots.C2))
    lever = {"kind": "lever", "moment": figure(moment), "angle": figure(np.pi)}
    position = np.zeros((40, 2))
    position[:, 0] = np.linspace(-3.0, 3.0, 40)
    still = np.zeros_like(position)
    alone = Robot.from_model(robots.two_link()).joint_torque(position, still, still)
    np.testing.assert_allclose(alone[:, 0], moment * np.cos(position[:, 0]), atol=1e-12)
    carried = Robot.from_model(with_spring(lever)).joint_torque(position, still, still)
    np.testing.assert_allclose(carried[:, 0], 0.0, atol=1e-10)
    np.testing.assert_array_equal(carried[:, 1], alone[:, 1])


@pytest.mark.parametrize("entry", [SPRING, LEVER, GAS])
def test_it_loses_nothing_over_a_closed_motion_and_the_rest_is_as_without(entry):
    time = np.arange(10_000) / 1000.0  # one period
    motion = fourier_motion(2, time)
    args = motion.joint_position, motion.joint_velocity, motion.joint_acceleration
    robot, plain = Robot.from_model(with_spring(entry)), Robot.from_model(robots.two_link())
    added = (robot.joint_torque(*args) - plain.joint_torque(*args))[:, 0]
    power = added * motion.joint_velocity[:, 0]
    assert np.abs(power).max() > 10.0
    assert abs(power.mean()) < 1e-9 * np.abs(power).max()
    again = pickle.loads(pickle.dumps(robot))  # of a worker process
    np.testing.assert_array_equal(again.joint_torque(*args), robot.joint_torque(*args))


def test_a_payload_changes_nothing_of_it_and_a_bad_sample_stays_alone():
    robot = Robot.from_model(with_spring(GAS)).with_payload(())
    position = np.array([[0.2, 0.1], [np.nan, 0.0]])
    still = np.zeros_like(position)
    torque = robot.joint_torque(position, still, still)
    gas = counterbalance_torque(ENTRIES[2], position[:1, 0])
    plain = Robot.from_model(robots.two_link()).joint_torque(position, still, still)
    assert torque[0, 0] == pytest.approx(plain[0, 0] + gas[0], rel=1e-14)
    assert np.isnan(torque[1, 0])


def test_a_model_without_one_keeps_its_identity():
    assert robots.two_link().model_id == validate(robots.two_link_data(), "again").model_id
    assert "counterbalance" not in robots.two_link().model_dump()["joints"][0]
    assert with_spring(SPRING).model_id != robots.two_link().model_id


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"kind": "rope"}, "kind"),
        ({"b": figure(0.3)}, "differ"),
        ({"a": figure(0.0)}, "> 0"),
        ({"force": figure(-5.0)}, "force"),
    ],
)
def test_an_impossible_spring_is_refused(change, words):
    with pytest.raises(Exception, match=words):
        with_spring({**GAS, **change})
