"""Power that flows whether the robot moves or not."""

from __future__ import annotations

import math

from robot_energy.blocks import MeterLocation
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.model.schema import RobotModel


def constant_power(model: RobotModel, location: MeterLocation = MeterLocation.GRID) -> float:
    """Return the losses that flow all the time: of the cabinet, and constants of the drives. [W]

    Args:
        model: The robot's model.
        location: Of the meter that sees them; at the DC bus the losses before it do not count.
    """
    kind = DRIVE_MODELS[model.drive]
    drives = [kind.constant_loss(entry) for entry in kind.entries(model.joints)]
    constant = model.cabinet.loss_dc.value + math.fsum(drives)
    at_grid = location is not MeterLocation.DC_BUS
    return constant + (model.cabinet.loss_grid.value if at_grid else 0.0)
