"""Columns: the torque of the fit is the torque of the monitor."""

import numpy as np
import pytest

import robots
from excited import fourier_motion
from robot_energy.model import RobotModel
from robot_energy.model.joint import ViscousExponent
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.friction import FrictionModel
from robot_energy_identify.dynamics.torque_model import Estimate, standard_columns
from robot_energy_plan.motion import Trajectory

MODEL = robots.two_link()
DRIVETRAIN = Drivetrain.from_model(MODEL)
TRANSMISSION = DRIVETRAIN.transmission  # the elbow's motor turns with the shoulder
MOTION = fourier_motion(2, np.arange(400) / 100.0)
VALUES = (0.7, 1.3)


def column_of(kind, *settings):
    """One of the standard columns."""
    return next(column for column in standard_columns(*settings) if column.kind == kind)


def written(column, values=VALUES) -> RobotModel:
    """The model with a column's parameters and no other friction or rotor."""
    nothing = Estimate(0.0, None, "assumed", "")
    joints = list(MODEL.joints)
    for index, value in enumerate(values):
        ratio = float(TRANSMISSION[index, index])
        joint = joints[index]
        for other in map(column_of, ("rotor_inertia", "viscous", "coulomb")):
            joint = other.written(joint, ratio, nothing)
        joints[index] = column.written(joint, ratio, Estimate(value, 0.1, "identified", "test"))
    return MODEL.model_copy(update={"joints": joints})


def monitor_friction(model):
    speed = DRIVETRAIN.motor_velocity_from_joint(MOTION.joint_velocity)
    friction = FrictionModel.from_model(model)
    temperature = np.full_like(speed, 25.0)
    coulomb = np.broadcast_to(friction.coulomb, speed.shape)
    still = np.zeros(speed.shape, dtype=np.bool_)
    return friction.torque(
        speed,
        coulomb,
        friction.viscous(temperature),
        motor_torque_rigid=speed,
        standing=still,
    )


@pytest.mark.parametrize("kind", ["viscous", "coulomb", "stribeck"])
def test_friction_column_is_the_monitors_friction(kind):
    column = column_of(kind, 0.03, 0.4)
    model = written(column)
    if kind == "stribeck":  # it has the smooth sign of the Coulomb term
        model = written(column)
        joints = [
            column_of("coulomb", 0.03).written(
                joint, float(TRANSMISSION[i, i]), Estimate(0, None, "assumed", "")
            )
            for i, joint in enumerate(model.joints)
        ]
        model = model.model_copy(update={"joints": joints})
    joint_torque = column.torque(MOTION, TRANSMISSION) @ np.array(VALUES)
    np.testing.assert_allclose(
        DRIVETRAIN.motor_torque_from_joint(joint_torque), monitor_friction(model), atol=1e-12
    )


def test_viscous_friction_that_was_fitted_in_proportion_to_speed_has_no_exponent():
    bent = ViscousExponent(exponent=robots.figure(0.7), velocity=robots.figure(150.0))
    joint = MODEL.joints[0]
    friction = joint.friction.model_copy(update={"viscous_exponent": bent})
    given = joint.model_copy(update={"friction": friction})
    found = column_of("viscous").written(given, 100.0, Estimate(2.0, 0.1, "identified", "test"))
    assert found.friction.viscous_exponent is None


def test_rotor_column_is_the_monitors_rotor_torque():
    model = written(column_of("rotor_inertia"))
    joint_torque = column_of("rotor_inertia").torque(MOTION, TRANSMISSION) @ np.array(VALUES)
    expected = Drivetrain.from_model(model).rotor_torque(MOTION.joint_acceleration)
    np.testing.assert_allclose(
        DRIVETRAIN.motor_torque_from_joint(joint_torque), expected, atol=1e-12
    )


def test_standard_deviation_changes_sides_with_its_value():
    joint = written(column_of("coulomb")).joints[1]
    ratio = abs(TRANSMISSION[1, 1])
    assert joint.friction.coulomb.value == pytest.approx(1.3 / ratio)
    assert joint.friction.coulomb.std == pytest.approx(0.1 / ratio)
    assert joint.friction.coulomb.tag == "identified"
    assert joint.friction.smooth_velocity.value == pytest.approx(0.01 * ratio)
    viscous = written(column_of("viscous")).joints[1].friction.viscous.viscous
    assert (viscous.value, viscous.std) == pytest.approx((1.3 / ratio**2, 0.1 / ratio**2))


def test_offset_is_a_constant_of_each_joint_and_has_no_place_in_a_model():
    torque = column_of("offset").torque(MOTION, TRANSMISSION) @ np.array(VALUES)
    np.testing.assert_array_equal(torque, np.tile(VALUES, (len(torque), 1)))
    assert column_of("offset").written is None


def test_coupled_joints_alone_have_friction_and_inertia_of_their_own():
    motion = Trajectory(np.zeros((1, 2)), np.array([[0.5, -2.0]]), np.array([[3.0, 4.0]]))
    for kind, expected in (
        ("joint_viscous", -2.0),
        ("joint_coulomb", -1.0),
        ("joint_inertia", 4.0),
    ):
        column = column_of(kind)
        assert column.joints(TRANSMISSION) == [1]
        np.testing.assert_allclose(
            column.torque(motion, TRANSMISSION)[0], [[0.0], [expected]], atol=1e-12
        )
        assert column.joints(np.diag([100.0, 50.0])) == []


def test_coupled_motor_drags_both_joints():
    """By hand: motor 2 turns with C = [[100, 0], [10, -50]]; its share at joint 1 is -1/5."""
    motion = Trajectory(np.zeros((1, 2)), np.array([[5.0, 3.0]]), np.zeros((1, 2)))
    torque = column_of("viscous").torque(motion, TRANSMISSION)[0]
    seen = 3.0 - 5.0 / 5.0
    np.testing.assert_allclose(torque, [[5.0, -0.2 * seen], [0.0, seen]])


def test_standard_columns_come_in_the_order_of_the_literature():
    kinds = [column.kind for column in standard_columns(0.01, 0.2)]
    assert kinds == [
        "viscous",
        "coulomb",
        "rotor_inertia",
        "offset",
        "stribeck",
        "joint_viscous",
        "joint_coulomb",
        "joint_inertia",
    ]
