"""Temperatures as whole tenths of a degree, in one file as a user writes it."""

from robot_energy.inputs.temperatures.kinds import (
    Said,
    TemperatureKind,
    register_temperature_kind,
)


class Tenths:
    """``Int32MultiArray``: one value per joint of the source. [0.1 degC]"""

    fields = ("data",)

    def __init__(self, source):
        self._joints = source.joints

    def read(self, run):
        values = 0.1 * run.array("data")
        if values.shape[1] != len(self._joints):
            return "wrong_length"
        return Said(self._joints, values)


KIND = register_temperature_kind(
    TemperatureKind(
        name="std_msgs/msg/Int32MultiArray",
        label="tenths",
        line="whole tenths of a degree, in the order of the joints of the source",
        adapter=Tenths,
        headed=False,
        needs_joints=True,
        named=False,
    )
)
