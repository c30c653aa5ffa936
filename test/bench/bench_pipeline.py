"""Cost of the pipeline per sample, live and in replay, beside the bare pin.rnea call."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
from recording import motion
from rich.table import Table

from robot_energy.blocks import JointBlock
from robot_energy.model import load
from robot_energy.pipeline import EnergyPipeline


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

        return go

    rnea = per_sample(bare, 4096)
    figures: dict[str, object] = {"rnea_us": rnea}
    table = Table(title="whole pipeline, 6 joints, per sample")
    for column in ("", "us/sample", "x bare pin.rnea"):
        table.add_column(column, justify="right" if column else "left")
    table.add_row("pin.rnea called from Python", f"{rnea:.2f}", "1.0")
    for block, samples in ((1, 512), (40, 4080), (4096, size)):
        cost = per_sample(pipeline(block, samples), samples)
        figures[f"block_{block}_us"] = cost
        what = {
            1: "blocks of 1",
            40: "blocks of 40 (live: 25 Hz ticks of a 1 kHz stream)",
            4096: "blocks of 4096 (replay)",
        }[block]
        table.add_row(what, f"{cost:.2f}", f"{cost / rnea:.1f}")
    return table, figures, {}
