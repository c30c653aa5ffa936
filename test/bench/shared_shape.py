"""What a lent temperature shape is worth on temperatures that the axis has not seen.

    ROBOT_ENERGY_DATA=... python test/bench/shared_shape.py

On the virtual rig, axis by axis: the axis is known from its coldest recording alone, the others
from all, and its friction torque is predicted on its warmest recording. On a real joint (xArm 6,
joint 3), where no second joint was recorded: the published shape of another robot (paper A, KUKA
KR 16) is lent to its samples from 29 degC on, and those up to 25 degC are predicted.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import tempfile
from pathlib import Path

import numpy as np
from rich.console import Console

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import load
from robot_energy.physics.friction import viscous_law
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_cli.main import main as command
from robot_energy_identify.data.recordings import read_recording
from robot_energy_identify.friction.friction import fit_axes
from robot_energy_identify.friction.laws import fit_law, nuisance
from robot_energy_identify.friction.samples import (
    FrictionData,
    friction_data,
    friction_data_of_log,
    moving_samples,
)
from robot_energy_identify.friction.shared_shape import TemperatureShape, common_shape, fit_shared
from robot_energy_logs.log_import import open_logs
from robot_energy_logs.mapping import load_mapping
from robot_energy_report.printing import table

ROOT = Path(__file__).resolve().parents[2]
DEGC = (20, 35, 50, 65)
# fv(T) = fv(20 degC) (0.206 + 2.089 exp(-T / 20.71 K)), as models/kr16.yaml quotes paper A
PAPER_A = TemperatureShape(
    0.206, 20.71, 0.0, 0.206 / 2.089, 0.0, 20.0, (20.0, 60.0), 0.0, ("paper A",)
)


def errors(train: FrictionData, test: FrictionData, shape: TemperatureShape) -> tuple[float, ...]:
    """RMS of the torque on test samples by a constant, the lent shape, and the axis's own law."""
    found: list[float] = []
    for law, fit in (fit_law("constant", train), fit_shared(train, shape)):
        curve = viscous_law(law).viscous(test.motor_temperature_degc)
        torque = fit.values[0] * test.sign + curve * test.motor_velocity + nuisance(fit, test)
        found.append(float(np.sqrt(np.mean((torque - test.friction_torque) ** 2))))
    return tuple(found)


def rig(robot: str, folder: Path) -> list[tuple[str, ...]]:
    """One row per axis."""
    model, recordings = load(robot), []
    for seed, degc in enumerate(DEGC):
        bag = folder / f"{robot}_{degc}"
        words = ["simulate", "--robot", robot, "--duration", "40", "--seed", str(seed)]
        with contextlib.redirect_stdout(io.StringIO()):
            assert not command([*words, "--start-temperature", str(degc), "--out", str(bag)])
        recordings.append(read_recording(bag, model, EffortMeaning.MOTOR_TORQUE))
    count = len(model.joints)
    fits, _ = fit_axes([friction_data(recordings, joint) for joint in range(count)])
    rows: list[tuple[str, ...]] = []
    for joint, name in enumerate(model.joint_names):
        cold, hot = (
            moving_samples(friction_data(part, joint)) for part in (recordings[:1], recordings[-1:])
        )
        try:
            shape = common_shape([fit for fit in fits if fit.name != name])
        except NotIdentifiableError as error:
            rows.append((f"rig, {robot} {name}", "-", "-", "-", error.found))
            continue
        constant, lent = errors(cold, hot, shape)
        rows.append(
            (f"rig, {robot} {name}", f"{constant:.4f}", f"{lent:.4f}", f"{lent / constant:.2f}",
             f"{len(shape.lenders)} axes, spread {100 * shape.spread:.0f} %")
        )  # fmt: skip
    return rows


def real(data: Path) -> list[tuple[str, ...]]:
    """The joint of the xArm, in the unit of its log."""
    mapping = load_mapping(ROOT / "src/examples/mappings/xarm6_joint3.yaml")
    logs = open_logs([str(data / "xarm6_j3/no_payload.csv.gz")], mapping)
    axis = moving_samples(
        friction_data_of_log([log.whole() for log in logs], mapping.joints.names, 0)
    )
    degc = axis.motor_temperature_degc
    warm, cold = axis[degc >= 29.0], axis[degc <= 25.0]
    constant, lent = errors(warm, cold, PAPER_A)
    return [("xArm 6 joint 3 [A]", f"{constant:.4f}", f"{lent:.4f}", f"{lent / constant:.2f}",
             "published shape of a KR 16")]  # fmt: skip


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", nargs="+", default=["kr16", "irb4600"])
    args = parser.parse_args()
    rows: list[tuple[str, ...]] = []
    with tempfile.TemporaryDirectory() as folder:
        for robot in args.robots:
            rows += rig(robot, Path(folder))
    data = Path(os.environ.get("ROBOT_ENERGY_DATA", "/nonexistent"))
    rows += real(data) if data.is_dir() else [("skipped: no data folder", "-", "-", "-", "-")]
    heads = ("axis", "constant", "lent shape", "ratio", "shape")
    table(Console(width=120), "RMS torque error on temperatures not seen [N m]", heads, rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
