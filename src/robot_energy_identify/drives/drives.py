"""Electrical power of the drives: efficiency maps and loss model, tested on held-out data.

Every way runs through `robot_energy.physics.drives_and_cabinet`, so what is tested is what the
monitor runs.
Energy accuracy is ``1 - |E_predicted - E_measured| / E_measured`` with ``E`` the sum over
the drives of the power integrated over the held-out time, braking negative (paper B, 7.3).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import field
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.drive_models import DRIVE_MODELS, DriveModel
from robot_energy.physics.drives_and_cabinet import with_warm_magnets
from robot_energy.physics.torque_constant import TorqueConstants
from robot_energy.timeline.blocks import Float, Int
from robot_energy_identify.blas_threads import one_thread
from robot_energy_identify.drives.drive_data import DriveData
from robot_energy_identify.drives.efficiency_map import (
    CUTOFF,
    MAX_QUANTILE,
    POINTS,
    ReducedMap,
    at_efficiency,
    fitted_efficiency,
    processed,
    reduced_map,
)
from robot_energy_identify.drives.losses import COPPER_COEFFICIENT, TERMS, Losses, fit_losses
from robot_energy_identify.stats.cross_validation import GAIN, averaged, contiguous_folds, rms_of
from robot_energy_identify.stats.systematic import (
    DRIVE_POWER,
    THERMOMETER,
    TORQUE,
    Changes,
)

Way = str  # one of WAYS, or the name of a drive model of a user
Fitted = Callable[[Any, str], Any]
Split = Literal["blocks", "recordings", "beyond"]
WAYS: tuple[Way, ...] = (
    "none", "constant", "constant_fitted", "map", "map_processed", "losses",
)  # fmt: skip
DEFAULT = "loss_model"  # where held-out data say nothing better
CONSTANT_EFFICIENCY = 0.875  # paper B, 7.3
INSIDE = 0.6  # of the greatest speed and torque: what lies beyond is held out
MIN_HELD_OUT = 50


class AxisSamples(Described):
    """What was measured of one drive, motor side."""

    motor_velocity: Annotated[Float, "Shape (N,). [rad/s]"]
    motor_torque: Annotated[Float, "Shape (N,). [N m]"]
    motor_temperature_degc: Annotated[Float, "Of the winding, shape (N,). [degC]"]
    drive_power: Annotated[Float, "Electrical input, shape (N,). [W]"]
    window: Annotated[
        Int, "Number of the 0.1 s that each lies in, over which noise is averaged, shape (N,)."
    ]
    constants: Annotated[
        TorqueConstants | None, "Of the motor; None where its torque constant does not fall."
    ] = None


class AxisFit(Described):
    """What was identified of one drive."""

    name: Annotated[str, "Of the joint."]
    losses: Annotated[Losses | None, "The loss model; None where the data do not determine it."]
    map: Annotated[
        ReducedMap | None, "The reduced efficiency map; None where the data do not determine it."
    ]
    notes: Annotated[tuple[str, ...], "What the data do not determine, one sentence each."]
    samples: Annotated[
        AxisSamples | None, "Behind the fit, for drive models of users; None if they are not known."
    ] = field(default=None, repr=False, compare=False)


class Score(Described):
    """One way to predict electrical power, on held-out data."""

    accuracy: Annotated[
        float, "Of the energy of all drives: 1 is exact, 0 is off by all of it. [-]"
    ]
    rms: Annotated[float, "Of the power of a drive, over all drives and held-out samples. [W]"]


class DriveComparison(Described):
    """All ways on one kind of held-out data."""

    split: Annotated[Split, "How the data were held out."]
    samples: Annotated[int, "Held-out samples of a drive, over all drives."]
    energy: Annotated[float, "Measured in them. [J]"]
    size: Annotated[float, "Root mean square of the measured power. [W]"]
    scores: Annotated[dict[Way, Score], "By way."]


class DrivesFit(Described):
    """What was identified of all drives."""

    axes: Annotated[tuple[AxisFit, ...], "One per joint."]
    comparisons: Annotated[
        tuple[DriveComparison, ...], "One per kind of held-out data that the recordings allow."
    ]
    chosen: Annotated[str, "Drive model of the model file, by held-out error."]
    cutoff: Annotated[float, "Of the low-pass of the maps. [Hz]"]


@one_thread
def fit_drives(
    data: DriveData,
    source: str = "",
    cutoff: float = CUTOFF,
    points: int = POINTS,
    compare: bool = True,
) -> DrivesFit:
    """Return fits of every drive whose power is measured and, held out, of every way.

    Args:
        source: Where they come from, for the model file.
        cutoff: Of the low-pass of the maps. [Hz]
        compare: Test all ways on parts held out; without it the loss model is chosen.
    """
    fitter = _Fitter(data, cutoff, points)
    axes = tuple(fitter.axis(joint, data.usable[:, joint], source) for joint in fitter.joints)
    if all(axis.losses is None for axis in axes):
        raise NotIdentifiableError(
            axes[0].notes[0],
            "measured electrical power of the drives, with torque and speed",
            "name its topic with --drive-power, or its columns in the mapping",
        )
    comparisons = [
        comparison
        for split, fold in (_folds(data) if compare else {}).items()
        if (comparison := fitter.compare(split, fold)) is not None
    ]
    return DrivesFit(axes, tuple(comparisons), _choose(axes, comparisons), cutoff)


def _fitted_kinds() -> Iterator[tuple[DriveModel, Way, Fitted]]:
    """Drive models that have a fit, each with its way and its fit."""
    for kind in DRIVE_MODELS.values():
        if kind.fitted is not None:
            yield kind, kind.way or kind.name, kind.fitted


def _entry(fitted: Fitted, axis: AxisFit, source: str = "") -> Any:
    """Entry of one drive by one kind; None where the data do not determine it."""
    try:
        return fitted(axis, source)
    except NotIdentifiableError:
        return None


def _choose(axes: Sequence[AxisFit], comparisons: Sequence[DriveComparison]) -> str:
    """By the RMS error on whole recordings held out, on blocks where there is one only.

    What replaces the loss model, whose figures have deviations, must be better by `GAIN`.
    """
    by_split = {comparison.split: comparison for comparison in comparisons}
    comparison = by_split.get("recordings") or by_split.get("blocks")
    chosen, least = DEFAULT, np.inf
    if comparison is not None:
        least = GAIN * comparison.scores["losses"].rms
    for kind, way, fitted in _fitted_kinds():
        score = None if comparison is None else comparison.scores.get(way)
        if score is None or not score.rms < least:
            continue
        if all(_entry(fitted, axis) is not None for axis in axes):
            chosen, least = kind.name, score.rms
    return chosen


def _folds(data: DriveData) -> dict[Split, Int]:
    """Fold of every sample for every kind of held-out data, -1 in none, shape (N, 1 or n)."""
    folds: dict[Split, Int] = {"blocks": contiguous_folds(len(data))[:, None]}
    if data.recordings > 1:
        folds["recordings"] = data.recording[:, None]
    beyond = np.zeros(data.usable.shape, dtype=np.bool_)
    for size in (np.abs(data.motor_velocity), np.abs(data.motor_torque)):
        known = np.where(data.usable, size, np.nan)
        if np.isfinite(known).any(axis=0).all():
            beyond |= size > INSIDE * np.nanquantile(known, MAX_QUANTILE, axis=0)
    folds["beyond"] = beyond.astype(np.int64) - 1
    return folds


class _Fitter:
    """Fits and tests the ways on parts of the same data."""

    def __init__(self, data: DriveData, cutoff: float, points: int) -> None:
        self.data = data
        self.joints = range(len(data.names))
        self._cutoff = cutoff
        self._points = points

    def losses(self, joint: int, rows: NDArray[np.bool_]) -> Losses:
        """Fit the loss model of one drive."""
        data = self.data
        window = data.window[rows]
        columns = averaged(data.loss_columns(rows, joint), window)
        both = data.shaft_power, data.drive_power
        shaft, power = (averaged(values[rows, joint], window) for values in both)
        std = data.sensors.std

        def changes(values: dict[str, float]) -> Changes:
            heat = values["copper"] * columns[:, 1]
            return {
                TORQUE: (-std.torque * (shaft + 2.0 * heat),),
                THERMOMETER: (-std.thermometer * COPPER_COEFFICIENT * heat,),
                DRIVE_POWER: (std.drive_power * power,),
            }

        return fit_losses(
            columns,
            power - shaft,
            data.block[rows][np.diff(window, prepend=-1) != 0],
            TERMS,
            f"the samples of {data.names[joint]}",
            changes,
        )

    def axis(self, joint: int, rows: NDArray[np.bool_], source: str = "") -> AxisFit:
        """Identify one drive; what the data do not determine becomes a note."""
        data, name = self.data, self.data.names[joint]
        notes: list[str] = []
        losses = reduced = None
        try:
            losses = self.losses(joint, rows)
            if losses.undetermined:
                notes.append(
                    f"{name}: {', '.join(losses.undetermined)} are not separated from the other "
                    "losses and taken as 0; record motion at several speeds and loads"
                )
            if losses.negative:
                notes.append(
                    f"{name}: {', '.join(losses.negative)} at the bound 0, negative otherwise"
                )
            reduced = reduced_map(data, joint, rows, self._cutoff, self._points, source)
        except NotIdentifiableError as error:
            notes.append(error.found)
        samples = AxisSamples(
            data.motor_velocity[rows, joint],
            data.motor_torque[rows, joint],
            data.motor_temperature_degc[rows, joint],
            data.drive_power[rows, joint],
            data.window[rows],
            None if data.constants is None else data.constants.of_joint(joint),
        )
        return AxisFit(name, losses, reduced, tuple(notes), samples)

    def compare(self, split: Split, fold: Int) -> DriveComparison | None:
        """Predict every fold from the others.

        A drive that cannot be fitted without a fold is left out of it; None if hardly
        anything is left.
        """
        data, usable = self.data, self.data.usable
        fold = np.where(usable, fold, -1)
        predicted: dict[Way, Float] = {way: np.full(usable.shape, np.nan) for way in WAYS}
        shaft, power = data.shaft_power, data.drive_power
        for joint, own in enumerate(fold.T):
            for number in np.unique(own[own >= 0]):
                held = own == number
                axis = self.axis(joint, usable[:, joint] & ~held)
                if axis.losses is None or axis.map is None:
                    continue
                for way, values in self._predict(joint, axis).items():
                    place = predicted.setdefault(way, np.full(usable.shape, np.nan))
                    place[held, joint] = values[held]
        for number in np.unique(fold[fold >= 0]):
            train, held = usable & (fold != number), fold == number
            constant = at_efficiency(shaft, fitted_efficiency(shaft[train], power[train]))
            predicted["constant_fitted"][held] = constant[held]
        tested = usable & np.isfinite(predicted["map"]) & np.isfinite(predicted["losses"])
        if int(tested.sum()) < MIN_HELD_OUT:
            return None
        weight = np.where(tested, data.duration[:, None], 0.0)
        energy = float(np.sum(weight * np.where(tested, data.drive_power, 0.0)))
        scores: dict[Way, Score] = {}
        for way, power in predicted.items():
            if not np.isfinite(power[tested]).all():  # the kind of a user has no fit here
                continue
            error = np.where(tested, power - data.drive_power, np.nan)
            accuracy = 1.0 - abs(float(np.nansum(weight * error)) / energy)
            scores[way] = Score(accuracy, float(np.sqrt(np.nanmean(error * error))))
        size = rms_of(data.drive_power[tested])
        return DriveComparison(split, int(tested.sum()), energy, size, scores)

    def _predict(self, joint: int, axis: AxisFit) -> dict[Way, Float]:
        """Power of one drive at all samples, by every way. [W]"""
        data = self.data
        shaft = data.shaft_power[:, joint]
        ways = {"none": shaft, "constant": at_efficiency(shaft, CONSTANT_EFFICIENCY)}
        for kind, way, fitted in _fitted_kinds():
            entry = _entry(fitted, axis)
            if entry is not None and kind.physics is not None:
                constants = None if data.constants is None else data.constants.of_joint(joint)
                drive = with_warm_magnets(kind, kind.physics([entry]), constants)
                ways[way] = data.input_power(drive, slice(joint, joint + 1))[:, 0]
        second = processed(ways["map"], data.stretch, data.periods, self._cutoff)
        ways["map_processed"] = np.where(np.isfinite(second), second, ways["map"])
        return ways


def with_drives(model: RobotModel, fit: DrivesFit, source: str) -> RobotModel:
    """Return a model with the chosen drive model; drives that were not identified keep theirs."""
    kind = DRIVE_MODELS[fit.chosen]
    joints = list(model.joints)
    for index, (joint, axis) in enumerate(zip(model.joints, fit.axes, strict=True)):
        if axis.losses is not None:
            update: dict[str, object] = {"losses": axis.losses.entry(source)}
            entry = None if kind.fitted is None else _entry(kind.fitted, axis, source)
            if entry is not None:
                update[kind.key] = entry
            joints[index] = joint.model_copy(update=update)
        elif joint.losses is None:
            raise NotIdentifiableError(
                f"{joint.name} was not identified and the model has no losses of it",
                "figures of every drive",
                axis.notes[0],
            )
    return model.changed(joints=joints, drive=fit.chosen)
