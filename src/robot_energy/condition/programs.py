"""The programs of a robot, as far as the friction of one joint can distinguish them.

Two programs load a gear in other poses. So at equal features their friction differs, and a payload
that the model does not have leaves another part of its torque in the mean of the directions. Each
program but the first therefore has coefficients of its own in the baseline: a level, and slopes of
load, difference of the directions and scatter. A program is recognised by how long every joint
moves at each speed, which neither load nor temperature changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_energy.condition.record import STRICT, Number, Numbers
from robot_energy.condition.wear_records import DIGITS, LOADS, WearRecord

SAME_PROGRAM = 0.05  # by how much the times of one program may differ [-]
OWN = 1 + LOADS.stop - LOADS.start  # coefficients of a program: level and slopes
MAX_PROGRAMS = 20  # with coefficients of their own; the one not seen for longest is forgotten


@dataclass
class KnownProgram:
    """A program that was seen.

    Attributes:
        work: That of its first record. [-]
        loads: Load, difference and scatter of its first record; its level is at these. [-]
        hours: Hours of motion when it was last seen. [h]
    """

    __pydantic_config__ = STRICT  # it is kept as it is

    work: Numbers
    loads: Numbers
    hours: Number


class ProgramTable:
    """Finds to which program a record belongs.

    Args:
        known: Seen before, in the order of their coefficients; the first has none.
    """

    def __init__(self, known: Sequence[KnownProgram] = ()) -> None:
        self.known = list(known)
        self._new: tuple[float, ...] = ()

    def step(self, record: WearRecord) -> tuple[WearRecord | None, int | None]:
        """Take a record.

        Args:
            record: Newer than all before, of any program.

        Returns:
            The record with what its own coefficients are multiplied by; None if it is of no
            program, as when the program changed meanwhile. And which program had to be forgotten
            for it; None if none.
        """
        if not record.work:
            return record, None
        forgotten: int | None = None
        number = _nearest(record.work, [one.work for one in self.known])
        before, self._new = self._new, ()
        if number is None and self.known and _nearest(record.work, [before]) is None:
            self._new = record.work
            return None, None  # of a new program once the next record agrees
        if number is None:
            new = KnownProgram(record.work, record.features[LOADS], record.hours)
            if len(self.known) <= MAX_PROGRAMS:
                number = len(self.known)
                self.known.append(new)
            else:
                hours = [one.hours for one in self.known[1:]]
                number = forgotten = 1 + int(np.argmin(hours))
                self.known[number] = new
        known = self.known[number]
        known.hours = record.hours
        if number == 0:
            return record._replace(program=(), work=()), None
        before = (0.0,) * (OWN * (number - 1))
        off = np.subtract(record.features[LOADS], known.loads)
        own = (1.0, *(round(value, DIGITS) for value in off.tolist()))
        return record._replace(program=before + own, work=()), forgotten


def _nearest(work: tuple[float, ...], known: Sequence[tuple[float, ...]]) -> int | None:
    """The one that hardly differs."""
    apart = [float(np.abs(np.subtract(one, work)).max()) for one in known if one]
    number = int(np.argmin(apart)) if apart else None
    return None if number is None or apart[number] > SAME_PROGRAM else number


def columns(number: int) -> slice:
    """Return where the coefficients of a program, from 1, stand among those of all programs."""
    return slice(OWN * (number - 1), OWN * number)
