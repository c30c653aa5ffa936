"""Friction, gears, hold and thermal networks of all joints, as one identification finds them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import Annotated

import numpy as np

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.physics.friction import FrictionModel
from robot_energy.results.base import Result, Texts
from robot_energy_identify.data.recordings import LACKING, Recording
from robot_energy_identify.friction.friction import FrictionFit, fit_axes, with_friction
from robot_energy_identify.friction.hold import HoldFit, fit_hold
from robot_energy_identify.friction.samples import FrictionData, friction_data, moving_rows
from robot_energy_identify.friction.shared_shape import share_shape
from robot_energy_identify.friction.torque_constants import (
    FallingConstant,
    at_shaft,
    find_falls,
    with_falls,
)
from robot_energy_identify.plausibility import check_friction
from robot_energy_identify.thermal.gear import GearsFound, fit_gears
from robot_energy_identify.thermal.gears_by_meter import gears_by_meter
from robot_energy_identify.thermal.network import (
    ThermalFit,
    ambient_of,
    fit_networks,
    runs_of_recordings,
    with_networks,
)

APART = 0.1  # of the friction power of an axis: sound recordings of one plant are off by 0.05
MIN_AXES = 2  # that are so far off: one alone may be of another form than its law
MIN_RECORDINGS = 3  # before one may be left out: two sound ones are both off, by up to 0.4


class FrictionReport(Result, name="friction"):
    """Friction over motor temperature."""

    effort: Annotated[str, "What the torque was measured as; ``log``: relative figures of a log."]
    axes: Annotated[tuple[FrictionFit, ...], "One per axis that could be identified."]
    refused: Annotated[Texts, "Why the others could not, one sentence each."]
    gears: Annotated[
        GearsFound, "Temperatures of gears, which the friction of their axes follows."
    ] = field(default_factory=GearsFound)
    hold: Annotated[HoldFit | None, "What motors hold at rest; None if few rests show it."] = None
    apart: Annotated[
        Texts, "Recordings of other friction, or without temperatures, one sentence each."
    ] = ()
    falls: Annotated[
        tuple[FallingConstant, ...], "Torque constants that fall with the motor temperature."
    ] = ()

    @property
    def torque_unit(self) -> str:
        return "A" if self.effort == "log" else "N m"

    def write(self, model: RobotModel, source: str) -> RobotModel:
        """Return a model with this friction, which follows gears where they were found."""
        names = [fit.name for fit in self.axes]
        written = with_falls(with_friction(model, self.axes, source), self.falls)
        written = self.gears.write(written, names)
        return written if self.hold is None else self.hold.write(written, source)


def find_friction(
    recordings: Sequence[Recording], model: RobotModel, source: str, share: bool = False
) -> FrictionReport:
    """Return the friction of every axis, over the temperature of gears where they show.

    Args:
        share: Whether axes of too small a range borrow the temperature shape of others.
    """
    joints = range(len(model.joints))
    axes = [friction_data(recordings, joint) for joint in joints]
    falls = find_falls(recordings, axes, source)
    model = with_falls(model, falls)  # which may keep others
    recordings = at_shaft(recordings, model)
    axes = [friction_data(recordings, joint) for joint in joints]
    air = model.temperature.ambient_degc
    gears, axes = fit_gears(axes, None if air is None else air.value, source)
    fits, refused = plausible_fits(axes, source, share)
    hold = fit_hold(recordings, with_friction(model, fits, source))
    names = [part.path.name for part in recordings]
    apart = recordings_apart(names, axes, fits, model)
    apart += recordings_without_temperature(recordings)
    return FrictionReport("measured", tuple(fits), refused, gears, hold, apart, falls)


def plausible_fits(
    axes: Sequence[FrictionData], source: str = "", share: bool = False
) -> tuple[list[FrictionFit], Texts]:
    """Return the friction of each axis where it is plausible, and why not that of the others."""
    fits, refused = fit_axes(axes, source)
    if share:
        fits = share_shape(fits, axes, source)
    fits, implausible = check_friction(fits)
    return fits, (*refused, *implausible)


def recordings_apart(
    names: Sequence[str],
    axes: Sequence[FrictionData],
    fits: Sequence[FrictionFit],
    model: RobotModel,
) -> tuple[str, ...]:
    """Return the recordings whose friction power is far from the laws, all in one sentence.

    One law for all takes up what differs in one of them, and then fits none: which is wrong does
    not show.

    Args:
        names: Of the recordings.
        axes: What the fits have seen, with the temperatures that the friction follows.
    """
    friction = FrictionModel.from_model(with_friction(model, fits, ""))
    velocity, degc, load, measured = (
        np.stack([getattr(axis, name) for axis in axes], axis=1)
        for name in ("motor_velocity", "motor_temperature_degc", "load", "friction_torque")
    )
    # without a temperature the law is a constant
    torque = friction.torque(
        velocity, friction.coulomb, friction.viscous(np.nan_to_num(degc)), motor_torque_rigid=load
    )
    fitted = {fit.name for fit in fits}
    shares = np.zeros((len(names), len(axes)))
    for joint, axis in enumerate(axes):
        if axis.name not in fitted:
            continue
        used = moving_rows(axis) & np.isfinite(torque[:, joint])
        for number in range(len(names)):
            rows = used & (axis.run == number)
            drawn, said = (
                float((one[rows, joint] * velocity[rows, joint]).sum())
                for one in (measured, torque)
            )
            shares[number, joint] = drawn / said - 1.0 if said > 0.0 else 0.0
    off = (np.abs(shares) > APART) & (len(names) > 1)
    found = [
        f"{name} ("
        + ", ".join(
            f"{axes[k].name} {100.0 * share[k]:+.0f} %" for k in np.flatnonzero(far).tolist()
        )
        + ")"
        for name, share, far in zip(names, shares, off, strict=True)
        if far.sum() >= MIN_AXES
    ]
    if not found:
        return ()
    remedy = "record temperatures in between"
    if len(names) >= MIN_RECORDINGS:
        remedy += ", or leave out one that is wrong: it puts sound ones off as well"
    return (
        f"friction power is off the laws of all recordings in {', '.join(found)}: too few "
        "temperatures for a law, or none, motor temperatures that are wrong in one of them, gears "
        "that are not as warm as motors, a payload that the model does not have, or another robot; "
        f"{remedy}",
    )


def recordings_without_temperature(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return the recordings that lack a temperature that others have, one sentence each."""
    known = [np.isfinite(part.power.motor_temperature_degc) for part in recordings]
    lacking = 1.0 - np.array([rows.mean(axis=0) for rows in known])
    lacking[:, (lacking == 1.0).all(axis=0)] = 0.0
    return tuple(
        f"{part.path.name}: no motor temperature of {', '.join(joints)} in {100.0 * row.max():.0f} "
        "% of its samples, which friction leaves out, as do drives by the torque of the model if "
        f"more than {100.0 * LACKING:.0f} % of all samples have one; check these sensors, or name "
        "their topic with --inputs"
        for part, row in zip(recordings, lacking, strict=True)
        if (joints := [part.model.joint_names[k] for k in np.flatnonzero(row > LACKING).tolist()])
    )


class ThermalReport(Result, name="thermal"):
    """Thermal networks of the motors of a robot."""

    heat: Annotated[
        str, "``losses`` [W], or of a log ``squared_current`` [A^2], with relative capacities."
    ]
    ambient_degc: Annotated[float, "Temperature of the air that was taken. [degC]"]
    axes: Annotated[tuple[ThermalFit, ...], "One per motor that could be identified."]
    refused: Annotated[Texts, "Why the others could not, one sentence each."]
    gears: Annotated[
        GearsFound, "Temperatures of gears by the power meter, where torque gave none."
    ] = field(default_factory=GearsFound)

    def write(self, model: RobotModel) -> RobotModel:
        """Return a model with these networks and gears."""
        written = with_networks(model, self.axes, self.ambient_degc)
        return self.gears.write(written, [fit.name for fit in self.gears.fits])


def find_thermal(
    recordings: Sequence[Recording], model: RobotModel, ambient_degc: float | None, source: str
) -> ThermalReport:
    """Return thermal networks of motors, and gears by the power meter where torque gave none.

    Args:
        ambient_degc: Of the air; None: the coldest first reading. [degC]
    """
    runs = [runs_of_recordings(recordings, joint) for joint in range(len(model.joints))]
    fits, refused = list[ThermalFit](), list[str]()
    failure: NotIdentifiableError | None = None
    try:
        ambient, fits, refused = fit_networks(model.joint_names, runs, ambient_degc, source)
    except NotIdentifiableError as error:
        failure = error
        if not any(runs):
            raise
        ambient = ambient_of(runs) if ambient_degc is None else ambient_degc
    gears = GearsFound()
    if all(joint.gear is None for joint in model.joints):
        gears = gears_by_meter(recordings, ambient, source)
    if failure is not None:
        if not gears.fits:
            raise failure
        refused = [str(failure)]
    return ThermalReport("losses", ambient, tuple(fits), tuple(refused), gears)
