"""From the URDF of a stranger and a log to a first replay, in three commands.

The URDFs are those of a package of robot descriptions, as they are. The logs are not of our rig:
a motion of sines, worked out here, with torques of Pinocchio, friction and noise.
"""

import json
from pathlib import Path

import numpy as np
import pinocchio
import pytest

from places import ROOT
from robot_energy.bag import BagWriter
from robot_energy.bag.cdr.types import typestore
from robot_energy_cli import main

LIBRARY = ROOT / "build/robots/compas_fab/data/robot_library"
ROBOTS = ["abb_irb120_3_58", "ur5_robot", "ur10e_robot"]
LOGS = ["bag", "table", "bag"]
RATE, DURATION = 250.0, 10.0  # Hz, s
COULOMB, VISCOUS = 0.03, 0.02  # of the greatest torque of each joint [-], [s/rad]
NOISE = 0.002  # of the same [-]

pytestmark = pytest.mark.skipif(not LIBRARY.is_dir(), reason="`make test` brings the URDFs")


class Motion:
    """A log of a robot: positions, velocities and joint torques of a motion of sines."""

    def __init__(self, urdf: Path) -> None:
        model = pinocchio.buildModelFromUrdf(str(urdf))
        data = model.createData()
        self.names = list(model.names)[1:]
        self.time = np.arange(round(RATE * DURATION)) / RATE
        middle = np.clip((model.lowerPositionLimit + model.upperPositionLimit) / 2, -1.0, 1.0)
        rate = 0.7 + 0.13 * np.arange(model.nv)  # rad/s
        swing = np.minimum(0.4 * model.velocityLimit / rate, 0.6)
        phase = self.time[:, None] * rate
        self.position = middle + swing * np.sin(phase)
        self.velocity = swing * rate * np.cos(phase)
        acceleration = -swing * rate**2 * np.sin(phase)
        rows = zip(self.position, self.velocity, acceleration, strict=True)
        self.rigid = np.array([pinocchio.rnea(model, data, q, v, a) for q, v, a in rows])
        largest = np.abs(self.rigid).max(axis=0)
        friction = COULOMB * np.sign(self.velocity) + VISCOUS * self.velocity
        noise = np.random.default_rng(1).normal(size=self.rigid.shape)
        self.torque = self.rigid + largest * (friction + NOISE * noise)

    def write_bag(self, path: Path) -> None:
        """As `ros2 bag record /joint_states` of a driver leaves it."""
        store = typestore()
        types = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
        start_ns = 1_700_000_000 * 10**9
        with BagWriter(path) as bag:
            bag.add_topic("/joint_states", "sensor_msgs/msg/JointState")
            for second, q, v, tau in zip(
                self.time, self.position, self.velocity, self.torque, strict=True
            ):
                stamp_ns = start_ns + round(second * 1e9)
                header = types["Header"](types["Time"](*divmod(stamp_ns, 10**9)), "")
                message = types["JointState"](header, self.names, q, v, tau)
                row = bytes(store.serialize_cdr(message, "sensor_msgs/msg/JointState"))
                bag.write("/joint_states", [stamp_ns], [row])

    def write_table(self, path: Path, mapping: Path) -> None:
        """As a controller writes it, with what its columns are called and their units."""
        names = [f"{what}_{joint}" for what in ("q", "dq", "tau") for joint in self.names]
        columns = np.hstack([self.time[:, None], self.position, self.velocity, self.torque])
        header = ",".join(["t", *names])
        np.savetxt(path, columns, fmt="%.9g", delimiter=",", header=header, comments="")
        mapping.write_text(
            "schema_version: 1\ntime: {column: t, unit: s, start: 2026-01-01T00:00:00Z}\n"
            f"joints:\n  names: [{', '.join(self.names)}]\n"
            "  position: {column: 'q_{joint}', unit: rad}\n"
            "  velocity: {column: 'dq_{joint}', unit: rad_per_s}\n"
            "  effort: {column: 'tau_{joint}', unit: newton_metre}\n"
        )


def run(*words: object) -> None:
    assert main([str(word) for word in words]) == 0


@pytest.mark.parametrize(("robot", "log"), list(zip(ROBOTS, LOGS, strict=True)))
def test_urdf_and_log_give_a_first_replay_in_three_commands(robot, log, tmp_path):
    """The rigid-body energy of each joint is that of the motion; nothing was written by hand."""
    urdf = LIBRARY / robot / "urdf/robot_description.urdf"
    motion = Motion(urdf)
    model, bag, result = tmp_path / "model.yaml", tmp_path / "bag", tmp_path / "result.json"
    run("model", "init", urdf, "--out", model)
    if log == "bag":
        motion.write_bag(bag)
    else:
        motion.write_table(tmp_path / "log.csv", tmp_path / "log.yaml")
        run(
            "import",
            "table",
            tmp_path / "log.csv",
            "--mapping",
            tmp_path / "log.yaml",
            "--out",
            bag,
        )
    run("replay", bag, "--model", model, "--effort", "joint_torque", "--json", result)
    found = json.loads(result.read_text())
    assert found["model"]["figures"]["identified"] == 0
    assert found["time"]["coverage"] == pytest.approx(1.0, abs=0.01)
    assert found["energy"]["grid_import"] > 0
    assert found["energy"]["balanced"]
    assert not found["problems"]

    power = motion.rigid * motion.velocity
    lifted = np.cumsum((power[1:] + power[:-1]) / (2.0 * RATE), axis=0)[-1]
    size = np.abs(power).sum(axis=0) / RATE
    assert [joint["name"] for joint in found["joints"]] == motion.names
    rigid = np.array([joint["rigid_energy"] for joint in found["joints"]])
    rotors = kinetic_energy_of_rotors(model, motion)
    np.testing.assert_allclose(rigid - rotors, lifted, atol=2e-4 * size.max())


def kinetic_energy_of_rotors(path: Path, motion: Motion) -> np.ndarray:
    """What rotors gain from the first sample to the last: they are the model's, not the log's."""
    import robot_energy as re

    model = re.load_model(path)
    inertia = np.array([joint.rotor_inertia.value for joint in model.joints])
    ratio = np.array([joint.gear_ratio.value for joint in model.joints])
    speed = motion.velocity[[0, -1]]
    return 0.5 * inertia * ratio**2 * (speed[1] ** 2 - speed[0] ** 2)


@pytest.mark.parametrize(
    ("robot", "words"),
    [
        ("abb_irb4600_40_255", "link 'base_link' has a principal moment of inertia of -6.04"),
        ("panda", "the URDF gives no mass to any moving link"),
    ],
)
def test_a_urdf_that_says_no_physics_is_refused_with_the_place(robot, words, tmp_path, capsys):
    """One has moments of inertia below zero, the other no inertials at all."""
    urdf = LIBRARY / robot / "urdf/robot_description.urdf"
    assert main(["model", "init", str(urdf), "--out", str(tmp_path / "model.yaml")]) == 2
    assert words in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
