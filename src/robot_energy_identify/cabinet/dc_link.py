"""Energy that the DC link stores, from a power meter at the grid.

While the drives feed back, the link takes ``1/2 C (U_on^2 - U_rect^2)`` before the chopper
burns the rest; afterwards it feeds the drives, and the grid gives nothing until it is empty.
A meter at the grid sees how much energy it gives back, not capacity or voltages. That energy
is found by least squares: the model's own cabinet (`cabinet.CabinetStage`) runs with one
energy after the other, each with the constant of the DC side that fits best, so that the two
cannot stand in for each other. The constant itself is not changed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from robot_energy.certainty.deviation import Z95
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.figure import PositiveFigure
from robot_energy.model.schema import Cabinet, Capacitor
from robot_energy.physics.drives_and_cabinet import CabinetStage
from robot_energy.timeline.blocks import NANOSECOND, Float, Int, MeterLocation
from robot_energy_identify.cabinet.link_readings import (
    MIN_FLOW,
    LinkReadings,
    best_energy,
    energy_errors,
    readings_of,
    tried,
    with_energy,
)
from robot_energy_identify.data.recordings import Recording, spread, with_meter
from robot_energy_identify.drives.all_drives import DrivesReport
from robot_energy_identify.drives.drive_data import held_energy
from robot_energy_identify.stats.cross_validation import (
    EnergyScore,
    Kind,
    energy_score,
    jackknife_std,
    recordings_or_blocks,
)
from robot_energy_identify.stats.regression import SCATTER, student
from robot_energy_identify.stats.systematic import total

NOMINAL_VOLTAGE = 566.0  # V: peak of 3 x 400 V mains, taken where no model file says other
CHOPPER_VOLTAGE = 700.0  # V: the same
MIN_EVENTS = 5  # times that the link must have been full
SETTLED = 1.0  # W of the constant between two rounds
ROUNDS = 4
MAX_HALF_WIDTH = 0.5  # of the energy: half width of a 95 % interval that still counts as determined
Voltages = tuple[float, float]


class LinkFit(Described):
    """Energy between the rectified voltage and that of the chopper.

    A chopper with hysteresis leaves the link between two voltages; the energy is then what
    the link holds on the average when braking ends.
    """

    energy: Annotated[float, "[J]"]
    std: Annotated[float, "Of the scatter between blocks and of constant errors together. [J]"]
    interval: Annotated[tuple[float, float], "Of 95 %. [J]"]
    loss_dc_shift: Annotated[
        float, "By which the constant of the DC side would change if it were free. [W]"
    ]
    loss_dc_shift_std: Annotated[float, "[W]"]
    events: Annotated[int, "How often the link was full."]
    readings: Annotated[int, "Of the meter."]
    spacing: Annotated[float, "Median time that a reading stands for. [s]"]
    emptying: Annotated[float, "Median time for which the link holds energy. [s]"]
    held_out: Annotated[Kind, "``recordings`` or ``blocks``."]
    given: Annotated[
        EnergyScore, "The model as given on what was held out; constants as the model has them."
    ]
    identified: Annotated[EnergyScore, "With the energy from the other folds."]
    parts: Annotated[dict[str, float], "Of the standard deviation, by cause. [J]"] = field(
        default_factory=dict[str, float]
    )

    @property
    def reason(self) -> str:
        """Why it is not taken; empty if held-out readings are predicted better with it."""
        given, new = self.given, self.identified
        if new.beats(given):
            return ""
        return (
            f"a DC link of {self.energy:.3g} J predicts held-out readings of the meter no better "
            f"(energy {100 * new.energy_error:.1f} % off and {new.rms:.3g} W RMS; as given "
            f"{100 * given.energy_error:.1f} % and {given.rms:.3g} W), so it stays as given; "
            "losses of the drives that the model lacks can hide it"
        )


def fit_link(
    recordings: Sequence[Recording],
    cabinet: Cabinet | None = None,
    drives: DrivesReport | None = None,
) -> LinkFit:
    """Return the energy with its interval, and what it is worth on held-out readings.

    Args:
        cabinet: To begin with; None for that of the model.
        drives: Found in these recordings, for the deviation; None if they are given.

    Raises:
        NotIdentifiableError: If there is no meter at the grid, the supply feeds back to the
            grid, the robot hardly brakes, or the meter averages for too long.
    """
    metered = spread(with_meter(recordings))
    cabinet = cabinet or recordings[0].model.cabinet
    if any(part.meter and part.meter.location is not MeterLocation.GRID for part in metered):
        raise NotIdentifiableError(
            "a meter that is not at the grid does not see what the DC link gives back",
            "a meter at the grid",
        )
    if cabinet.regeneration_efficiency is not None:
        raise NotIdentifiableError(
            "the supply feeds braking energy back to the grid, so the DC link hardly stores any",
            "a rectifier with a brake resistor",
        )
    top = max(  # the most energy that was fed back and not yet drawn again
        float(
            held_energy(
                power.bus_power + cabinet.loss_dc.value, power.stamp_ns, power.segment
            ).max()
        )
        for power in (part.power for part in metered)
    )
    if top <= MIN_FLOW:
        raise NotIdentifiableError(
            "the drives never feed back more than the DC side uses",
            "braking that fills the DC link",
            "record fast motions that stop hard, ten times or more",
        )
    given = 0.0 if cabinet.capacitor is None else cabinet.capacitor.swing
    base = cabinet.loss_dc.value
    energies, data = np.empty(0), None
    for _ in range(ROUNDS):
        energies, data = tried(metered, cabinet, base, top)
        shift = best_energy(energies, data.squares().sum(axis=0))[1]
        base += shift
        if abs(shift) < SETTLED:
            break
    assert data is not None
    squares = data.squares()
    energy, shift = best_energy(energies, squares.sum(axis=0))
    scatter, shift_std = _deviations(energies, squares)
    best = with_energy(cabinet, base, energy)
    parts = {SCATTER: scatter, **energy_errors(metered, best, energies, data, drives)}
    std = total(parts)
    half = Z95 * std
    spacing = float(np.median(data.duration))
    events, emptying = _use_of(metered, best)
    braking = _braking_time(metered, cabinet.loss_dc.value)
    _require_determined(energy, half, events, top, spacing, braking)
    kind, fold = recordings_or_blocks(data.recording, data.block)
    scores = _scores(metered, cabinet, given, energies, squares, data, fold)
    return LinkFit(
        energy,
        std,
        (max(energy - half, 0.0), energy + half),
        base + shift - cabinet.loss_dc.value,
        shift_std,
        events,
        len(data.measured),
        spacing,
        emptying,
        kind,
        *scores,
        parts,
    )


def with_link(
    model: RobotModel,
    fit: LinkFit,
    source: str,
    voltages: Voltages | None = None,
) -> tuple[RobotModel, str]:
    """Return a model whose DC link stores the energy, and what its voltages are, one sentence.

    Args:
        model: Any model of the same robot.
        source: Where the data come from.
        voltages: Rectified and of the chopper, where the user says them; else those of the
            model's capacitor, else those of 3 x 400 V mains, assumed. [V]
    """
    before = model.cabinet.capacitor
    if voltages is not None:
        low, high = (
            PositiveFigure(value=value, tag="published", source="as the user says")
            for value in voltages
        )
        origin = "as given"
    elif before is not None:
        low, high, origin = before.nominal_voltage, before.chopper_voltage, "as in the model file"
    else:
        text = "usual for 3 x 400 V; only the energy between the voltages is identified"
        low, high = (
            PositiveFigure(value=value, tag="assumed", source=text)
            for value in (NOMINAL_VOLTAGE, CHOPPER_VOLTAGE)
        )
        origin = "assumed, usual for 3 x 400 V"
    half = 0.5 * (high.value**2 - low.value**2)
    capacitor = Capacitor(
        capacitance=PositiveFigure(
            value=fit.energy / half,
            tag="identified",
            std=fit.std / half,
            source=f"{fit.energy:.4g} +- {fit.std:.2g} J between the two voltages: {source}",
        ),
        nominal_voltage=low,
        chopper_voltage=high,
    )
    cabinet = model.cabinet.model_copy(update={"capacitor": capacitor})
    return model.changed(cabinet=cabinet), (
        f"the energy of the DC link is identified; its {1e3 * fit.energy / half:.3g} mF follow "
        f"from {low.value:g} and {high.value:g} V, {origin}"
    )


def _deviations(energies: Float, squares: Float) -> tuple[float, float]:
    """Deviations of energy and shift that the scatter between blocks makes (jackknife)."""
    blocks = len(squares)
    if blocks < 2:
        return np.inf, np.inf
    whole = squares.sum(axis=0)
    left_out = np.asarray([best_energy(energies, whole - part) for part in squares])
    std, shift_std = (jackknife_std(left_out) * student(blocks - 1.0)).tolist()
    return std, shift_std


def _require_determined(
    energy: float, half: float, events: int, top: float, spacing: float, braking: float
) -> None:
    """Refuse an energy that the readings do not determine."""
    known = half <= MAX_HALF_WIDTH * energy
    found = f"the energy of the DC link is known only as {energy:.3g} +- {half:.2g} J"
    if not known and spacing > braking:
        raise NotIdentifiableError(
            f"{found}: a reading stands for {spacing:.2g} s, and the robot brakes for "
            f"{braking:.2g} s",
            f"a reading every {braking:.1g} s or faster, or a longer recording with varied motion",
        )
    if events < MIN_EVENTS:
        raise NotIdentifiableError(
            f"the drives feed back {top:.3g} J at once at most, and the DC link of least error "
            f"({energy:.3g} J) was full {events} times",
            f"braking that fills it, at least {MIN_EVENTS} times",
            "record fast motions with load that stop hard, with rest or motion in between",
        )
    if not known:
        raise NotIdentifiableError(
            found,
            f"a 95 % interval within {100 * MAX_HALF_WIDTH:.0f} % of it",
            "record longer, with more fast motions that stop hard, and identify the drives first",
        )


def _scores(
    metered: Sequence[Recording],
    cabinet: Cabinet,
    given: float,
    energies: Float,
    squares: Float,
    data: LinkReadings,
    fold: Int,
) -> tuple[EnergyScore, EnergyScore]:
    """Predict every fold as the model runs, with the energy given and that of the others."""
    names = np.unique(fold).tolist()
    own = [np.unique(data.block[fold == name]) for name in names]
    whole = squares.sum(axis=0)
    found = [best_energy(energies, whole - squares[part].sum(axis=0))[0] for part in own]
    loss = cabinet.loss_dc.value
    run = readings_of(metered, [with_energy(cabinet, loss, value) for value in (given, *found)])
    place = np.searchsorted(names, fold)

    def score(column: Callable[[int], int]) -> EnergyScore:
        predicted = np.choose(place, [run.predicted[:, column(k)] for k in range(len(names))])
        return energy_score(predicted, run.measured, run.duration, fold, run.duration)

    return score(lambda _: 0), score(lambda k: k + 1)


def _braking_time(metered: Sequence[Recording], loss_dc: float) -> float:
    """Median time for which the drives feed back more than the DC side uses. [s]"""
    times = [
        (part.power.stamp_ns[last - 1] - part.power.stamp_ns[first]) * NANOSECOND
        for part in metered
        for first, last in _runs(part.power.bus_power + loss_dc < 0.0)
    ]
    return float(np.median([time for time in times if time > 0.0] or [0.0]))


def _use_of(metered: Sequence[Recording], cabinet: Cabinet) -> tuple[int, float]:
    """How often a link was full, and the median time for which it holds energy. [s]"""
    events, times = 0, [0.0]
    for part in metered:
        power = part.power
        stamp, segment = power.stamp_ns, power.segment
        flows = CabinetStage(cabinet).step(stamp, segment, power.bus_power)
        step = np.diff(stamp, prepend=stamp[:1]) * NANOSECOND
        stored = np.cumsum(np.nan_to_num(flows.capacitor_power) * step)
        first = np.flatnonzero(np.diff(segment, prepend=segment[0] - 1))  # empty there
        stored -= np.repeat(stored[first], np.diff(np.append(first, len(stored))))
        holds = _runs(stored > MIN_FLOW)
        full = np.concatenate([[0], np.cumsum(flows.brake_power > MIN_FLOW)])
        events += sum(bool(full[last] > full[first]) for first, last in holds)
        times += [(stamp[last - 1] - stamp[first]) * NANOSECOND for first, last in holds]
    return events, float(np.median(times[1:] or times))


def _runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2)]
