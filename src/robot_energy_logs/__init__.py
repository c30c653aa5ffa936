"""Logs of robots (CSV, Parquet) -> bags that replay like any other."""

from robot_energy_logs.log_import import contents_of, import_log, open_logs
from robot_energy_logs.mapped_log import MappedLog
from robot_energy_logs.mapping import LogMapping, load_mapping
from robot_energy_logs.recording import FileAccount, ImportReport
from robot_energy_logs.ur_rtde import UR_JOINTS, UR_LINK, import_ur_rtde

__all__ = [
    "UR_JOINTS",
    "UR_LINK",
    "FileAccount",
    "ImportReport",
    "LogMapping",
    "MappedLog",
    "contents_of",
    "import_log",
    "import_ur_rtde",
    "load_mapping",
    "open_logs",
]
