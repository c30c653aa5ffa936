"""Readings that lie inside one state of auxiliary loads, of their own meters or of the outlet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np

from robot_energy.accounting.load_curve import UNKNOWN
from robot_energy.bag import BagReader
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.inputs.auxiliary import LoadTopics
from robot_energy.inputs.bag_topics import find_auxiliary
from robot_energy.inputs.sources import Inputs
from robot_energy.model.auxiliary import AuxiliaryLoad
from robot_energy.replay.replay_steps import LoadIngest
from robot_energy.timeline.blocks import Float, Int, MeterBlock
from robot_energy.timeline.pieces import NO_PIECES, CoveredPieces
from robot_energy_identify.cabinet.phase_readings import (
    BEFORE_MOTION,
    SETTLED,
    holding,
    readings_inside,
)
from robot_energy_identify.data.recordings import Recording

AFTER_CHANGE = 500_000_000  # ns after a state has changed, until its power counts


class StateChanges(Described):
    """When a load changed its state."""

    stamp_ns: Annotated[Int, "Since when, rising, shape (K,). [ns]"]
    state: Annotated[Int, "Number since then, shape (K,); `UNKNOWN` before the first message."]

    @classmethod
    def of(cls, load: AuxiliaryLoad, block: MeterBlock | None) -> StateChanges:
        """Return the changes of a load.

        Args:
            block: Numbers of its states as powers, in order of arrival; None for none.
        """
        stamp = np.array([np.iinfo(np.int64).min])
        state = np.array([0 if len(load.states) == 1 else UNKNOWN])
        if block is not None and len(load.states) > 1:
            order = np.argsort(block.stamp_ns, kind="stable")
            number = block.power[order]
            fits = (number == np.floor(number)) & (number >= 0) & (number < len(load.states))
            stamp = np.concatenate([stamp, block.stamp_ns[order]])
            state = np.concatenate([state, np.where(fits, number, UNKNOWN).astype(np.int64)])
        news = np.append(True, np.diff(state) != 0)
        return cls(stamp[news], state[news])

    def inside(self, pieces: CoveredPieces) -> Int:
        """Return which change each piece lies behind, -1 where its state is not one alone."""
        first = np.searchsorted(self.stamp_ns, pieces.stamp_ns - AFTER_CHANGE, side="right") - 1
        last = np.searchsorted(self.stamp_ns, pieces.end_ns, side="left") - 1
        return np.where((first == last) & (self.state[first] != UNKNOWN), first, -1)


class StateReadings(Described):
    """Readings of one recording, each inside one state of every load."""

    power: Annotated[Float, "Shape (N,). [W]"]
    duration: Annotated[Float, "Shape (N,). [s]"]
    state: Annotated[Int, "Number of the state of each load, shape (N, loads)."]
    visit: Annotated[Int, "Number of the uninterrupted stretch of states, rising, shape (N,)."]
    shown: Annotated[Float, "What the meter showed, which its gain concerns, shape (N,). [W]"]

    def __len__(self) -> int:
        return len(self.power)

    def __getitem__(self, rows: slice | Int) -> StateReadings:
        return StateReadings(*(each[rows] for each in self.__dict__.values()))

    @classmethod
    def joined(cls, parts: Sequence[StateReadings]) -> StateReadings:
        """Return the readings of recordings as of one, every visit with a number of its own."""
        starts = np.cumsum([0, *(int(part.visit.max(initial=0)) + 1 for part in parts)])
        moved = [replace(p, visit=p.visit + add) for p, add in zip(parts, starts, strict=False)]
        return cls(*map(np.concatenate, zip(*(p.__dict__.values() for p in moved), strict=True)))

    @property
    def first(self) -> list[int]:
        """The least number of a state of each load."""
        return self.state.min(axis=0).tolist()


LoadRecording = Mapping[str, tuple[CoveredPieces, StateChanges]]
"""What a bag holds of the loads, by their names: curve of the meter, none without; changes."""


def read_loads(
    path: str | Path, loads: Sequence[AuxiliaryLoad], inputs: Inputs | None
) -> LoadRecording:
    """Return the curves of the meters of loads and the changes of their states, by their names.

    Args:
        inputs: Inputs of the node that the bag is to be read like; None: the usual topics.
    """
    bag = BagReader(path)
    topics, _ = find_auxiliary(bag, loads, inputs)
    readers = {name: LoadIngest(each, bag.typestore) for name, each in topics.items()}
    blocks: dict[tuple[str, int], list[MeterBlock]] = {}
    wanted = sorted({topic for each in topics.values() for topic in each.topics})
    for part in (*(bag.parts(wanted) if wanted else ()), None):
        for name, reader in readers.items():
            read = reader.flush() if part is None else reader.step(part)
            for place, block in enumerate(read):
                if block is not None:
                    blocks.setdefault((name, place), []).append(block)
    whole = {key: MeterBlock.concatenate(found) for key, found in blocks.items()}
    gap = 2.0 if inputs is None else inputs.meter_max_gap
    return {
        load.name: (
            _pieces(topics[load.name], whole.get((load.name, 0)), gap),
            StateChanges.of(load, whole.get((load.name, 1))),
        )
        for load in loads
    }


def own_readings(recording: LoadRecording, load: AuxiliaryLoad) -> StateReadings:
    """Return the readings of a load's own meter that lie inside one state."""
    pieces, changes = recording[load.name]
    row = changes.inside(pieces)
    used = np.flatnonzero(row >= 0)
    kept = pieces[used]
    power = kept.mean_power
    return StateReadings(power, kept.duration, changes.state[row[used]][:, None], row[used], power)


def outlet_readings(
    recording: Recording, loads: Sequence[AuxiliaryLoad], held: LoadRecording
) -> StateReadings:
    """Return what a meter of the outlet shows on top of the cabinet while the robot stands still.

    Loads with a meter of their own are taken off by it.
    """
    if recording.meter is None:
        raise NotIdentifiableError(
            f"{recording.path.name} has no power meter", "a meter of the outlet"
        )
    pieces = readings_inside(recording, holding(recording), SETTLED, BEFORE_MOTION)
    power, shown = pieces.mean_power, pieces.mean_power
    stamp, middle = recording.power.stamp_ns, (pieces.stamp_ns + pieces.end_ns) // 2
    row = np.clip(np.searchsorted(stamp, middle), 0, len(stamp) - 1)
    power = power - recording.power.grid_power[row]
    known = np.isfinite(power)
    rows: list[Int] = []
    states: list[Int] = []
    for load in loads:
        curve, changes = held[load.name]
        if load.metered:
            own, inside = curve.index(pieces.stamp_ns, pieces.end_ns)
            known &= inside
            if len(curve):
                power = power - curve.value(own, middle)
            continue
        change = changes.inside(pieces)
        known &= change >= 0
        rows.append(change)
        states.append(changes.state[change])
    if not rows:
        raise NotIdentifiableError(
            "every auxiliary load has a meter of its own", "a load without one"
        )
    used = np.flatnonzero(known)
    where = np.stack(rows, axis=1)[used]
    apart = (np.diff(where, axis=0) != 0).any(axis=1) if len(used) > 1 else np.empty(0, bool)
    visit = np.concatenate([[0], np.cumsum(apart)])[: len(used)]
    return StateReadings(
        power[used], pieces.duration[used], np.stack(states, axis=1)[used], visit, shown[used]
    )


def _pieces(topics: LoadTopics, block: MeterBlock | None, max_gap: float) -> CoveredPieces:
    """The longest stretch of a meter's curve whose stamps do not go back."""
    if block is None:
        return NO_PIECES
    limits = topics.limits
    limits = type(limits)(max_gap, limits.max_power, limits.wraps_at)
    return max(limits.pieces(block), key=len)
