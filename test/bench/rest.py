"""Power at rest: held load alone, identified torque at rest, and measured torque.

    python test/bench/rest.py [--plants 10] [--first 300] [--warm-up] [--without EFFECT ...]

Drawn plants of the virtual rig with every effect (simulated), every second one with friction that
creeps until it carries a part of the load. Each is identified from three short recordings
with torque and one power meter, or from these and an hour of warm-up, then rests in 36 poses of
another program. Errors of the mean power of each rest from its second second on, over the mean
of all; RMS, and RMS about the mean. A plant whose programs cannot be drawn is left out and named.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np
from rich.console import Console

sys.path.insert(0, str(Path(__file__).parent.parent))

from warm_robots import AMBIENT, BODIES, RATE, SOAKED, WARM_UP, WarmPlant

from robot_energy.foundation.errors import MotionError
from robot_energy.model import RobotModel
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.timeline.blocks import EffortMeaning, Float, PowerBlock
from robot_energy_identify.api.identify import identify_all
from robot_energy_report.printing import table
from robot_energy_rig import RigConfig
from robot_energy_rig.config import RigOutput
from robot_energy_rig.record import outputs, record
from robot_energy_studies.learning_study import joint_block

CONSOLE = Console(width=110)
POSES, DWELL, SECONDS = 36, 4.0, 260.0
NONE, TORQUE = EffortMeaning.NONE, EffortMeaning.MOTOR_TORQUE


def errors(
    model: RobotModel, effort: EffortMeaning, pieces: list[RigOutput]
) -> tuple[Float, Float]:
    """Predicted less true power of each rest, and the true one. [W]"""
    pipeline = EnergyPipeline(model, Settings(effort=effort))
    found = [pipeline.step(joint_block(piece.joints), piece.temperatures) for piece in pieces]
    found.append(pipeline.flush())
    power = PowerBlock.concatenate([one.power for one in found if one.power is not None])
    truth = [piece.truth for piece in pieces]
    stamp = np.concatenate([one.stamp_ns for one in truth])
    speed = np.concatenate([one.motor_velocity for one in truth])
    still = np.abs(speed).max(axis=1) < 1e-9
    stretch = np.cumsum(np.diff(still, prepend=still[0]) != 0)
    true = np.concatenate([one.grid_power for one in truth])
    off, mean = list[float](), list[float]()
    for number in np.unique(stretch[still]).tolist():
        rows = np.flatnonzero(stretch == number)[round(RATE) : -1]
        if len(rows) >= RATE:
            predicted = np.interp(stamp[rows], power.stamp_ns, power.grid_power)
            off.append(float(predicted.mean() - true[rows].mean()))
            mean.append(float(true[rows].mean()))
    return np.array(off[:POSES]), np.array(mean[:POSES])


def rows_of(
    folder: Path, number: int, seed: int, config: RigConfig, warm_up: bool
) -> list[list[str]]:
    """Return the rows of one plant."""
    creeps = number % 2 == 1
    config = config.having("creep") if creeps else config
    plant = WarmPlant(folder, BODIES[number % len(BODIES)], seed, 1.0, config)
    bags = [
        record(plant.rig(at, plant.program(at, dwell, 1.0), degc), 90.0, folder / f"{seed}_{at}")
        for at, dwell, degc in zip((2, 3, 4), (0.5, 2.0, 0.5), SOAKED, strict=True)
    ]
    if warm_up:
        rig = plant.rig(0, plant.program(0, 1.0, plant.override), AMBIENT)
        bags.append(record(rig, WARM_UP, folder / f"{seed}_warm_up"))
    paths = [bag.path for bag in bags]
    model = identify_all(paths, plant.body, "motor_torque", held_out=False, skip=["thermal"]).model
    pieces = list(outputs(plant.rig(9, plant.program(9, DWELL, 1.0), 40.0), SECONDS, 20.0))
    name = plant.name.split(",")[0] + (", creeping" if creeps else "")
    rows: list[list[str]] = []
    for what, used, effort in (
        ("load alone", model.changed(hold=None), NONE),
        ("identified", model, NONE),
        ("measured", model, TORQUE),
    ):
        off, mean = errors(used, effort, pieces)
        share = 100.0 * off / mean.mean()
        about = share - share.mean()
        cells = (share.mean(), np.sqrt((share**2).mean()), np.sqrt((about**2).mean()))
        rows.append([name, what, f"{mean.mean():.0f}", *(f"{value:.1f}" for value in cells)])
    return rows


def main() -> int:
    """Print a row for each plant and torque."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", type=int, default=10, help="drawn plants, of three robots")
    parser.add_argument("--first", type=int, default=300, help="seed of the first plant")
    parser.add_argument("--warm-up", action="store_true", help="record one as well")
    parser.add_argument("--without", nargs="*", default=[], help="effects of the rig to leave out")
    args = parser.parse_args()
    config = RigConfig.hard().without(*args.without)
    warnings.simplefilter("ignore", RuntimeWarning)  # of fits that find nothing
    rows: list[list[str]] = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(args.plants):
            seed = args.first + number
            try:
                found = rows_of(Path(folder), number, seed, config, args.warm_up)
            except MotionError as error:
                print(f"{BODIES[number % len(BODIES)]} {seed} is left out: {error}", flush=True)
                continue
            for row in found:
                print(*row, sep=" | ", flush=True)
            rows += found
    whole = [
        ["median of all", what, "", *(
            f"{np.median([abs(float(row[at])) for row in rows if row[1] == what]):.1f}"
            for at in (3, 4, 5)
        )]
        for what in dict.fromkeys(row[1] for row in rows)
    ]  # fmt: skip
    heads = ("plant", "torque at rest", "mean W", "mean error %", "RMS %", "RMS about the mean %")
    table(CONSOLE, "virtual rig, drawn plants (simulated): power at rest", heads, rows + whole)
    return 0


if __name__ == "__main__":
    sys.exit(main())
