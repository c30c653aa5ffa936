"""Plants of the printing machines: of their class, and not their models in disguise."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from robot_energy.messages.fields import DRIVE_POWER_TOPIC
from robot_energy.model import load
from robot_energy.physics.drives_and_cabinet import drive_from_model
from robot_energy.physics.friction import FrictionModel
from robot_energy_identify.drives.drive_power import drive_topics
from robot_energy_plan.motion import InverseKinematics, Trajectory
from robot_energy_rig import RigConfig, RigOutput, VirtualRig, load_profile
from robot_energy_rig.record import outputs, record

PRINTERS = ("mantis", "testbed", "irb4600")
SPEED, RADIUS = 0.125, 0.3  # m/s of paper B, m
START = {
    "mantis": ("tool0", [0.0, -1.2, 1.8], [2.0, 0.0, 1.0]),
    "testbed": ("tool0", [0.0, 0.0, 0.0], [1.5, 0.5, 0.2]),
    "irb4600": ("nozzle", [0.1, 0.3, 0.2, 0.0, 1.0, 0.0], [1.5, 0.0, 0.4]),
}


class Circle:
    """The tool goes round at print speed."""

    def __init__(self, name: str, **options) -> None:
        link, start, centre = START[name]
        robot, _ = load_profile(name).mechanics()
        angle = np.linspace(0.0, 2 * np.pi, 200)
        places = np.array(centre) + RADIUS * np.column_stack(
            [np.cos(angle), np.sin(angle), np.zeros_like(angle)]
        )
        found = InverseKinematics(robot, link, **options).solve(places, np.array(start))
        found[-1] = found[0]
        self.period = 2 * np.pi * RADIUS / SPEED
        self.spline = CubicSpline(angle / (2 * np.pi) * self.period, found, bc_type="periodic")
        self.n_joints = robot.n_joints

    def sample(self, time) -> Trajectory:
        return Trajectory(*(self.spline(time, order) for order in range(3)))


def play(name, config=None, **options):
    motion = Circle(name, **options)
    rig = VirtualRig(load_profile(name), motion, config, 0, 22.0, 22.0)
    return RigOutput.concatenate(list(outputs(rig, motion.period)))


@pytest.mark.parametrize("options", [{}, {"held": ["joint_1"]}])
def test_mantis_drives_are_30_to_50_percent_efficient_while_printing(options):
    """Paper B, section 8, at the motor speeds of 60 to 200 rpm of a slow print."""
    truth = play("mantis", **options).truth
    shaft, input_ = truth.shaft_power.sum(axis=0), truth.drive_power.sum(axis=0)
    assert 0.3 < shaft.sum() / input_.sum() < 0.5
    moving = shaft > 0
    rpm = np.abs(truth.motor_velocity[:, moving]).mean(axis=0) * 60 / (2 * np.pi)
    assert (rpm > 25).all()
    assert (rpm < 200).all()


def test_gravity_costs_the_articulated_arm_much_more_than_it_moves():
    truth = play("irb4600").truth
    shaft, input_ = truth.shaft_power.sum(), truth.drive_power.sum()
    assert shaft / input_ < 0.25
    assert truth.copper_loss.sum() > 2 * shaft
    assert truth.rigid_power.sum() == pytest.approx(0.0, abs=0.02 * input_)


@pytest.mark.parametrize("name", PRINTERS)
def test_plant_is_not_its_model(name):
    """Friction and input of the drives differ from those of the shipped model."""
    truth, model = play(name, RigConfig().without("warming")).truth, load(name)
    friction = FrictionModel.from_model(model)
    standing = truth.motor_velocity == 0.0
    degc = np.full_like(truth.motor_velocity, 22.0)
    coulomb = np.broadcast_to(friction.coulomb, degc.shape)
    torque = friction.torque(
        truth.motor_velocity,
        coulomb,
        friction.viscous(degc),
        motor_torque_rigid=truth.motor_torque,
        standing=standing,
    )
    power, _ = drive_from_model(model).input_power(
        truth.shaft_power, truth.motor_velocity, truth.motor_torque, degc
    )
    for theirs, ours in (
        (truth.friction_power, torque * truth.motor_velocity),
        (truth.drive_power, power),
    ):
        moved = theirs.sum(axis=0) > 0.01 * theirs.sum()
        error = np.abs(ours.sum(axis=0)[moved] / theirs.sum(axis=0)[moved] - 1.0)
        assert error.max() > 0.03
        assert abs(ours.sum() / theirs.sum() - 1.0) < 0.5


def test_recorded_drive_power_is_what_the_drives_say(tmp_path):
    motion = Circle("mantis")
    rigs = [VirtualRig(load_profile("mantis"), motion, None, 5) for _ in range(2)]
    written = record(rigs[0], 2.0, tmp_path / "bag", drive_power=True)
    assert written.messages[DRIVE_POWER_TOPIC] == 500
    expected = RigOutput.concatenate(list(outputs(rigs[1], 2.0)))
    found = drive_topics(DRIVE_POWER_TOPIC).read(tmp_path / "bag", rigs[0].joint_names)
    np.testing.assert_array_equal(found.power, expected.joints.measured_drive_power)
    error = found.power - expected.truth.drive_power
    assert 0.4 < error.std() < 0.7
    assert np.abs(error.mean(axis=0) / expected.truth.drive_power.mean(axis=0)).max() < 0.02


def test_power_of_the_drives_can_be_true_and_changes_nothing_else():
    noisy, true = (
        play("mantis", config) for config in (None, RigConfig().without("drive_power_error"))
    )
    np.testing.assert_array_equal(true.joints.measured_drive_power, true.truth.drive_power)
    np.testing.assert_array_equal(
        noisy.joints.measured_motor_torque, true.joints.measured_motor_torque
    )
    np.testing.assert_array_equal(noisy.meter.power, true.meter.power)
