"""`robot-energy replay` without printing, and where its time goes."""

from __future__ import annotations

import time

from robot_energy.bag import BagReader
from robot_energy.foundation.process_memory import keep_freed_memory
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.model import load
from robot_energy.physics.rigid_body import Robot
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.setup import ReplaySetup


def ahead(bag: str, model_name: str, processes: str) -> dict[str, float]:
    """Replay in several processes."""
    keep_freed_memory()
    model = load(model_name)
    begin = time.perf_counter()
    result = replay(bag, model, ReplaySetup(processes=int(processes)))
    wall = time.perf_counter() - begin
    return {"wall": wall, "energy": result.account.registers.cabinet("grid_import")}


def main(bag: str, model_name: str) -> dict[str, float]:
    """Replay, then time the reading and the dynamics of the same samples alone."""
    keep_freed_memory()  # as the command does
    model = load(model_name)
    begin = time.perf_counter()
    result = replay(bag, model)
    total = time.perf_counter() - begin

    ingest, robot = JointStateIngest(model.joint_names), Robot.from_model(model)
    reading = dynamics = 0.0
    parts = BagReader(bag).parts(["/joint_states", "/motor_temperatures", "/power_meter"])
    while True:
        begin = time.perf_counter()
        part = next(parts, None)
        if part is None:
            break
        block = ingest.step(part["/joint_states"])
        reading += time.perf_counter() - begin
        if block is not None:
            begin = time.perf_counter()
            robot.joint_torque(block.joint_position, block.joint_velocity, block.joint_velocity)
            dynamics += time.perf_counter() - begin
    return {
        "wall": total,
        "reading": reading / total,
        "dynamics": dynamics / total,
        "rest": 1 - (reading + dynamics) / total,
        "energy": result.account.registers.cabinet("grid_import"),
    }
