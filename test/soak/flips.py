"""Bit rot of bags: single flipped bits, each of which must be said or change nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from figure import Figure

from robot_energy.bag import BagReader, BagWriter
from robot_energy.bag.cdr import Encoder, stamp_columns
from robot_energy.foundation.errors import BagError

MINUTES = (0.5, 0.1)

JOINT_STATE = "sensor_msgs/msg/JointState"
ROWS = 400
Found = list[tuple[int, bytes]]


def run(folder: str, quick: bool) -> list[Figure]:
    """Flip 3,000 bits, or 300, one at a time, in an unpacked and in a packed bag."""
    trials = 300 if quick else 3000
    figures: list[Figure] = []
    for compression in ("none", "zstd"):
        file = _record(Path(folder) / compression, compression)
        whole, data = _read(file)[0], file.read_bytes()
        said = silent = 0
        for bit in np.random.default_rng(0).integers(0, 8 * len(data), trials).tolist():
            damaged = bytearray(data)
            damaged[bit // 8] ^= 1 << bit % 8
            file.write_bytes(damaged)
            try:
                found, problems = _read(file)
            except BagError:
                said += 1
                continue
            said += bool(problems)
            silent += not problems and found != whole
        what = f"flipped bits of {trials} in a bag, compression {compression}"
        figures.append(Figure(f"{what}: said", said))
        figures.append(Figure(f"{what}: silently different", silent, "0", not silent))
    return figures


def _record(folder: Path, compression: str) -> Path:
    encoder = Encoder(
        JOINT_STATE, {"name": ("a", "b")}, {"position": 2, "velocity": 2, "effort": 2}
    )
    random = np.random.default_rng(1)
    with BagWriter(folder, "zstd" if compression == "zstd" else "none") as bag:
        bag.add_topic("/joints", JOINT_STATE)
        for start in range(0, ROWS, 20):
            stamp = 10**15 + np.arange(start, start + 20) * 10**6
            values = {key: random.normal(size=(20, 2)) for key in ("position", "velocity")}
            columns = {**stamp_columns(stamp), **values, "effort": np.nan}
            bag.write("/joints", stamp, encoder.encode(columns, 20))
    return folder / f"{folder.name}_0.mcap"


def _read(file: Path) -> tuple[Found, list[str]]:
    reader = BagReader(file)
    found: Found = []
    for part in reader.parts(list(reader.topics)):
        for batch in part.values():
            times = batch.log_time_ns.tolist()
            found += [(time, batch.row(i)) for i, time in enumerate(times)]
    return found, reader.problems
