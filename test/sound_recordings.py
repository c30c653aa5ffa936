"""Sound recordings with their models: real ones, and the rig with plants drawn at random.

A plant shares the kinematics with the model it is checked against, and no figure: bodies,
rotors, friction, losses, sensors, temperatures and the motion are drawn.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml
from scipy.signal import decimate

from mistakes import Change, rewrite
from places import ROOT
from robot_energy.bag import BagWriter
from robot_energy.bag.cdr import Encoder, stamp_columns
from robot_energy.model import RobotModel, load, save, validate
from robot_energy.timeline.blocks import EffortMeaning, Float, MeterMeaning
from robot_energy_identify.data.log_channels import model_of, read_channels
from robot_energy_identify.dynamics.dynamics import identify_dynamics
from robot_energy_identify.dynamics.dynamics_model import to_model
from robot_energy_logs.log_import import import_log
from robot_energy_logs.mapping import load_mapping
from robot_energy_logs.ur_rtde import import_ur_rtde
from robot_energy_plan.motion import random_program, tool_above
from robot_energy_rig import PlantProfile, RigConfig, Sensors, VirtualRig, random_profile
from robot_energy_rig.record import record

MAPPINGS = ROOT / "src/examples/mappings"
IDENTIFY = ROOT / "src/examples/identify"
RIG_ROBOTS = ("kr16", "irb4600", "mantis", "testbed", "ur3e", "ur5e", "ur10e")
RATED = {"kr16": 16, "irb4600": 60, "ur3e": 3, "ur5e": 5, "ur10e": 12.5, "kr300": 300, "tx40": 2}
RIG_SECONDS = 25.0


@dataclass(frozen=True)
class Sound:
    """A recording without a mistake.

    Attributes:
        name: Of the recording.
        bag: Where it is.
        model: The model it fits.
        effort: What its effort means.
        rated: Payload that the robot may carry; 0 where it is not known. [kg]
        bodies: Whether the model's bodies are those of the robot.
    """

    name: str
    bag: Path
    model: RobotModel
    effort: EffortMeaning
    rated: float = 0.0
    bodies: bool = True


def kr300(data: Path, folder: Path, part: str) -> Sound:
    """One of the two recordings of the KR 300; its model is identified from both."""
    _, model = identified(data / "kr300", "kr300")
    bag = folder / f"kr300_{part}"
    mapping = load_mapping(MAPPINGS / "kr300.yaml")
    import_log([data / f"kr300/recorded_{part}.csv.gz"], mapping, bag)
    return Sound(f"KUKA KR 300 {part}", bag, model, EffortMeaning.MOTOR_TORQUE, RATED["kr300"])


def tx40(data: Path, folder: Path) -> Sound:
    """The TX40 at 250 Hz, without velocities; its model is identified from it."""
    (channels,), model = identified(data / "tx40", "tx40")
    step = round(channels.rate / 250)
    position, torque = (
        decimate(values, step, ftype="fir", axis=0)
        for values in (channels.joint_position, channels.motor_torque)
    )
    bag = folder / "tx40"
    write_states(bag, model.joint_names, channels.rate / step, position, torque)
    return Sound("Staubli TX40", bag, model, EffortMeaning.MOTOR_TORQUE, RATED["tx40"])


def ur3e(data: Path, folder: Path) -> Sound:
    """Three motions of a UR3e, 5 s in all, at 25 Hz, with its 48 V supply as a meter."""
    bag = folder / "ur3e_real"
    import_ur_rtde(sorted((data / "rad_ur3e").glob("L*.csv")), bag)
    return Sound("UR3e", bag, load("ur3e"), EffortMeaning.MOTOR_CURRENT, RATED["ur3e"])


def voraus(data: Path, folder: Path) -> Sound:
    """Four times 1 s of a Yu-Cobot; the bodies of a UR10e stand in, as its own are not public."""
    mapping = load_mapping(MAPPINGS / "voraus.yaml")
    bag = folder / "voraus"
    import_log([data / "voraus/test.parquet"], mapping, bag)
    model = renamed(load("ur10e"), mapping.joints.names)
    return Sound("voraus Yu-Cobot", bag, model, EffortMeaning.NONE, bodies=False)


def xarm6(data: Path, folder: Path) -> Sound:
    """Joint 3 of an xArm 6 alone, 2 Hz; one body of the mass of its forearm stands in."""
    bag = folder / "xarm6_j3"
    mapping = load_mapping(MAPPINGS / "xarm6_joint3.yaml")
    import_log([data / "xarm6_j3/no_payload.csv.gz"], mapping, bag)
    model = validate(yaml.safe_load(FOREARM), "forearm")
    return Sound("xArm 6, joint 3", bag, model, EffortMeaning.NONE, bodies=False)


FOREARM = """
schema_version: 1
robot: {type: xArm 6 joint 3}
urdf:
  xml: |
    <robot name="forearm"><link name="upper"/><link name="forearm"><inertial>
    <origin xyz="0.2 0 0"/><mass value="4"/>
    <inertia ixx="0.01" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="joint3" type="revolute"><parent link="upper"/><child link="forearm"/>
    <axis xyz="0 1 0"/><limit lower="-3.93" upper="0.19" effort="32" velocity="3.14"/></joint>
    </robot>
joints:
  - name: joint3
    gear_ratio: {value: 100, tag: assumed}
    rotor_inertia: {value: 3.0e-5, tag: assumed}
    torque_constant: {value: 0.08, tag: assumed}
    friction:
      coulomb: {value: 0.05, tag: assumed}
      viscous: {law: constant, viscous: {value: 3.0e-4, tag: assumed}}
cabinet: {loss_grid: {value: 0, tag: assumed}, loss_dc: {value: 20, tag: assumed}}
temperature: {fallback_degc: 25}
"""


def identified(data: Path, name: str) -> tuple[list[Any], RobotModel]:
    """Channels and identified model of a log that the examples describe."""
    mapping = load_mapping(IDENTIFY / f"{name}.yaml")
    first = model_of(mapping, [data, IDENTIFY])
    channels = [one for part in read_channels([data], mapping, first).values() for one in part]
    return channels, to_model(identify_dynamics(channels, first))


def write_states(
    bag: Path,
    names: tuple[str, ...],
    rate: float,
    position: Float,
    effort: Float,
    kept: Any = slice(None),
) -> None:
    """Write joint states without velocities; only the rows that are kept."""
    stamp = np.round(np.arange(len(position)) / rate * 1e9).astype(np.int64)[kept] + 10**18
    position, effort = position[kept], effort[kept]
    rows = len(position)
    encoder = Encoder(
        "sensor_msgs/msg/JointState",
        {"name": names},
        {"position": len(names), "velocity": 0, "effort": effort.shape[1]},
    )
    columns = {
        **stamp_columns(stamp),
        "position": position,
        "velocity": np.empty((rows, 0)),
        "effort": effort,
    }
    with BagWriter(bag) as writer:
        writer.add_topic("/joint_states", "sensor_msgs/msg/JointState")
        data = encoder.encode(columns, rows)
        writer.write("/joint_states", stamp, [row.tobytes() for row in data])


def plain(model: RobotModel) -> dict[str, Any]:
    """Values of a model, with its URDF, to change and validate."""
    data = model.model_dump(exclude_none=True, mode="json")
    data["urdf"] = {"xml": model.urdf_xml}
    return data


def renamed(model: RobotModel, names: list[str]) -> RobotModel:
    """A model with other joint names."""
    data = plain(model)
    for entry, name in zip(data["joints"], names, strict=True):
        data["urdf"]["xml"] = data["urdf"]["xml"].replace(f'"{entry["name"]}"', f'"{name}"')
        entry["name"] = name
    return validate(data, "renamed")


def on_the_rig(robot: str, seed: int, folder: Path) -> Sound:
    """A recording of a plant drawn at random.

    Args:
        robot: Name of a shipped model.
        seed: The same seed gives the same recording.
        folder: Of the recording.
    """
    rng = np.random.default_rng([seed, RIG_ROBOTS.index(robot)])
    model = load(robot)
    profile = drawn_plant(model, rng, folder / f"{robot}_{seed}.yaml", seed)
    bodies, _ = profile.mechanics()
    program = random_program(
        profile.motion_limits(bodies),
        seed,
        moves=12,
        dwell=rng.uniform(0.2, 0.6),
        override=rng.uniform(0.4, 1.0),
        accept=tool_above(bodies, "tool0", 0.0) if bodies.n_joints == 6 else None,
    )
    ratio = np.array([abs(joint.gear_ratio.value) for joint in model.joints])
    quiet = float(np.min(ratio * [joint.standstill_velocity for joint in model.joints]))
    meanings = [MeterMeaning.MEAN_OVER_INTERVAL, MeterMeaning.INSTANTANEOUS]
    sensors = Sensors(
        velocity_noise=quiet * rng.uniform(0.05, 0.4),
        torque_noise=0.1 * float(np.median(profile.coulomb)) * rng.uniform(0.5, 3.0),
        meter_rate=float(rng.choice([5.0, 10.0, 20.0])),
        meter_meaning=MeterMeaning(int(rng.choice(meanings))),
        meter_class=0.01,
    )
    # Every second plant is hard: elastic joints, presliding, filtered velocities and more. A
    # meter that filters is behind indeed, so that effect stays off.
    config = RigConfig.hard().without("meter_filter") if seed % 2 else RigConfig()
    rig = VirtualRig(
        profile, program, replace(config, sensors=sensors), seed, rng.uniform(10.0, 55.0), 22.0
    )
    made = folder / f"{robot}_{seed}_motor_torque"
    record(rig, RIG_SECONDS, made)
    name, rated = f"rig {robot}, plant {seed}", RATED.get(robot, 0.0)
    if model.joints[0].torque_constant is None:
        return Sound(name, made, model, EffortMeaning.MOTOR_TORQUE, rated)
    bag = folder / f"{robot}_{seed}_motor_current"
    rewrite(made, bag, as_current(model))
    return Sound(name, bag, model, EffortMeaning.MOTOR_CURRENT, rated)


def as_current(model: RobotModel) -> Change:
    """Motor torque as the current of a driver."""
    constant = np.array([joint.torque_constant.value for joint in model.joints])  # type: ignore

    def change(message: Any) -> None:
        message.effort = message.effort / constant

    return change


def drawn_plant(model: RobotModel, rng: np.random.Generator, path: Path, seed: int) -> PlantProfile:
    """A plant drawn for a model; masses within 8 % of its own, rotors within 15 %."""
    data = plain(model)
    data["urdf"]["xml"] = other_bodies(model.urdf_xml, rng)
    for entry in data["joints"]:
        entry["rotor_inertia"]["value"] *= rng.uniform(0.85, 1.15)
    save(validate(data, "plant"), path)
    return random_profile(str(path), seed)


def other_bodies(xml: str, rng: np.random.Generator) -> str:
    """A URDF with other masses, and centres of mass off by some millimetres."""
    root = ElementTree.fromstring(xml)
    for inertial in root.iter("inertial"):
        factor = rng.uniform(0.92, 1.08)
        mass, tensor, origin = (inertial.find(key) for key in ("mass", "inertia", "origin"))
        assert mass is not None
        mass.set("value", repr(float(mass.get("value", "0")) * factor))
        if tensor is not None:
            for key, value in tensor.attrib.items():
                tensor.set(key, repr(float(value) * factor))
        if origin is not None:
            centre = np.array(origin.get("xyz", "0 0 0").split(), dtype=float)
            centre = centre * rng.uniform(0.95, 1.05, 3)
            origin.set("xyz", " ".join(map(repr, centre.tolist())))
    return ElementTree.tostring(root, encoding="unicode")


REAL = {"kr300_A": lambda *at: kr300(*at, "A"), "kr300_B": lambda *at: kr300(*at, "B"),
        "tx40": tx40, "ur3e": ur3e, "voraus": voraus, "xarm6": xarm6}  # fmt: skip


def bundled(name: str) -> Sound:
    """A recording of the rig that comes with the project."""
    return Sound(
        f"rig {name}", ROOT / "bags" / name, load("kr16"), EffortMeaning.MOTOR_TORQUE, RATED["kr16"]
    )


def sound(name: str, data: Path | None, folder: Path) -> Sound:
    """Make a recording.

    Args:
        name: ``kr16_cold``, one of `REAL`, or ``ROBOT:SEED`` of the rig.
        data: Folder of the real recordings.
        folder: Where the bag is made.
    """
    if ":" in name:
        robot, seed = name.split(":")
        return on_the_rig(robot, int(seed), folder)
    if name not in REAL:
        return bundled(name)
    if data is None:
        raise SystemExit("ROBOT_ENERGY_DATA names no folder")
    return REAL[name](data, folder)
