"""Each robot's preset reads what its driver publishes. The drivers themselves were not run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from driver_messages import (
    Driver,
    Message,
    chain_model,
    effort_of,
    motion,
    replaced,
)
from places import ROOT
from robot_energy.foundation.errors import KindError, ModelFileError, ParameterError
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.model import load, save
from robot_energy.presets import ROBOTS
from robot_energy.timeline.blocks import EffortMeaning, JointBlock
from robot_energy_cli import main

UR = [
    *("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"),
    *("wrist_1_joint", "wrist_2_joint", "wrist_3_joint"),
]
UR_POSE = (0.0, -1.0, 1.2, 0.5, 0.5, 0.0)
SIX = [f"joint_{number}" for number in range(1, 7)]
WARM = [31.0, 32.0, 33.0, 34.0, 35.0, 36.0]  # degC
SECONDS = 4.0
Messages = list[Message]


def replayed(folder: Path, bag: Path, robot: str, *more: object) -> dict[str, Any]:
    """The figures of a replay with the inputs of a robot."""
    out = folder / "out.json"
    words = ["replay", bag, "--robot", robot, "--json", out, *more]
    assert main([str(word) for word in words]) == 0
    return json.loads(out.read_text())


def ur(
    folder: Path,
    effort: EffortMeaning,
    robot: str = "ur5e",
    names: list[str] = UR,
    seconds: float = SECONDS,
) -> Path:
    """ur_robot_driver at 500 Hz, its RTDE publisher at 125 Hz."""
    model, driver = load(robot), Driver(names)
    block = motion(6, 500.0, seconds, UR_POSE)
    block = replaced(block, joint_effort=effort_of(model, block, effort))
    messages = list(driver.joint_states(block, "/joint_states"))
    number = "example_interfaces/msg/Float64"
    for stamp in block.stamp_ns[::4].tolist():
        messages.append(driver.array(stamp, "/rtde/joint_temperatures", WARM, "example_interfaces"))
        for field, value in (("actual_robot_voltage", 48.0), ("actual_robot_current", 2.5)):
            messages.append((stamp, f"/rtde/{field}", number, driver.new(number, value)))
    return driver.write(folder, messages)


@pytest.mark.parametrize("robot", ["ur3e", "ur5e", "ur10e"])
def test_universal_robots(tmp_path, robot):
    """Current as effort, six temperatures in one array, voltage and current of the 48 V bus."""
    summary = replayed(tmp_path, ur(tmp_path, EffortMeaning.MOTOR_CURRENT, robot), robot)
    assert summary["model"]["robot"].lower().endswith(robot)
    assert summary["topics"] == {
        "joint_states": ["/joint_states"],
        "temperatures": ["/rtde/joint_temperatures"],
        "meter": "/rtde/actual_robot_voltage and /rtde/actual_robot_current",
        "payload": None,
    }
    accepted_all(summary, joint_state=2000, temperature=500, meter=1000)
    assert temperatures_of(summary) == WARM
    assert summary["comparison"]["meter_location"] == "dc_bus"
    assert summary["comparison"]["measured_mean_power"] == pytest.approx(120.0)
    assert summary["shaft"]["effort"] == "motor_current"
    assert effort_notes(summary) == []


@pytest.mark.parametrize(
    ("sent", "taken_for"),
    [("joint_torque", "motor_current"), ("motor_current", "joint_torque")],
)
def test_the_two_meanings_of_effort_of_universal_robots(tmp_path, sent, taken_for):
    """Releases differ: the wrong meaning is named together with the right one."""
    bag = ur(tmp_path, EffortMeaning(sent))
    (note,) = effort_notes(replayed(tmp_path, bag, "ur5e", "--effort", taken_for))
    assert note.startswith(f"taken for {taken_for}, the effort is ")
    assert note.endswith(f"joint_states.effort_meaning is probably {sent}")
    assert effort_notes(replayed(tmp_path, bag, "ur5e", "--effort", sent)) == []


def test_check_takes_the_robot_too(tmp_path, capsys):
    """The torque of newer releases, taken for the current of older ones."""
    bag = str(ur(tmp_path, EffortMeaning.JOINT_TORQUE, seconds=12.0))
    out = tmp_path / "check.json"
    assert main(["check", bag, "--robot", "ur5e", "--json", str(out)]) == 2
    assert "torque" in capsys.readouterr().out
    (checked,) = json.loads(out.read_text())["recordings"]
    assert checked["findings"][0]["cause"] == "effort_meaning"


def test_check_takes_the_robot_as_model_and_inputs(tmp_path):
    bag, out = str(ur(tmp_path, EffortMeaning.JOINT_TORQUE)), tmp_path / "check.json"

    def checked(*words):
        assert main(["check", bag, *words, "--json", str(out)]) in (0, 2)
        return json.loads(out.read_text())["recordings"]

    apart = checked("--model", "ur5e", "--inputs", "ur5e")
    assert apart == checked("--robot", "ur5e") != checked("--model", "ur5e")


def franka(driver: Driver, block: JointBlock) -> Iterator[Message]:
    """1 kHz from the controllers; at 30 Hz with fingers; and from the state broadcaster."""
    yield from driver.joint_states(block, "/franka/joint_states")
    fingers = np.zeros((len(block), 2))
    wide = replaced(
        block,
        joint_position=np.hstack([block.joint_position, fingers]),
        joint_velocity=np.hstack([block.joint_velocity, fingers]),
        joint_effort=np.hstack([block.joint_effort, fingers]),
    )
    prefix = driver.joints[0].removesuffix("joint1")
    names = [*driver.joints, f"{prefix}finger_joint1", f"{prefix}finger_joint2"]
    yield from driver.joint_states(wide, "/joint_states", "", names, every=33)
    measured = "/franka_robot_state_broadcaster/measured_joint_states"
    yield from driver.joint_states(block, measured)


def lbr(driver: Driver, block: JointBlock) -> Iterator[Message]:
    """Joint states and LBRState, which has no header, in the namespace of the robot."""
    yield from driver.joint_states(block, "/lbr/joint_states")
    kind = "lbr_fri_idl/msg/LBRState"
    for row, stamp in enumerate(block.stamp_ns.tolist()):
        position, torque = block.joint_position[row].copy(), block.joint_effort[row].copy()
        zero = np.zeros(7)
        fields = (*(position, position, torque, torque, zero, np.full(7, np.nan)), 1.0)
        state = driver.new(kind, 0.01, *(4, 3, 0, 2, 2, 1, 0, 1), 0, 0, *fields)
        yield stamp, "/lbr/state", kind, state


def kuka_kr(driver: Driver, block: JointBlock) -> Iterator[Message]:
    """Positions alone: velocity and effort are NaN unless RSI is configured for them."""
    nothing = np.full_like(block.joint_position, np.nan)
    positions = replaced(block, joint_velocity=nothing, joint_effort=nothing)
    yield from driver.joint_states(positions, "/joint_states")
    kind = "kuka_driver_interfaces/msg/KssStatus"
    for stamp in block.stamp_ns[::25].tolist():
        status = driver.new(kind, 1, 1, True, False, False, True, True, 4, False)
        yield stamp, "/kss_message_handler/status", kind, status


def xarm(driver: Driver, block: JointBlock, place: str = "xarm") -> Iterator[Message]:
    """xarm_driver with report_type:=dev; a joint_state_publisher repeats it at 10 Hz."""
    yield from driver.joint_states(block, f"/{place}/joint_states", "joint-state data")
    yield from driver.joint_states(block, "/joint_states", "", every=10)
    kind = "xarm_msgs/msg/RobotMsg"
    for row, stamp in enumerate(block.stamp_ns.tolist()):
        pose = np.zeros(6, dtype=np.float32)
        angle = block.joint_position[row].astype(np.float32)
        head = driver.header(stamp)
        message = driver.new(kind, head, 1, 1, 0, 0, 0, 0, 0, angle, pose, pose)
        yield stamp, f"/{place}/robot_states", kind, message


def lite6(driver: Driver, block: JointBlock) -> Iterator[Message]:
    """The same driver in its other namespace."""
    return xarm(driver, block, "ufactory")


def doosan(driver: Driver, block: JointBlock) -> Iterator[Message]:
    """No effort; joints in the driver's order; temperatures in degC every 10 ms."""
    order = [0, 1, 3, 4, 2, 5]
    shuffled = replaced(
        block,
        joint_position=block.joint_position[:, order],
        joint_velocity=block.joint_velocity[:, order],
        joint_effort=np.full_like(block.joint_position, np.nan),
    )
    names = [driver.joints[index] for index in order]
    yield from driver.joint_states(shuffled, "/dsr01/joint_states", names=names)
    for stamp in block.stamp_ns.tolist():
        yield driver.array(stamp, "/rt_topic/joint_temperature", WARM, "std_msgs")


def kinova(driver: Driver, block: JointBlock) -> Iterator[Message]:
    """Positions wrapped to -pi to pi, as joint 1 turns without end."""
    position = block.joint_position.copy()
    turn = position[:, 0] + np.pi
    position[:, 0] = (turn + np.pi) % (2 * np.pi) - np.pi
    yield from driver.joint_states(replaced(block, joint_position=position), "/joint_states")


def dynamic(driver: Driver, block: JointBlock) -> Iterator[Message]:
    """joint_state_broadcaster up to Kilted: all state interfaces on dynamic_joint_states."""
    yield from driver.joint_states(block, "/joint_states")
    kind, entry = "control_msgs/msg/DynamicJointState", "control_msgs/msg/InterfaceValue"
    names = ["position", "velocity", "effort", "temperature"]
    for row, stamp in enumerate(block.stamp_ns.tolist()):
        arrays = (block.joint_position, block.joint_velocity, block.joint_effort)
        values = [
            driver.new(entry, names, np.array([*(array[row, joint] for array in arrays), degc]))
            for joint, degc in enumerate(WARM)
        ]
        head = driver.header(stamp)
        yield stamp, "/dynamic_joint_states", kind, driver.new(kind, head, driver.joints, values)


def interfaces(driver: Driver, block: JointBlock) -> Iterator[Message]:
    """state_interfaces_broadcaster: the names once, then the values."""
    yield from driver.joint_states(block, "/joint_states")
    keys, values = "control_msgs/msg/Keys", "control_msgs/msg/Float64Values"
    place, start = "/state_interfaces_broadcaster", int(block.stamp_ns[0])
    names = [f"{joint}/temperature" for joint in driver.joints]
    yield start, f"{place}/names", keys, driver.new(keys, driver.header(start), names)
    for stamp in block.stamp_ns[1:].tolist():
        message = driver.new(values, driver.header(stamp), np.array(WARM))
        yield stamp, f"{place}/values", values, message


Publish = Callable[[Driver, JointBlock], Iterator[Message]]
JOINT_TORQUE, NO_EFFORT = "joint_torque", None
FR3, FER, LBR, XARM, LITE6 = (
    [f"{prefix}{number}" for number in range(1, size + 1)]
    for prefix, size in (
        ("fr3_joint", 7),
        ("fer_joint", 7),
        ("lbr_A", 7),
        ("joint", 7),
        ("joint", 6),
    )
)
DYNAMIC = ["/dynamic_joint_states"]
INTERFACES = [f"/state_interfaces_broadcaster/{name}" for name in ("names", "values")]
CASES = [  # robot, joints, messages, rate [1/s], topic of joint states, temperatures, effort
    ("fr3", FR3, franka, 1000, "/franka/joint_states", [], JOINT_TORQUE),
    ("fer", FER, franka, 1000, "/franka/joint_states", [], JOINT_TORQUE),
    ("lbr", LBR, lbr, 100, "/lbr/joint_states", [], JOINT_TORQUE),
    ("kr16", SIX, kuka_kr, 250, "/joint_states", [], NO_EFFORT),
    ("kuka_kr", SIX, kuka_kr, 250, "/joint_states", [], NO_EFFORT),
    ("xarm", XARM, xarm, 100, "/xarm/joint_states", [], JOINT_TORQUE),
    ("lite6", LITE6, lite6, 100, "/ufactory/joint_states", [], JOINT_TORQUE),
    ("doosan", SIX, doosan, 100, "/dsr01/joint_states", ["/rt_topic/joint_temperature"], NO_EFFORT),
    ("gen3", SIX, kinova, 1000, "/joint_states", [], JOINT_TORQUE),
    ("ros2_control", SIX, dynamic, 100, "/joint_states", DYNAMIC, NO_EFFORT),
    ("ros2_control", SIX, interfaces, 100, "/joint_states", INTERFACES, NO_EFFORT),
    ("ur", UR, None, 500, "/joint_states", ["/rtde/joint_temperatures"], "motor_current"),
]


@pytest.mark.parametrize("case", CASES[:-1], ids=lambda case: f"{case[0]}-{case[2].__name__}")
def test_other_robots(tmp_path, case):
    """Joint states accepted, temperatures used, effort read with the meaning of the driver."""
    robot, joints, publish, rate, topic, temperatures, effort = case
    model = load(robot) if ROBOTS[robot].model else chain_model(joints)
    block, driver = motion(len(joints), rate, SECONDS), Driver(joints)
    sent = effort_of(model, block, EffortMeaning.JOINT_TORQUE)
    bag = driver.write(tmp_path, list(publish(driver, replaced(block, joint_effort=sent))))
    save(model, tmp_path / "my_robot.yaml")
    own = [] if ROBOTS[robot].model else ["--model", tmp_path / "my_robot.yaml"]
    summary = replayed(tmp_path, bag, robot, *own)
    assert summary["topics"]["joint_states"] == [topic]
    assert summary["topics"]["temperatures"] == temperatures
    accepted_all(summary, joint_state=len(block))
    assert summary["time"]["gap_count"] == 0
    if temperatures:
        accepted_all(summary, temperature=None)
        assert temperatures_of(summary) == WARM
    assert (summary["shaft"] or {"effort": None})["effort"] == effort
    assert effort_notes(summary) == []
    if effort is not None:
        assert all(joint["coverage"] > 0.95 for joint in summary["shaft"]["joints"])
    assert summary["energy"]["grid_import"] > 0
    assert summary["joints"][0]["shaft_energy_positive"] > 0


def test_every_robot_of_the_table_is_tried():
    tried = {case[0] for case in CASES} | {"ur3e", "ur5e", "ur10e"}
    assert tried == set(ROBOTS)


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_parameter_file_holds_inputs_alone(robot):
    """All of them known, so that nodes and replay read the same."""
    inputs, notes = read_inputs(robot)
    assert notes == []
    document = yaml.safe_load(ROBOTS[robot].inputs.read_text())
    assert list(document) == ["/**"]
    groups = {"joint_states", "temperature_sources", "meter", *inputs.temperature_sources}
    assert set(document["/**"]["ros__parameters"]) <= groups


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=lambda robot: robot.file)
def test_a_preset_says_where_it_is_from(robot):
    text = robot.inputs.read_text()
    assert "# Source: " in text
    assert "# Second source: " in text


def test_an_unknown_robot_is_refused_with_the_nearest_name(capsys):
    assert main(["replay", "bag", "--robot", "ur5x"]) == 2
    said = capsys.readouterr().err
    assert "the robot 'ur5x' is unknown" in said
    assert "expected one of 'ur3e', 'ur5e'" in said
    assert said.endswith("Write 'ur5e'.\n")
    with pytest.raises(KindError):
        ROBOTS["kinova"]


def test_a_robot_without_a_model_says_how_to_make_one(capsys):
    assert main(["replay", "bag", "--robot", "fr3"]) == 2
    assert "robot-energy model init" in capsys.readouterr().err
    with pytest.raises(ModelFileError, match="fr3"):
        ROBOTS["fr3"].model_or(None)
    assert ROBOTS["fr3"].model_or("mine.yaml") == ROBOTS["kr16"].model_or("mine.yaml")
    assert main(["replay", "bag"]) == 2
    assert "neither --model nor --robot" in capsys.readouterr().err


def test_a_parameter_file_goes_before_the_robot(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text("/**:\n  ros__parameters:\n    joint_states: {effort_meaning: none}\n")
    inputs, _ = read_inputs(path, ROBOTS["ur5e"])
    assert inputs.joint_states.effort_meaning == "none"
    assert inputs.meter.voltage_topic == "rtde/actual_robot_voltage"
    assert list(inputs.temperature_sources) == ["rtde"]


def test_names_of_joints_must_fit_the_model(tmp_path):
    block, driver = motion(6, 100.0, 1.0, UR_POSE), Driver(UR)
    bag = driver.write(tmp_path, list(driver.joint_states(block, "/joint_states")))
    path = tmp_path / "own.yaml"
    path.write_text("/**:\n  ros__parameters:\n    joint_states: {joint_names: [a, b]}\n")
    from robot_energy import replay

    with pytest.raises(ParameterError, match="joint_names has 2 names; expected 6"):
        replay(bag, "ur5e", inputs=path)
    path.write_text("/**:\n  ros__parameters:\n    joint_states: {joint_names: [a, a]}\n")
    with pytest.raises(ParameterError, match="a name twice"):
        read_inputs(path)


def accepted_all(summary: dict[str, Any], **counts: int | None) -> None:
    """All messages of these inputs were accepted; so many, where a number is given."""
    for name, count in counts.items():
        account = summary["inputs"][f"{name}_messages"]
        assert account["rejected"] == {}, name
        assert account["accepted"] == account["received"] > 0
        assert count is None or account["received"] == count


def temperatures_of(summary: dict[str, Any]) -> list[float]:
    """The newest temperature of each joint. [degC]"""
    return [joint["last_motor_temperature_degc"] for joint in summary["joints"]]


def effort_notes(summary: dict[str, Any]) -> list[str]:
    """What the notes say of the effort."""
    return [note for note in summary["notes"] if "effort" in note]


def test_a_preset_with_other_names_also_reads_those_of_the_model(capsys):
    assert main(["replay", str(ROOT / "bags/kr16_cold"), "--robot", "kr16"]) == 0
    assert "predicted 52.78 kJ" in capsys.readouterr().out
