"""Choose the plan that needs least energy: ask a running energy_monitor before anything moves.

Needs a running ``energy_monitor``; it asks about one move at three speeds, in place of your own
plans. `joint_trajectories` takes what planners give: JointTrajectory, and of MoveIt
RobotTrajectory, DisplayTrajectory and MotionPlanResponse (moveit_msgs need not be installed).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from typing import Any

import rclpy
from builtin_interfaces.msg import Duration
from rclpy.node import Node
from ros2_energy_msgs.srv import CompareTrajectories
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

KR16 = [f"joint_a{number}" for number in range(1, 7)]


def joint_trajectories(plan: Any) -> list[JointTrajectory]:
    """Return the joint motions of a plan, whatever message it comes in."""
    if isinstance(plan, JointTrajectory):
        return [plan]
    if hasattr(plan, "joint_trajectory"):  # moveit_msgs/RobotTrajectory
        return [plan.joint_trajectory]
    if hasattr(plan, "trajectory"):  # MotionPlanResponse: one; DisplayTrajectory: several parts
        parts = plan.trajectory
        parts = parts if isinstance(parts, list | tuple) else [parts]
        return [one for part in parts for one in joint_trajectories(part)]
    raise TypeError(f"{type(plan).__name__} is not a plan with joint trajectories")


def costs(node: Node, plans: Iterable[Any], **options: Any) -> CompareTrajectories.Response:
    """Ask what each plan needs; the answer is also a cost for a planner that scores its plans."""
    request = CompareTrajectories.Request(**options)
    for plan in plans:
        parts = joint_trajectories(plan)
        if len(parts) != 1:
            raise ValueError(f"a plan of {len(parts)} parts: ask for each part")
        request.trajectories.append(parts[0])
    client = node.create_client(CompareTrajectories, "energy_monitor/compare_trajectories")
    if not client.wait_for_service(timeout_sec=20.0):
        raise TimeoutError("no energy_monitor answers; start one")
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future)
    return future.result()


def move(joint_names: list[str], seconds: float) -> JointTrajectory:
    """One move from rest to rest in a given time."""
    first = [0.0, -1.2, 1.2, 0.0, 0.3, 0.0]
    last = [0.8, -0.9, 0.9, 0.2, 0.5, 0.4]
    still = [0.0] * len(joint_names)
    points = [
        JointTrajectoryPoint(
            positions=positions,
            velocities=still,
            accelerations=still,
            time_from_start=Duration(sec=int(at), nanosec=round(at % 1.0 * 1e9)),
        )
        for positions, at in ((first, 0.0), (last, seconds))
    ]
    return JointTrajectory(joint_names=joint_names, points=points)


def main() -> int:
    """Ask, and print what each plan needs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--joints", nargs="+", default=KR16, help="names of six joints")
    parser.add_argument("--cycle-time", type=float, default=6.0, help="of every plan [s]")
    args = parser.parse_args()
    rclpy.init()
    try:
        node = rclpy.create_node("cheapest_plan")
        plans = [move(args.joints, seconds) for seconds in (1.5, 3.0, 6.0)]
        answer = costs(node, plans, cycle_time=args.cycle_time)
    finally:
        rclpy.shutdown()
    for number, one in enumerate(answer.candidates):
        print(f"plan {number}: {one.message}")
    print(answer.message)
    return 0 if answer.success else 1


if __name__ == "__main__":
    sys.exit(main())
