"""``EnergyRegisters`` -> readings, ``FrictionCondition`` -> learned friction of each joint."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.bag.cdr.decode import Decoder, RawBatch, Run, stamp_ns
from robot_energy.foundation.described import Described
from robot_energy.foundation.units import MINUTE_NS
from robot_energy.messages.fields import (
    ENERGY_REGISTERS,
    EXACT_FIELDS,
    EXACT_JOINT_FIELDS,
    FRAME,
    RECORDING,
    STAMP,
)
from robot_energy.timeline.stamps import MAX_STAMP_NS, valid_stamps

PHASES = ("hold", "motion", "generating")  # from PHASE_HOLD on
FROM_MESSAGE = (
    "observed_ns", "gap_ns", "compared_ns", *EXACT_FIELDS.values(), "measured_microjoule",
    "predicted_microjoule_at_meter", "standby_microjoule", "standby_ns",
)  # fmt: skip
OF_PHASES = tuple(f"{phase}_{unit}" for unit in ("microjoule", "ns") for phase in PHASES)
OF_JOINTS = ("rigid_microjoule", "friction_microjoule", "drive_loss_microjoule")
COLUMNS = (*FROM_MESSAGE, *OF_PHASES, *OF_JOINTS)
"""What a slot holds, as its table does: sums of all joints last. [ns], [uJ]"""
JOINT_COLUMNS = tuple(EXACT_JOINT_FIELDS.values())
"""What it holds of every joint. [uJ]"""
IMPORT = COLUMNS.index("predicted_import_microjoule")
OBSERVED, GAP = COLUMNS.index("observed_ns"), COLUMNS.index("gap_ns")
_STAMPS = ("header.stamp", "energy_start", "minute")
_FIELDS = (
    *(f"{stamp}.{part}" for stamp in _STAMPS for part in ("sec", "nanosec")),
    *(FRAME, "model_id", "meter_location", "phase_microjoule", "phase_ns", "joints.name"),
    *FROM_MESSAGE,
    *(f"joints.{name}" for name in JOINT_COLUMNS),
)


class Reading(Described):
    """The registers of one robot at an instant."""

    energy_start_ns: Annotated[int, "When they were last zero. [ns]"]
    stamp_ns: Annotated[int, "Of the last sample counted. [ns]"]
    minute_ns: Annotated[int, "UTC minute up to which all samples are counted; 0 for none. [ns]"]
    model_id: Annotated[str, "Of the model that counts."]
    meter_location: Annotated[int, "Where the meter sits."]
    values: Annotated[tuple[int, ...], "By `COLUMNS`. [ns], [uJ]"]
    joints: Annotated[dict[str, tuple[int, ...]], "By name and `JOINT_COLUMNS`. [uJ]"]

    @property
    def counted_ns(self) -> int:
        """Time that was counted, observed or not: never falls between two resets. [ns]"""
        return self.values[OBSERVED] + self.values[GAP]

    @property
    def known_until_ns(self) -> int:
        """Until when nothing but what was counted has happened. [ns]"""
        return max(self.minute_ns, self.stamp_ns)


class ReadingDecoder:
    """Decodes the messages of one robot; what is malformed is left out and counted.

    Attributes:
        malformed: Messages left out.
        recorded: Messages left out since they count a recording that is played.
        recording: Whether the newest message was one of these.
    """

    def __init__(self) -> None:
        self._decoder = Decoder(ENERGY_REGISTERS, _FIELDS)
        self.malformed = self.recorded = 0
        self.recording = False

    def decode(self, batch: RawBatch) -> list[Reading]:
        """Return the readings of a batch in order of arrival, without those in between.

        Within a minute the last is enough, as `supersedes` has it.
        """
        decoded = self._decoder.decode(batch)
        self.malformed += len(decoded.malformed)
        self.malformed += sum(int((~_usable(run)).sum()) for run in decoded.runs)
        rows = [
            (int(row), one, run.columns[FRAME] == RECORDING)
            for run in decoded.runs
            for row, one in _readings(run)
        ]
        rows.sort(key=lambda row: row[0])
        if rows:
            self.recording = rows[-1][2]
        kept = [one for _, one, recording in rows if not recording]
        self.recorded += len(rows) - len(kept)
        return kept


def _readings(run: Run) -> Iterator[tuple[int, Reading]]:
    times = [stamp_ns(run, path) for path in _STAMPS]
    kept = _kept(run, *times) & _usable(run)
    stamps, starts, minutes = (one[kept].tolist() for one in times)
    plain = [run.array(name)[kept].tolist() for name in FROM_MESSAGE]
    phases = [run.array(name)[kept, 1:].tolist() for name in ("phase_microjoule", "phase_ns")]
    names = run.names("joints.name")
    joints = [run.array(f"joints.{name}")[kept].tolist() for name in JOINT_COLUMNS]
    totals = [JOINT_COLUMNS.index(name) for name in OF_JOINTS]
    location, model = run.array("meter_location")[kept].tolist(), str(run.columns["model_id"])
    for number, row in enumerate(run.rows[kept].tolist()):
        values = [column[number] for column in plain]
        for phase in phases:
            values += phase[number]
        values += [sum(joints[place][number]) for place in totals]
        own = zip(*(column[number] for column in joints), strict=True)
        yield (
            row,
            Reading(
                energy_start_ns=starts[number],
                stamp_ns=stamps[number],
                minute_ns=minutes[number],
                model_id=model,
                meter_location=location[number],
                values=tuple(values),
                joints=dict(zip(names, own, strict=True)),
            ),
        )


def _usable(run: Run) -> NDArray[np.bool_]:
    """Which readings have stamps, and have not counted more time than there was since 1970."""
    usable = np.ones(len(run.rows), dtype=bool)
    for path in _STAMPS:
        usable &= valid_stamps(stamp_ns(run, path))
    for counted in (run.array(name) for name in ("observed_ns", "gap_ns")):
        usable &= (counted >= 0) & (counted <= MAX_STAMP_NS)
    return usable & (stamp_ns(run, _STAMPS[0]) > 0)


def _kept(
    run: Run, stamps: NDArray[np.int64], starts: NDArray[np.int64], minutes: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Which readings the next one does not supersede, where that came right after it."""
    kept = np.ones(len(stamps), dtype=bool)
    counted = run.array("observed_ns") + run.array("gap_ns")
    location, passed = run.array("meter_location"), np.diff(counted)
    kept[:-1] = (  # also the first, and those after a late one, which the one before decides on
        np.concatenate([[True], passed[:-1] < 0])[: len(passed)]
        | (minutes[:-1] != 0)
        | (np.diff(run.rows) != 1)
        | (np.diff(starts) != 0)
        | (location[1:] != location[:-1])
        | (passed < 0)
        | (np.diff(stamps) != passed)
        | (np.diff((stamps - 1) // MINUTE_NS) != 0)
    )
    return kept


CONDITION_TYPE = "ros2_energy_msgs/msg/FrictionCondition"
_OF_FRICTION = (*STAMP, "model_id", "joints.name", "joints.multiplier", "joints.valid")


class LearnedFriction(Described):
    """Friction of the joints of one robot over that of its model file, as learned by an instant."""

    stamp_ns: Annotated[int, "Newest sample learned from. [ns]"]
    model_id: Annotated[str, "Of the model that it is relative to."]
    ratios: Annotated[dict[str, float], "By joint, of those where it is valid. [-]"]


class FrictionDecoder:
    """Decodes what monitors have learned of one robot; what is malformed is left out."""

    def __init__(self) -> None:
        self._decoder = Decoder(CONDITION_TYPE, _OF_FRICTION)

    def decode(self, batch: RawBatch) -> list[LearnedFriction]:
        """Return what the messages of a batch say; those without a valid joint say nothing."""
        found: list[LearnedFriction] = []
        for run in self._decoder.decode(batch).runs:
            names, stamps = run.names("joints.name"), stamp_ns(run).tolist()
            ratios = run.array("joints.multiplier").tolist()
            valid = run.array("joints.valid").tolist()
            for stamp, own, known in zip(stamps, ratios, valid, strict=True):
                kept = {
                    name: ratio
                    for name, ratio, use in zip(names, own, known, strict=True)
                    if use and math.isfinite(ratio)
                }
                if kept and stamp > 0:
                    found.append(LearnedFriction(stamp, str(run.columns["model_id"]), kept))
        return found
