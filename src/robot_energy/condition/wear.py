"""Says which axis runs heavier or lighter than it did, since when, and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

from pydantic import PlainSerializer

from robot_energy.condition.baseline import Contrasts
from robot_energy.condition.drift import ROBOT, Drift, DriftTest, FrictionChange
from robot_energy.condition.joint_friction import MotionSums
from robot_energy.condition.record import (
    ConditionPart,
    ContrastEntry,
    Number,
    Numbers,
    Stamp,
    filled,
)
from robot_energy.condition.wear_records import (
    FEATURES,
    KnownProgram,
    MeterGatherer,
    MotionGatherer,
    ProgramTable,
    WearRecord,
)
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import StateFileError
from robot_energy.foundation.time_zone import local_time

WHOLE_ROBOT = ""  # name of what one power meter sees
MAX_SURE = 0.9999  # more is not claimed


class WearAlarm(Described):
    """A lasting change of friction."""

    joint: Annotated[str, "Its name; empty for the whole robot, as one power meter sees it."]
    drift: Drift

    @property
    def warns(self) -> bool:
        """Whether somebody should look at the robot: friction has risen."""
        return not self.drift.fell

    @property
    def sure(self) -> float:
        """Probability that the change is not chance, at most ``MAX_SURE``. [-]"""
        return min(self.drift.sure, MAX_SURE)

    @property
    def sentence(self) -> str:
        """What has happened, in one sentence."""
        drift, where = self.drift, self.joint or "the whole robot"
        since = local_time(drift.since_ns or 0)
        size = f"{100 * abs(drift.size):.1f} +- {100 * drift.std:.1f} %"
        level = "above" if drift.size > 0 else "below"
        what = "fell, as after re-greasing or running in," if drift.fell else "rose"
        return (
            f"friction of {where} {what} and is {size} {level} its first level, changing since "
            f"{since:%Y-%m-%d %H:%M} UTC (certainty {100 * self.sure:.4g} %)"
        )


REMEDY = "check the lubricant, the bearings, the brake and the belt of this axis"


class DriftRecord(ConditionPart):
    """What one `DriftTest` keeps."""

    records: tuple[Annotated[WearRecord, PlainSerializer(WearRecord._asdict)], ...]
    changes: tuple[FrictionChange, ...]
    contrasts: ContrastEntry
    programs: tuple[KnownProgram, ...] = ()


class WearState(ConditionPart):
    """What `WearMonitor` keeps; the last test is the whole robot's."""

    hours: Numbers
    meter_hours: Number
    means_degc: tuple[Number | None, ...]
    stamp_ns: Stamp | None
    tests: tuple[DriftRecord, ...]


class WearMonitor:
    """Watches the friction of every joint, or of the whole robot, for lasting changes."""

    def __init__(self, joint_names: Sequence[str]) -> None:
        self._names = tuple(joint_names)
        self._gatherer = MotionGatherer(len(self._names))
        self._meter = MeterGatherer()
        self.joints = [DriftTest() for _ in self._names]  # test of each joint, from measured torque
        self.robot = DriftTest(ROBOT)

    def step(self, part: MotionSums) -> None:
        """Take a part of measured torque."""
        for joint, record in self._gatherer.step(part).items():
            self.joints[joint].step(record)

    def step_meter(
        self, stamp_ns: int, duration: float, residual: float, friction: float, degc: float
    ) -> None:
        """Take a window of the power meter.

        Args:
            duration: [s]
            residual: Measured minus what the model file predicts. [J]
            friction: Friction energy of the model file that the meter sees. [J]
            degc: Mean motor temperature. [degC]
        """
        record = self._meter.step(stamp_ns, duration, residual, friction, degc)
        if record is not None:
            self.robot.step(record)

    @property
    def alarms(self) -> tuple[WearAlarm, ...]:
        """Every change that was found and lasts, joints in model order, the whole robot last."""
        tests = zip((*self._names, WHOLE_ROBOT), (*self.joints, self.robot), strict=True)
        return tuple(WearAlarm(name, test.drift) for name, test in tests if test.changes)

    def records(self) -> list[list[WearRecord]]:
        """Return what the tests of the joints hold, in model order, oldest record first.

        A last record may be shorter than the others: what has been gathered since.
        """
        last = self._gatherer.open_records()
        return [
            [*test.records, *([last[joint]] if joint in last else [])]
            for joint, test in enumerate(self.joints)
        ]

    def state(self) -> WearState:
        """Return what must be kept across a restart; the open records are not."""
        gatherer = self._gatherer
        return WearState(
            hours=tuple(gatherer.hours.tolist()),
            meter_hours=self._meter.hours,
            means_degc=tuple(
                None if value != value else value for value in gatherer.means.reshape(-1).tolist()
            ),
            stamp_ns=gatherer.stamp_ns,
            tests=tuple(
                DriftRecord(
                    records=tuple(test.records),
                    changes=tuple(test.changes),
                    contrasts=ContrastEntry.of(test.contrasts),
                    programs=tuple(test.programs.known),
                )
                for test in (*self.joints, self.robot)
            ),
        )

    def restore(self, record: WearState) -> None:
        """Continue from a record."""
        if len(record.tests) != len(self.joints) + 1:
            raise StateFileError(
                f"learned figures of {len(record.tests) - 1} joints", f"{len(self.joints)}"
            )
        sizes = {len(one.features) for entry in record.tests for one in entry.records}
        if sizes - {FEATURES}:
            raise StateFileError(f"records of wear with {max(sizes)} features", f"{FEATURES}")
        gatherer = self._gatherer
        means = tuple(float("nan") if value is None else value for value in record.means_degc)
        gatherer.hours = filled(record.hours, gatherer.hours)
        gatherer.means = filled(means, gatherer.means)
        gatherer.stamp_ns = record.stamp_ns
        self._meter.hours = record.meter_hours
        for test, entry in zip((*self.joints, self.robot), record.tests, strict=True):
            test.restore(
                list(entry.records),
                list(entry.changes),
                Contrasts.restored(entry.contrasts),
                ProgramTable([replace(one) for one in entry.programs]),
            )
