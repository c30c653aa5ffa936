"""Entries of a model file for motor temperatures that no sensor tells."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from robot_energy.model.figure import ModelEntry, PositiveFigure


class JointThermal(ModelEntry):
    """Thermal network of one motor: motor - structure - ambient, or motor - ambient.

    ``C_m dT_m/dt = P_m - G_m (T_m - T_s)`` and
    ``C_s dT_s/dt = P_s + G_m (T_m - T_s) - G_s (T_s - T_a)`` with the heat
    ``P_m = drive loss + share * friction power + idle`` and ``P_s`` the rest of the friction power;
    without structure ``T_s`` is the ambient.

    Attributes:
        capacity: C_m, heat capacity of the motor, > 0. [J/K]
        conductance: G_m, from the motor to the structure, or to the ambient without it. [W/K]
        structure_capacity: C_s, of gear and links around the motor, > 0. [J/K]
        structure_conductance: G_s, from the structure to the ambient. [W/K]
        friction_to_motor: Share of the friction power that heats the motor; without structure
            all of it does. At most 1. [-]
        idle: Heat of the motor while samples come, beyond its losses: brakes, electronics. [W]
        std: Error (RMS) of the temperature of a free run on recordings that the fit has not
            seen. [K]
    """

    capacity: PositiveFigure
    conductance: PositiveFigure
    structure_capacity: PositiveFigure | None = None
    structure_conductance: PositiveFigure | None = None
    friction_to_motor: PositiveFigure | None = None
    idle: PositiveFigure | None = None
    std: Annotated[float, Field(ge=0)] | None = None

    @model_validator(mode="after")
    def _check(self) -> JointThermal:
        if (self.structure_capacity is None) != (self.structure_conductance is None):
            raise ValueError("structure_capacity and structure_conductance: both or neither")
        if self.friction_to_motor is not None and self.structure_capacity is None:
            raise ValueError("friction_to_motor needs a structure that takes the rest")
        if self.friction_to_motor is not None and self.friction_to_motor.value > 1.0:
            raise ValueError(f"friction_to_motor <= 1, found {self.friction_to_motor.value}")
        above = ("capacity", "conductance", "structure_capacity", "structure_conductance")
        for key in above:
            figure = getattr(self, key)
            if figure is not None and not figure.value > 0.0:
                raise ValueError(f"{key} must be > 0, found {figure.value}")
        return self
