"""Programs of any kind that can be made cheaper, by the end of their name."""

from __future__ import annotations

from pathlib import Path

from robot_energy.bag.reader import BagReader, TimeRange
from robot_energy.foundation.errors import MotionError
from robot_energy.model import RobotModel
from robot_energy.physics.rigid_body import Robot
from robot_energy_plan.motion.joint_trajectory import (
    MESSAGE,
    read_bag_trajectory,
    read_csv_trajectory,
)
from robot_energy_plan.motion.load_motion import BAG, GCODE, YAML, ToolOptions
from robot_energy_plan.optimization.gcode_form import GcodeForm
from robot_energy_plan.optimization.program_form import ProgramForm, PtpForm
from robot_energy_plan.optimization.trajectory_form import TrajectoryForm, recorded_motion
from robot_energy_plan.options import OptimizeOptions


def read_form(
    path: str | Path,
    model: RobotModel,
    robot: Robot,
    options: OptimizeOptions | None = None,
) -> ProgramForm:
    """Return a program that can be made cheaper.

    Args:
        path: YAML of point-to-point moves, G-code, a JointTrajectory as CSV or in a bag, or a
            bag of recorded joint states.
    """
    file = Path(path)
    given: OptimizeOptions = options or {}
    topic, time_range = given.get("topic"), TimeRange(given.get("start"), given.get("end"))
    if not file.exists():
        raise MotionError(f"there is no program '{path}'", "a file or a bag")
    if file.suffix.lower() in YAML and file.name != "metadata.yaml":
        return PtpForm(file, robot)
    if file.suffix.lower() in GCODE:
        tool = given.get("tool") or ToolOptions()
        return GcodeForm(file, robot, tool, given.get("max_feed", 1.0))
    if file.suffix.lower() == ".csv":
        return TrajectoryForm(read_csv_trajectory(file), robot, file)
    if file.suffix.lower() in BAG or file.is_dir():
        if holds_trajectory(file, topic) and not time_range:
            return TrajectoryForm(read_bag_trajectory(file, topic), robot, file)
        motion = recorded_motion(file, model, time_range, topic)
        return TrajectoryForm(motion, robot, file, recorded=True)
    raise MotionError(
        f"the program '{path}' cannot be made cheaper",
        f"moves ({', '.join(YAML)}), G-code ({', '.join(GCODE)}), a bag or .csv with a "
        "JointTrajectory, or a bag of recorded joint states",
    )


def holds_trajectory(path: Path, topic: str | None) -> bool:
    """Return whether a bag holds a JointTrajectory, else recorded motion."""
    topics = BagReader(path).topics
    named = topics if topic is None else {topic} & topics.keys()
    return any(topics[name].msgtype == MESSAGE for name in named)
