"""Everything that reads what others wrote, as functions of bytes that fail only on a fault.

A target returns for any bytes whatever: online input is counted, files are refused with a
`RobotEnergyError`. The same targets run under Hypothesis in `make test` and guided by coverage
in `make soak`.
"""

from __future__ import annotations

import functools
import gzip
import json
import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
import zstandard
from rosbags.interfaces import Nodetype

import robots
from robot_energy.bag import BagReader, BagWriter
from robot_energy.bag.metadata import FILE_NAME
from robot_energy.errors import RobotEnergyError
from robot_energy.ingest import JointStateIngest, MeterIngest, TemperatureIngest
from robot_energy.ingest.joint_states import JOINT_STATE
from robot_energy.ingest.meter_source import (
    BATTERY_STATE,
    FLOAT32,
    FLOAT64,
    POWER_READING,
    MeterSource,
)
from robot_energy.ingest.sources import (
    INTERFACE_NAMES,
    INTERFACE_VALUES,
    TEMPERATURE_TYPES,
    TemperatureSource,
)
from robot_energy.inputs_file import read_inputs
from robot_energy.logs import import_csv, import_ur_rtde
from robot_energy.logs.mapping import load_mapping
from robot_energy.messages import FrictionReader, TorqueReader
from robot_energy.messages.friction import JOINT_FRICTION
from robot_energy.messages.payload import PAYLOAD, PayloadReader
from robot_energy.messages.torque import JOINT_TORQUE
from robot_energy.model_file import parse_yaml, validate
from robot_energy.motion.gcode import load_gcode
from robot_energy.motion.joint_trajectory import read_points
from robot_energy.motion.program_file import program_for, read_program
from robot_energy.motion.tool_timing import TimedPath
from robot_energy.motion.trajectory_file import (
    MESSAGE as JOINT_TRAJECTORY,
)
from robot_energy.motion.trajectory_file import (
    decode_trajectory,
    read_csv_trajectory,
)
from robot_energy.motion.wall import Wall
from robot_energy.pipeline import EnergyPipeline, Ledger
from robot_energy.registers.record import FORMAT_VERSION
from robot_energy.robot import Robot
from robot_energy.state_file import books_of
from robot_energy.state_file.bookkeeper import file_name_of, identity_of
from robot_energy.state_file.envelope import wrap
from robot_energy.wire import RawBatch, typestore

JOINTS = ("shoulder", "elbow")
NAMED = {"link": "fore", "key": "temperature", "value": "35.5 degC"}
KEYS = ["shoulder/temperature", "elbow/temperature"]
MESSAGES = (
    JOINT_STATE,
    POWER_READING,
    JOINT_TORQUE,
    JOINT_FRICTION,
    PAYLOAD,
    INTERFACE_NAMES,
    BATTERY_STATE,
    FLOAT32,
    FLOAT64,
    *TEMPERATURE_TYPES,
)
SOURCES = {
    kind: TemperatureSource(
        topic=f"/{index}",
        type=kind,
        joints=JOINTS[:1] if kind.endswith("/Temperature") else JOINTS,
        keys=("temperature",),
        names=JOINTS if kind.endswith("DiagnosticArray") else (),
        stamps="receipt" if kind.endswith("MultiArray") else "header",
        names_topic="/names" if kind == INTERFACE_VALUES else "",
    )
    for index, kind in enumerate(TEMPERATURE_TYPES)
}
METERS = {
    POWER_READING: MeterSource(topic="/reading"),
    BATTERY_STATE: MeterSource(topic="/battery", type=BATTERY_STATE),
    FLOAT32: MeterSource(
        type=FLOAT32, unit="W", meaning="instantaneous", location="grid",
        voltage_topic="/volt", current_topic="/ampere",
    ),
    FLOAT64: MeterSource(topic="/counter", type=FLOAT64, unit="Wh", location="grid", wraps_at=100),
}  # fmt: skip
TOPIC_OF = {kind: source.topic for kind, source in SOURCES.items()} | {INTERFACE_NAMES: "/names"}


class Target(NamedTuple):
    """What is tried, and valid samples to begin with."""

    run: Callable[[bytes], bool]  # whether something of it was taken
    seeds: Callable[[], list[bytes]]


@functools.cache
def scratch() -> Path:
    """A folder of this process."""
    return Path(tempfile.mkdtemp(prefix="fuzz_"))


def discard_scratch() -> None:
    """Remove the folder of this process."""
    shutil.rmtree(scratch(), ignore_errors=True)
    scratch.cache_clear()


# Online: messages of any type, one after another.


def pack(messages: list[tuple[str, bytes]]) -> bytes:
    """Messages as one string of bytes: type, two bytes of length, content."""
    return b"".join(
        bytes([MESSAGES.index(kind)]) + len(data).to_bytes(2, "little") + data
        for kind, data in messages
    )


def unpack(data: bytes) -> Iterator[tuple[str, bytes]]:
    """Messages out of any bytes."""
    while len(data) > 3:
        kind, size = MESSAGES[data[0] % len(MESSAGES)], int.from_bytes(data[1:3], "little")
        yield kind, data[3 : 3 + size]
        data = data[3 + size :]


def online(data: bytes) -> bool:
    """No message raises, each is counted once, and the books stay balanced."""
    given = dict.fromkeys(MESSAGES, 0)
    model = robots.two_link()
    pipeline = EnergyPipeline(model)
    joints = JointStateIngest(JOINTS)
    meters = {kind: MeterIngest(source) for kind, source in METERS.items()}
    ledgers = {kind: Ledger(2) for kind in METERS}
    ledgers[POWER_READING] = pipeline.ledger

    def measure(batch: RawBatch) -> None:
        if batch.msgtype == FLOAT32:  # voltage and current in turn
            batch = replace(batch, topic=("/volt", "/ampere")[given[FLOAT32] % 2])
        readings = meters[batch.msgtype].step([batch])
        if readings is not None:
            ledgers[batch.msgtype].measure(readings)

    temperatures = TemperatureIngest(JOINTS, {source.topic: source for source in SOURCES.values()})
    torque = TorqueReader(JOINTS, model.model_id)
    friction = FrictionReader(model)
    payload = PayloadReader(pipeline.torque.set_payload)
    readers: dict[str, tuple[Any, Callable[[RawBatch], Any]]] = {
        JOINT_STATE: (joints, lambda batch: pipeline.step(joints.step(batch))),
        **{kind: (meter, measure) for kind, meter in meters.items()},
        JOINT_TORQUE: (torque, torque.decode),
        JOINT_FRICTION: (friction, friction.decode),
        PAYLOAD: (payload, payload.step),
    }
    for kind, message in unpack(data):
        given[kind] += 1
        batch = RawBatch.from_messages(
            TOPIC_OF.get(kind, "/t"), kind, [10**9 * sum(given.values())], [message]
        )
        if kind in readers:
            readers[kind][1](batch)
        else:
            pipeline.step(temperatures=temperatures.step([batch]))
    pipeline.step(joints.flush())
    pipeline.flush()
    for kind, (reader, _) in readers.items():
        assert reader.account.received == given[kind], kind
        assert reader.account.balanced, (kind, reader.account)
    assert temperatures.account.balanced
    time = pipeline.ledger.registers.time
    assert min(time.observed_ns, time.gap_ns) >= 0
    assert (pipeline.ledger.registers.microjoule[:2] >= 0).all()
    accounts = [reader.account for reader, _ in readers.values()]
    return any(account.accepted for account in [*accounts, temperatures.account])


def example(kind: str, value: float = 1.0) -> bytes:
    """A valid message of a type: two of everything."""
    store = typestore()

    def field(description: Any, name: str) -> Any:
        node, detail = description
        if node == Nodetype.NAME:
            return record(detail)
        if node == Nodetype.BASE:
            text = robots.two_link().model_id if name == "model_id" else NAMED.get(name, JOINTS[0])
            return text if detail[0] == "string" else value if "float" in detail[0] else 1
        count = detail[1] if node == Nodetype.ARRAY else 2
        if detail[0][0] == Nodetype.NAME:
            return [record(detail[0][1])] * count
        base = detail[0][1][0]
        if base == "string":
            names = {"keys": KEYS, "interface_names": ["temperature", "position"]}
            return names.get(name, list(JOINTS))
        array = np.full(count, value, dtype=base.replace("byte", "uint8"))
        array[3:] = 0  # products of inertia
        return array

    def record(name: str) -> Any:
        return store.types[name](*(field(d, n) for n, d in store.fielddefs[name][1]))

    return bytes(store.serialize_cdr(record(kind), kind))


def online_seeds() -> list[bytes]:
    """One message of each type, and a second of joint states with a meter."""
    paired = (INTERFACE_NAMES, INTERFACE_VALUES)  # of use together only
    singles = [pack([(kind, example(kind))]) for kind in MESSAGES if kind not in paired]
    singles.append(pack([(kind, example(kind)) for kind in paired]))
    singles.append(pack([(kind, example(kind, 48.0)) for kind in [FLOAT32, FLOAT64] * 4]))
    joint_state = bytearray(example(JOINT_STATE))
    stream: list[tuple[str, bytes]] = []
    for index in range(12):
        joint_state[4:12] = np.array([1000, index * 10**7], dtype="<u4").tobytes()
        stream.append((JOINT_STATE, bytes(joint_state)))
    stream.insert(4, (POWER_READING, example(POWER_READING, 500.0)))
    stream.insert(6, (PAYLOAD, example(PAYLOAD, 0.1)))
    return [*singles, pack(stream)]


# Files: anything or a refusal.


def done(action: Callable[[], Any]) -> bool:
    """Run and say whether it was not refused; a refusal must be text that can be printed."""
    try:
        action()
    except RobotEnergyError as error:
        if not str(error):
            raise AssertionError("a refusal says why") from error
        return False
    return True


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


def read_bag(path: Path) -> None:
    """Read everything in a bag."""
    reader = BagReader(path)
    reader.typestore  # noqa: B018  the definitions in the bag are parsed here
    names = [name for name, info in reader.topics.items() if info.encoding == "cdr"]
    for part in reader.parts(names):
        for batch in part.values():
            assert len(batch)
            batch.row(len(batch) - 1)


def in_file(name: str, data: bytes) -> Path:
    """Write bytes where a target can read them."""
    path = scratch() / name
    path.write_bytes(data)
    return path


def mcap(data: bytes) -> bool:
    """An MCAP file is refused, or read as far as it is whole."""
    return done(lambda: read_bag(in_file("bag.mcap", data)))


def mcap_seeds() -> list[bytes]:
    """Small bags, packed and not."""
    seeds: list[bytes] = []
    for compression in ("none", "zstd"):
        folder = scratch() / "seed"
        with BagWriter(folder, compression, overwrite=True) as bag:
            bag.add_topic("/t", JOINT_STATE)
            bag.write("/t", np.arange(3) * 10**9, [example(JOINT_STATE)] * 3)
        seeds.append((folder / "seed_0.mcap").read_bytes())
    return seeds


def sqlite(data: bytes) -> bool:
    """A database is refused, or read as far as it is whole."""
    return done(lambda: read_bag(in_file("bag.db3", data)))


@functools.cache
def sqlite_seeds() -> list[bytes]:
    """A small database."""
    path = scratch() / "seed.db3"
    path.unlink(missing_ok=True)
    base = sqlite3.connect(path)
    base.executescript(
        "PRAGMA page_size = 512; CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, "
        "type TEXT, serialization_format TEXT);"
        f"INSERT INTO topics VALUES(1, '/t', '{JOINT_STATE}', 'cdr');"
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
        f"data BLOB); INSERT INTO messages VALUES(1, 1, 5, x'{example(JOINT_STATE).hex()}');"
    )
    base.close()
    return [path.read_bytes()]


def bag_folder(data: bytes) -> bool:
    """The metadata of a folder is used, or left out with a sentence."""
    folder = scratch() / "folder"
    folder.mkdir(exist_ok=True)
    (folder / FILE_NAME).write_bytes(data)
    for name, content in folder_files().items():
        if not (folder / name).exists():
            (folder / name).write_bytes(content)
    return done(lambda: read_bag(folder))


@functools.cache
def folder_files() -> Mapping[str, bytes]:
    """Files that the metadata may name."""
    (base,) = sqlite_seeds()
    return {"a.mcap": mcap_seeds()[0], "a.db3": base, "a.db3.zstd": zstandard.compress(base)}


def folder_seeds() -> list[bytes]:
    """The metadata of bags packed in each way."""
    info = {"version": 9, "relative_file_paths": ["a.mcap"], "custom_data": {"origin": "x"}}
    ways = [("mcap", "", "a.mcap"), ("sqlite3", "", "a.db3"), ("sqlite3", "file", "a.db3.zstd")]
    ways.append(("sqlite3", "message", "a.db3"))
    return [
        yaml.safe_dump(
            {
                "rosbag2_bagfile_information": {
                    **info,
                    "storage_identifier": kind,
                    "compression_mode": mode,
                    "relative_file_paths": [file],
                }
            }
        ).encode()
        for kind, mode, file in ways
    ]


LOG = b"t,q1,q2,v1,v2,p\n0.0,0,0,1,1,50\n0.1,0.1,0.1,1,1,51\n0.2,0.2,0.2,1,1,52\n"
MAPPING = {
    "schema_version": 1,
    "time": {"column": "t", "start": "2024-01-01T00:00:00"},
    "joints": {
        "names": list(JOINTS),
        "position": {"columns": ["q1", "q2"], "unit": "rad"},
        "velocity": {"columns": ["v1", "v2"], "unit": "rad_per_s"},
    },
    "power": {
        "location": "grid",
        "meaning": "instantaneous",
        "reading": {"column": "p", "unit": "W"},
    },
}


def log_csv(data: bytes) -> bool:
    """A log is refused, or becomes a bag."""
    mapping = load_mapping(in_file("mapping.yaml", yaml.safe_dump(MAPPING).encode()))
    log, out = in_file("log.csv", data), scratch() / "out"
    return done(lambda: import_csv(log, mapping, out, overwrite=True))


def log_ur(data: bytes) -> bool:
    """A log of a UR robot is refused, or becomes a bag."""
    log, out = in_file("log.csv", data), scratch() / "out"
    return done(lambda: import_ur_rtde([log], out, overwrite=True))


def log_mapping(data: bytes) -> bool:
    """A mapping is refused, or used."""
    mapping, log, out = in_file("m.yaml", data), in_file("log.csv", LOG), scratch() / "out"
    return done(lambda: import_csv(log, load_mapping(mapping), out, overwrite=True))


def ur_seeds() -> list[bytes]:
    """Three rows of a UR log."""
    names = ["timestamp", *(f"actual_{q}_{i}" for q in ("q", "qd", "current") for i in range(6))]
    names += ["actual_robot_voltage", "actual_robot_current"]
    rows = [" ".join([str(1000 + k / 500), *["0.1"] * (len(names) - 1)]) for k in range(3)]
    return ["\n".join([" ".join(names), *rows, ""]).encode()]


def inputs_file(data: bytes) -> bool:
    """The inputs of a replay are refused, or read."""
    path = in_file("inputs.yaml", data)
    return done(lambda: read_inputs(path))


def inputs_seeds() -> list[bytes]:
    """Parameters of a node."""
    source = {"topic": "/a", "type": TEMPERATURE_TYPES[0], "unit": "kelvin", "joints": ["a"]}
    nodes = {"/**": {"ros__parameters": {"temperature_sources": ["m"], "m": source, "rate": 2}}}
    return [yaml.safe_dump(nodes).encode()]


def gcode(data: bytes) -> bool:
    """A program is refused, or becomes a motion that stays finite and within its speed."""
    path = in_file("program.gcode", data)

    def read() -> None:
        program = load_gcode(path)
        motion = TimedPath(program.path)
        assert 0 < motion.duration < np.inf
        time = np.linspace(-1.0, motion.duration + 1.0, 200)
        tool = motion.sample(time)
        for values in (tool.position, tool.velocity, tool.acceleration):
            assert np.isfinite(values).all()
        fastest = max(getattr(segment, "speed", 0.0) for segment in program.path.segments)
        assert np.linalg.norm(tool.velocity, axis=1).max() <= fastest * (1 + 1e-6) + 1e-6

    return done(read)


def gcode_seeds() -> list[bytes]:
    """The wall, and all that is understood."""
    rich = (
        "%\n( all codes )\nG21 G90 G17\nM82\nG92 E0\nM104 S200\nN10 G0 X0 Y0 Z0\n"
        "G1 X20 E1 F3000\nG2 X30 Y10 I0 J10\nG3 X20 Y20 R10\nG3 X20 Y20 I5 J0 Z2\nG4 P200\n"
        "G91\nG1 X-5 Y1\nG20\nG1 Y.1 F50\nG90 G21\nG0 X5 F600 ; back\nM117 Hello (\nM2\n"
    )
    return [Wall(strokes=3).gcode().encode(), rich.encode()]


def moves_file(data: bytes) -> bool:
    """A program of moves is refused, or made for a robot."""
    path = in_file("moves.yaml", data)
    limits = Robot(robots.TWO_LINK_URDF, JOINTS).limits
    limits = replace(limits, velocity=np.array([4.0, 4.0]))

    def read() -> None:
        loaded = program_for(read_program(path), limits)
        time = np.linspace(0.0, loaded.program.period, 100)
        assert np.isfinite(loaded.program.sample(time).joint_acceleration).all()

    return done(read)


def moves_seeds() -> list[bytes]:
    """Moves of two joints."""
    via = [{"shoulder": 0.0, "elbow": 10}, {"shoulder": 45.5, "elbow": -30}]
    data = {"schema_version": 1, "motion": "point_to_point", "angle_unit": "deg", "via": via}
    rich = {"dwell": [0.5, 0], "override": 0.5, "acceleration": {"shoulder": 9.0, "elbow": 8}}
    return [yaml.safe_dump(each).encode() for each in (data, {**data, **rich, "repeat": 3})]


def trajectory(data: bytes) -> bool:
    """A JointTrajectory is refused, or can be followed."""

    def read() -> None:
        found = read_points(decode_trajectory(typestore(), data, "it"), "it")
        time = np.linspace(0.0, found.duration, 100)
        assert np.isfinite(found.sample(time).joint_position).all()

    return done(read)


def trajectory_seeds() -> list[bytes]:
    """Three points of two joints."""
    kinds = typestore().types
    rows = [
        kinds["trajectory_msgs/msg/JointTrajectoryPoint"](
            positions=np.array([0.1, 0.2]) * k,
            velocities=np.array([0.1, 0.2]),
            accelerations=np.zeros(2),
            effort=np.empty(0),
            time_from_start=kinds["builtin_interfaces/msg/Duration"](sec=k, nanosec=5),
        )
        for k in range(3)
    ]
    stamp = kinds["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    message = kinds[JOINT_TRAJECTORY](header=header, joint_names=list(JOINTS), points=rows)
    return [bytes(typestore().serialize_cdr(message, JOINT_TRAJECTORY))]


def trajectory_csv(data: bytes) -> bool:
    """A table of points is refused, or can be followed."""
    path = in_file("points.csv", data)
    return done(lambda: read_csv_trajectory(path).sample(np.linspace(0.0, 1.0, 50)))


def trajectory_csv_seeds() -> list[bytes]:
    """Points with and without derivatives."""
    plain = "time,position_a,position_b\n0,0,0\n0.5,1,2\n1,2,1\n"
    rich = "time,position_a,velocity_a,acceleration_a\n0,0,0,0\n0.5,1,2,3\n1,2,0,0\n"
    return [plain.encode(), rich.encode()]


def state_file(data: bytes) -> bool:
    """State files are continued or moved aside; what a newer release wrote stays, with a word."""
    model, ledger = robots.two_link(), Ledger(2)
    folder = scratch() / "state"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    name = file_name_of(identity_of(model))
    (folder / f"{name}.a.state").write_bytes(data)
    payload = data.partition(b"\n")[2]
    (folder / f"{name}.b.state").write_bytes(wrap(FORMAT_VERSION, 1, payload))
    keeper = books_of(ledger, model, folder)
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
    keeper = books_of(pipeline.ledger, model, folder)
    keeper.open()
    stamp, pose = 10 + np.arange(20) / 100, np.full((20, 2), 0.3)
    pipeline.step(robots.joint_block(stamp, pose, pose))
    pipeline.flush()
    assert keeper.checkpoint()
    assert keeper.close()
    return [path.read_bytes() for path in sorted(folder.glob("*.state"))]


TARGETS = {
    "online": Target(online, online_seeds),
    "model_file": Target(model_file, model_seeds),
    "urdf": Target(urdf, urdf_seeds),
    "mcap": Target(mcap, mcap_seeds),
    "sqlite": Target(sqlite, sqlite_seeds),
    "bag_folder": Target(bag_folder, folder_seeds),
    "log_csv": Target(log_csv, lambda: [LOG, gzip.compress(LOG, mtime=0)]),
    "log_ur": Target(log_ur, ur_seeds),
    "log_mapping": Target(log_mapping, lambda: [yaml.safe_dump(MAPPING).encode()]),
    "inputs_file": Target(inputs_file, inputs_seeds),
    "state_file": Target(state_file, state_seeds),
    "gcode": Target(gcode, gcode_seeds),
    "moves_file": Target(moves_file, moves_seeds),
    "trajectory": Target(trajectory, trajectory_seeds),
    "trajectory_csv": Target(trajectory_csv, trajectory_csv_seeds),
}
