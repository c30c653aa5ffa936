"""A recording of any length in bounded memory: whole windows of it, evenly spread."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TypeVar

import numpy as np

from robot_energy.model import RobotModel
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.rigid_body import Robot
from robot_energy.physics.torque_limits import TorqueLimitWatch
from robot_energy.pipeline import Output
from robot_energy.timeline.blocks import Block, MeterBlock, PowerBlock, TorqueBlock

WINDOW_NS = 10_000_000_000
MAX_SAMPLES = 60_000  # kept; some 0.5 kB each for six joints
NEEDED = (
    "joint_position", "joint_velocity", "joint_acceleration", "motor_torque_measured",
    "shaft_power_measured", "motor_temperature_degc",
)  # fmt: skip
Kept = TypeVar("Kept", bound=Block)
Window = tuple[list[TorqueBlock], list[PowerBlock], list[MeterBlock]]


class Windows:
    """Keeps all windows, then every second one, every fourth, ... as they become too many."""

    def __init__(self, model: RobotModel) -> None:
        robot = Robot.from_model(model)
        self._limits = TorqueLimitWatch(robot.limits, Drivetrain.from_model(model))
        self._begin = self._samples = 0
        self._every = 1
        self._windows: dict[int, Window] = {}

    @property
    def beyond(self) -> dict[str, str]:
        """Joints of the whole recording that need more than their torque limit too often."""
        return self._limits.sentences()

    def take(self, output: Output) -> None:
        """Keep what one step gave."""
        if output.torque is not None:
            self._limits.step(output.torque)
        for kind, block in enumerate((output.torque, output.power, output.meter)):
            if block is None or not len(block):
                continue
            self._begin = self._begin or int(block.stamp_ns[0])
            number = (int(block.stamp_ns[0]) - self._begin) // WINDOW_NS
            if number % self._every:
                continue
            window = self._windows.setdefault(number, ([], [], []))
            window[kind].append(_needed(block))  # type: ignore[arg-type]
            if kind == 0:
                self._samples += len(block)
        while self._samples > MAX_SAMPLES and len(self._windows) > 1:
            self._every *= 2
            for number in [one for one in self._windows if one % self._every]:
                self._samples -= sum(map(len, self._windows.pop(number)[0]))

    def blocks(self) -> tuple[TorqueBlock, PowerBlock | None, MeterBlock | None]:
        """Return what is kept; a window that does not follow the one before is a segment."""
        torque: list[TorqueBlock] = []
        power: list[PowerBlock] = []
        meter: list[MeterBlock] = []
        for number, window in sorted(self._windows.items()):
            apart = number << 32 if self._every > 1 else 0
            torque += [replace(one, segment=one.segment + apart) for one in window[0]]
            power += [replace(one, segment=one.segment + apart) for one in window[1]]
            meter += window[2]
        return (
            TorqueBlock.concatenate(torque),
            PowerBlock.concatenate(power) if power else None,
            MeterBlock.concatenate(meter) if meter else None,
        )


def _needed(block: Kept) -> Kept:
    """Without the columns of each joint that no check looks at."""
    none = np.empty((len(block), 0))
    wide = {
        one.name: none
        for one in fields(block)
        if one.name not in NEEDED and np.ndim(getattr(block, one.name)) == 2
    }
    return replace(block, **wide)
