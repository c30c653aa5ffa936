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
from robot_energy.blocks import EffortMeaning, Float, MeterMeaning
from robot_energy.cdr import Encoder, stamp_columns
from robot_energy.identify.data.log_channels import model_of, read_channels
from robot_energy.identify.dynamics.dynamics import identify_dynamics
from robot_energy.identify.dynamics.dynamics_model import to_model
from robot_energy.logs import import_log, import_ur_rtde, load_mapping
from robot_energy.model import RobotModel, load, save, validate
from robot_energy.motion import MotionLimits, random_program, tool_above
from robot_energy.rig import Lubricant, PlantProfile, RigConfig, Sensors, SupplyProfile, VirtualRig
from robot_energy.rig.record import record

MAPPINGS = ROOT / "src/examples/mappings"
IDENTIFY = ROOT / "src/examples/identify"
RIG_ROBOTS = ("kr16", "irb4600", "mantis", "testbed", "ur3e", "ur5e", "ur10e")
RATED = {"kr16": 16, "irb4600": 60, "ur3e": 3, "ur5e": 5, "ur10e": 12.5, "kr300": 300, "tx40": 2}
RIG_SECONDS = 30.0
# Acceleration [rad/s^2] of joints whose axis turns the whole arm, and of those of the hand.
REACH = {"mantis": (1.0, 2.0), "testbed": (3.0, 6.0)}


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
    return Sound("voraus Yu-Cobot", bag, model, EffortMeaning.MOTOR_TORQUE, bodies=False)


def xarm6(data: Path, folder: Path) -> Sound:
    """Joint 3 of an xArm 6 alone, 2 Hz; one body of the mass of its forearm stands in."""
    bag = folder / "xarm6_j3"
    mapping = load_mapping(MAPPINGS / "xarm6_joint3.yaml")
    import_log([data / "xarm6_j3/no_payload.csv.gz"], mapping, bag)
    model = validate(yaml.safe_load(FOREARM), "forearm")
    return Sound("xArm 6, joint 3", bag, model, EffortMeaning.MOTOR_CURRENT, bodies=False)


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
    bag: Path, names: tuple[str, ...], rate: float, position: Float, effort: Float
) -> None:
    """Write joint states without velocities."""
    rows = len(position)
    stamp = 1_000_000_000_000_000_000 + np.round(np.arange(rows) / rate * 1e9).astype(np.int64)
    encoder = Encoder(
        "sensor_msgs/msg/JointState",
        {"name": names},
        {"position": len(names), "velocity": 0, "effort": len(names)},
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
    profile = drawn_plant(model, robot, rng, folder / f"{robot}_{seed}.yaml")
    bodies, _ = profile.mechanics()
    limits = with_limits(profile.motion_limits(bodies))
    accept = None if robot in REACH else tool_above(bodies, "tool0", 0.1)
    program = random_program(
        limits, seed, dwell=rng.uniform(0.2, 0.6), override=rng.uniform(0.4, 1.0), accept=accept
    )
    meaning = rng.choice([MeterMeaning.MEAN_OVER_INTERVAL, MeterMeaning.INSTANTANEOUS])
    ratio = np.array([abs(joint.gear_ratio.value) for joint in model.joints])
    quiet = float(np.min(ratio * [joint.standstill_velocity for joint in model.joints]))
    sensors = Sensors(
        velocity_noise=quiet * rng.uniform(0.05, 0.4),
        torque_noise=0.02 * float(np.median(profile.coulomb)) / 0.3 * rng.uniform(0.5, 3.0),
        meter_rate=float(rng.choice([5.0, 10.0, 20.0])),
        meter_meaning=MeterMeaning(int(meaning)),
        meter_class=0.01,
    )
    rig = VirtualRig(
        profile, program, RigConfig(sensors=sensors), seed, rng.uniform(10.0, 55.0), 22.0
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


def with_limits(limits: MotionLimits) -> MotionLimits:
    """Half a turn either way where the URDF allows more than one."""
    wide = limits.upper - limits.lower > 2 * np.pi
    return replace(
        limits,
        lower=np.where(wide, -np.pi, limits.lower),
        upper=np.where(wide, np.pi, limits.upper),
    )


def drawn_plant(
    model: RobotModel, robot: str, rng: np.random.Generator, path: Path
) -> PlantProfile:
    """A plant of the class of a model: masses within 8 %, rotors 15 %, friction 0.5 to 1.6."""
    data = plain(model)
    data["urdf"]["xml"] = other_bodies(model.urdf_xml, rng)
    for entry in data["joints"]:
        entry["rotor_inertia"]["value"] *= rng.uniform(0.85, 1.15)
    save(validate(data, "plant"), path)
    n = len(model.joints)

    def about(values: Any, low: float = 0.7, high: float = 1.4) -> Float:
        return np.broadcast_to(np.asarray(values, dtype=float), n) * rng.uniform(low, high, n)

    coulomb = np.array([joint.friction.coulomb.value for joint in model.joints])
    viscous = np.array([viscous_at(joint.friction.viscous, 40.0) for joint in model.joints])
    constants = [joint.torque_constant for joint in model.joints]
    constant = np.array([0.5 if one is None else one.value for one in constants])
    first, last = REACH.get(robot, (6.0, 30.0) if robot.startswith("ur") else (8.0, 60.0))
    heavy = about(coulomb / max(coulomb.max(), 1e-9))
    return PlantProfile(
        body=str(path),
        lubricant=tuple(
            Lubricant(float(rng.choice([150.0, 220.0])), float(rng.uniform(15, 25)))
            for _ in range(n)
        ),
        coulomb=about(coulomb, 0.5, 1.6) * 0.85,
        load_coulomb=about(0.03, 0.0, 2.0),
        stribeck=about(coulomb * 0.15, 0.5, 1.6),
        stribeck_velocity=about(12.0),
        viscous_40=about(viscous, 0.5, 1.6),
        torque_constant=constant,
        torque_constant_fall=about(0.0011),
        resistance=about(0.67 * heavy * (constant / coulomb) ** 2),  # 200 W at ten times Coulomb
        resistance_rise=about(0.0039, 1.0, 1.0),
        hysteresis_torque=about(0.05 * coulomb),
        eddy_viscous=about(0.05 * viscous),
        inverter_linear=about(2.0),
        inverter_square=about(0.05),
        motor_capacity=about(500.0 + 4500.0 * heavy),
        gear_capacity=about(2000.0 + 15000.0 * heavy),
        motor_conductance=about(2.0 + 8.0 * heavy),
        gear_conductance=about(0.5 + 3.0 * heavy),
        friction_to_motor=about(0.1),
        acceleration=about(np.geomspace(first, last, n), 0.6, 1.2),
        supply=SupplyProfile(
            loss_dc=model.cabinet.loss_dc.value * rng.uniform(0.7, 1.3),
            loss_grid=model.cabinet.loss_grid.value * rng.uniform(0.7, 1.3),
            rectifier_efficiency=float(rng.uniform(0.96, 0.99)),
            capacitance=0.001,
            rectified_voltage=566.0,
            chopper_on_voltage=700.0,
            chopper_off_voltage=680.0,
            brake_resistance=40.0,
        ),
    )


def viscous_at(law: Any, degc: float) -> float:
    """Viscous coefficient of a model's joint. [N m s/rad]"""
    if law.law == "exponential":
        return law.a.value + law.b.value * float(np.exp(-degc / law.c.value))
    if law.law == "constant":
        return law.viscous.value
    return float(np.interp(degc, law.temperature_degc, law.viscous))


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
