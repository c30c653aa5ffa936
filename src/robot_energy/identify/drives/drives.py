"""Electrical power of the drives: efficiency maps and loss model, tested on held-out data.

Every way runs through `robot_energy.drive`, so what is tested is what the monitor runs.
Energy accuracy is ``1 - |E_predicted - E_measured| / E_measured`` with ``E`` the sum over
the drives of the power integrated over the held-out time, braking negative (paper B, 7.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from robot_energy.blocks import Float
from robot_energy.drive import Drive, EfficiencyMaps, LossModel
from robot_energy.errors import NotIdentifiableError
from robot_energy.identify.drive_data import DriveData, averaged
from robot_energy.identify.efficiency import CUTOFF, POINTS, ReducedMap, processed, reduced_map
from robot_energy.identify.losses import TERMS, Losses, fit_losses, loss_columns
from robot_energy.identify.quality import folds_in_order
from robot_energy.model_file import RobotModel

Way = Literal["none", "constant", "map", "map_processed", "losses"]
Split = Literal["blocks", "recordings", "beyond"]
WAYS: tuple[Way, ...] = ("none", "constant", "map", "map_processed", "losses")
CONSTANT_EFFICIENCY = 0.875  # paper B, 7.3
FOLDS = 5
INSIDE = 0.6  # of the greatest speed and torque: what lies beyond is held out
GREATEST = 0.999  # quantile that stands for the greatest speed or torque
LEAST_HELD_OUT = 50


@dataclass(frozen=True)
class AxisFit:
    """What was identified of one drive.

    Attributes:
        name: Of the joint.
        losses: The loss model; None where the data do not tell it.
        map: The reduced efficiency map; None where the data do not tell it.
        notes: What the data do not tell, one sentence each.
    """

    name: str
    losses: Losses | None
    map: ReducedMap | None
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Score:
    """One way to predict electrical power, on held-out data.

    Attributes:
        accuracy: Of the energy of all drives: 1 is exact, 0 is off by all of it. [-]
        rms: Of the power of a drive, over all drives and held-out samples. [W]
        axis_rms: Of each drive, NaN where it has no held-out samples. [W]
    """

    accuracy: float
    rms: float
    axis_rms: tuple[float, ...]


@dataclass(frozen=True)
class Comparison:
    """All ways on one kind of held-out data.

    Attributes:
        split: How the data were held out.
        samples: Held-out samples of a drive, over all drives.
        energy: Measured in them. [J]
        scores: By way.
    """

    split: Split
    samples: int
    energy: float
    scores: dict[Way, Score]


@dataclass(frozen=True)
class DrivesFit:
    """What was identified of all drives.

    Attributes:
        axes: One per joint.
        comparisons: One per kind of held-out data that the recordings allow.
        chosen: Drive model of the model file, by held-out error.
        cutoff: Of the low-pass of the maps. [Hz]
    """

    axes: tuple[AxisFit, ...]
    comparisons: tuple[Comparison, ...]
    chosen: Literal["loss_model", "efficiency_map"]
    cutoff: float


def fit_drives(
    data: DriveData,
    source: str = "",
    cutoff: float = CUTOFF,
    points: int = POINTS,
    compare: bool = True,
) -> DrivesFit:
    """Identify every drive whose power is measured.

    Args:
        data: Samples of all drives.
        source: Where they come from, for the model file.
        cutoff: Of the low-pass of the maps. [Hz]
        points: Greatest number of points of a map.
        compare: Test all ways on parts held out; without it the loss model is chosen.

    Raises:
        NotIdentifiableError: If no drive can be identified.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):  # the matrices are small: more threads only wait for each other
        fitter = _Fitter(data, cutoff, points)
        axes = tuple(fitter.axis(joint, data.usable[:, joint], source) for joint in fitter.joints)
        if all(axis.losses is None for axis in axes):
            raise NotIdentifiableError(
                axes[0].notes[0],
                "measured electrical power of the drives beside torque and speed",
                "name its topic with --drive-power, or its columns in the mapping",
            )
        comparisons = [
            comparison
            for split, test in (_splits(data) if compare else {}).items()
            if (comparison := fitter.compare(split, test)) is not None
        ]
    return DrivesFit(axes, tuple(comparisons), _choose(axes, comparisons), cutoff)


def _choose(
    axes: Sequence[AxisFit], comparisons: Sequence[Comparison]
) -> Literal["loss_model", "efficiency_map"]:
    """By the RMS error on whole recordings held out, on blocks where there is one only."""
    if any(axis.map is None for axis in axes):
        return "loss_model"
    for split in ("recordings", "blocks"):
        for comparison in comparisons:
            if comparison.split == split:
                scores = comparison.scores
                better = scores["map"].rms < scores["losses"].rms
                return "efficiency_map" if better else "loss_model"
    return "loss_model"


def _splits(data: DriveData) -> dict[Split, list[NDArray[np.bool_]]]:
    """Held-out samples of every kind, one array (N, n) per fold."""
    fold = folds_in_order(len(data), FOLDS)
    width = len(data.names)

    def wide(rows: NDArray[np.bool_]) -> NDArray[np.bool_]:
        return np.repeat(rows[:, None], width, axis=1)

    splits: dict[Split, list[NDArray[np.bool_]]] = {
        "blocks": [wide(fold == number) for number in range(FOLDS)]
    }
    if data.recordings > 1:
        splits["recordings"] = [wide(data.recording == k) for k in range(data.recordings)]
    speed, torque = np.abs(data.motor_velocity), np.abs(data.motor_torque)
    beyond = np.zeros(speed.shape, dtype=np.bool_)
    for size in (speed, torque):
        known = np.where(data.usable, size, np.nan)
        if np.isfinite(known).any(axis=0).all():
            beyond |= size > INSIDE * np.nanquantile(known, GREATEST, axis=0)
    splits["beyond"] = [beyond]
    return splits


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
        velocity, torque = data.motor_velocity[rows, joint], data.motor_torque[rows, joint]
        columns = loss_columns(velocity, torque, data.motor_temperature_degc[rows, joint])
        window = data.window[rows]
        return fit_losses(
            averaged(columns, window),
            averaged(data.drive_power[rows, joint] - torque * velocity, window),
            data.block[rows][np.diff(window, prepend=-1) != 0],
            TERMS,
            f"the samples of {data.names[joint]}",
        )

    def map(self, joint: int, rows: NDArray[np.bool_], source: str = "") -> ReducedMap:
        """Make the map of one drive."""
        data = self.data
        return reduced_map(
            data.names[joint],
            data.motor_torque[:, joint],
            data.motor_velocity[:, joint],
            data.drive_power[:, joint],
            data.stretch,
            data.period,
            rows,
            self._cutoff,
            self._points,
            source,
        )

    def axis(self, joint: int, rows: NDArray[np.bool_], source: str) -> AxisFit:
        """Identify one drive; what the data do not tell becomes a note."""
        name = self.data.names[joint]
        notes: list[str] = []
        losses = reduced = None
        try:
            losses = self.losses(joint, rows)
            if losses.untold:
                notes.append(
                    f"{name}: {', '.join(losses.untold)} cannot be told apart from the other "
                    "losses and is taken as 0; record motion at several speeds and loads"
                )
            if losses.negative:
                notes.append(
                    f"{name}: {', '.join(losses.negative)} at its bound 0, negative otherwise"
                )
            reduced = self.map(joint, rows, source)
        except NotIdentifiableError as error:
            notes.append(error.found)
        return AxisFit(name, losses, reduced, tuple(notes))

    def compare(self, split: Split, folds: Sequence[NDArray[np.bool_]]) -> Comparison | None:
        """Predict every fold from the others.

        A drive that cannot be fitted without a fold is left out of it; None if hardly
        anything is left.
        """
        data = self.data
        usable = data.usable
        measured = [joint for joint in self.joints if usable[:, joint].any()]
        predicted: dict[Way, Float] = {way: np.full(usable.shape, np.nan) for way in WAYS}
        for test in folds:
            for joint in measured:
                held = test[:, joint] & usable[:, joint]
                if not held.any():
                    continue
                try:
                    ways = self._predict(joint, usable[:, joint] & ~test[:, joint])
                except NotIdentifiableError:
                    continue
                for way, power in ways.items():
                    predicted[way][held, joint] = power[held]
        tested = usable & np.isfinite(predicted["map"]) & np.isfinite(predicted["losses"])
        if int(tested.sum()) < LEAST_HELD_OUT:
            return None
        weight = np.where(tested, data.duration[:, None], 0.0)
        energy = float(np.sum(weight * np.where(tested, data.drive_power, 0.0)))
        scores: dict[Way, Score] = {
            way: self._score(predicted[way], tested, weight, energy) for way in WAYS
        }
        return Comparison(split, int(tested.sum()), energy, scores)

    def _score(
        self, power: Float, tested: NDArray[np.bool_], weight: Float, energy: float
    ) -> Score:
        error = np.where(tested, power - self.data.drive_power, np.nan)
        total = float(np.nansum(weight * error))
        square = error * error
        axis = [
            float(np.sqrt(np.nanmean(square[:, k]))) if tested[:, k].any() else float("nan")
            for k in self.joints
        ]
        return Score(1.0 - abs(total / energy), float(np.sqrt(np.nanmean(square))), tuple(axis))

    def _predict(self, joint: int, rows: NDArray[np.bool_]) -> dict[Way, Float]:
        """Power of one drive at all samples, from some of them. [W]"""
        data = self.data
        shaft = data.shaft_power[:, joint]
        mapped = self._run(EfficiencyMaps([self.map(joint, rows).entry]), joint)
        second = processed(mapped, data.stretch, data.period, self._cutoff)
        return {
            "none": shaft,
            "constant": np.where(
                shaft > 0, shaft / CONSTANT_EFFICIENCY, shaft * CONSTANT_EFFICIENCY
            ),
            "map": mapped,
            "map_processed": np.where(np.isfinite(second), second, mapped),
            "losses": self._run(LossModel([self.losses(joint, rows).entry()]), joint),
        }

    def _run(self, drive: Drive, joint: int) -> Float:
        data, only = self.data, slice(joint, joint + 1)
        power, _ = drive.input_power(
            data.shaft_power[:, only],
            data.motor_velocity[:, only],
            data.motor_torque[:, only],
            data.motor_temperature_degc[:, only],
        )
        return power[:, 0]


def with_drives(model: RobotModel, fit: DrivesFit, source: str) -> RobotModel:
    """Return a model with the chosen drive model; drives that were not identified keep theirs.

    Args:
        model: Any model of the same robot.
        fit: What was identified.
        source: Where the data come from.

    Raises:
        NotIdentifiableError: If a drive was not identified and the model has no losses of it.
    """
    mapped = fit.chosen == "efficiency_map"
    joints = list(model.joints)
    for index, (joint, axis) in enumerate(zip(model.joints, fit.axes, strict=True)):
        if axis.losses is not None:
            update: dict[str, object] = {"losses": axis.losses.entry(source)}
            if mapped and axis.map is not None:
                update["efficiency_map"] = axis.map.entry
            joints[index] = joint.model_copy(update=update)
        elif joint.losses is None:
            raise NotIdentifiableError(
                f"{joint.name} was not identified and the model has no losses of it",
                "figures of every drive",
                axis.notes[0],
            )
    changed = model.model_copy(update={"joints": joints, "drive": fit.chosen})
    return changed.with_urdf(model.urdf_xml, model.source)
