"""Files of a log -> the recordings in it, and a bag."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from decimal import Decimal
from pathlib import Path

from robot_energy.foundation.errors import LogFormatError
from robot_energy.foundation.time_zone import local_time
from robot_energy.foundation.units import SECOND_NS
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.timeline.blocks import MeterLocation, MeterMeaning
from robot_energy.timeline.stamps import MIN_DATE
from robot_energy_logs.columns import ROTOR_FRAME
from robot_energy_logs.instants import time_remedy
from robot_energy_logs.mapped_log import MappedLog
from robot_energy_logs.mapping import DIGITS, LogMapping, Time
from robot_energy_logs.recording import ImportReport, LogBlock, RecordingContents, write_bag
from robot_energy_logs.rows import Clock


def open_logs(
    paths: Sequence[str | Path],
    mapping: LogMapping,
    drivetrain: Drivetrain | None = None,
    optional: bool = False,
) -> list[MappedLog]:
    """Open all files of a log, each recording as one.

    Args:
        paths: Tables: CSV, plain or gzip, or Parquet. One folder, if the mapping names files.
        optional: Whether files may lack columns other than those of time and position.

    Returns:
        The recordings: in the order of their time if that has a date or one clock, else as
        they are given.
    """
    found = [Path(path) for path in paths]
    if not found:
        raise LogFormatError("no log is named", "at least one file")
    if mapping.in_folder and (len(found) > 1 or not found[0].is_dir()):
        raise LogFormatError(
            f"{', '.join(map(str, found))} as the log",
            "the folder with the files that the mapping names",
        )
    names = mapping.recordings or [""]
    logs = [MappedLog(p, mapping, name, drivetrain, optional) for p in found for name in names]
    if mapping.time.column is not None and not mapping.in_runs:
        logs.sort(key=lambda log: log.begins)
    return logs


def import_log(
    paths: str | Path | Sequence[str | Path],
    mapping: LogMapping,
    out: str | Path,
    overwrite: bool = False,
    optional: bool = False,
    start_ns: int | None = None,
) -> ImportReport:
    """Turn a log into a bag.

    Args:
        paths: Tables of one log: CSV, plain or gzip, or Parquet. One folder, if the mapping
            names the files.
        optional: Whether files may lack columns other than those of time and position.
        start_ns: Added to every time; None: as the mapping says. [ns]

    Returns:
        What was written, and the account of every row.
    """
    files = [paths] if isinstance(paths, str | Path) else paths
    if mapping.joints.position is None:
        raise LogFormatError(
            "the mapping names no positions",
            "joints.position for a bag of joint states",
            "`robot-energy identify drives --log` takes this log as it is",
        )
    logs = open_logs(files, mapping, optional=optional)
    contents, effort = contents_of(logs, mapping), mapping.joints.effort
    names = ", ".join(log.name for log in logs)
    origin = f"{mapping.description}: {names}" if mapping.description else names
    accounts = [log.account for log in logs]
    clock = Clock(mapping.time)
    blocks = _in_turn(logs, clock, start_ns)
    report = write_bag(out, contents, blocks, accounts, overwrite, origin)
    report.notes += [*(note for log in logs for note in log.notes), *clock.notes]
    if start_ns is None and mapping.time.start is None and mapping.time.rate is None:
        report.notes += _early(report.start_ns or 0, mapping.time)
    if contents.effort and effort is not None:
        report.notes.append(
            f"the effort of /joint_states is the log's, in {effort.si_unit.replace('_', ' ')}"
        )
    for account in accounts:
        if account.received and account.rejected["not_newer"] == account.received:
            report.notes.append(
                f"no row of {account.path.name} is newer than those before it: if each file counts "
                "from its own zero, set time.each_file_is_a_run: true in the mapping"
            )
    return report


def contents_of(logs: Sequence[MappedLog], mapping: LogMapping) -> RecordingContents:
    """Return what the logs of one recording hold: all that at least one of them has."""

    def have(quantity: str) -> bool:
        return any(quantity in log for log in logs)

    power = mapping.power
    metered = power is not None and all(map(have, power.factors()))
    return RecordingContents(
        tuple(mapping.joints.names),
        have("velocity"),
        have("effort"),
        have("temperature"),
        MeterMeaning[power.meaning.upper()] if power and metered else MeterMeaning.UNKNOWN,
        MeterLocation[power.location.upper()] if power and metered else MeterLocation.UNKNOWN,
        power.interval if power and power.interval else float("nan"),
        have("drive_power") or all(map(have, ROTOR_FRAME)),
        mapping.payload.link if mapping.payload and have("payload") else "",
    )


def _in_turn(logs: Sequence[MappedLog], clock: Clock, start_ns: int | None) -> Iterator[LogBlock]:
    """Rows of all logs on one time, each newer than those before it."""
    last = None
    for log in logs:
        for block in log.blocks(clock, last, start_ns):
            last = int(block.stamp_ns[-1]) if len(block) else last
            yield block


def _early(begin_ns: int, time: Time) -> list[str]:
    """A remark on times that another unit would put into the years from 2000 on."""
    if begin_ns >= MIN_DATE * SECOND_NS or time.unit not in DIGITS:
        return []
    remedy = time_remedy(str(Decimal(begin_ns).scaleb(-DIGITS[time.unit])))
    day = local_time(begin_ns).date()
    return [f"the recording begins on {day}: {remedy}"] if remedy else []
