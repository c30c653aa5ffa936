"""Cost of joint states whose names change with every message, next to names that stay."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from rich.table import Table

from robot_energy.bag.cdr import Encoder, RawBatch, stamp_columns
from robot_energy.inputs.joint_states.joint_states import JOINT_STATE, JointStateIngest

NAMES = tuple(f"joint_{number}" for number in range(1, 7))
RATE = 5000  # messages in a second
TICK = 100  # messages of one tick, 50 ticks in a second
SETS = 399  # of names that take turns
OURS = 10  # every so many messages is one of this robot
MOST_US = 100.0  # a new layout may take


def ticks(sets: list[tuple[str, ...]], seconds: float) -> list[RawBatch]:
    """Messages of some seconds, cut into ticks; every tenth is one of the robot at a stand."""
    found: list[RawBatch] = []
    encoders: dict[tuple[str, ...], Encoder] = {}
    for first in range(0, round(RATE * seconds), TICK):
        rows: list[bytes] = []
        stamp = 10**18 + np.arange(first, first + TICK) * (10**9 // RATE)
        for number in range(first, first + TICK):
            names = sets[number % len(sets)] if number % OURS else NAMES
            lengths = dict.fromkeys(("position", "velocity", "effort"), len(names))
            encoder = encoders.setdefault(names, Encoder(JOINT_STATE, {"name": names}, lengths))
            zero = np.zeros((1, len(names)))
            columns = stamp_columns(stamp[number - first : number - first + 1])
            columns |= {"position": zero + 0.1, "velocity": zero, "effort": zero}
            rows.append(encoder.encode(columns, 1)[0].tobytes())
        length = np.array([len(row) for row in rows], dtype=np.int64)
        buffer = np.frombuffer(b"".join(rows), dtype=np.uint8)
        offset = np.cumsum(length) - length
        found.append(RawBatch("/joint_states", JOINT_STATE, stamp, buffer, offset, length))
    return found


def cost(batches: list[RawBatch], repeats: int) -> tuple[float, float, int]:
    """Processor time of a message [us], the longest tick [s], and the good states lost."""
    best, longest, lost = np.inf, np.inf, 0
    for _ in range(repeats):
        ingest, times = JointStateIngest(NAMES), [time.process_time()]
        for batch in batches:
            ingest.step(batch)
            times.append(time.process_time())
        ingest.flush()
        best = min(best, (times[-1] - times[0]) / (TICK * len(batches)) * 1e6)
        longest = min(longest, float(np.diff(times).max()))
        lost = max(lost, TICK * len(batches) // OURS - ingest.samples)
    return best, longest, lost


def run(folder: Path, quick: bool) -> tuple[Table, dict[str, object], dict[str, bool]]:
    """Measure names that stay, that take turns, and that never come again."""
    del folder
    seconds, repeats = (0.2, 2) if quick else (1.0, 5)
    count = round(RATE * seconds)
    sets = {
        "names that stay": [NAMES],
        f"{SETS} sets of six other names": [
            tuple(f"other_{number}_{joint}" for joint in range(6)) for number in range(SETS)
        ],
        "40 names that never come again": [
            tuple(f"other_{number}_{joint}" for joint in range(40)) for number in range(count)
        ],
    }
    table = Table(title=f"joint states at {RATE} Hz, one in {OURS} of this robot")
    for title in ("names", "message [us]", "longest tick [ms]", "good states lost"):
        table.add_column(title, justify="left" if title == "names" else "right")
    figures: dict[str, object] = {}
    goals: dict[str, bool] = {}
    for what, names in sets.items():
        message, longest, lost = cost(ticks(names, seconds), repeats)
        table.add_row(what, f"{message:.1f}", f"{1e3 * longest:.1f}", str(lost))
        figures[what] = {"message_us": message, "longest_tick_s": longest, "lost": lost}
        goals[f"{what}: at most {MOST_US:g} us a message, no good state lost"] = (
            message <= MOST_US and not lost
        )
    return table, figures, goals
