"""Models, URDFs, parameter files of inputs, state files: anything or a refusal."""

import functools
import json
import shutil

import numpy as np
import yaml
from target import JOINTS, done, in_file, scratch

import robots
from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.record import FORMAT_VERSION
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.inputs.temperatures.kinds import TEMPERATURE_KINDS
from robot_energy.model import parse_yaml, validate
from robot_energy.physics.rigid_body import Robot
from robot_energy.pipeline import EnergyPipeline
from robot_energy.store.account_store import file_name_of, identity_of, load_account
from robot_energy.store.slots import wrap
from robot_energy_identify.starter import read_arm, read_description, starter_text
from robot_energy_identify.starter.model_remarks import implausible


def model_file(data: bytes) -> bool:
    """A model file is refused, or makes a pipeline."""

    def read() -> None:
        model = validate(parse_yaml(data.decode("utf-8", "replace"), "fuzz.yaml"), "fuzz.yaml")
        EnergyPipeline(model)

    return done(read)


def model_seeds() -> list[bytes]:
    """The two-link arm, with all drives and laws."""
    plain, rich = robots.two_link_data(), robots.two_link_data()
    figure = robots.figure
    law = {"law": "table", "motor_temperature_degc": [20, 60], "viscous": [2e-4, 1e-4]}
    points = {"motor_velocity": [1, 2], "motor_torque": [1, -1], "efficiency": [0.8, 1.2]}
    for joint in rich["joints"]:
        joint["friction"]["viscous"] = {**law, "tag": "identified"}
        joint["friction"]["stribeck"] = {"torque": figure(0.1), "velocity": figure(1.0)}
        joint["friction"]["smooth_velocity"] = figure(0.1)
        joint["efficiency_map"] = {**points, "tag": "derived"}
        joint["losses"] = {
            name: figure(1e-3) for name in ("constant", "linear", "quadratic", "copper")
        }
    rich["cabinet"]["capacitor"] = {
        "capacitance": figure(1e-3),
        "nominal_voltage": figure(300.0),
        "chopper_voltage": figure(380.0),
    }
    rich["payload"] = [{"link": "fore", "mass": 1.0, "tag": "assumed"}]
    drives = [{**rich, "drive": drive} for drive in ("loss_model", "efficiency_map")]
    apart = [json.loads(json.dumps(data)) for data in (plain, *drives)]  # no aliases
    return [yaml.safe_dump(data).encode() for data in apart]


def urdf(data: bytes) -> bool:
    """A robot description is refused, or makes a robot with finite torques at rest."""

    def read() -> None:
        robot = Robot(data.decode("utf-8", "replace"), JOINTS)
        pose = np.zeros((1, 2))
        assert np.isfinite(robot.joint_torque(pose, pose, pose)).all()

    return done(read)


def urdf_seeds() -> list[bytes]:
    """The two-link arm."""
    return [robots.TWO_LINK_URDF.encode()]


def first_model(data: bytes) -> bool:
    """A file is refused, or makes a first model that can be read, with finite torques."""

    def read() -> None:
        description = read_description(in_file("robot.urdf", data))
        arm = read_arm(description.xml)
        text = starter_text(arm, description, scratch())
        model = validate(parse_yaml(text, "first.yaml"), str(scratch() / "first.yaml"))
        robot = Robot.from_model(model)
        pose = np.zeros((1, len(arm.joints)))
        assert np.isfinite(robot.joint_torque(pose, pose, pose)).all()
        assert all("\n" not in text for text in (*arm.remarks, *implausible(model, robot)))

    if b"xacro" in data:  # which is a program of others, and slow
        return False
    return done(read)


def first_model_seeds() -> list[bytes]:
    """The two-link arm as others write it: drives, prefixes, encodings."""
    more = (
        '<transmission name="t"><joint name="elbow"/><actuator name="m"><drake:gear_ratio '
        'value="50"/><drake:rotor_inertia value="1e-5"/></actuator></transmission>'
        '<transmission name="s"><joint name="shoulder"/><actuator name="n"><mechanicalReduction>'
        "113.9</mechanicalReduction></actuator></transmission></robot>"
    )
    text = robots.TWO_LINK_URDF.strip().replace("</robot>", more)
    text = text.replace("<limit", '<dynamics damping="3" friction="2"/><limit')
    declared = '<?xml version="1.0" encoding="{}"?>\n' + text.replace("two_link", "zweiglied ä")
    encodings = ("ISO-8859-1", "utf-16")
    return [text.encode(), *(declared.format(name).encode(name) for name in encodings)]


def inputs_file(data: bytes) -> bool:
    """The inputs of a replay are refused, or read."""
    path = in_file("inputs.yaml", data)
    return done(lambda: read_inputs(path))


def inputs_seeds() -> list[bytes]:
    """Parameters of a node."""
    source = {
        "topic": "/a",
        "type": next(iter(TEMPERATURE_KINDS)),
        "unit": "kelvin",
        "joints": ["a"],
    }
    nodes = {"/**": {"ros__parameters": {"temperature_sources": ["m"], "m": source, "rate": 2}}}
    return [yaml.safe_dump(nodes).encode()]


def state_file(data: bytes) -> bool:
    """State files are continued or moved aside."""
    model, account = robots.two_link(), EnergyAccount(2)
    folder = scratch() / "state"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    name = file_name_of(identity_of(model))
    (folder / f"{name}.a.state").write_bytes(data)
    payload = data.partition(b"\n")[2]
    (folder / f"{name}.b.state").write_bytes(wrap(FORMAT_VERSION, 1, payload))
    keeper = load_account(account, model, folder)
    keeper.open()
    taken = keeper.sequence > 0
    kept = keeper.close()
    assert kept == keeper.loaded
    assert kept or keeper.trouble
    return taken


@functools.cache
def state_seeds() -> list[bytes]:
    """The books of an arm that has moved."""
    model, folder = robots.two_link(), scratch() / "state_seed"
    pipeline = EnergyPipeline(model)
    keeper = load_account(pipeline.account, model, folder)
    keeper.open()
    stamp, pose = 10 + np.arange(20) / 100, np.full((20, 2), 0.3)
    pipeline.step(robots.joint_block(stamp, pose, pose))
    pipeline.flush()
    assert keeper.checkpoint()
    assert keeper.close()
    return [path.read_bytes() for path in sorted(folder.glob("*.state"))]
