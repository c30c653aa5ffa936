"""Bags and logs: anything, read as far as it is whole, or a refusal."""

import functools
import sqlite3
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import yaml
import zstandard
from online import example
from target import JOINTS, done, in_file, scratch

from robot_energy.bag import BagReader, BagWriter
from robot_energy.bag.metadata import FILE_NAME
from robot_energy.inputs.joint_states.joint_states import JOINT_STATE
from robot_energy_logs.log_import import import_log
from robot_energy_logs.mapping import load_mapping
from robot_energy_logs.ur_rtde import import_ur_rtde


def read_bag(path: Path) -> None:
    """Read everything in a bag."""
    reader = BagReader(path)
    reader.typestore  # noqa: B018  the definitions in the bag are parsed here
    names = [name for name, info in reader.topics.items() if info.encoding == "cdr"]
    for part in reader.parts(names):
        for batch in part.values():
            assert len(batch)
            batch.row(len(batch) - 1)


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
    return done(lambda: import_log(log, mapping, out, overwrite=True))


def log_ur(data: bytes) -> bool:
    """A log of a UR robot is refused, or becomes a bag."""
    log, out = in_file("log.csv", data), scratch() / "out"
    return done(lambda: import_ur_rtde([log], out, overwrite=True))


def log_mapping(data: bytes) -> bool:
    """A mapping is refused, or used."""
    mapping, log, out = in_file("m.yaml", data), in_file("log.csv", LOG), scratch() / "out"
    return done(lambda: import_log(log, load_mapping(mapping), out, overwrite=True))


def ur_seeds() -> list[bytes]:
    """Three rows of a UR log."""
    names = ["timestamp", *(f"actual_{q}_{i}" for q in ("q", "qd", "current") for i in range(6))]
    names += ["actual_robot_voltage", "actual_robot_current"]
    rows = [" ".join([str(1000 + k / 500), *["0.1"] * (len(names) - 1)]) for k in range(3)]
    return ["\n".join([" ".join(names), *rows, ""]).encode()]
