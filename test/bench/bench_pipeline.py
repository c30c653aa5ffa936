"""Cost of the pipeline per sample, live and in replay, next to the bare pin.rnea call."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from recording import motion
from rich.table import Table

from robot_energy.certainty.deviation import CABINET_DEVIATIONS, JOINT_DEVIATIONS
from robot_energy.model import RobotModel, load
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.timeline.blocks import (
    EffortMeaning,
    JointBlock,
    Learning,
    MeterBlock,
    MeterLocation,
    MeterMeaning,
    TemperatureBlock,
)


def per_sample(run: Callable[[], None], samples: int, repeats: int = 5) -> float:
    """Median time of a run per sample. [us]"""
    times: list[float] = []
    for _ in range(repeats):
        begin = time.perf_counter()
        run()
        times.append(time.perf_counter() - begin)
    return statistics.median(times) / samples * 1e6


def run(folder: Path, quick: bool) -> tuple[Table, dict[str, object], dict[str, bool]]:
    """Measure blocks of 1, 40 (one tick at 1 kHz) and 4096."""
    del folder
    model = load("kr16")
    size = 4096 * (1 if quick else 8)
    stamp, position, velocity = motion(size, 1000.0)
    whole = JointBlock(
        stamp,
        np.zeros(size, np.int64),
        np.zeros(size, np.uint32),
        position,
        velocity,
        np.full_like(position, np.nan),
        np.full_like(position, np.nan),
    )
    robot = pin.buildModelFromXML(model.urdf_xml)
    data = robot.createData()

    def bare() -> None:
        for row in range(4096):
            pin.rnea(robot, data, position[row], velocity[row], velocity[row])

    def pipeline(block: int, samples: int) -> Callable[[], None]:
        def go() -> None:
            chain = EnergyPipeline(model)
            for begin in range(0, samples, block):
                chain.step(joints=whole[slice(begin, min(begin + block, samples))])
            chain.flush()

        return go

    rnea = per_sample(bare, 4096)
    figures: dict[str, object] = {"rnea_us": rnea}
    table = Table(title="whole pipeline, 6 joints, per sample")
    for column in ("", "us/sample", "x bare pin.rnea"):
        table.add_column(column, justify="right" if column else "left")
    table.add_row("pin.rnea called from Python", f"{rnea:.2f}", "1.0")
    for block, samples in ((1, 4080), (40, 4080), (4096, size)):
        cost = per_sample(pipeline(block, samples), samples)
        figures[f"block_{block}_us"] = cost
        what = {
            1: "blocks of 1",
            40: "blocks of 40 (of a 1 kHz stream; two make a step of the stages)",
            4096: "blocks of 4096 (replay)",
        }[block]
        table.add_row(what, f"{cost:.2f}", f"{cost / rnea:.1f}")
    shares, goals = _additions(model)
    for name, share in shares.items():
        table.add_row(f"{name}, of blocks of 40 with temperatures and a meter", f"{share:+.1%}", "")
    return table, {**figures, "added": shares}, goals


def _additions(model: RobotModel) -> tuple[dict[str, float], dict[str, bool]]:
    """What bands, learner and thermal observer add to the processor time of the pipeline.

    At 1 kHz in ticks of 25 Hz with effort, temperatures at 1 Hz and a meter at 10 Hz. The learner
    has a parameter, the observer a key of the model file; bands cannot be switched off, so this
    script puts zeros in the place of the deviations and scores no reading.
    """
    observed = with_thermal(model)
    variants: dict[str, Callable[[], EnergyPipeline]] = {
        "all": lambda: _chain(observed, Learning.OBSERVE),
        "bands": lambda: without_bands(_chain(observed, Learning.OBSERVE)),
        "learner": lambda: _chain(observed, Learning.OFF),
        "thermal observer": lambda: _chain(model, Learning.OBSERVE),
        "all three": lambda: without_bands(_chain(model, Learning.OFF)),
    }
    inputs = _ticks(20.0)
    times: dict[str, list[float]] = {name: [] for name in variants}
    for _ in range(5):  # interleaved, so that noise meets all alike
        for name, make in variants.items():
            chain = make()
            begin = time.process_time()
            for tick in inputs:
                chain.step(*tick)
            times[name].append(time.process_time() - begin)
    medians = {name: statistics.median(each) for name, each in times.items()}
    whole = medians.pop("all")
    added = {name: whole / without - 1.0 for name, without in medians.items()}
    goal = (
        f"bands, learner and observer add at most 15 % to the pipeline: {added['all three']:+.0%}"
    )
    return added, {goal: added["all three"] <= 0.15}


def _chain(model: RobotModel, learning: Learning) -> EnergyPipeline:
    return EnergyPipeline(model, Settings(learning=learning, effort=EffortMeaning.MOTOR_TORQUE))


def without_bands(chain: EnergyPipeline) -> EnergyPipeline:
    """Replace the deviations of each sample by zeros, and leave readings without a score."""
    columns = len(CABINET_DEVIATIONS) + len(JOINT_DEVIATIONS) * len(chain.model.joints)
    deviation: Any = chain.power._deviation  # nothing public switches it off
    calibration: Any = chain.account.calibration
    deviation.columns = lambda speed, *_, **__: np.zeros((len(speed), columns), order="F")
    calibration.step = lambda *_: None
    return chain


def with_thermal(model: RobotModel) -> RobotModel:
    """Give every joint a thermal network, so that temperatures are estimated."""
    figure = {"value": 1.0, "tag": "assumed", "source": "bench"}
    entry = {"capacity": {**figure, "value": 8e3}, "conductance": {**figure, "value": 4.0}}
    joints = [
        type(joint).model_validate({**joint.model_dump(exclude_none=True), "thermal": entry})
        for joint in model.joints
    ]
    return model.changed(joints=joints)


def _ticks(seconds: float) -> list[tuple[JointBlock, TemperatureBlock | None, MeterBlock | None]]:
    stamp, position, velocity = motion(round(seconds * 1000), 1000.0)
    effort = velocity + 0.5 * np.sign(velocity)
    ticks: list[tuple[JointBlock, TemperatureBlock | None, MeterBlock | None]] = []
    for number, begin in enumerate(range(0, len(stamp), 40)):
        rows = slice(begin, begin + 40)
        at = stamp[rows]
        none = np.full_like(position[rows], np.nan)
        count = np.zeros(len(at), np.int64), np.zeros(len(at), np.uint32)
        joints = JointBlock(at, *count, position[rows], velocity[rows], none, effort[rows])
        warm = TemperatureBlock(at[:1], np.full((1, 6), 20.0 + number * 0.01))
        nothing = np.array([np.nan])
        meter = MeterBlock(
            at[-1:], np.array([900.0 + number % 7]), nothing, nothing,
            MeterMeaning.INSTANTANEOUS, MeterLocation.GRID,
        )  # fmt: skip
        ticks.append(
            (joints, warm if number % 25 == 0 else None, meter if number % 3 == 0 else None)
        )
    return ticks
