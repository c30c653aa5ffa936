"""Logs of robots (CSV) -> bags that replay like any other."""

from robot_energy.logs.mapped_csv import import_csv
from robot_energy.logs.mapping import LogMapping, load_mapping
from robot_energy.logs.recording import FileAccount, ImportReport
from robot_energy.logs.ur_rtde import UR_JOINTS, import_ur_rtde

__all__ = [
    "UR_JOINTS",
    "FileAccount",
    "ImportReport",
    "LogMapping",
    "import_csv",
    "import_ur_rtde",
    "load_mapping",
]
