"""What a robot carries: a rigid body fixed to a link, and whether one can exist."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field, ValidationError, model_validator

from robot_energy.errors import PayloadError
from robot_energy.model_file.figure import Entry, Number, Tag

ROUNDING = 1e-6  # of the largest principal moment: what figures in a datasheet are rounded by


class Payload(Entry):
    """A rigid body fixed to a link.

    Attributes:
        link: Link or frame of the URDF that carries it.
        mass: [kg]
        centre_of_mass: In the frame of ``link``. [m]
        inertia: Ixx, Iyy, Izz, Ixy, Ixz, Iyz about the centre of mass, axes of ``link``;
            all zero for a point mass. [kg m^2]
        tag: How these are known.
        source: Where they come from.
    """

    link: str
    mass: Annotated[Number, Field(ge=0)]
    centre_of_mass: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)
    inertia: tuple[Number, Number, Number, Number, Number, Number] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    tag: Tag
    source: str = ""

    @model_validator(mode="after")
    def _check(self) -> Payload:
        """No principal moment is negative or larger than the other two together."""
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
    """Make a payload of plain values, as they come from a message.

    Args:
        link: Link or frame of the URDF that carries it.
        mass: 0 for nothing. [kg]
        centre_of_mass: In the frame of ``link``, 3 values. [m]
        inertia: As in `Payload`, 6 values. [kg m^2]
        source: Where the figures come from.

    Raises:
        PayloadError: If no such body exists.
    """
    try:
        return Payload(
            link=link,
            mass=mass,
            centre_of_mass=tuple(float(value) for value in centre_of_mass),  # pyright: ignore
            inertia=tuple(float(value) for value in inertia),  # pyright: ignore
            tag="assumed",
            source=source,
        )
    except ValidationError as error:
        first = error.errors()[0]
        what = ".".join(str(part) for part in first["loc"])
        why = first["msg"].removeprefix("Value error, ")
        text = f"{what} is {first['input']}: {why}" if what else why
        raise PayloadError(
            f"the payload on '{link}' is refused: {text}", "a body that can exist"
        ) from error
