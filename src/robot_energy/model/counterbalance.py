"""Counterbalances of joints in a model file: springs that carry part of the weight. Joint side.

Each has a potential energy U(q), so it takes nothing over a closed path, and the drive adds
``dU/dq``.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from robot_energy.model.figure import Figure, ModelEntry, PositiveFigure


class TorsionSpring(ModelEntry):
    """A spring about the axis of a joint: the drive adds ``stiffness (q - rest)``."""

    kind: Annotated[Literal["spring"], "``spring``."]
    stiffness: Annotated[PositiveFigure, "k. [N m/rad] or [N/m]"]
    rest: Annotated[Figure, "q0, position of the joint at which the spring is slack. [rad] or [m]"]


class LeverSpring(ModelEntry):
    """A tension spring on a lever, its force proportional to its length.

    The drive adds ``moment cos(q - angle)``. A weight has the same form; a spring that carries
    one has the opposite angle. With a stiffness k between two points at distances a and b from
    the axis the moment is k a b.
    """

    kind: Annotated[Literal["lever"], "``lever``."]
    moment: Annotated[PositiveFigure, "Greatest torque. [N m]"]
    angle: Annotated[
        Figure, "Position of the joint at which the drive adds the whole moment. [rad]"
    ]


class GasSpring(ModelEntry):
    """A gas spring between the link before a joint and the one behind it.

    Its length is ``l = sqrt(a^2 + b^2 - 2 a b cos(q - angle))``; it pushes its ends apart with
    ``F = force + rate (length - l)``, so the drive adds ``-F dl/dq`` with ``dl/dq = (a b / l)
    sin(q - angle)``.
    """

    kind: Annotated[Literal["gas_spring"], "``gas_spring``."]
    a: Annotated[PositiveFigure, "Distance of its fixed end from the axis. [m]"]
    b: Annotated[PositiveFigure, "Distance of its moved end from the axis. [m]"]
    angle: Annotated[
        Figure,
        "Position of the joint at which both ends lie on one side of the axis, in line with it: "
        "the gas spring is shortest there. [rad]",
    ]
    force: Annotated[PositiveFigure, "F at `length`. [N]"]
    rate: Annotated[PositiveFigure, "Rise of F per length that the gas is pressed together. [N/m]"]
    length: Annotated[PositiveFigure, "Length that `force` is stated for, usually extended. [m]"]

    @model_validator(mode="after")
    def _check(self) -> GasSpring:
        if not min(self.a.value, self.b.value) > 0.0 or self.a.value == self.b.value:
            raise ValueError("a and b must be > 0 and differ, or the spring can have no length")
        return self


Counterbalance = Annotated[TorsionSpring | LeverSpring | GasSpring, Field(discriminator="kind")]
