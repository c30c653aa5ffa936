"""What an energy is divided by: the path of the tool, and the work on the bodies."""

from __future__ import annotations

import numpy as np

from robot_energy.physics.rigid_body import Robot
from robot_energy.pipeline.energy_pipeline import Output
from robot_energy.timeline.blocks import (
    NANOSECOND,
    Float,
    TorqueBlock,
    differences,
    sum_over_joints,
)

TOOL = "tool0"  # frame of the tool in URDFs that follow REP-199
SLOT_NS = 100_000_000  # the tool is placed at the first sample of each: that costs most [ns]
MIN_STEP = 2e-4  # m; less is noise of the encoders


class WorkSums:
    """Integrates over what a pipeline gave.

    ``W = integral max(sum_i P_rigid,i, 0) dt``: what lifts and accelerates the bodies, before they
    give it back. The path is the sum of the ways of the tool between instants 100 ms apart, without
    steps below 0.2 mm, which are counted once they have added up; arcs count as their chords, 1.5 %
    less at 6 rad/s.

    Attributes:
        body_work: W. [J]
        tool_path: Path of the frame ``tool0``; NaN where the robot has none, or positions are not
            known. [m]
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._last: tuple[int, int, float] = (0, -1, 0.0)  # stamp, segment, power on the bodies
        self._slot = self._segment = -1
        self._place: Float | None = None
        self.body_work = 0.0
        self.tool_path = 0.0 if robot.has_link(TOOL) else np.nan

    def take(self, output: Output) -> None:
        """Take what a step of the pipeline gave."""
        if output.power is not None and len(output.power):
            block = output.power
            stamp, segment, before = self._last
            power = np.maximum(np.nan_to_num(sum_over_joints(block.rigid_power)), 0.0)
            time = differences(block.stamp_ns, stamp) * NANOSECOND
            time[differences(block.segment, segment) != 0] = 0.0
            self.body_work += 0.5 * float(power @ time + power[:-1] @ time[1:] + before * time[0])
            self._last = int(block.stamp_ns[-1]), int(block.segment[-1]), float(power[-1])
        if output.torque is not None and not np.isnan(self.tool_path):
            self._follow(output.torque)

    def _follow(self, block: TorqueBlock) -> None:
        if block.joint_position.shape[1] != self._robot.n_joints:
            self.tool_path = np.nan
            return
        begins = differences(block.stamp_ns // SLOT_NS, self._slot) != 0
        begins |= differences(block.segment, self._segment) != 0
        for row in np.flatnonzero(begins).tolist():
            place = self._robot.link_position(block.joint_position[row], TOOL)
            segment = int(block.segment[row])
            if self._place is None or segment != self._segment:
                self._place = place
            elif (way := float(np.linalg.norm(place - self._place))) >= MIN_STEP:
                self.tool_path += way
                self._place = place
            self._segment = segment
        self._slot, self._segment = int(block.stamp_ns[-1] // SLOT_NS), int(block.segment[-1])
