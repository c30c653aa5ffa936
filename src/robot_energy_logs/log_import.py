"""Files of a log -> the recordings in it, and a bag."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.errors import LogFormatError
from robot_energy.foundation.time_zone import local_time
from robot_energy.foundation.units import SECOND_NS
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.electrical_power import electrical_power
from robot_energy.timeline.blocks import Float, Int, MeterLocation, MeterMeaning
from robot_energy.timeline.stamps import MIN_DATE
from robot_energy_logs.columns import (
    FACTORS,
    PLACEHOLDER,
    ROTOR_FRAME,
    SPELLINGS,
    ZEROS,
    Columns,
    PositionColumn,
    Velocity,
)
from robot_energy_logs.instants import time_remedy
from robot_energy_logs.mapping import DIGITS, PLACE, LogMapping
from robot_energy_logs.recording import (
    BODY,
    FileAccount,
    ImportReport,
    LogBlock,
    RecordingContents,
    nothing_used,
    write_bag,
)
from robot_energy_logs.rows import Clock, side_by_side, usable_rows
from robot_energy_logs.table import LogTable, TableRows
from robot_energy_logs.text_table import TextForm


class MappedLog:
    """One recording of a log: a table, or several side by side.

    Args:
        optional: Whether the file may lack columns other than those of time and position.
    """

    def __init__(
        self,
        path: Path,
        mapping: LogMapping,
        recording: str = "",
        drivetrain: Drivetrain | None = None,
        optional: bool = False,
    ) -> None:
        self._mapping, self._drivetrain = mapping, drivetrain
        self._optional = optional
        folder = path if mapping.in_folder else path.parent
        joint_keys = mapping.joints.keys or mapping.joints.names
        first = (mapping.joints.first.file or "").replace(PLACEHOLDER, joint_keys[0])
        main = folder / first.replace(PLACE, recording) if first else path
        self.name = recording or main.name
        self.account = FileAccount(path=main)
        self.tables: dict[Path, LogTable] = {}
        self._columns: dict[Path, list[tuple[str, str]]] = {}  # quantity and name of each
        for key, group in mapping.joints.quantities():
            file = folder / group.file.replace(PLACE, recording) if group.file else main
            owner = mapping if file == main and group.column_names is None else group
            for keys in [[one] for one in joint_keys] if group.files_of_joints else [joint_keys]:
                own = file.with_name(file.name.replace(PLACEHOLDER, keys[0]))
                self._add(key, own, owner.column_names, group, keys)
        for key, (column, _) in (mapping.power.factors() if mapping.power else {}).items():
            if not optional or column in self.tables[main].columns:
                self._take(f"power.{key}", main, [column])
        if mapping.payload is not None:
            body = [mapping.payload.mass, *mapping.payload.centre_of_mass]
            for part in (body, mapping.payload.inertia or []):
                if not optional or set(part) <= set(self.tables[main].columns):
                    self._take("payload.payload", main, part)
        self._texts = [
            self.tables[main].require(column, f"time.{key}")
            for key in ("column", "run")
            if (column := getattr(mapping.time, key)) is not None
        ]

    def _add(
        self,
        key: str,
        file: Path,
        names: Sequence[str] | None,
        group: Columns[Any],
        joint_keys: list[str],
    ) -> None:
        if file not in self.tables:
            form = self._mapping.model_dump(include={*TextForm.__annotations__})
            self.tables[file] = LogTable(file, names, **form)
        table = self.tables[file]
        columns = group.names(joint_keys)
        if columns is None:
            columns = list(table.columns[: len(joint_keys)])
            if len(columns) < len(joint_keys):
                raise LogFormatError(
                    f"{file} has {len(columns)} columns", f"one per joint: {len(joint_keys)}"
                )
        required = not self._optional or self._mapping.joints.first is group
        if required or set(columns) <= set(table.columns):
            self._take(f"joints.{key}", file, columns)
            _check_units(f"joints.{key}", table, columns, group.unit)

    def _take(self, owner: str, file: Path, columns: Sequence[str]) -> None:
        taken = self._columns.setdefault(file, [])
        for column in columns:
            taken.append((owner.partition(".")[2], self.tables[file].require(column, owner)))

    def __contains__(self, quantity: str) -> bool:
        """Whether the files have a quantity, such as ``velocity`` or ``reading``."""
        return any(quantity == key for taken in self._columns.values() for key, _ in taken)

    @property
    def begins(self) -> float:
        """Time of the first row that has one, infinite where none has. [ns]"""
        rows = next(self.main.rows((), self._texts[:1]), None)
        if rows is None:
            return np.inf
        instants, known, _ = Clock(self._mapping.time).instants(rows)
        return float(instants[known][0]) if known.any() else np.inf

    @property
    def main(self) -> LogTable:
        """The table with the time and the positions, or velocities without positions."""
        return next(iter(self.tables.values()))

    def blocks(
        self,
        clock: Clock | None = None,
        last_ns: int | None = None,
        start_ns: int | None = None,
        kept: bool = False,
    ) -> Iterator[LogBlock]:
        """Yield the usable rows, and account for the others.

        Args:
            clock: Of all files of the log; None: of this one alone.
            last_ns: Stamp of the last row before these; None if there is none. [ns]
            start_ns: Added to every time; None: as the mapping says. [ns]
            kept: Whether all rows will be kept in memory, so that their number is bounded.

        Yields:
            Rows in SI units, joint side, in the order of the files.
        """
        time = self._mapping.time
        clock = Clock(time) if clock is None else clock
        start = time.start_ns if start_ns is None else start_ns
        last = None if last_ns is None else last_ns - start
        clock.begin_table(self.account.path.name)
        required = np.asarray(self._keys == next(self._mapping.joints.quantities())[0])
        streams: list[Iterator[TableRows]] = []
        for file, table in self.tables.items():
            names, texts = [name for _, name in self._columns[file]], () if streams else self._texts
            streams.append(table.rows(names, texts, kept or len(self.tables) > 1))
        for rows in side_by_side(list(self.tables.values()), streams):
            instants, known, run = clock.instants(rows)
            used, last = usable_rows(rows, instants, known, required, last, self.account, start)
            yield self._block(instants[used] + start, rows.values[used], run[used])

    @property
    def _keys(self) -> NDArray[np.str_]:
        """Quantity of every column that is read, in their order."""
        return np.array([key for taken in self._columns.values() for key, _ in taken])

    @property
    def notes(self) -> list[str]:
        """What was found about the files, one sentence each."""
        return [note for table in self.tables.values() for note in table.notes]

    def whole(self, clock: Clock | None = None) -> LogBlock:
        """Return all usable rows at once, in SI units.

        Args:
            clock: Of all files of the log; None: of this one alone.
        """
        blocks = [block for block in self.blocks(clock, kept=True) if len(block)]
        if not blocks:
            raise LogFormatError(*nothing_used([self.account]))
        return LogBlock.concatenate(blocks)

    def _block(self, stamp_ns: Int, values: Float, run: Int) -> LogBlock:
        keys = self._keys
        joints, power = self._mapping.joints, self._mapping.power
        groups = dict(joints.quantities())

        def quantity(key: str) -> Float:
            """Values of one quantity of all joints, as logged but in SI; NaN without any."""
            if key not in self:
                return np.full((len(values), len(joints.names)), np.nan)
            unit: str = groups[key].unit
            return values[:, keys == key] * FACTORS[unit] + ZEROS.get(unit, 0.0)

        def joint_side(key: str, group: PositionColumn | Velocity | None) -> Float:
            """Positions or velocities; both follow the same map from the motors."""
            found = quantity(key)
            if group is None:
                return found
            if group.side == "motor":
                gears = self._drivetrain or self._mapping.drivetrain()
                found = gears.joint_velocity_from_motor(found)
            return group.correction.apply(found)

        effort = quantity("effort")
        if joints.effort is not None:
            effort = effort * np.asarray(joints.effort.torque_constant or 1.0)
            effort = joints.effort.correction.apply(effort)
        reading = np.full(len(values), np.nan)
        if power is not None and all(key in self for key in power.factors()):
            reading = np.full(len(values), power.factor)
            for key, (_, factor) in power.factors().items():
                reading = reading * (values[:, keys == key][:, 0] * factor)
        drive_power = quantity("drive_power")
        if joints.current_q is not None:
            current_d, current_q, voltage_d, voltage_q = map(quantity, ROTOR_FRAME)
            drive_power = electrical_power(
                current_d, current_q, voltage_d, voltage_q, joints.dq_scaling
            )
        body = values[:, keys == "payload"]
        without = len(BODY) - body.shape[1]  # of a point mass
        payload = np.hstack([body, np.zeros((len(body), without))]) if body.shape[1] else None
        return LogBlock(
            stamp_ns,
            joint_side("position", joints.position),
            joint_side("velocity", joints.velocity),
            effort,
            quantity("temperature"),
            reading,
            drive_power,
            payload,
            run,
        )


def _check_units(owner: str, table: LogTable, columns: Sequence[str], unit: str) -> None:
    """Refuse a unit that contradicts the one that the file itself says of a column."""
    for column in columns:
        said = table.units.get(column, "")
        known = SPELLINGS.get(said.lower())
        if known is not None and known != {"celsius": "degc"}.get(unit, unit):
            raise LogFormatError(
                f"{table.path} says that '{column}' is in '{said}', and the mapping {unit}",
                f"{owner}.unit: {known}",
                "correct the mapping",
            )


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
    begin_ns, time = report.start_ns or 0, mapping.time
    counted = start_ns is None and time.start is None and time.rate is None
    if counted and begin_ns < MIN_DATE * SECOND_NS and time.unit in DIGITS:
        # another unit might put it into the years from 2000 on
        if remedy := time_remedy(str(Decimal(begin_ns).scaleb(-DIGITS[time.unit]))):
            report.notes.append(f"the recording begins on {local_time(begin_ns).date()}: {remedy}")
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
