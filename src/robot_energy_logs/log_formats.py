"""Table of the formats of logs that become bags; light to import, for the command line."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from robot_energy.foundation.kinds import Kind, Kinds

if TYPE_CHECKING:
    from robot_energy_logs.recording import ImportReport


@dataclass(frozen=True, kw_only=True)
class LogFormat(Kind):
    """One format of logs. Its name is that of ``robot-energy import NAME``.

    Attributes:
        add_arguments: Adds the arguments of the import, but for ``--out`` and ``--overwrite``.
        run: Turns logs into the bag of ``--out``, by these arguments.
        recording: Turns one file into a bag, with the joints of a model; with it
            ``identify drives --NAME`` takes such files. None: it takes bags of them.
    """

    description: str
    epilog: str = ""
    add_arguments: Callable[[ArgumentParser], None]
    run: Callable[[Namespace], ImportReport]
    recording: Callable[[str, Path, Sequence[str]], ImportReport] | None = None


def _ur_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("logs", nargs="+", metavar="LOG", help="CSV files of one recording")
    parser.add_argument(
        "--joints",
        nargs=6,
        metavar="NAME",
        help="names of the six joints, base first (default: those of the UR URDF)",
    )
    parser.add_argument("--prefix", default="", metavar="TEXT", help="put before each joint name")


def _run_ur(args: Namespace) -> ImportReport:
    from robot_energy_logs.ur_rtde import UR_JOINTS, UR_LINK, import_ur_rtde

    names = [f"{args.prefix}{name}" for name in args.joints or UR_JOINTS]
    link = f"{args.prefix}{UR_LINK}"
    return import_ur_rtde(args.logs, args.out, names, args.overwrite, link)


def _ur_recording(log: str, out: Path, joint_names: Sequence[str]) -> ImportReport:
    from robot_energy_logs.ur_rtde import import_ur_rtde

    return import_ur_rtde([log], out, joint_names)


def _table_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("log", nargs="+", metavar="LOG", help="tables of one recording")
    parser.add_argument("--mapping", required=True, metavar="FILE", help="YAML file")
    parser.add_argument(
        "--recordings",
        nargs="+",
        default=[],
        metavar="NAME",
        help="what stands for {recording} in the names of files, instead of the mapping's own",
    )


def _run_table(args: Namespace) -> ImportReport:
    from robot_energy_logs.log_import import import_log
    from robot_energy_logs.mapping import load_mapping

    mapping = load_mapping(args.mapping, args.recordings)
    return import_log(args.log, mapping, args.out, args.overwrite)


_TABLE = LogFormat(
    name="table",
    label="tables",
    line="any table (CSV, gzip, Parquet), by a mapping of its columns",
    description="""\
Turn any table (CSV, plain or .gz, or Parquet) into a bag, by a small YAML file that says
which column means what, in which unit. Several files become one recording, in the order of
their time. If the mapping names the files, LOG is their folder. Commented examples:
src/examples/mappings.
""",
    epilog="""\
examples:
  robot-energy import table log.csv.gz --mapping kr300.yaml --out kr300_bag
  robot-energy import table monday.parquet tuesday.parquet --mapping cell.yaml --out cell_bag
""",
    add_arguments=_table_arguments,
    run=_run_table,
)
LOG_FORMATS = Kinds(
    "log format",
    LogFormat(
        name="ur-rtde",
        label="UR's RTDE",
        line="CSV recordings of UR robots",
        description="""\
Turn a recording of UR's real-time interface (RTDE, CSV) into a bag.

Needs the columns timestamp and actual_q_0 ... actual_q_5; uses, where they are there,
actual_qd_*, actual_current_*, joint_temperatures_*, actual_robot_voltage,
actual_robot_current, payload, payload_cog_* and payload_inertia_*. Several files of one recording
are joined in the order of their time.
""",
        epilog="""\
example:
  robot-energy import ur-rtde part_1.csv part_2.csv --out ur_bag
  robot-energy replay ur_bag --model ur3e
""",
        add_arguments=_ur_arguments,
        run=_run_ur,
        recording=_ur_recording,
    ),
    _TABLE,
    replace(_TABLE, name="csv", label="CSV", line="the same as `table`"),
)

register_log_format = LOG_FORMATS.register
"""Add a format of yours: ``robot-energy import NAME`` reads it from now on."""
