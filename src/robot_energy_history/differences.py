"""The rules of the history: readings of one robot -> what was counted from when to when.

Each difference of two readings is one span. A span that lies within a slot is added to it; one that
does not is kept with its true beginning and end, and no energy is spread over it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import timedelta
from typing import Annotated

from robot_energy.foundation.described import Described
from robot_energy.foundation.units import MINUTE_NS, SECOND_NS
from robot_energy.timeline.stamps import MAX_STAMP_NS
from robot_energy_history.readings import COLUMNS, GAP, JOINT_COLUMNS, OBSERVED, Reading

SLOT_NS = 15 * MINUTE_NS
BEHIND_NS = MINUTE_NS  # registers that stay behind what was recorded for longer have gone back [ns]
MAX_POWER = 10**9  # mean between two readings, meters that count in MWh included [W]
UNRESOLVED = 1  # flags of a span: it is not a slot; its beginning and end are its own
CLOCK = 2  # stamps were set meanwhile
EARLIER = 4  # counted before this robot was recorded at all
REPAIRED = 8  # put in by a repair, so that sums are those of the registers
FLAGS = {UNRESOLVED: "not resolved", CLOCK: "clock set", EARLIER: "before recording",
         REPAIRED: "repaired"}  # fmt: skip


class Epoch(Described):
    """Registers that one model has counted since they were zero, with one place of the meter."""

    first: Annotated[Reading, "Reading that it begins from."]
    last: Annotated[Reading, "Newest reading that was recorded."]
    known_until_ns: Annotated[int, "Until when it is known what was counted. [ns]"]
    newest_ns: Annotated[int, "Latest stamp recorded, also where clocks were set back. [ns]"]


class CountedSpan(Described):
    """What was counted between two readings."""

    begin_ns: Annotated[int, "When it began. [ns]"]
    end_ns: Annotated[int, "When it ended. [ns]"]
    values: Annotated[tuple[int, ...], "By `COLUMNS`. [ns], [uJ]"]
    joints: Annotated[dict[str, tuple[int, ...]], "By name and `JOINT_COLUMNS`. [uJ]"]
    flags: Annotated[int, "What is to be known of it."] = 0

    def slot(self, length_ns: int) -> tuple[int, int, int]:
        """Return begin, end and flags of the slot that it is added to.

        Time in which nothing was observed carries no energy: it belongs to the slot of its end.
        """
        start = (self.end_ns - 1) // length_ns * length_ns
        if start <= self.begin_ns or not self.values[OBSERVED]:
            return start, start + length_ns, self.flags
        return self.begin_ns, self.end_ns, self.flags | UNRESOLVED


class Event(Described):
    """Something that happened to the registers of a robot."""

    stamp_ns: Annotated[int, "When. [ns]"]
    kind: Annotated[str, "What."]
    text: Annotated[str, "In words."]


class EpochStep(Described):
    """What one reading gives."""

    epoch: Annotated[Epoch, "As it stands now."]
    new: Annotated[bool, "Whether it is another one than before."] = False
    span: Annotated[CountedSpan | None, "What was counted; None for nothing."] = None
    events: Annotated[tuple[Event, ...], "What happened."] = ()


def refuse_nonsense(span: CountedSpan) -> None:
    """Refuse times and energies that no robot has, as of a register with a flipped bit.

    Raises:
        OverflowError: If a mean power is over `MAX_POWER`, or the time longer than stamps reach.
    """
    time = span.values[OBSERVED] + span.values[GAP] + SECOND_NS
    limit = MAX_POWER * time // 1000  # W ns = 1e-3 uJ
    energies = [value for own in span.joints.values() for value in own]
    energies += [v for name, v in zip(COLUMNS, span.values, strict=True) if name[-3:] != "_ns"]
    if time > MAX_STAMP_NS or any(abs(value) > limit for value in energies):
        raise OverflowError(f"over {limit} uJ in {time} ns")


def zero_of(reading: Reading) -> Reading:
    """Return registers as they were when they were zero."""
    return replace(
        reading,
        stamp_ns=reading.energy_start_ns,
        minute_ns=0,
        values=(0,) * len(COLUMNS),
        joints=dict.fromkeys(reading.joints, (0,) * len(JOINT_COLUMNS)),
    )


def begun(reading: Reading, known: bool) -> EpochStep:
    """Return the beginning of registers that are new here; those of a known robot were reset."""
    zero = zero_of(reading)
    begin = max(0, reading.stamp_ns - reading.counted_ns)
    flags = 0 if known else EARLIER
    until = reading.stamp_ns
    span = CountedSpan(min(begin, until), until, reading.values, reading.joints, flags)
    text = "set to zero" if known else f"recorded from here on, with model {reading.model_id}"
    event = Event(reading.energy_start_ns, "reset" if known else "first", text)
    epoch = Epoch(zero, reading, reading.known_until_ns, reading.stamp_ns)
    return EpochStep(epoch, new=True, span=span, events=(event,))


def gone_back(reading: Reading) -> EpochStep:
    """Return a new beginning where registers have lost what was recorded: none counts twice."""
    text = "the registers fell below the recorded values, as from an older state file"
    event = Event(reading.stamp_ns, "went_back", text)
    epoch = Epoch(reading, reading, reading.known_until_ns, reading.stamp_ns)
    return EpochStep(epoch, new=True, events=(event,))


def is_behind(epoch: Epoch, reading: Reading) -> bool:
    """Whether a reading holds less than was recorded, although it is newer than all that was."""
    return (
        reading.counted_ns < epoch.last.counted_ns
        and reading.stamp_ns >= epoch.newest_ns + BEHIND_NS
    )


def step(epoch: Epoch, reading: Reading) -> EpochStep | None:
    """Return what a reading adds to an epoch of the same registers; None if nothing.

    Only what was counted orders readings, never stamps: a reading with no more counted time is
    late or doubled.
    """
    last = epoch.last
    if not reading.meter_location:  # not read yet, as after a restart
        reading = replace(reading, meter_location=last.meter_location)
    counted = reading.counted_ns - last.counted_ns
    if counted < 0 or (counted == 0 and reading.values == last.values):
        if counted == 0 and reading.minute_ns > epoch.known_until_ns:
            return EpochStep(replace(epoch, known_until_ns=reading.minute_ns))
        return None
    begin, events, flags = epoch.known_until_ns, list[Event](), 0
    set_by = reading.stamp_ns - counted - last.stamp_ns
    if set_by:
        begin, flags = max(0, reading.stamp_ns - counted), CLOCK
        text = f"stamps were set by {set_by / 1e9:+.3f} s"
        events.append(Event(reading.stamp_ns, "clock", text))
    none = (0,) * len(JOINT_COLUMNS)
    span = CountedSpan(
        min(begin, reading.stamp_ns),
        reading.stamp_ns,
        _less(reading.values, last.values),
        {name: _less(own, last.joints.get(name, none)) for name, own in reading.joints.items()},
        flags,
    )
    new = False
    for kind, before, now in (
        ("model", last.model_id, reading.model_id),
        ("meter", last.meter_location, reading.meter_location),
    ):
        if before != now and not (kind == "meter" and not before):
            new = True
            events.append(Event(reading.stamp_ns, kind, f"{before} -> {now}"))
    if tuple(last.joints) != tuple(reading.joints):
        new = True
    if span.slot(SLOT_NS)[2] & UNRESOLVED:
        length = timedelta(seconds=round((span.end_ns - span.begin_ns) / SECOND_NS))
        text = f"not recorded for {length}; one span holds the energy of that time"
        events.append(Event(reading.stamp_ns, "not_resolved", text))
    first = last if new else epoch.first
    newest = max(epoch.newest_ns, reading.stamp_ns)
    return EpochStep(
        Epoch(first, reading, reading.known_until_ns, newest), new, span, tuple(events)
    )


def supersedes(reading: Reading, before: Reading) -> bool:
    """Whether a reading can take the place of the one before: same minute, same registers."""
    return (
        not before.minute_ns
        and reading.energy_start_ns == before.energy_start_ns
        and reading.model_id == before.model_id
        and reading.meter_location == before.meter_location
        and before.counted_ns <= reading.counted_ns
        and (reading.stamp_ns - 1) // MINUTE_NS == (before.stamp_ns - 1) // MINUTE_NS
        and reading.stamp_ns - before.stamp_ns == reading.counted_ns - before.counted_ns
    )


def finished(waiting: Sequence[Reading], now_ns: int) -> int:
    """Return how many readings are recorded now: a last one within a minute waits for its end."""
    if not waiting or waiting[-1].minute_ns or now_ns - waiting[-1].stamp_ns > 2 * MINUTE_NS:
        return len(waiting)
    return len(waiting) - 1


def thinned(waiting: list[Reading]) -> list[Reading]:
    """Return readings without every other of the older half, but for ends of registers."""
    half = len(waiting) // 2
    return [
        one
        for place, one in enumerate(waiting)
        if place >= half
        or place % 2 == 0
        or waiting[place + 1].energy_start_ns != one.energy_start_ns
    ]


def _less(values: tuple[int, ...], before: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(a - b for a, b in zip(values, before, strict=True))
