"""What a robot carries: a rigid body fixed to a link, and whether one can exist."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Annotated

import numpy as np
from pydantic import Field, ValidationError, model_validator

from robot_energy.foundation.described import documented
from robot_energy.foundation.errors import PayloadError
from robot_energy.foundation.schema_errors import refusal
from robot_energy.foundation.shown_text import shown
from robot_energy.model.figure import ModelEntry, Number, Tag

MAX_MASS = 10_000.0  # kg; the strongest industrial robots carry 2,300 kg
MAX_DISTANCE = 10.0  # m from the frame of the link to the centre of mass, along each axis
MAX_INERTIA = MAX_MASS * MAX_DISTANCE**2  # kg m^2
ROUNDING = 1e-6  # of the largest principal moment: what figures in a datasheet are rounded by


@documented
class Payload(ModelEntry):
    """A rigid body fixed to a link."""

    link: Annotated[str, "Link or frame of the URDF that carries it."]
    mass: Annotated[Number, Field(ge=0), "[kg]"]
    centre_of_mass: Annotated[tuple[Number, Number, Number], "In the frame of ``link``. [m]"] = (
        0.0,
        0.0,
        0.0,
    )
    inertia: Annotated[
        tuple[Number, Number, Number, Number, Number, Number],
        "Ixx, Iyy, Izz, Ixy, Ixz, Iyz about the centre of mass, axes of ``link``; all zero for a "
        "point mass. [kg m^2]",
    ] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    tag: Annotated[Tag, "How these are known."]
    source: Annotated[str, "Where they come from."] = ""

    @model_validator(mode="after")
    def _check(self) -> Payload:
        """A body of a size that a robot carries, with moments that a body can have."""
        for what, values, limit in (
            ("a mass [kg]", (self.mass,), MAX_MASS),
            ("a centre of mass [m]", self.centre_of_mass, MAX_DISTANCE),
            ("an inertia [kg m^2]", self.inertia, MAX_INERTIA),
        ):
            largest = max(abs(value) for value in values)
            if largest > limit:
                raise ValueError(f"{what} with {largest:g} is beyond {limit:g}")
        ixx, iyy, izz, ixy, ixz, iyz = self.inertia
        low, middle, high = np.linalg.eigvalsh([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
        shown = f"{low:.4g}, {middle:.4g}, {high:.4g} kg m^2"
        if low < -ROUNDING * abs(high):
            raise ValueError(f"no body has the principal moments of inertia {shown}: one is < 0")
        if high - low - middle > ROUNDING * high:
            raise ValueError(
                f"no body has the principal moments of inertia {shown}: the largest is more "
                "than the sum of the other two"
            )
        if not self.mass and high > 0:
            raise ValueError("a body without mass has no inertia")
        return self

    @property
    def tensor(self) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        """Inertia about the centre of mass, shape (3, 3). [kg m^2]"""
        ixx, iyy, izz, ixy, ixz, iyz = self.inertia
        return np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])


def payload(
    link: str,
    mass: float,
    centre_of_mass: Sequence[float] = (0.0, 0.0, 0.0),
    inertia: Sequence[float] = (0.0,) * 6,
    source: str = "set at run time",
) -> Payload:
    """Return a payload of plain values, as a message has them, tagged ``assumed``.

    Args:
        mass: 0 for nothing. [kg]
        centre_of_mass: In the frame of ``link``, 3 values. [m]
        inertia: As in `Payload`, 6 values. [kg m^2]
    """
    fields = {
        "link": link,
        "mass": mass,
        "centre_of_mass": [float(value) for value in centre_of_mass],
        "inertia": [float(value) for value in inertia],
        "tag": "assumed",
        "source": source,
    }
    try:
        return Payload.model_validate(fields)
    except ValidationError as error:
        source = f"the payload on '{link}' is refused"
        raise refusal(error, Payload, fields, source, PayloadError) from error


def several_carried(carried: Iterable[Payload]) -> str:
    """Return what the robot carries, where that is on more than one link, else nothing.

    Such as ``15 kg on 'flange' and 8 kg on 'tool0', 23 kg in all``.
    """
    bodies = [body for body in carried if body.mass]
    if len(bodies) < 2:
        return ""
    each = " and ".join(f"{body.mass:g} kg on '{shown(body.link)}'" for body in bodies)
    return f"{each}, {sum(body.mass for body in bodies):g} kg in all"
