import numpy as np
import pytest

import robots
from robot_energy.foundation.errors import RobotDescriptionError, UnknownJointError
from robot_energy.model import load
from robot_energy.model.schema import Payload
from robot_energy.physics.rigid_body import Robot


def lagrange_two_link(q, dq, ddq):
    """Closed-form torque of the arm from Lagrange's equations, angles lifting the arm."""
    q1, q2 = q
    dq1, dq2 = dq
    m, l1, c1, c2 = robots.M2, robots.L1, robots.C1, robots.C2
    cos2, sin2 = np.cos(q2), np.sin(q2)
    m22 = m * c2**2 + robots.I2
    m12 = m22 + m * l1 * c2 * cos2
    m11 = robots.M1 * c1**2 + robots.I1 + m * l1**2 + m22 + 2 * m * l1 * c2 * cos2
    h = m * l1 * c2 * sin2
    coriolis = np.array([-h * (2 * dq1 * dq2 + dq2**2), h * dq1**2])
    g2 = m * c2 * robots.G * np.cos(q1 + q2)
    gravity = np.array([(robots.M1 * c1 + m * l1) * robots.G * np.cos(q1) + g2, g2])
    return np.array([[m11, m12], [m12, m22]]) @ ddq + coriolis + gravity


def test_torque_equals_lagrange_equations_of_two_link_arm():
    robot = Robot.from_model(robots.two_link())
    rng = np.random.default_rng(1)
    q, dq, ddq = rng.normal(size=(3, 50, 2)) * np.array([1.0, 2.0, 5.0])[:, None, None]
    torque = robot.joint_torque(q, dq, ddq)
    for row in range(50):
        np.testing.assert_allclose(
            torque[row], lagrange_two_link(q[row], dq[row], ddq[row]), rtol=1e-11, atol=1e-11
        )


def test_one_sample_equals_the_same_sample_in_a_block():
    robot = Robot.from_model(robots.two_link())
    q = np.random.default_rng(2).normal(size=(7, 2))
    whole = robot.joint_torque(q, q, q)
    for row in range(7):
        part = robot.joint_torque(q[row : row + 1], q[row : row + 1], q[row : row + 1])
        assert part.shape == (1, 2)
        np.testing.assert_array_equal(part[0], whole[row])


def test_nan_sample_gives_nan_and_leaves_its_neighbours():
    robot = Robot.from_model(robots.two_link())
    q = np.zeros((3, 2))
    bad = q.copy()
    bad[1] = np.nan
    torque = robot.joint_torque(bad, q, q)
    assert np.isnan(torque[1]).all()
    np.testing.assert_array_equal(torque[[0, 2]], robot.joint_torque(q, q, q)[[0, 2]])


def test_model_order_is_kept_whatever_the_order_in_the_urdf():
    forward = Robot(robots.TWO_LINK_URDF, ("shoulder", "elbow"))
    backward = Robot(robots.TWO_LINK_URDF, ("elbow", "shoulder"))
    q = np.random.default_rng(3).normal(size=(4, 2))
    np.testing.assert_array_equal(
        forward.joint_torque(q, q, q), backward.joint_torque(*[q[:, ::-1]] * 3)[:, ::-1]
    )
    assert backward.limits.velocity[1] == 4.0
    assert backward.limits.lower[0] == -np.inf


def test_joint_that_the_model_does_not_name_is_locked():
    robot = Robot(robots.TWO_LINK_URDF, ("shoulder",), gravity=(0, 0, -robots.G))
    assert robot.inventory.locked_joints == ("elbow",)
    zero = np.zeros((1, 1))
    stretched = lagrange_two_link([0, 0], [0, 0], [0, 0])[0]
    assert robot.joint_torque(zero, zero, zero)[0, 0] == pytest.approx(stretched, rel=1e-12)


def test_payload_adds_its_weight_at_its_lever():
    body = Payload(link="fore", mass=3.0, centre_of_mass=(0.25, 0, 0), tag="assumed")
    bare = Robot(robots.TWO_LINK_URDF, ("shoulder", "elbow"), (0, 0, -robots.G))
    loaded = Robot(robots.TWO_LINK_URDF, ("shoulder", "elbow"), (0, 0, -robots.G), [body])
    zero = np.zeros((1, 2))
    extra = (loaded.joint_torque(zero, zero, zero) - bare.joint_torque(zero, zero, zero))[0]
    weight = 3.0 * robots.G
    np.testing.assert_allclose(extra, [weight * (robots.L1 + 0.25), weight * 0.25], rtol=1e-12)
    assert loaded.moving_mass == pytest.approx(bare.moving_mass + 3.0)


def test_links_and_joints_may_share_a_name():
    """As in the URDF of the Unitree Z1; torque, payload and place are those of other names."""
    urdf = robots.TWO_LINK_URDF
    shared = urdf.replace('"upper"', '"shoulder"').replace('"fore"', '"elbow"')
    body = {"mass": 3.0, "centre_of_mass": (0.25, 0, 0), "tag": "assumed"}
    joints, q = ("shoulder", "elbow"), np.array([[0.3, -0.7]])
    one = Robot(urdf, joints, payload=[Payload(link="fore", **body)])
    two = Robot(shared, joints, payload=[Payload(link="elbow", **body)])
    np.testing.assert_array_equal(two.joint_torque(q, q, q), one.joint_torque(q, q, q))
    np.testing.assert_array_equal(two.link_position(q[0], "elbow"), one.link_position(q[0], "fore"))
    assert two.has_link("elbow")
    assert not one.has_link("elbow")


@pytest.mark.parametrize(
    ("urdf", "error", "words"),
    [
        ("<robot", RobotDescriptionError, "well-formed"),
        ("<!DOCTYPE x><robot/>", RobotDescriptionError, "DOCTYPE"),
        ("<sdf/>", RobotDescriptionError, "root 'sdf'"),
        ("<robot name='r'><link name='base'/></robot>", UnknownJointError, "shoulder"),
        (
            '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/></robot>',
            RobotDescriptionError,
            "^the URDF is a xacro file.*xacro FILE > robot.urdf.*model init FILE",
        ),
        ("<robot><xacro:arm/></robot>", RobotDescriptionError, "^the URDF is a xacro file"),
        (
            robots.TWO_LINK_URDF.replace('<mass value="2.0"/>', '<mass value="0"/>'),
            RobotDescriptionError,
            "no mass to moving links.*fore",
        ),
        (
            robots.TWO_LINK_URDF.replace('type="revolute"', 'type="floating"'),
            RobotDescriptionError,
            "type 'floating'",
        ),
        (
            robots.TWO_LINK_URDF.replace('<mass value="2.0"/>', '<mass value="heavy"/>'),
            RobotDescriptionError,
            "mass 'heavy'",
        ),
    ],
)
def test_unusable_urdf_is_refused_in_one_sentence(urdf, error, words):
    with pytest.raises(error, match=words) as caught:
        Robot(urdf, ("shoulder", "elbow"))
    assert "\n" not in str(caught.value)


def test_massless_link_may_be_named_on_purpose():
    urdf = robots.TWO_LINK_URDF.replace('<mass value="2.0"/>', '<mass value="0"/>')
    assert Robot(urdf, ("shoulder", "elbow"), massless_links=["fore"]).n_joints == 2


@pytest.mark.parametrize("rounding", [0.0, -3e-31, -5e-8])
def test_a_payload_whose_least_moment_is_rounded_below_zero_is_carried(rounding):
    """A rod has no moment about its axis; in figures that is sometimes -3e-31."""
    rod = {"link": "fore", "mass": 1.0, "inertia": [rounding, 0.1, 0.1, 0, 0, 0], "tag": "assumed"}
    robot = Robot(
        robots.TWO_LINK_URDF, ("shoulder", "elbow"), payload=robots.two_link(payload=[rod]).payload
    )
    turn = np.array([[0.0, 1.0]])
    bare = Robot(robots.TWO_LINK_URDF, ("shoulder", "elbow")).joint_torque(0 * turn, 0 * turn, turn)
    loaded = robot.joint_torque(0 * turn, 0 * turn, turn)
    assert robot.moving_mass == pytest.approx(robots.M1 + robots.M2 + 1.0)
    assert loaded[0, 1] - bare[0, 1] == pytest.approx(0.1)


@pytest.mark.parametrize("order", [("shoulder", "elbow"), ("elbow", "shoulder")])
def test_regressor_times_parameters_is_inverse_dynamics(order):
    """The payload belongs to the torque, not to the parameters of the links."""
    body = Payload(link="fore", mass=3.0, centre_of_mass=(0.25, 0, 0), tag="assumed")
    bare = Robot(robots.TWO_LINK_URDF, order, (0, 0, -robots.G))
    loaded = Robot(robots.TWO_LINK_URDF, order, (0, 0, -robots.G), [body])
    q, v, a = np.random.default_rng(4).normal(size=(3, 30, 2))
    np.testing.assert_allclose(
        loaded.torque_regressor(q, v, a) @ loaded.link_parameters,
        bare.joint_torque(q, v, a),
        rtol=1e-10,
        atol=1e-12,
    )


def test_regressor_of_a_six_axis_robot_with_locked_joint_is_its_inverse_dynamics():
    model = load("kr16")
    names = [name for name in model.joint_names if name != model.joint_names[4]]
    robot = Robot(model.urdf_xml, names)
    assert len(robot.inventory.locked_joints) == 1
    q, v, a = np.random.default_rng(5).normal(size=(3, 20, 5))
    torque = robot.joint_torque(q, v, a)
    found = robot.torque_regressor(q, v, a) @ robot.link_parameters
    np.testing.assert_allclose(found, torque, rtol=1e-9, atol=1e-9 * np.abs(torque).max())


def test_link_parameters_are_mass_moment_and_inertia_about_the_joint():
    parameters = Robot(robots.TWO_LINK_URDF, ("shoulder", "elbow")).link_parameters
    m, c = robots.M1, robots.C1
    about_joint = robots.I1 + m * c**2  # parallel axis theorem
    np.testing.assert_allclose(
        parameters[:10], [m, m * c, 0, 0, 0.001, 0, about_joint, 0, 0, about_joint], atol=1e-15
    )


def test_robots_of_one_model_do_not_share_what_they_carry():
    first, second = Robot.from_model(load("kr16")), Robot.from_model(load("kr16"))
    q = np.full((1, 6), 0.4)
    before = second.joint_torque(q, q, q)
    empty = first.with_payload(())
    assert not np.allclose(empty.joint_torque(q, q, q), before)
    np.testing.assert_array_equal(second.joint_torque(q, q, q), before)
    np.testing.assert_array_equal(Robot.from_model(load("kr16")).joint_torque(q, q, q), before)
