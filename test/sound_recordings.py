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
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.inputs.sources import Inputs
from robot_energy.model import RobotModel, load, parse_yaml, save, validate
from robot_energy.timeline.blocks import EffortMeaning, Float, MeterMeaning
from robot_energy_identify.check.finding import MODEL, PARAMETERS, Finding
from robot_energy_identify.data.log_channels import model_of, read_channels
from robot_energy_identify.dynamics.dynamics import identify_dynamics
from robot_energy_identify.dynamics.dynamics_model import to_model
from robot_energy_identify.starter import RobotText, read_arm, starter_text
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


def mended(remedy: str, model: RobotModel) -> RobotModel:
    """The model with a line of YAML of a remedy."""
    data, line = plain(model), yaml.safe_load(remedy)
    for entry in line.pop("joints", []):
        next(one for one in data["joints"] if one["name"] == entry["name"]).update(entry)
    return validate({**data, **line}, "mended")


def read_with(remedy: str, path: Path) -> Inputs:
    """The inputs of a file with the line of YAML of a remedy."""
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": yaml.safe_load(remedy)}}))
    return read_inputs(path)[0]


def with_remedy(
    finding: Finding, model: RobotModel, folder: Path
) -> tuple[RobotModel, Inputs | None]:
    """Model and inputs with the remedy of a finding applied as a user would."""
    if finding.remedy_in == MODEL:
        return mended(finding.remedy, model), None
    if finding.remedy_in == PARAMETERS:
        return model, read_with(finding.remedy, folder / "remedy.yaml")
    return model, None


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


PROGRAMS = {  # moves, share of the joint ranges, share of full speed, coldest and warmest start
    "random": (12, 0.8, (0.4, 1.0), (10.0, 55.0)),
    "pick": (4, 0.35, (0.5, 1.0), (15.0, 45.0)),
    "slow": (8, 0.8, (0.12, 0.25), (15.0, 45.0)),
    "one_axis": (6, 0.8, (0.4, 1.0), (15.0, 45.0)),
    "cold": (12, 0.8, (0.4, 1.0), (2.0, 10.0)),
}


def foreign(
    robot: str,
    seed: int,
    program: str,
    folder: Path,
    carried: float = 0.0,
    end: float = RIG_SECONDS,
) -> Sound:
    """A recording of a robot of which there is no more than a URDF, whose bodies are off.

    Its model is what ``model init`` makes; the plant has bodies off by 8 % of their masses and
    12 mm of their centres, one standard deviation. The driver sends joint torque: with an even
    seed computed from the motor current, with an odd one measured behind the gear.

    Args:
        robot: Name of a shipped model, whose URDF is taken, or ``armN`` for a drawn arm of N axes.
        seed: The same seed gives the same recording.
        program: One of `PROGRAMS`.
        folder: Of the recording.
        carried: Mass that the robot carries, of which the model does not know. [kg]
    """
    rng = np.random.default_rng([seed, *robot.encode(), *program.encode()])
    xml = drawn_arm(int(robot[3:]), rng) if robot.startswith("arm") else load(robot).urdf_xml
    name = f"foreign_{robot}_{seed}_{program}"
    text = starter_text(read_arm(xml), RobotText(xml, "URDF"), ".")
    model = validate(parse_yaml(text, name), name)
    data = plain(model)
    data["urdf"]["xml"] = other_bodies(xml, rng, 0.08, 0.012)
    for entry in data["joints"]:
        entry["rotor_inertia"]["value"] *= rng.uniform(0.5, 1.5)
    if carried:
        link = xml.split("<link")[-1].split('"')[1]
        place = [0.0, 0.02, 0.08]
        body = {"link": link, "mass": carried, "centre_of_mass": place, "tag": "assumed"}
        data["payload"] = [body]
    save(validate(data, "plant"), folder / f"{name}.yaml")
    profile = random_profile(str(folder / f"{name}.yaml"), seed)
    bodies, _ = profile.mechanics()
    moves, zone, override, start = PROGRAMS[program]
    zones = np.full(bodies.n_joints, zone)
    if program == "one_axis":
        zones[np.arange(bodies.n_joints) != rng.integers(min(3, bodies.n_joints))] = 1e-3
    motion = random_program(
        profile.motion_limits(bodies), seed, moves, zones, 0.4, rng.uniform(*override)
    )
    ratio = np.array([abs(joint.gear_ratio.value) for joint in model.joints])
    quiet = float(np.min(ratio * [joint.standstill_velocity for joint in model.joints]))
    sensors = Sensors(
        velocity_noise=quiet * rng.uniform(0.05, 0.4),
        torque_noise=0.1 * float(np.median(profile.coulomb)) * rng.uniform(0.5, 3.0),
        torque_constant_error=0.03,
    )
    config = RigConfig.hard().without("meter_filter") if seed % 4 > 1 else RigConfig()
    rig = VirtualRig(profile, motion, replace(config, sensors=sensors), seed, rng.uniform(*start))
    made, bag = folder / f"{name}_motor", folder / name
    record(rig, RIG_SECONDS, made)
    rewrite(made, bag, as_joint_torque(model, profile.mechanics()[1].rotor_inertia, seed % 2 == 1))
    return Sound(name, bag, model, EffortMeaning.JOINT_TORQUE)


def as_joint_torque(model: RobotModel, rotor_inertia: Float, behind: bool) -> Change:
    """Motor torque as joint torque, with what the rotors take, or without it."""
    ratio = np.array([joint.gear_ratio.value for joint in model.joints])
    last: list[tuple[float, Float]] = []

    def change(message: Any) -> None:
        stamp = message.header.stamp
        now = stamp.sec + 1e-9 * stamp.nanosec
        effort = message.effort * ratio
        if behind and last and now > last[0][0]:
            acceleration = (message.velocity - last[0][1]) / (now - last[0][0])
            effort = effort - ratio**2 * rotor_inertia * acceleration
        last[:0] = [(now, message.velocity.copy())]
        del last[10:]
        message.effort = effort

    return change


def drawn_arm(axes: int, rng: np.random.Generator) -> str:
    """A URDF of an arm drawn at random, of one to two metres."""
    size = rng.uniform(0.6, 1.6)
    lines = ['<robot name="drawn_arm"><link name="l0"/>']
    for k in range(1, axes + 1):
        left = 1.0 - (k - 1) / axes  # bodies become lighter towards the tool
        mass, length = 12.0 * size**2 * left**2 + 0.5, size * 1.3 / axes
        radius = 0.05 + 0.05 * left
        across, along = mass * (length**2 / 12 + radius**2 / 4), 0.5 * mass * radius**2
        x, y, z = (*rng.normal(0.0, 0.02, 2).tolist(), length * rng.uniform(0.3, 0.7))
        axis = "0 0 1" if k in (1, 4, 6) else "0 1 0"
        effort = 9.81 * (25.0 * size**3) * left**2 + 12.0
        lines.append(
            f'<link name="l{k}"><inertial><origin xyz="{x:.4f} {y:.4f} {z:.4f}"/>'
            f'<mass value="{mass:.4f}"/><inertia ixx="{across:.5f}" iyy="{across:.5f}" '
            f'izz="{along:.5f}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="j{k}" type="revolute"><parent link="l{k - 1}"/><child link="l{k}"/>'
            f'<origin xyz="0 0 {0.2 if k == 1 else length:.4f}"/><axis xyz="{axis}"/>'
            f'<limit lower="-2.6" upper="2.6" effort="{effort:.1f}" velocity="{2.0 + k / 4}"/>'
            "</joint>"
        )
    return "".join(lines) + "</robot>"


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


def other_bodies(
    xml: str, rng: np.random.Generator, mass_std: float = 0.0, centre_std: float = 0.0
) -> str:
    """A URDF with other masses, and centres of mass off by some millimetres.

    Args:
        xml: A URDF.
        rng: Draws.
        mass_std: Standard deviation of masses [-]; 0: within 8 %.
        centre_std: Standard deviation along each axis [m]; 0: within 5 % of each coordinate.
    """
    root = ElementTree.fromstring(xml)
    for inertial in root.iter("inertial"):
        factor = float(np.exp(rng.normal(0.0, mass_std)) if mass_std else rng.uniform(0.92, 1.08))
        mass, tensor, origin = (inertial.find(key) for key in ("mass", "inertia", "origin"))
        assert mass is not None
        mass.set("value", repr(float(mass.get("value", "0")) * factor))
        if tensor is not None:
            for key, value in tensor.attrib.items():
                tensor.set(key, repr(float(value) * factor))
        if origin is not None:
            centre = np.array(origin.get("xyz", "0 0 0").split(), dtype=float)
            if centre_std:
                centre = centre + rng.normal(0.0, centre_std, 3)
            else:
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
        name: ``kr16_cold``, one of `REAL`, ``ROBOT:SEED`` of the rig, or ``ROBOT:SEED:PROGRAM``
            for a foreign robot.
        data: Folder of the real recordings.
        folder: Where the bag is made.
    """
    if ":" in name:
        robot, seed, *program = name.split(":")
        if program:
            return foreign(robot, int(seed), program[0], folder)
        return on_the_rig(robot, int(seed), folder)
    if name not in REAL:
        return bundled(name)
    if data is None:
        raise SystemExit("ROBOT_ENERGY_DATA names no folder")
    return REAL[name](data, folder)
