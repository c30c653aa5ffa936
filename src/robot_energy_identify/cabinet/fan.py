"""A fan of the cabinet, by the step in the power at rest when a robot warms up.

The power r of rests, less that of the drives, at times t around the begin t_0 of one of them is

    r = a + b (t - t_0) + P (t >= t_0) + sum_i k_i (1 + alpha (T_i - 20)) tau_i^2

with the torques tau that motors hold and their temperatures T, so it matters little what the model
knows of the drives. What warms up with the robot has a slope and no step. P and its
deviation follow for every rest. The fan starts at the rest where P has the greatest ratio to its
deviation. Its temperature is what the warmest motor had reached by then. A step down contradicts a
fan while motors warm up. While they cool the fan itself stops, so these rests do not count. Where
no recording has the step, levels of recordings with the fan and without it may show it
(`robot_energy_identify.cabinet.levels`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from robot_energy.certainty.deviation import MEDIAN_TO_STD
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.figure import Figure, PositiveFigure
from robot_energy.model.schema import CabinetFan
from robot_energy.physics.drives_and_cabinet import FanStage, warmest_degc
from robot_energy.timeline.blocks import NANOSECOND, Float, MeterLocation
from robot_energy_identify.bounds import identified
from robot_energy_identify.cabinet.levels import level_step, levels_of
from robot_energy_identify.cabinet.phase_readings import at_rest, holding, parted, row_of
from robot_energy_identify.cabinet.thermometers import Thermometers, thermometers_of
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.drives.drive_data import COOL, shaft_torque, winding_torque
from robot_energy_identify.drives.losses import TERMS, loss_columns
from robot_energy_identify.drives.total_power import BY_LEVELS
from robot_energy_identify.stats.regression import estimate

SURE = 5.0  # deviations of a step; without a fan the greatest of a warm-up are below 4
BY_LEVELS_SURE, LIKELY = 4.0, 3.0  # of levels: of a fan, and of constants that are less sure
UNKNOWNS = 3  # of levels: constant, slope and step, which more recordings test
MOST, LEAST = 48, 12  # rests on each side of a step
AROUND = 6  # rests to each side, between which it may lie
FALL = 1.0  # K below its highest temperature, beyond which the warmest motor cools
HYSTERESIS, HYSTERESIS_STD = 5.0, 2.0  # K; a warm-up does not show when the fan stops
TOLERANCE = 2.0  # deviations of that temperature, within which another recording shows the step
FED = 4.0  # deviations below the rests before and after, beyond which the DC link feeds a rest
NOT_YET = 1.4  # deviations below its start, at which one fan of ten has started
RANK = 1e-6  # of columns that the others explain
EXACT = 1e-6  # W: no step is known better
WARM_UP = "a warm-up with pauses of a second, with motor temperatures and a meter at the grid"
UNTIL_IT_RUNS = "let the warm-up go on until the fan of the cabinet runs"
ROOT12 = 12.0**0.5


class FanFit(Described):
    """A fan that starts while a robot warms up."""

    power: Annotated[float, "While it runs. [W]"]
    std: Annotated[float, "[W]"]
    on_above_degc: Annotated[float, "Temperature of the warmest motor at which it starts. [degC]"]
    on_std: Annotated[float, "[K]"]
    recordings: Annotated[int, "Number of recordings in which it starts, or runs."]
    rests: Annotated[
        int, "Number of rests around its starts; 0 where levels of recordings show it."
    ]
    thermometers: Annotated[
        tuple[float, ...] | None,
        "What the thermometer of each motor shows above the mean of all; None where begins of "
        "recordings do not show it. [K]",
    ] = None

    def entry(self, source: str) -> CabinetFan:
        """Return it for a model file.

        Args:
            source: Where the data come from.
        """
        source = source if self.rests else BY_LEVELS + source
        on = Figure(value=self.on_above_degc, tag="identified", std=self.on_std, source=source)
        stops = PositiveFigure(value=HYSTERESIS, tag="assumed", std=HYSTERESIS_STD)
        power = identified(self.power, self.std, source)
        return CabinetFan(
            power=power, on_above_degc=on, hysteresis=stops, thermometers=self.thermometers
        )


class FanFound(NamedTuple):
    """What recordings say of a fan.

    Attributes:
        fan: None where none is sure.
        reason: Why none is; empty otherwise.
        likely: Power of a fan that levels of recordings show, but not surely; 0 otherwise. [W]
    """

    fan: FanFit | None
    reason: str = ""
    likely: float = 0.0


def with_fan(
    model: RobotModel, recordings: Sequence[Recording], source: str
) -> tuple[RobotModel, FanFound]:
    """Return a model with the fan that recordings show, and what they say of it.

    Args:
        model: Any model of the same robot; without a step it keeps what it has.
        source: Where the data come from.
    """
    try:
        found = FanFound(find_fan(recordings))
    except NotIdentifiableError as error:
        found = FanFound(None, str(error))
        usable = [part for part in recordings if _usable(part)]
        if usable and model.cabinet.fan is None:
            found = _by_levels(usable) or found
    if found.fan is None:
        return model, found
    cabinet = model.cabinet.model_copy(update={"fan": found.fan.entry(source)})
    return model.changed(cabinet=cabinet), found


def _by_levels(recordings: Sequence[Recording]) -> FanFound | None:
    """A fan that levels of recordings show, sure or likely."""
    known = thermometers_of(recordings)
    errors = None if known is None else known.error
    try:
        levels = levels_of(recordings, errors)
    except NotIdentifiableError:
        return None
    step = level_step(levels)
    if step is None or step.score < LIKELY:
        return None
    # Levels of one recording have its error in common, so they test nothing between recordings.
    if step.score < BY_LEVELS_SURE or len(np.unique(levels.recording)) <= UNKNOWNS:
        reason = NotIdentifiableError(
            f"levels of the power look like a fan of {step.power:.0f} W that starts between "
            f"{step.below:.0f} and {step.above:.0f} degC, at {step.score:.1f} deviations: {levels}",
            f"{BY_LEVELS_SURE:g} deviations in more than {UNKNOWNS} recordings, or the step of its "
            "start",
            UNTIL_IT_RUNS,
        )
        return FanFound(None, str(reason), step.power)
    off = _between_thermometers(recordings, known)
    on_std = float(np.hypot((step.above - step.below) / ROOT12, off))
    between = 0.5 * (step.below + step.above)
    fit = FanFit(step.power, step.std, between, on_std, step.recordings, 0, errors)
    return FanFound(fit)


def _between_thermometers(recordings: Sequence[Recording], known: Thermometers | None) -> float:
    """Deviation between two thermometers; another motor may be the warmest later. [K]"""
    std = recordings[0].sensors.std.thermometer if known is None else known.std
    return 2.0**0.5 * std


@dataclass(frozen=True)
class Rests:
    """Rests of a recording, in the order of time.

    Attributes:
        time: Of their middle, shape (N,). [s]
        power: Of the meter less that of the drives, shape (N,). [W]
        warmest_degc: Highest that any motor had so far, shape (N,). [degC]
        heat: Copper loss of each motor over its coefficient, shape (N, n). [(N m)^2]
        fall: Of the warmest motor now below the highest so far, shape (N,). [K]
    """

    time: Float
    power: Float
    warmest_degc: Float
    heat: Float
    fall: Float

    @property
    def least(self) -> int:
        """Rests on each side of a step; constant, slope, step and joints are fewer than both."""
        return max(LEAST, (self.heat.shape[1] + 5) // 2)

    @property
    def places(self) -> range:
        """Rests with enough others on both sides."""
        return range(self.least, len(self.time) - self.least + 1)

    @property
    def warming(self) -> Rests:
        """Those at which the warmest motor does not cool."""
        return self._rows(self.fall <= FALL)

    @property
    def fed_by_grid(self) -> Rests:
        """Those whose power is not far below the rests before and after.

        After hard braking the DC link feeds what a robot at rest takes, and the meter shows less.
        """
        count, joints = self.heat.shape
        if count < 2 * (LEAST + joints):
            return self
        levels = np.repeat(np.eye(-(-count // LEAST)), LEAST, axis=0)[:count]
        columns = np.column_stack([self.heat, levels])
        values, _ = estimate(columns, self.power)
        power = self.power - self.heat @ values[:joints]
        around = np.pad(power, LEAST, mode="edge")
        medians = np.median(sliding_window_view(around, LEAST), axis=1)
        low = np.minimum(medians[:count], medians[LEAST + 1 :]) - power  # before, after
        scatter = MEDIAN_TO_STD * float(np.median(np.abs(low - np.median(low))))
        kept = self._rows(low <= max(FED * scatter, EXACT))
        return self if len(kept.time) == count else kept.fed_by_grid

    def before(self, fan: CabinetFan) -> Rests:
        """Return those before any start.

        Args:
            fan: Whose start it is.
        """
        start = fan.on_above_degc
        return self._rows(self.warmest_degc <= start.value - NOT_YET * (start.std or 0.0))

    def _rows(self, rows: NDArray[np.bool_]) -> Rests:
        every = self.time, self.power, self.warmest_degc, self.heat, self.fall
        return Rests(*(values[rows] for values in every))

    def start(self, degc: float, tolerance: float) -> int | None:
        """Return the rest with the surest step about a temperature; None if it is not passed.

        Args:
            degc: Of the warmest motor. [degC]
            tolerance: To both sides of it. [K]
        """
        off = self.warmest_degc - degc
        near = [at for at in self.places if abs(float(off[at])) <= tolerance]
        if not near or off[0] >= -tolerance or off[-1] <= tolerance:
            return None
        return max(near, key=lambda at: self.step(at).score)

    def less(self, power: float, first: int) -> Rests:
        """Return the rests without a power that begins at one of them.

        Args:
            power: That is taken off. [W]
            first: From which rest on.
        """
        return replace(self, power=self.power - power * (np.arange(len(self.power)) >= first))

    def step(self, first: int) -> PowerStep:
        """Return the step of the power from the rest before one to that one.

        Args:
            first: Which one.
        """
        rows = slice(max(first - MOST, 0), first + MOST)
        time, power = self.time[rows] - self.time[first], self.power[rows]
        others = np.column_stack([np.ones(len(time)), time, self.heat[rows]])
        size = np.linalg.norm(others, axis=0)
        others /= np.where(size > 0.0, size, 1.0)  # an upright axis holds nothing
        base, scale, _ = np.linalg.svd(others, full_matrices=False)
        base = base[:, scale > RANK * scale[0]]
        left = (time >= 0.0) - base @ (base.T @ (time >= 0.0))  # of the step, and of the power
        power = power - base @ (base.T @ power)
        square = float(left @ left)
        step = float(left @ power) / square
        rest = power - step * left
        variance = float(rest @ rest) / (len(time) - base.shape[1] - 1)
        return PowerStep(step, max((variance / square) ** 0.5, EXACT), len(time))


@dataclass(frozen=True)
class PowerStep:
    """A step of the power at rest.

    Attributes:
        power: After it less before it. [W]
        std: [W]
        rests: That show it.
    """

    power: float
    std: float
    rests: int

    @property
    def score(self) -> float:
        """Its size in deviations."""
        return self.power / self.std


def with_begin(fan: CabinetFan, recordings: Sequence[Recording], source: str) -> CabinetFan:
    """Return the fan with the warmest rest of a recording that shows that it did not run.

    Only of recordings that begin where its model leaves that open, between the temperatures of its
    stop and its start, of rests surely before its start, and below the coldest begin there at which
    it ran. A monitor that had begun at such a rest had found the fan at rest.

    Args:
        recordings: By the model with this fan and the drives of these recordings.
        source: Where the data come from.
    """
    found: dict[bool, list[float]] = {False: [], True: []}
    for part in recordings:
        cabinet = part.model.cabinet
        warmest = warmest_degc(part.power.motor_temperature_degc, fan.thermometers)
        known = warmest[np.isfinite(warmest)][:1]
        open_at = FanStage(cabinet, assumed=True).step(known[:, None]) if _usable(part) else 0.0
        if np.any(open_at):
            rests = _rests(part, fan.thermometers)
            constant = cabinet.loss_dc.value + cabinet.loss_grid.value
            seen = runs_at_begin(rests, fan, constant)
            if seen is not None:
                found[seen] += [float(known[0]), *rests.before(fan).warmest_degc.tolist()]
    coldest = min(found[True], default=np.inf)
    off = [degc for degc in found[False] if degc < coldest]
    if not off:
        return fan
    begins = Figure(value=max(off), tag="identified", source=source)
    return fan.model_copy(update={"begins_off_to_degc": begins})


def runs_at_begin(rests: Rests, fan: CabinetFan, constant: float) -> bool | None:
    """Return whether a fan runs in rests before any start; None if they do not show it.

    Args:
        constant: Of the cabinet without it. [W]
    """
    power = rests.before(fan).power
    if len(power) < AROUND:
        return None
    middle = float(np.median(power))
    scatter = MEDIAN_TO_STD * float(np.median(np.abs(power - middle))) / len(power) ** 0.5
    above = middle - constant - 0.5 * fan.power.value
    return above > 0.0 if abs(above) > SURE * scatter else None


def find_fan(recordings: Sequence[Recording]) -> FanFit:
    """Return the fan that a step in the power at rest shows.

    Raises:
        NotIdentifiableError: If the power has no step, or no fan explains it.
    """
    usable = [part for part in recordings if _usable(part)]
    if not usable:
        return fan_of([], 0.0)
    known = thermometers_of(usable)
    errors = None if known is None else known.error
    found = fan_of([_rests(part, errors) for part in usable], _between_thermometers(usable, known))
    return replace(found, thermometers=errors)


def fan_of(recordings: Sequence[Rests], thermometer: float) -> FanFit:
    """Return the fan that rests show, see `find_fan`.

    Args:
        thermometer: Deviation between those of two motors; another one may be warmest later. [K]
    """
    recordings = [part.fed_by_grid.warming for part in recordings]  # a fan stops while motors cool
    steps = [(part.step(first), part, first) for part in recordings for first in part.places]
    if not steps:
        least = min((part.least for part in recordings), default=LEAST)
        raise NotIdentifiableError(
            f"no recording has {2 * least} rests with motor temperatures and a meter at the grid",
            "rests before and after a fan starts",
            f"record {WARM_UP}",
        )
    _, part, first = max(steps, key=lambda one: one[0].score)
    degc = float(part.warmest_degc[first - 1 : first + 1].mean())
    near = part.warmest_degc[max(first - AROUND, 0) : first + AROUND]
    on_std = float(np.hypot(np.ptp(near) / ROOT12, thermometer))
    starts = [
        first if other is part else other.start(degc, TOLERANCE * on_std) for other in recordings
    ]
    same = [
        other.step(place)
        for other, place in zip(recordings, starts, strict=True)
        if place is not None
    ]
    weight = np.array([one.std**-2.0 for one in same])
    power = float(weight @ [one.power for one in same] / weight.sum())
    std = float(weight.sum() ** -0.5)
    if power < SURE * std:
        raise NotIdentifiableError(
            f"no step of the power at rest is {SURE:g} deviations high, the greatest is "
            f"{power:.1f} +- {std:.2g} W",
            "a fan that starts while the robot warms up",
            f"record {WARM_UP}",
        )
    rise = float(part.warmest_degc[: first + MOST][-1] - part.warmest_degc[0])
    if rise < thermometer:
        raise NotIdentifiableError(
            f"the power at rest has a step of {power:.1f} W, but no motor warms up: the warmest by "
            f"{rise:.2g} K",
            "a fan that starts while the robot warms up",
            f"record {WARM_UP}",
        )
    down = min(
        (
            rest.step(at)
            for other, place in zip(recordings, starts, strict=True)
            for rest in [other if place is None else other.less(power, place)]
            for at in rest.places
        ),
        key=lambda one: one.score,
        default=None,
    )
    if down is not None and down.score < -SURE:
        raise NotIdentifiableError(
            f"the power at rest has a step of {power:.1f} W and one of {down.power:.1f} W while "
            "the motors warm up",
            "steps of a fan alone",
            f"switch no other load in {WARM_UP}",
        )
    return FanFit(power, std, degc, on_std, len(same), sum(one.rests for one in same))


def _usable(part: Recording) -> bool:
    meter = part.meter
    known = np.isfinite(part.power.motor_temperature_degc).any()
    return meter is not None and meter.location is MeterLocation.GRID and bool(known)


def _rests(part: Recording, thermometers: tuple[float, ...] | None) -> Rests:
    pieces, power = at_rest(part, holding(part))
    warmest = warmest_degc(part.power.motor_temperature_degc, thermometers)
    so_far = np.fmax.accumulate(warmest)
    fall = np.nan_to_num(so_far - warmest)  # where it is unknown, it counts as warm
    middle = 0.5 * NANOSECOND * (pieces.stamp_ns + pieces.end_ns)
    row = row_of(part, pieces)
    torque, degc = (
        winding_torque(part, shaft_torque(part))[row],
        part.power.motor_temperature_degc[row],
    )
    heat = loss_columns(np.zeros_like(torque), torque, np.where(np.isnan(degc), COOL, degc))
    values = (middle, power, so_far[row], heat[..., TERMS.index("copper")], fall[row])
    known = np.flatnonzero(np.isfinite(np.column_stack(values)).all(axis=1))
    own = [parted(pieces[known], each[known]) for each in values]
    return Rests(
        *(
            np.array([one.mean(axis=0) for one in each]).reshape(-1, *whole.shape[1:])
            for each, whole in zip(own, values, strict=True)
        )
    )
