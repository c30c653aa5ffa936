"""The machines of paper B: gantry, planar arm and articulated arm, against hand calculation."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from robot_energy.model import RobotModel, load
from robot_energy.model.figure import Figure
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.friction import FrictionModel
from robot_energy.physics.rigid_body import Robot
from robot_energy.pipeline import EnergyPipeline
from robot_energy.timeline.blocks import JointBlock

G = 9.80665
PRINTERS = ("mantis", "testbed", "irb4600")
MANTIS = ((1.15, 1.00, 0.65), (170.0, 110.0, 80.0))  # lengths [m], masses [kg]


def robot(name: str) -> Robot:
    return Robot.from_model(load(name))


def total_mass(name: str) -> float:
    root = ET.fromstring(load(name).urdf_xml)
    return sum(float(mass.get("value", "nan")) for mass in root.iter("mass"))


def figures(model: RobotModel) -> list[Figure]:
    found: list[Figure] = [model.cabinet.loss_grid, model.cabinet.loss_dc]
    for joint in model.joints:
        assert joint.losses is not None
        found += [joint.gear_ratio, joint.rotor_inertia, joint.friction.coulomb]
        found += [getattr(joint.losses, key) for key in ("constant", "linear", "copper")]
    return found


@pytest.mark.parametrize("name", PRINTERS)
def test_no_drive_figure_passes_for_more_than_assumed(name):
    model = load(name)
    assert model.drive == "loss_model"
    assert {figure.tag for figure in figures(model)} == {"assumed"}
    assert all(figure.source for figure in figures(model))
    assert "Identify your own" in model.provenance.notes


def test_masses_of_paper_b():
    assert total_mass("mantis") == pytest.approx(620.0)  # nearly, without base
    assert total_mass("testbed") == pytest.approx(2500.0)
    assert total_mass("irb4600") == pytest.approx(440.9, abs=0.1)  # ABB: 435, paper B: 465


@pytest.mark.parametrize("name", PRINTERS)
def test_every_joint_can_hold_and_overcome_its_friction(name):
    """Cold friction at top speed leaves torque to move with."""
    model, arm = load(name), robot(name)
    ratio = np.array([joint.gear_ratio.value for joint in model.joints])
    friction = FrictionModel.from_model(model)
    viscous = friction.viscous(np.full(arm.n_joints, 20.0))
    drag = (friction.coulomb + viscous * arm.limits.velocity * ratio) * ratio
    assert (drag < 0.6 * arm.limits.effort).all(), drag / arm.limits.effort


@pytest.mark.parametrize("name", PRINTERS)
def test_motors_turn_below_4000_rpm(name):
    model, arm = load(name), robot(name)
    ratio = np.array([joint.gear_ratio.value for joint in model.joints])
    assert (arm.limits.velocity * ratio * 60 / math.tau < 4000).all()


def test_mantis_reaches_2_8_m_and_its_tool_stays_in_a_plane():
    arm = robot("mantis")
    np.testing.assert_allclose(arm.link_position(np.zeros(3), "tool0"), [2.8, 0.0, 1.0])
    q = np.random.default_rng(0).uniform(-2.0, 2.0, 3)
    assert arm.link_position(q, "tool0")[2] == pytest.approx(1.0)


def test_mantis_knows_no_gravity():
    q = np.random.default_rng(1).uniform(-2.0, 2.0, (50, 3))
    still = np.zeros_like(q)
    assert np.abs(robot("mantis").joint_torque(q, still, still)).max() < 1e-9


def test_mantis_inertia_about_the_first_axis_by_hand():
    """Stretched: each beam by its distance from axis 1 and its own moment m a^2 / 10."""
    (a1, a2, a3), (m1, m2, m3) = MANTIS
    expected = (
        m1 * ((0.45 * a1) ** 2 + a1**2 / 10)
        + m2 * ((a1 + 0.45 * a2) ** 2 + a2**2 / 10)
        + m3 * ((a1 + a2 + 0.45 * a3) ** 2 + a3**2 / 10)
    )
    still = np.zeros((1, 3))
    turned = np.array([[1.0, 0.0, 0.0]])
    assert robot("mantis").joint_torque(still, still, turned)[0, 0] == pytest.approx(expected)
    assert expected == pytest.approx(841.0, abs=1.0)


def test_gantry_forces_by_hand():
    """Bridge, carriage and ram move with x, the ram alone against gravity with z."""
    arm = robot("testbed")
    still = np.zeros((1, 3))
    pushed = np.array([[0.5, -0.4, 0.2]])
    force = arm.joint_torque(np.array([[1.0, 0.5, 0.3]]), np.full((1, 3), 0.2), pushed)
    np.testing.assert_allclose(force, [[600 * 0.5, -250 * 0.4, 100 * (G + 0.2)]], rtol=1e-12)
    np.testing.assert_allclose(arm.joint_torque(still, still, still), [[0, 0, 100 * G]], atol=1e-9)
    assert arm.limits.prismatic.all()


def test_gantry_motors_turn_in_radians_per_metre():
    """Rack: gear 10 on a pinion of 30 mm; screw: one turn each 10 mm. Power is the same."""
    chain = Drivetrain.from_model(load("testbed"))
    speed = np.array([[0.125, 0.125, 0.01]])
    motor = chain.motor_velocity_from_joint(speed)
    np.testing.assert_allclose(motor, [[0.125 / 0.03 * 10, 0.125 / 0.03 * 10, math.tau]], rtol=1e-6)
    force = np.array([[300.0, 150.0, 100 * G]])
    torque = chain.motor_torque_from_joint(force)
    assert torque[0, 2] == pytest.approx(100 * G * 0.01 / math.tau, rel=1e-6)
    np.testing.assert_allclose((torque * motor).sum(), (force * speed).sum(), rtol=1e-12)


def test_gantry_runs_through_the_whole_chain():
    """Straight along x at 125 mm/s: 300 N and viscous friction, the ram held without power."""
    model = load("testbed")
    time = np.arange(500) * 4e-3
    position = np.column_stack([0.5 + 0.125 * time, np.full(500, 0.4), np.full(500, 0.2)])
    velocity = np.tile([0.125, 0.0, 0.0], (500, 1))
    stamps = (time * 1e9).astype(np.int64)
    nothing = np.full_like(position, np.nan)
    pipeline = EnergyPipeline(model)
    output = pipeline.step(
        JointBlock(
            stamps,
            np.zeros(500, dtype=np.int64),
            np.zeros(500, dtype=np.uint32),
            position,
            velocity,
            nothing,
            nothing,
        ),
        None,
        None,
    )
    assert output.power is not None
    shaft = output.power.rigid_power[250] + output.power.friction_power[250]
    speed = 0.125 / 0.03 * 10
    fv = 0.003 * (0.206 + 2.089 * math.exp(-22.0 / 20.71))
    assert shaft[0] == pytest.approx(0.9 * speed + fv * speed**2, rel=1e-3)
    assert 0.9 * speed / 0.125 == pytest.approx(300.0, rel=1e-6)
    np.testing.assert_allclose(shaft[1:], 0.0, atol=1e-6)
    loss = output.power.drive_loss[250, 2]
    assert loss == pytest.approx(5.0 + 10.0 * (1 + 0.0039 * 2) * (100 * G / 628.318531) ** 2)


def test_irb4600_kinematics():
    """Elbow and wrist of the published offsets; reach 2.55 m from axis 1 to the wrist."""
    arm = robot("irb4600")
    zero = np.zeros(6)
    np.testing.assert_allclose(arm.link_position(zero, "link_5"), [1.445, 0, 1.765], atol=1e-12)
    np.testing.assert_allclose(arm.link_position(zero, "tool0"), [1.580, 0, 1.765], atol=1e-12)
    np.testing.assert_allclose(arm.link_position(zero, "nozzle"), [1.880, 0, 1.765], atol=1e-12)
    stretched = np.array([0, math.pi / 2, -math.atan2(1.270, 0.175), 0, 0, 0])
    assert arm.link_position(stretched, "link_5")[0] == pytest.approx(2.55, abs=0.005)


def test_irb4600_hold_torque_by_hand():
    """Zero pose: each mass times its horizontal distance from the axis."""
    body = load("irb4600")
    still = np.zeros((1, 6))
    torque = Robot.from_model(body).joint_torque(still, still, still)[0]
    forearm, hand = 1.270 / 1.035, 1.270 + 0.135
    elbow = (
        61.590 * 0.0313
        + 29.550 * (0.308 + 0.4125) * forearm
        + 12.967 * (1.270 + 0.0339)
        + 2.896 * (hand + 0.0015)
        + 20.0 * (hand + 0.15)
    )
    assert torque[2] == pytest.approx(-G * elbow, rel=1e-3)  # +y bends the arm down
    assert torque[1] == pytest.approx(-G * (elbow + 104.928 * 0.002), rel=1e-3)
    assert torque[0] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(torque).max() < 0.2 * 5104.3


def test_irb4600_holds_the_arm_stretched():
    """At full reach with the print head axis 2 stays below its effort limit."""
    stretched = np.array([[0, math.pi / 2, -math.atan2(1.270, 0.175), 0, 0, 0]])
    still = np.zeros((1, 6))
    torque = robot("irb4600").joint_torque(stretched, still, still)[0]
    assert 1500 < abs(torque[1]) < 0.6 * 5104.3
