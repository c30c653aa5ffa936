"""Models identified from recordings, as paper A describes it and beyond.

The start is a model with bodies and gears, without friction and cabinet. What
is tested is what comes out here, by its grid energy on motions that no fit has used; no shipped
figure of friction or losses takes part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.figure import ModelEntry, PositiveFigure
from robot_energy.model.friction_laws import ConstantLaw, ExponentialLaw
from robot_energy.model.joint import Joint, JointFriction
from robot_energy.model.schema import Capacitor
from robot_energy.physics.friction import viscous_law
from robot_energy.replay.bag_replay import replay
from robot_energy.timeline.blocks import NANOSECOND, EffortMeaning, Float, Quality
from robot_energy_identify.cabinet.cabinet import CabinetFit, fit_cabinet, with_cabinet
from robot_energy_identify.data.recordings import Recording, read_recording
from robot_energy_identify.drives.drive_data import drive_data, location
from robot_energy_identify.drives.total_power import TotalFit, fit_total, with_total
from robot_energy_identify.drives.total_sums import sums
from robot_energy_identify.friction.friction import FrictionFit, fit_friction, with_friction
from robot_energy_identify.friction.samples import friction_data
from robot_energy_papers.experiment import MotionSet
from robot_energy_rig import SupplyProfile

FOLLOWS = "follows"  # the paper's proposed model: fv follows the motor temperature
TABLE = "table"  # the same with fv as a table of points, "saved directly"
LOSSES = "losses"  # the proposed model and drive losses from the grid meter
CAPACITOR = "capacitor"  # and the DC link's capacitor by its name plate
FIXED_DEGC = (20.0, 60.0)  # the cold end of the paper's range, and the state of its fig. 4
Entry = TypeVar("Entry", bound=ModelEntry)
UNKNOWN = "unknown before identification"
GUESS = 100.0  # W, constant losses before identification; from 0 no rest would be found


class SetFriction(Described):
    """Friction of every axis from one set alone, as in eq. 9, shape (n,) each."""

    motor_degc: Annotated[Float, "Mean over the set. [degC]"]
    coulomb: Annotated[Float, "Motor side. [N m]"]
    viscous: Annotated[Float, "Motor side. [N m s/rad]"]


class Identified(Described):
    """What was identified."""

    fits: tuple[FrictionFit, ...]
    cabinet: CabinetFit
    total: Annotated[TotalFit | None, "Drive losses behind the grid meter; None: not found."]
    models: Annotated[dict[str, RobotModel], "By name, as ``follows``, ``fixed_20``, ``losses``."]
    fixed_degc: Annotated[dict[str, float], "Motor temperature behind each fixed model. [degC]"]
    sets: tuple[SetFriction, ...]
    notes: tuple[str, ...]

    def viscous(self, motor_temperature_degc: Float) -> Float:
        """Return viscous friction of every axis by its identified law, shape (n,). [N m s/rad]

        Args:
            motor_temperature_degc: Shape (n,). [degC]
        """
        pairs = zip(self.fits, motor_temperature_degc, strict=True)
        return np.array([float(viscous_law(fit.law).viscous(degc)) for fit, degc in pairs])


def fixed_name(degc: float) -> str:
    """Return the name of the model whose friction is that of one operating point.

    Args:
        degc: Robot temperature. [degC]
    """
    return f"fixed_{degc:.0f}"


def with_values(entry: Entry, **values: float) -> Entry:
    """Return an entry of a model with other values of its figures.

    Args:
        values: By the names of the figures. [units of these]
    """
    figures = {
        name: getattr(entry, name).model_copy(update={"value": value})
        for name, value in values.items()
    }
    return entry.model_copy(update=figures)


def with_friction_times(joint: Joint, coulomb: float = 1.0, viscous: float = 1.0) -> JointFriction:
    """Return the friction of a joint of a shipped model with factors on its figures.

    Args:
        coulomb: Factor on Coulomb friction. [-]
        viscous: Factor on viscous friction at every temperature. [-]
    """
    friction, law = joint.friction, joint.friction.viscous
    assert isinstance(law, ExponentialLaw)  # as all shipped models have
    law = with_values(law, a=law.a.value * viscous, b=law.b.value * viscous)
    friction = with_values(friction, coulomb=friction.coulomb.value * coulomb)
    return friction.model_copy(update={"viscous": law})


def without_knowledge(model: RobotModel) -> RobotModel:
    """Return a model with bodies and gears only: no friction, no losses."""
    zero = PositiveFigure(value=0.0, tag="assumed", source=UNKNOWN)
    friction = JointFriction(coulomb=zero, viscous=ConstantLaw(law="constant", viscous=zero))
    guess = PositiveFigure(value=GUESS, tag="assumed", source=UNKNOWN)
    cabinet = model.cabinet.model_copy(update={"loss_grid": guess, "loss_dc": guess})
    bare = model.with_joints("friction", dict.fromkeys(model.joint_names, friction))
    return bare.changed(cabinet=cabinet, drive="ideal")


def identify(
    bags: Sequence[Path],
    rest: Path,
    start: RobotModel,
    supply: SupplyProfile | None = None,
    fixed_degc: Sequence[float] = FIXED_DEGC,
    beyond: bool = True,
) -> Identified:
    """Return models with identified friction, cabinet and, beyond the paper, drive losses.

    Args:
        bags: Sets of motions for identification, with motor torque in the effort.
        start: Model with the bodies and gears; its friction and losses are not used.
        supply: Plant of whose name plate the capacitor is read; None: no such model is made.
        fixed_degc: Operating points of the models with fixed friction. [degC]
        beyond: Whether to go beyond the paper: friction of each set, tables, losses.
    """
    blank = without_knowledge(start)
    source = f"{len(bags)} sets of motions on the virtual rig"
    read = [read_recording(bag, blank, EffortMeaning.MOTOR_TORQUE) for bag in bags]
    axes = range(len(blank.joints))
    fits = tuple(fit_friction(friction_data(read, axis), source) for axis in axes)
    sets = tuple(_of_one(recording) for recording in read) if beyond else ()
    degc = np.array([np.nanmean(part.power.motor_temperature_degc) for part in read])
    frictions: dict[str, Sequence[FrictionFit]] = {FOLLOWS: fits}
    chosen: dict[str, float] = {}
    for wanted in fixed_degc:
        nearest = int(np.argmin(np.abs(degc - wanted)))
        one = [fit_friction(friction_data(read[nearest : nearest + 1], axis)) for axis in axes]
        frictions[fixed_name(wanted)] = one
        chosen[fixed_name(wanted)] = float(degc[nearest])
    del read
    # Braking is found with the shaft power, so the losses need a model with friction.
    model = with_friction(blank, fits, source)
    powered = [read_recording(bag, model) for bag in (rest, *bags)]
    cabinet = fit_cabinet(powered)
    models = {
        name: with_cabinet(with_friction(blank, found, source), cabinet, source)
        for name, found in frictions.items()
    }
    total, notes = None, list[str]()
    if beyond:
        tables = {
            joint.name: joint.friction.model_copy(update={"viscous": fit.laws["table"]})
            for joint, fit in zip(models[FOLLOWS].joints, fits, strict=True)
            if "table" in fit.laws
        }
        models[TABLE] = models[FOLLOWS].with_joints("friction", tables)
        total, notes = _with_losses(models, powered, supply)
    return Identified(fits, cabinet, total, models, chosen, sets, tuple(notes))


def _of_one(recording: Recording) -> SetFriction:
    """Friction of one set by one constant law per axis."""
    axes = range(len(recording.model.joints))
    fits = [fit_friction(friction_data([recording], axis)) for axis in axes]
    return SetFriction(
        np.nanmean(recording.power.motor_temperature_degc, axis=0),
        np.array([fit.coulomb for fit in fits]),
        np.array([fit.points[0].viscous for fit in fits]),
    )


def _with_losses(
    models: dict[str, RobotModel], powered: Sequence[Recording], supply: SupplyProfile | None
) -> tuple[TotalFit | None, list[str]]:
    model = models[FOLLOWS]
    # The torque of the model under test is what it will have when it predicts.
    data = drive_data(powered, [None] * len(powered), measured_torque=False)
    place = location(data)
    if place is None:
        return None, ["no meter, so no losses of the drives"]
    try:
        total = fit_total(sums(data, model))
    except NotIdentifiableError as error:
        return None, [error.found]
    models[LOSSES], notes = with_total(model, total, place, "grid meter of the virtual rig")
    if supply is not None:
        models[CAPACITOR] = with_capacitor(models[LOSSES], supply)
    return total, notes


def with_capacitor(model: RobotModel, supply: SupplyProfile) -> RobotModel:
    """Return a model with the capacitor of a DC link, as on its name plate."""

    def plate(value: float) -> PositiveFigure:
        return PositiveFigure(value=value, tag="assumed", source="name plate of the rig's DC link")

    capacitor = Capacitor(
        capacitance=plate(supply.capacitance),
        nominal_voltage=plate(supply.rectified_voltage),
        chopper_voltage=plate(supply.chopper_on_voltage),
    )
    cabinet = model.cabinet.model_copy(update={"capacitor": capacitor})
    return model.changed(cabinet=cabinet)


class SetRow(Described):
    """One set."""

    bag: str
    way: str
    robot_degc: Annotated[float, "Mean over the motors and the set. [degC]"]
    motor_degc: Annotated[tuple[float, float], "The coldest and the warmest motor. [degC]"]
    rise: Annotated[float, "Rise of temperature of the motor that warmed most in the set. [K]"]
    motor_minus_gear: Annotated[float, "Mean motor minus gear temperature, truth. [K]"]
    measured_energy: Annotated[float, "By the meter, over the compared time. [J]"]
    compared_time: Annotated[float, "That time. [s]"]
    peak_power: Annotated[float, "Truth. [W]"]
    predicted_energy: Annotated[dict[str, float], "Energy over the same time, by model. [J]"]
    extrapolated: Annotated[float, "Share of the samples outside the range of a friction law. [-]"]

    @property
    def mean_power(self) -> float:
        """Measured energy over the compared time. [W]"""
        return self.measured_energy / self.compared_time

    def error(self, model: str) -> float:
        """Return predicted over measured energy, less 1. [-]"""
        return self.predicted_energy[model] / self.measured_energy - 1.0


def held_out(
    sets: Sequence[MotionSet], models: Mapping[str, RobotModel], reference: str
) -> list[SetRow]:
    """Return one row per set, replayed with every model."""
    return [_row(entry, models, reference) for entry in sets]


def _row(entry: MotionSet, models: Mapping[str, RobotModel], reference: str) -> SetRow:
    predicted: dict[str, float] = {}
    measured = compared = extrapolated = 0.0
    for name, model in models.items():
        result = replay(entry.path, model)
        comparison = result.account.comparison
        predicted[name] = comparison.predicted_energy
        if name == reference:
            measured = comparison.measured_energy
            compared = comparison.compared_ns * NANOSECOND
            held = result.account.counts.quality.get(int(Quality.EXTRAPOLATED), 0)
            extrapolated = held / max(result.account.counts.samples, 1)
    truth = entry.recording.motor_temperature_degc.mean(axis=0)
    return SetRow(
        entry.path.name,
        entry.way,
        float(truth.mean()),
        (float(truth.min()), float(truth.max())),
        entry.rise,
        entry.motor_minus_gear,
        measured,
        compared,
        entry.recording.peak_power,
        predicted,
        extrapolated,
    )


def worst(rows: Sequence[SetRow], model: str) -> float:
    """Return the greatest error of a model in size, with its sign. [-]"""
    errors = [row.error(model) for row in rows]
    return max(errors, key=abs)


def normalised(rows: Sequence[SetRow], degc: float) -> float:
    """Return the measured mean power at one temperature, straight between the sets. [W]

    Args:
        degc: Mean motor temperature; held at the ends. [degC]
    """
    order = sorted(rows, key=lambda row: row.robot_degc)
    return float(
        np.interp(degc, [row.robot_degc for row in order], [row.mean_power for row in order])
    )


def shaft_power(bag: Path, model: RobotModel, axis: int) -> tuple[Float, Float]:
    """Return time [s] and measured shaft power [W] of one axis, shape (N,) each.

    Traced torque times speed, since the first sample.

    Args:
        bag: A recording with motor torque in the effort.
        model: Its bodies and gears.
        axis: Index of the joint.
    """
    torque = read_recording(bag, model, EffortMeaning.MOTOR_TORQUE).torque
    time = (torque.stamp_ns - torque.stamp_ns[0]) * NANOSECOND
    return time, torque.motor_torque_measured[:, axis] * torque.motor_velocity[:, axis]
