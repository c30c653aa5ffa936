"""A drive model with a fit of its own, in one file as a user writes it."""

import numpy as np

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model.drive_models import DriveModel, register_drive_model
from robot_energy.model.figure import ModelEntry, PositiveFigure


class SquareRoot(ModelEntry):
    """P_el = P_mech + loss sqrt(|w|)."""

    loss: PositiveFigure


class SquareRoots:
    """The drives of all joints."""

    def __init__(self, entries):
        self._loss = np.asarray([entry.loss.value for entry in entries])

    def input_power(self, shaft_power, motor_velocity, motor_torque, motor_temperature_degc):
        return shaft_power + self._loss * np.sqrt(np.abs(motor_velocity)), None


def fitted(axis, source):
    """Least squares on the samples of one drive."""
    samples = axis.samples
    root = np.sqrt(np.abs(samples.motor_velocity))
    if not root.any():
        raise NotIdentifiableError(f"{axis.name} does not move")
    lost = samples.drive_power - samples.motor_torque * samples.motor_velocity
    value = float(root @ lost / (root @ root))
    return SquareRoot(loss=PositiveFigure(value=value, tag="identified", source=source))


KIND = register_drive_model(
    DriveModel(
        name="square_root",
        label="loss by the root of speed",
        line="shaft power plus a loss that grows with the root of the speed",
        key="square_root",
        entry=SquareRoot,
        physics=SquareRoots,
        fitted=fitted,
        figures=(("loss", "loss", "W (s/rad)^0.5"),),
    )
)
