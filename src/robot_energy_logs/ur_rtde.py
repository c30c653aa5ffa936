"""Import of UR RTDE recordings: the columns of the robot's real-time interface."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from robot_energy.foundation.errors import LogFormatError
from robot_energy_logs.log_import import import_log, open_logs
from robot_energy_logs.mapping import LogMapping, since_1970
from robot_energy_logs.recording import ImportReport
from robot_energy_logs.table import LogTable

UR_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
CLOCK = "timestamp"
COLUMNS: dict[str, Any] = {
    "position": {"column": "actual_q_{joint}", "unit": "rad"},
    "velocity": {"column": "actual_qd_{joint}", "unit": "rad_per_s"},
    "effort": {"column": "actual_current_{joint}", "unit": "ampere"},
    "temperature": {"column": "joint_temperatures_{joint}", "unit": "celsius"},
}
SUPPLY: dict[str, Any] = {  # of the 48 V bus
    "location": "dc_bus",
    "meaning": "instantaneous",
    "voltage": {"column": "actual_robot_voltage", "unit": "V"},
    "current": {"column": "actual_robot_current", "unit": "A"},
}
UR_LINK = "tool0"  # of the URDF: the tool flange, with the axes that the controller uses
PAYLOAD: dict[str, Any] = {  # as set on the controller
    "mass": "payload",
    "centre_of_mass": [f"payload_cog_{axis}" for axis in range(3)],
    "inertia": [f"payload_inertia_{entry}" for entry in range(6)],  # Ixx Iyy Izz Ixy Ixz Iyz
}
WALLS = ("time", "_id")  # recorders differ in where they note the wall clock
WALL_FORMATS = ("%Y:%m:%d:%H:%M:%S.%f", "%Y-%m-%dT%H:%M:%S.%f", "%Y-%m-%d %H:%M:%S.%f")


def import_ur_rtde(
    logs: Sequence[str | Path],
    out: str | Path,
    joint_names: Sequence[str] = UR_JOINTS,
    overwrite: bool = False,
    link: str = UR_LINK,
) -> ImportReport:
    """Turn UR RTDE recordings into one bag.

    Positions and velocities become ``/joint_states`` with the motor currents [A] as its
    effort, joint temperatures ``/motor_temperatures``, and robot voltage times current
    ``/power_meter``: instantaneous, on the DC bus. Stamps follow the controller's clock
    ``timestamp``; where ``time`` or ``_id`` holds a wall clock, its first entry says when
    the recording started, taken as UTC.

    Args:
        logs: Files of one recording, joined in the order of their time.
        link: Link of the URDF that is the tool flange, whose payload becomes
            ``/energy/payload`` at each change.

    Returns:
        What was written, and the account of every row.
    """
    names = list(joint_names)
    decimal = _decimal(logs)
    if len(names) != len(UR_JOINTS) or len(set(names)) != len(names):
        raise LogFormatError(f"the joint names {', '.join(names)}", "six different names")
    keys = [str(axis) for axis in range(len(names))]
    mapping = LogMapping.model_validate(
        {
            "schema_version": 1,
            "description": "UR RTDE recording",
            "decimal": decimal,
            "time": {"column": CLOCK},
            "joints": {"names": names, "keys": keys, **COLUMNS},
            "power": SUPPLY,
            "payload": {**PAYLOAD, "link": link},
        }
    )
    for log in logs:
        table = LogTable(log, decimal=decimal)
        for column in (CLOCK, *(f"actual_q_{key}" for key in keys)):
            table.require(column, "a UR RTDE recording")
    start_ns, note = _start(open_logs(logs, mapping, optional=True)[0].main)
    report = import_log(logs, mapping, out, overwrite, True, start_ns)
    report.notes.insert(0, note)
    if decimal == ",":
        report.notes.insert(1, "numbers are read with decimal commas")
    contents = report.contents
    for present, what in (
        (contents.velocity, "velocities"),
        (contents.effort, "motor currents"),
        (contents.temperatures, "joint temperatures"),
        (contents.meaning, "supply voltage and current"),
        (contents.payload_link, "payload"),
    ):
        if not present:
            report.notes.append(f"the recording has no {what}")
    return report


def _decimal(logs: Sequence[str | Path]) -> str:
    """The decimal sign: a comma where the first clock is written so."""
    for log in logs:
        table = LogTable(log)
        if CLOCK in table.columns and table.delimiter != "," and (cells := table.first([CLOCK])):
            return "," if "," in str(cells[0][0]) else "."
    return "."


def _start(table: LogTable) -> tuple[int, str]:
    """What to add to the controller's clock, and the note on it. [ns]"""
    for column in WALLS:
        if column not in table.columns:
            continue
        wall, clock = table.first([column, CLOCK]) or [None, None]
        start = None if wall is None else _instant(str(wall[0]))
        if start is not None and clock is not None:
            text = start.isoformat(timespec="milliseconds").removesuffix("+00:00")
            first = float(str(clock[0]).replace(",", "."))
            return since_1970(start) - round(first * 1e9), (
                f"stamps are the controller's clock, set to {text} at the first row; "
                f"the column '{column}' is taken as UTC"
            )
    return 0, "stamps are the controller's own clock (time since it was started)"


def _instant(text: str) -> datetime | None:
    for form in WALL_FORMATS:
        with suppress(ValueError):
            return datetime.strptime(text.strip(), form).replace(tzinfo=UTC)
    return None
