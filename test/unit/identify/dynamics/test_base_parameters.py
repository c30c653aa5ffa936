"""Groups of parameters: robots whose groups are known by hand, and the traps of rounding."""

import numpy as np
import pytest

import robots
from robot_energy.model import load
from robot_energy.physics.rigid_body import Robot
from robot_energy_identify.dynamics.base_parameters import (
    base_parameters,
    not_excited,
    numerical_rank,
)
from robot_energy_identify.dynamics.torque_model import TorqueModel, standard_columns


def groups(model, columns=()):
    return TorqueModel.from_model(model, columns).structure()


def expressions(base):
    return {base.expression(group) for group in range(len(base))}


def test_groups_of_a_vertical_two_link_arm():
    """By hand: the fore-arm's mass sits in the shoulder's terms at the upper arm's length."""
    base = groups(robots.two_link())
    assert len(base) == 6
    lever, square = robots.L1, robots.L1**2
    assert expressions(base) == {
        f"mx shoulder + {lever:g} m elbow",
        "mz shoulder",
        f"Iyy shoulder + {square:g} m elbow",
        "mx elbow",
        "mz elbow",
        "Iyy elbow",
    }


def test_groups_of_the_same_arm_without_gravity():
    """Nothing pulls at the first link any more: only its inertia about the axis is left."""
    base = groups(robots.two_link(gravity=[0.0, -robots.G, 0.0]))
    assert {name.split(" +")[0] for name in expressions(base)} == {
        "Iyy shoulder",
        "mx elbow",
        "mz elbow",
        "Iyy elbow",
    }


def test_rotor_of_the_first_joint_cannot_be_said_from_its_link():
    base = groups(robots.one_wheel(), standard_columns())
    assert expressions(base) == {
        "Izz axle + rotor_inertia axle",
        "viscous axle",
        "coulomb axle",
        "offset axle",
    }
    assert base.alone("viscous axle")
    assert not base.alone("rotor_inertia axle")
    assert not base.alone("Izz axle")
    assert "m axle" in base.without_effect


@pytest.mark.parametrize("name", ["kr16", "ur5e"])
def test_an_arm_with_six_joints_has_36_inertial_groups(name):
    """The known number for six revolute joints, the first one vertical."""
    model = load(name)
    assert len(groups(model)) == 36
    with_drives = groups(model, standard_columns())
    inertial = (with_drives.independent < 60).sum()
    # 6 viscous, 6 Coulomb, 6 offsets; rotors of the first two joints join their links.
    assert (inertial, len(with_drives)) == (36, 36 + 18 + 4)


def test_base_parameters_times_their_columns_are_the_whole_torque():
    model = robots.two_link()
    robot = Robot.from_model(model)
    base = groups(model)
    q, v, a = np.random.default_rng(0).normal(size=(3, 40, 2))
    whole = robot.torque_regressor(q, v, a)
    values = base.matrix @ robot.link_parameters
    np.testing.assert_allclose(
        whole[:, :, base.independent] @ values, robot.joint_torque(q, v, a), atol=1e-10
    )


def test_a_column_of_rounding_is_no_parameter():
    """Scaled to unit length it would be as long as any other, and count."""
    random = np.random.default_rng(1)
    columns = random.normal(size=(300, 3)) * np.array([1.0, 1e-4, 1e3])
    rounding = 1e-16 * random.normal(size=(300, 1))
    twice = columns[:, :1] * 2 + 1e-15 * random.normal(size=(300, 1))
    names = ("a", "small", "large", "nothing", "twice a")
    base = base_parameters(np.concatenate([columns, rounding, twice], axis=1), names)
    assert expressions(base) == {"a + 2 twice a", "small", "large"}
    assert base.without_effect == ("nothing",)
    scaled = np.concatenate([columns, rounding], axis=1)
    scaled /= np.linalg.norm(scaled, axis=0)
    assert len(base_parameters(scaled, names[:4])) == 4  # the trap


@pytest.mark.parametrize(
    ("pivots", "rank"),
    [
        ([], 0),
        ([0.0, 0.0], 0),
        ([3.0, 2.0, 1.0], 3),
        ([1e3, 1.0, 1e-4, 1e-13, 1e-15], 3),
        ([1.0, 1e-2, 1e-14, 0.0, 0.0], 2),
        ([1.0, 1e-2, 0.0], 2),
        ([1.0, 1e-7], 2),
    ],
)
def test_rank_ends_at_the_widest_gap_above_rounding(pivots, rank):
    assert numerical_rank(np.array(pivots)) == rank


def test_the_first_parameter_names_a_group():
    first = np.random.default_rng(2).normal(size=(50, 1))
    columns = np.concatenate([first, 3 * first], axis=1)
    assert expressions(base_parameters(columns, ("a", "b"))) == {"a + 3 b"}


def test_what_a_recording_does_not_excite_is_named():
    random = np.random.default_rng(3)
    columns = random.normal(size=(500, 4))
    columns[:, 1] *= 1e-13
    columns[:, 3] = columns[:, 2] * (1 + 1e-9 * random.normal(size=500))
    assert set(not_excited(columns, ("a", "silent", "c", "d"))) == {"silent", "c", "d"}
    assert not_excited(random.normal(size=(500, 2)), ("a", "b")) == ()
    assert not_excited(random.normal(size=(1, 2)), ("a", "b")) == ("a", "b")
