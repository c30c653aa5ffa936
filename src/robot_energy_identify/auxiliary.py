"""Powers of the states of auxiliary loads, and the readings of a meter that show each of them.

A power is taken from readings that lie inside one state: of the load's own meter, or of the meter
of the outlet while the robot stands still (paper B, figure 1).
"""

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
from robot_energy.model import RobotModel
from robot_energy.model.auxiliary import AuxiliaryLoad
from robot_energy.model.figure import PositiveFigure
from robot_energy.replay.replay_steps import LoadIngest
from robot_energy.results.base import Result, Texts
from robot_energy.timeline.blocks import Float, Int, MeterBlock, Rows
from robot_energy.timeline.pieces import NO_PIECES, CoveredPieces
from robot_energy_identify.bounds import identified
from robot_energy_identify.cabinet.phase_readings import (
    BEFORE_MOTION,
    SETTLED,
    holding,
    readings_inside,
)
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.stats.regression import Fit, regress
from robot_energy_identify.stats.systematic import METER, total, with_systematic

AFTER_CHANGE = 500_000_000  # ns after a state has changed, until its power counts


class StateChanges(Described):
    """When a load changed its state."""

    stamp_ns: Annotated[Int, "Since when, rising, shape (K,). [ns]"]
    state: Annotated[Int, "Number since then, shape (K,); `UNKNOWN` before the first message."]

    @classmethod
    def of(cls, load: AuxiliaryLoad, block: MeterBlock | None) -> StateChanges:
        """Return the changes of a load from numbers of its states, as powers in order."""
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


class StateReadings(Rows):
    """Readings of one recording, each inside one state of every load."""

    power: Annotated[Float, "Shape (N,). [W]"]
    duration: Annotated[Float, "Shape (N,). [s]"]
    state: Annotated[Int, "Number of the state of each load, shape (N, loads)."]
    visit: Annotated[Int, "Number of the uninterrupted stretch of states, rising, shape (N,)."]
    shown: Annotated[Float, "What the meter showed, which its gain concerns, shape (N,). [W]"]

    @staticmethod
    def joined(parts: Sequence[StateReadings]) -> StateReadings:
        """Return the readings of recordings as of one, every visit with a number of its own."""
        starts = np.cumsum([0, *(int(part.visit.max(initial=0)) + 1 for part in parts)])
        moved = zip(parts, starts, strict=False)
        return StateReadings.concatenate(
            [replace(part, visit=part.visit + add) for part, add in moved]
        )

    @property
    def first(self) -> list[int]:
        """The least number of a state of each load."""
        return self.state.min(axis=0).tolist()


LoadRecording = Mapping[str, tuple[CoveredPieces, StateChanges]]
"""What a bag holds of the loads, by their names: curve of the meter, none without; changes."""


def read_loads(
    path: str | Path, loads: Sequence[AuxiliaryLoad], inputs: Inputs | None
) -> LoadRecording:
    """Return the curves of the meters of loads and the changes of their states, by their names."""
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
    kept, row = pieces[row >= 0], row[row >= 0]
    power = kept.mean_power
    return StateReadings(power, kept.duration, changes.state[row][:, None], row, power)


def outlet_readings(
    recording: Recording, loads: Sequence[AuxiliaryLoad], held: LoadRecording
) -> StateReadings:
    """Return what an outlet shows on top of cabinet and metered loads while the robot stands."""
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


MIN_READINGS = 5  # of a state
CHUNKS = 8  # that the readings of a state are cut into where it was in force fewer times
TRAIN_SHARE = 0.6  # of the only recording; the rest is the test
OWN, OUTLET = "own meter", "meter of the outlet"
Tried = tuple[Float, Float, Float, Float]  # measured, new and before [W], time [s], shape (N,)


class StateFit(Described):
    """Power of one state."""

    load: Annotated[str, "Name of the load."]
    state: Annotated[str, "Of the state."]
    power: Annotated[float, "[W]"]
    std: Annotated[float | None, "None where one reading says nothing of its scatter. [W]"]
    parts: Annotated[dict[str, float], "Deviations by cause. [W]"]
    readings: Annotated[int, "Behind it."]
    visits: Annotated[int, "How often the state was in force."]
    time: Annotated[float, "Of these readings. [s]"]
    before: Annotated[float, "Power in the given model. [W]"]


class HeldOutStates(Described):
    """What the fit has not seen, by the new figures and by those of the given model."""

    what: Annotated[str, "What that was: ``recordings`` or ``end of the recording``."]
    readings: Annotated[int, "How many."]
    energy: Annotated[float, "Measured. [J]"]
    energy_error: Annotated[float, "Predicted minus measured, over measured. [-]"]
    energy_error_before: Annotated[float, "The same with the given model. [-]"]
    rms: Annotated[float, "Error of the power. [W]"]
    rms_before: Annotated[float, "The same with the given model. [W]"]


class LoadsFit(Described):
    """States of one load with a meter, or of all loads behind the meter of the outlet."""

    loads: Annotated[tuple[str, ...], "Their names."]
    source: Annotated[str, "`OWN` or `OUTLET`."]
    states: Annotated[tuple[StateFit, ...], "Those with enough readings."]
    held_out: Annotated[HeldOutStates | None, "None where too little was left to try it."]
    used: Annotated[bool, "Whether the model takes it: held-out readings are predicted better."]
    notes: Annotated[tuple[str, ...], "What the readings do not determine, one sentence each."]


class LoadStatesReport(Result, name="auxiliary"):
    """Powers of the states of auxiliary loads."""

    fits: Annotated[
        tuple[LoadsFit, ...],
        "One for each load with a meter, one for all behind that of the outlet.",
    ]
    refused: Annotated[Texts, "Why others could not be identified, one sentence each."]


def fit_own(load: AuxiliaryLoad, parts: Sequence[StateReadings], gain: float) -> LoadsFit:
    """Return powers of the states of a load from its own meter, and how they do held out.

    The power of a state is its energy over its time.

    Args:
        gain: Standard deviation of the gain of the meter. [-]
    """
    states, notes = _states(load, StateReadings.joined(parts), gain)
    if not states:
        raise NotIdentifiableError(
            f"no state of {load.name} has {MIN_READINGS} readings of its meter",
            "readings that lie inside one state, half a second after its change",
            "record its meter and its state, in every state for some seconds",
        )
    before = {name: figure.value for name, figure in load.states.items()}
    tried: list[Tried] = []
    for train, test in _folds(parts):
        found, _ = _states(load, StateReadings.joined(train), gain)
        powers = before | {one.state: one.power for one in found}
        new, old = (np.array([*each.values()])[test.state[:, 0]] for each in (powers, before))
        tried.append((test.power, new, old, test.duration))
    held = _held_out(tried, len(parts))
    return LoadsFit((load.name,), OWN, states, held, _taken(held, [load]), notes)


def fit_outlet(
    loads: Sequence[AuxiliaryLoad], parts: Sequence[StateReadings], gain: float
) -> LoadsFit:
    """Return powers of states from a meter of the outlet, gain as in `fit_own`.

    The loads have no meter of their own. What cabinet and loads draw at rest is unknown but
    constant in a recording, so only differences between states show, held out as well: the first
    state of each load keeps the power of the model.
    """
    fit, columns = _regressed(loads, parts, gain)
    states: list[StateFit] = []
    whole = StateReadings.joined(parts)
    for place, (load, number) in enumerate(columns, len(parts)):
        entry, own = loads[load], whole[np.flatnonzero(whole.state[:, load] == number)]
        power = _figures(entry)[whole.first[load]] + float(fit.values[place])
        states.append(_state_fit(entry, number, power, fit.parts_of(place), own))
    notes = tuple(
        f"a meter of the outlet shows differences alone: {load.name} "
        f"{load.state_names[first]} keeps the power of the model"
        for load, first in zip(loads, whole.first, strict=True)
    )
    held = _outlet_held_out(loads, parts, gain)
    names, taken = tuple(load.name for load in loads), _taken(held, loads)
    return LoadsFit(names, OUTLET, tuple(states), held, taken, notes)


def with_states(model: RobotModel, fits: Sequence[LoadsFit], source: str) -> RobotModel:
    found: dict[str, dict[str, PositiveFigure]] = {}
    for one in (state for fit in fits if fit.used for state in fit.states):
        found.setdefault(one.load, {})[one.state] = identified(one.power, one.std, source)
    loads = [
        load.model_copy(update={"states": {**load.states, **found.get(load.name, {})}})
        for load in model.auxiliary or ()
    ]
    return model.changed(auxiliary=tuple(loads))


def _taken(held: HeldOutStates | None, loads: Sequence[AuxiliaryLoad]) -> bool:
    """Whether new figures replace the given ones: better, untried, or instead of mere guesses."""
    return (
        held is None
        or held.rms < held.rms_before
        or any(all(each.tag == "assumed" for each in load.states.values()) for load in loads)
    )


def _states(
    load: AuxiliaryLoad, whole: StateReadings, gain: float
) -> tuple[tuple[StateFit, ...], tuple[str, ...]]:
    found: list[StateFit] = []
    missing: list[str] = []
    for number, name in enumerate(load.state_names):
        own = whole[np.flatnonzero(whole.state[:, 0] == number)]
        if len(own) < MIN_READINGS:
            missing.append(name)
            continue
        root = np.sqrt(own.duration)
        target, columns = own.power * root, root[:, None]
        fit = regress(columns, target, _chunks(own.visit), (name,), "ols", load.name)
        parts_of = with_systematic(fit, columns, {METER: [gain * target]}).parts_of(0)
        found.append(_state_fit(load, number, float(fit.values[0]), parts_of, own))
    if not missing:
        return tuple(found), ()
    return tuple(found), (
        f"{load.name} keeps its power in {', '.join(missing)}: fewer than {MIN_READINGS} "
        "readings lie inside",
    )


def _state_fit(
    load: AuxiliaryLoad, number: int, power: float, deviations: dict[str, float], own: StateReadings
) -> StateFit:
    std = total(deviations)
    return StateFit(
        load.name,
        load.state_names[number],
        power,
        std if np.isfinite(std) else None,
        deviations,
        len(own),
        len(np.unique(own.visit)),
        float(own.duration.sum()),
        _figures(load)[number],
    )


def _figures(load: AuxiliaryLoad) -> list[float]:
    return [figure.value for figure in load.states.values()]


def _regressed(
    loads: Sequence[AuxiliaryLoad], parts: Sequence[StateReadings], gain: float
) -> tuple[Fit, list[tuple[int, int]]]:
    """Fit of a constant for each recording, then of each state but the first of each load."""
    whole = StateReadings.joined(parts)
    run = np.concatenate([np.full(len(part), place) for place, part in enumerate(parts)])
    names = [f"recording {place + 1}" for place in range(len(parts))]
    columns = [(run == place).astype(float) for place in range(len(parts))]
    wanted: list[tuple[int, int]] = []
    for place, load in enumerate(loads):
        state = whole.state[:, place]
        for number in np.unique(state)[1:].tolist():
            wanted.append((place, number))
            names.append(f"{load.name} {load.state_names[number]}")
            columns.append((state == number).astype(float))
    if not wanted or len(whole) < MIN_READINGS + len(names):
        raise NotIdentifiableError(
            f"{len(whole)} readings of the outlet lie inside rest, in "
            f"{len(wanted) + len(loads)} states of {', '.join(load.name for load in loads)}",
            "loads that change their states while the robot stands still",
            "let the robot stand with active drives and switch each load on its own, several times",
        )
    matrix = np.stack(columns, axis=1)
    fit = regress(matrix, whole.power, whole.visit, names, "irls", "the readings of the outlet")
    return with_systematic(fit, matrix, {METER: [gain * whole.shown]}), wanted


def _outlet_held_out(
    loads: Sequence[AuxiliaryLoad], parts: Sequence[StateReadings], gain: float
) -> HeldOutStates | None:
    """Held-out differences from the mean, since the constant of a recording is not predicted."""
    tried: list[Tried] = []
    for train, test in _folds(parts):
        try:
            fit, columns = _regressed(loads, train, gain)
        except NotIdentifiableError:
            return None
        new, before = np.zeros((2, len(test)))
        first = StateReadings.joined(train).first
        for place, (load, number) in enumerate(columns, len(train)):
            rows = test.state[:, load] == number
            figures = _figures(loads[load])
            new[rows] += fit.values[place]
            before[rows] += figures[number] - figures[first[load]]
        rest, new, before = (
            each - np.average(each, weights=test.duration) for each in (test.power, new, before)
        )
        tried.append((rest, new, before, test.duration))
    return _held_out(tried, len(parts))


def _folds(parts: Sequence[StateReadings]) -> list[tuple[list[StateReadings], StateReadings]]:
    """What to fit from and what to predict: each recording from the others, or the end of one."""
    if len(parts) > 1:
        return [([*parts[:place], *parts[place + 1 :]], part) for place, part in enumerate(parts)]
    cut = int(TRAIN_SHARE * len(parts[0]))
    return [([parts[0][slice(0, cut)]], parts[0][slice(cut, None)])]


def _held_out(tried: Sequence[Tried], recordings: int) -> HeldOutStates | None:
    if not sum(len(time) for *_, time in tried):
        return None
    measured, new, before, time = (np.concatenate(each) for each in zip(*tried, strict=True))
    energy = float(measured @ time)

    def rms(predicted: Float) -> float:
        return float(np.sqrt(np.average((predicted - measured) ** 2, weights=time)))

    def error(predicted: Float) -> float:
        # Differences from their mean have no energy to refer to.
        sound = abs(energy) > 1e-6 * float(np.abs(measured) @ time)
        return float((predicted - measured) @ time) / energy if sound else float("nan")

    what = "recordings" if recordings > 1 else "end of the recording"
    return HeldOutStates(what, len(time), energy, error(new), error(before), rms(new), rms(before))


def _chunks(visit: Int) -> Int:
    """Blocks of readings: the visits, cut further where they are few."""
    numbers = np.unique(visit)
    if len(numbers) >= CHUNKS:
        return visit
    per_visit = -(-CHUNKS // len(numbers))
    chunk = np.empty_like(visit)
    start = 0
    for number in numbers:
        rows = np.flatnonzero(visit == number)
        for part in np.array_split(rows, min(per_visit, len(rows))):
            chunk[part] = start
            start += 1
    return chunk
