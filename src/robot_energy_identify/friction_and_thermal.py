"""Friction, gears, hold and thermal networks of all joints, as one identification finds them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import Annotated

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.results.base import Result, Texts
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.friction.apart import (
    recordings_apart,
    recordings_without_temperature,
)
from robot_energy_identify.friction.friction import FrictionFit, fit_axes, with_friction
from robot_energy_identify.friction.hold import HoldFit, fit_hold
from robot_energy_identify.friction.samples import friction_data
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
    with_networks,
)
from robot_energy_identify.thermal.windows import runs_of_recordings


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
    fits, refused = fit_axes(axes, source)
    if share:
        fits = share_shape(fits, axes, source)
    fits, implausible = check_friction(fits)
    hold = fit_hold(recordings, with_friction(model, fits, source))
    names = [part.path.name for part in recordings]
    apart = recordings_apart(names, axes, fits, model)
    apart += recordings_without_temperature(recordings)
    refused = (*refused, *implausible)
    return FrictionReport("measured", tuple(fits), refused, gears, hold, apart, falls)


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
