"""Power of each state of an auxiliary load, with its interval, and tried on held-out readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.auxiliary import AuxiliaryLoad
from robot_energy.timeline.blocks import Float, Int
from robot_energy_identify.auxiliary.readings import StateReadings
from robot_energy_identify.bounds import identified
from robot_energy_identify.stats.regression import Fit, regress
from robot_energy_identify.stats.systematic import METER, total, with_systematic

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
    std: Annotated[
        float | None,
        "Its standard deviation; None where one reading says nothing of its scatter. [W]",
    ]
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
    states: Annotated[
        tuple[StateFit, ...], "What was found; states without enough readings are left out."
    ]
    held_out: Annotated[HeldOutStates | None, "None where too little was left to try it."]
    used: Annotated[bool, "Whether the model takes it: held-out readings are predicted better."]
    notes: Annotated[tuple[str, ...], "What the readings do not determine, one sentence each."] = (
        field(default=())
    )


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
    before = np.array([figure.value for figure in load.states.values()])
    powers = before.copy()
    tried: list[Tried] = []
    for train, test in _folds(parts):
        found, _ = _states(load, StateReadings.joined(train), gain)
        powers[:] = before
        for one in found:
            powers[load.state_names.index(one.state)] = one.power
        number = test.state[:, 0]
        tried.append((test.power, powers[number], before[number], test.duration))
    held = _held_out(tried, len(parts))
    return LoadsFit((load.name,), OWN, states, held, _taken(held, [load]), notes)


def fit_outlet(
    loads: Sequence[AuxiliaryLoad], parts: Sequence[StateReadings], gain: float
) -> LoadsFit:
    """Identify states from a meter of the outlet, while the robot stands still.

    What cabinet and loads draw at rest is unknown but constant in a recording, so only
    differences between states show: the first state of each load keeps the power of the model.

    Args:
        loads: Those without a meter of their own, in the order of the columns of the states.
        gain: Standard deviation of the gain of the meter. [-]

    Returns:
        Powers of all states but the first of each load, and how their differences do on what
        the fit has not seen.
    """
    fit, columns = _regressed(loads, parts, gain)
    states: list[StateFit] = []
    whole = StateReadings.joined(parts)
    for place, (load, number) in enumerate(columns, len(parts)):
        entry, rows = loads[load], np.flatnonzero(whole.state[:, load] == number)
        first = list(entry.states.values())[whole.first[load]].value
        power = first + float(fit.values[place])
        states.append(_state_fit(entry, number, power, fit.parts_of(place), whole[rows]))
    notes = tuple(
        f"a meter of the outlet shows differences alone: {load.name} "
        f"{load.state_names[first]} keeps the power of the model"
        for load, first in zip(loads, whole.first, strict=True)
    )
    held = _outlet_held_out(loads, parts, gain)
    names, taken = tuple(load.name for load in loads), _taken(held, loads)
    return LoadsFit(names, OUTLET, tuple(states), held, taken, notes)


def with_states(model: RobotModel, fits: Sequence[LoadsFit], source: str) -> RobotModel:
    """Return a model with the identified powers that are used."""
    found = {(s.load, s.state): s for fit in fits if fit.used for s in fit.states}
    loads: list[AuxiliaryLoad] = []
    for load in model.auxiliary or ():
        states = {
            name: old
            if (one := found.get((load.name, name))) is None
            else identified(one.power, one.std, source)
            for name, old in load.states.items()
        }
        loads.append(load.model_copy(update={"states": states}))
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
        list(load.states.values())[number].value,
    )


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
            figures = list(loads[load].states.values())
            new[rows] += fit.values[place]
            before[rows] += figures[number].value - figures[first[load]].value
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
