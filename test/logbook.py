"""Small logs and bags for the tests of logs, reports and the command."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import robot_energy as re
from robot_energy.bag import BagReader
from robot_energy.bag.cdr.decode import Decoder, RawBatch, stamp_ns
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.inputs.meter.meter import MeterIngest
from robot_energy.model import save
from robot_energy.timeline.blocks import Float, Int, JointBlock, MeterBlock, TemperatureBlock
from robot_energy_logs.log_import import import_log
from robot_energy_logs.mapping import LogMapping, Time
from robot_energy_logs.recording import FileAccount
from robot_energy_logs.rows import Clock, usable_rows
from robot_energy_logs.table import LogTable
from robots import one_wheel

# The wheel turns at 2 rad/s, its motor at 20 rad/s. Friction torque at the motor is
# 0.5 + 0.02 * 20 = 0.9 N m, so 18 W; nothing accelerates and the drive is ideal. With
# constant losses of 20 W (DC) and 30 W (grid): 38 W on the DC bus, 68 W from the grid.
SPEED = 2.0  # rad/s
FRICTION, LOSS_DC, LOSS_GRID = 18.0, 20.0, 30.0  # W
BUS, GRID = 38.0, 68.0  # W
WHEEL_MAPPING: dict[str, Any] = {
    "schema_version": 1,
    "time": {"column": "t", "start": "2024-05-06T07:08:09Z"},
    "joints": {
        "names": ["axle"],
        "position": {"column": "q_{joint}", "unit": "rad"},
        "velocity": {"column": "w_{joint}", "unit": "rad_per_s"},
    },
    "power": {
        "location": "grid",
        "meaning": "instantaneous",
        "reading": {"column": "p", "unit": "W"},
    },
}


def mapping(**changes: Any) -> LogMapping:
    """The mapping of the wheel with top-level entries replaced or, by None, left out."""
    data = {**WHEEL_MAPPING, **changes}
    return LogMapping.model_validate({k: v for k, v in data.items() if v is not None})


def write_csv(path: Path, header: str, rows: Sequence[Sequence[object] | str]) -> Path:
    """Write a CSV file; a row may be given as raw text."""
    lines = [row if isinstance(row, str) else ",".join(map(str, row)) for row in rows]
    path.write_text("\n".join([header, *lines, ""]), encoding="utf-8")
    return path


def wheel_csv(
    path: Path, power: float | None = 80.0, seconds: float = 10.0, rate: float = 100.0
) -> Path:
    """Ten seconds of the wheel at constant speed, and what its meter reads."""
    time = np.arange(round(seconds * rate) + 1) / rate
    reading = "" if power is None else power
    rows = [(f"{t:.6f}", f"{SPEED * t:.9f}", SPEED, reading) for t in time.tolist()]
    return write_csv(path, "t,q_axle,w_axle,p", rows)


def wheel_bag(
    folder: Path, power: float | None = 80.0, location: str = "grid", **shape: float
) -> Path:
    """The same as a bag; without power there is no meter."""
    log = wheel_csv(folder / "wheel.csv", power, **shape)
    meter = None if power is None else {**WHEEL_MAPPING["power"], "location": location}
    import_log(log, mapping(power=meter), folder / "bag")
    return folder / "bag"


def wheel_model(folder: Path, **changes: Any) -> Path:
    """The model file of the wheel."""
    path = folder / "wheel.yaml"
    save(one_wheel(**changes), path)
    return path


def table_rows(
    path: Path,
    numbers: Sequence[str],
    time: dict[str, Any] | None = None,
    required: int = 1,
    last_ns: int | None = None,
    **of_table: Any,
) -> tuple[Float, Int, FileAccount]:
    """Numbers and instants of the usable rows of one table, and the account of all."""
    spec = Time.model_validate(time or {"column": "t"})
    texts = [name for name in (spec.column, spec.run) if name is not None]
    account, clock = FileAccount(path=path), Clock(spec)
    values, instants = [], []
    for rows in LogTable(path, **of_table).rows(numbers, texts):
        instant, known, _ = clock.instants(rows)
        needed = np.arange(rows.values.shape[1]) < required
        used, last_ns = usable_rows(rows, instant, known, needed, last_ns, account)
        values.append(rows.values[used])
        instants.append(instant[used])
    return np.concatenate(values), np.concatenate(instants), account


def read_bag(
    path: Path, joint_names: Sequence[str]
) -> tuple[JointBlock, TemperatureBlock | None, MeterBlock | None]:
    """Everything that a bag of an import holds."""
    names = ("/joint_states", "/motor_temperatures", "/power_meter")
    bag = BagReader(path)
    ingest = (JointStateIngest(joint_names), MeterIngest())
    blocks: list[list[Any]] = [[], [], []]
    for part in bag.parts([name for name in names if name in bag.topics]):
        found = (
            ingest[0].step(part[names[0]]) if names[0] in part else None,
            _temperatures(part[names[1]], joint_names) if names[1] in part else None,
            ingest[1].step([part[names[2]]]) if names[2] in part else None,
        )
        for held, block in zip(blocks, found, strict=True):
            held += [] if block is None else [block]
    joints = JointBlock.concatenate(blocks[0])
    return (
        joints,
        TemperatureBlock.concatenate(blocks[1]) if blocks[1] else None,
        MeterBlock.concatenate(blocks[2]) if blocks[2] else None,
    )


def _temperatures(batch: RawBatch, joint_names: Sequence[str]) -> TemperatureBlock:
    """Every reading of a batch; an ingest would take ten a second."""
    decoder = Decoder(
        batch.msgtype,
        ("header.stamp.sec", "header.stamp.nanosec", "joint_names", "temperature_degc"),
    )
    (run,) = decoder.decode(batch).runs
    columns = [run.names("joint_names").index(name) for name in joint_names]
    return TemperatureBlock(stamp_ns(run), run.array("temperature_degc")[:, columns])


def wheel_start(bag: Path) -> float:
    """Time of the first sample of a bag of `wheel_bag`. [s since 1970]"""
    start_ns = re.replay(bag, str(wheel_model(bag.parent))).report.time.start_ns
    assert start_ns is not None
    return start_ns * 1e-9
