"""Job intervals of a recording: named by a file, counted by the account as live ones are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, field_validator, model_validator

from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.plain_text import MAX_NAME, require_plain_text
from robot_energy.accounting.record import EnergyInterval
from robot_energy.foundation.config_file import load
from robot_energy.foundation.errors import RegisterError
from robot_energy.foundation.time_zone import local_time
from robot_energy.foundation.units import SECOND_NS
from robot_energy.model.figure import ModelEntry
from robot_energy.timeline.blocks import Int

MAX_JOBS = 20_000
STEP_NS = 20_000_000  # of the pipeline while jobs may begin or end [ns]
LAG_NS = 400_000_000  # of the account behind the newest joint state, at most [ns]
MAX_LATE_NS = 100_000_000  # after its begin that a job is opened; the account states where [ns]

Seconds = Annotated[float, Field(ge=0.0, le=2.0**31, allow_inf_nan=False)]


class Job(ModelEntry):
    """One job or cycle."""

    name: Annotated[str, Field(min_length=1, max_length=MAX_NAME)]
    begin: Annotated[Seconds, "Stamp of its first instant. [s since 1970]"]
    end: Annotated[Seconds, "Stamp of its last instant. [s since 1970]"]

    @field_validator("name")
    @classmethod
    def _can_be_kept(cls, name: str) -> str:
        return require_plain_text("a job name", name, MAX_NAME, RegisterError)

    @model_validator(mode="after")
    def _lasts(self) -> Job:
        if not self.end > self.begin:
            raise ValueError("expected an end after the begin")
        return self


class JobList(ModelEntry):
    """The jobs of one or several recordings."""

    jobs: Annotated[
        Annotated[tuple[Job, ...], Field(max_length=MAX_JOBS)],
        "One after the other; each begins when or after the one before has ended.",
    ]

    @model_validator(mode="after")
    def _in_order(self) -> JobList:
        for before, after in zip(self.jobs, self.jobs[1:], strict=False):
            if after.begin < before.end:
                raise ValueError(
                    f"'{after.name}' at {after.begin:.3f} s begins in the job before it"
                )
        return self


def load_jobs(path: str | Path) -> tuple[Job, ...]:
    return load(path, JobList, RegisterError, "list of jobs").jobs


class RecordedJobs:
    """Opens and closes intervals of an account at the stamps of a list of jobs.

    A job that the recording does not hold from begin to end is left out.
    """

    def __init__(self, jobs: Sequence[Job]) -> None:
        self.closed: list[EnergyInterval] = []
        self.left_out = 0
        self._bounds_ns = np.array(
            [[round(one.begin * SECOND_NS), round(one.end * SECOND_NS)] for one in jobs], np.int64
        ).reshape(-1, 2)
        self._names = [one.name for one in jobs]
        self._next = 0
        self._is_open = False

    def notes(self, start_ns: int | None) -> list[str]:
        """Return what a reader of the jobs should know, one sentence each."""
        if self.left_out:
            return [
                "jobs that are not in the recording from beginning to end, left out: "
                f"{self.left_out}"
            ]
        if not self._names or self.closed or start_ns is None:
            return []
        return [
            f"none of the jobs ({len(self._names)}) lies in the recording, which "
            f"begins {_utc(start_ns)}; the first job begins {_utc(int(self._bounds_ns[0, 0]))}: "
            "are clock and time zone right?"
        ]

    def cuts(self, stamp_ns: Int) -> Int:
        """Return where to cut samples, so that steps are short while a job begins or ends.

        Args:
            stamp_ns: Of the samples, shape (N,). [ns]
        """
        if not self._names:
            return np.zeros(0, dtype=np.int64)
        cuts = np.flatnonzero(np.diff(stamp_ns // STEP_NS)) + 1
        bounds_ns = np.unique(self._bounds_ns)
        before = np.searchsorted(bounds_ns, stamp_ns[cuts], side="right") - 1
        since_ns = stamp_ns[cuts] - bounds_ns[before]
        return cuts[(before >= 0) & (since_ns < LAG_NS)]

    def step(self, account: EnergyAccount) -> None:
        """Open and close what is due."""
        end_ns = account.end_ns
        while end_ns is not None and self._next < len(self._names):
            begin_ns, until_ns = self._bounds_ns[self._next].tolist()
            if self._is_open:
                if end_ns < until_ns:
                    return
                self.closed.append(account.close_interval(self._names[self._next]))
                self._is_open = False
                self._next += 1
            elif end_ns < begin_ns:
                return
            elif end_ns - begin_ns > MAX_LATE_NS:  # it began before the recording, or in a gap
                self._next += 1
                self.left_out += until_ns > (account.registers.time.start_ns or 0)
            else:
                account.open_interval(self._names[self._next])
                self._is_open = True

    def finish(self, account: EnergyAccount) -> None:
        if self._is_open:
            late_ns = int(self._bounds_ns[self._next, 1]) - (account.end_ns or 0)
            found = account.close_interval(self._names[self._next])
            if late_ns <= MAX_LATE_NS:
                self.closed.append(found)
            else:
                self.left_out += 1
            self._is_open = False


def _utc(stamp_ns: int) -> str:
    return f"{local_time(stamp_ns):%Y-%m-%d %H:%M:%S} UTC"
