"""Entries of a model file for loads outside of the cabinet: pump, panel, extruder, control."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from robot_energy.model.figure import ModelEntry, PositiveFigure

MAX_LOADS = 32


class AuxiliaryLoad(ModelEntry):
    """A load at the outlet of the cell, not part of the robot's cabinet (paper B, figure 1)."""

    name: Annotated[
        str,
        Field(min_length=1, pattern=r"^[A-Za-z][A-Za-z0-9_]*$"),
        "Unique; in topics, tables and pictures.",
    ]
    states: Annotated[
        dict[str, PositiveFigure],
        Field(min_length=1, max_length=256),
        "Power of each state by its name, such as ``off`` and ``on``, in the order of their "
        "numbers from 0; a load without states has one. [W]",
    ]
    state: Annotated[
        str | None,
        "The state in force before a message says another; absent: it is not known then, unless "
        "there is only one.",
    ] = None
    metered: Annotated[
        bool,
        "Whether a meter of its own measures it. Its power is then what that says; where it says "
        "nothing, the power is not known, whatever the states.",
    ] = False

    @model_validator(mode="after")
    def _check(self) -> AuxiliaryLoad:
        if self.state is not None and self.state not in self.states:
            known = ", ".join(self.states)
            raise ValueError(f"state is '{self.state}'; expected one of {known}")
        return self

    @property
    def state_names(self) -> tuple[str, ...]:
        return tuple(self.states)

    @property
    def initial(self) -> str | None:
        """The state in force before a message says another; None if it is not known."""
        return self.state or (self.state_names[0] if len(self.states) == 1 else None)
