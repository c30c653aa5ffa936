"""Kinds of a user in one file each, `test/unit/kinds/toy_*.py`, and a robot that has them."""

import os

import pytest

from places import ROOT
from robot_energy.foundation import kinds
from robot_energy.foundation.errors import ModelFileError
from robot_energy.inputs.meter.kinds import METER_KINDS
from robot_energy.inputs.temperatures.kinds import TEMPERATURE_KINDS
from robot_energy.model import validate
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy_logs.log_formats import LOG_FORMATS
from robots import figure, wheel_data

TOYS = os.pathsep.join(map(str, sorted((ROOT / "test/unit/kinds").glob("toy_*.py"))))
INT32, TOY = "std_msgs/msg/Int32", "constant_efficiency"
TENTHS, SQUARE_ROOT = "std_msgs/msg/Int32MultiArray", "square_root"
SECOND, RATE, SPAN = 10**9, 100, 10
EFFICIENCY = 0.7


def forget():
    """Take out what the files registered."""
    for table, names in (
        (DRIVE_MODELS, (TOY, SQUARE_ROOT)),
        (METER_KINDS, (INT32,)),
        (TEMPERATURE_KINDS, (TENTHS,)),
        (LOG_FORMATS, ("angles",)),
    ):
        for name in names:
            table.remove(name)
    kinds._loaded.clear()


def wheel(**changes):
    """One joint without gravity; its motor needs 0.5 + 0.02 * 10 = 0.7 N m at 10 rad/s."""
    data = {**wheel_data(), "drive": TOY}
    joint = data["joints"][0]
    joint[TOY] = {"efficiency": figure(EFFICIENCY)}
    joint.update(changes.pop("joint", {}))
    return {**data, **changes}


def refused(data):
    with pytest.raises(ModelFileError) as error:
        validate(data, "toy.yaml")
    return error.value
