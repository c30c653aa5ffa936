"""This project on the TX40 recording, from raw files to a saved model file."""

from __future__ import annotations

import json
import re
import sys
import tempfile
import time
from pathlib import Path

import clarabel  # noqa: F401  # imported before the clock starts, as FIGAROH's imports are
import numpy as np

from robot_energy.model import save
from robot_energy_identify.data.log_channels import model_of, read_channels
from robot_energy_identify.dynamics.dynamics import identify_dynamics
from robot_energy_identify.dynamics.dynamics_model import friction_at_joints, to_model
from robot_energy_logs.mapping import load_mapping

MAPPING = Path(__file__).resolve().parents[2] / "src/examples/identify/tx40.yaml"


def main(folder: Path) -> dict[str, float]:
    """Identify and return the figures."""
    with tempfile.TemporaryDirectory() as out:
        begin, spent = time.perf_counter(), time.process_time()
        log = load_mapping(MAPPING)
        model = model_of(log, [folder])
        (channels,) = read_channels([folder], log, model).values()
        result = identify_dynamics(channels, model)
        save(to_model(result), Path(out) / "tx40.yaml")
        wall, cpu = time.perf_counter() - begin, time.process_time() - spent
    peak = int(re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[1]) / 1024
    friction = friction_at_joints(result)
    worst = max(
        float(np.abs(friction[kind][0] / np.array(getattr(log.reference, kind)) - 1.0).max())
        for kind in friction
    )
    held, written = result.held_out(), result.held_out_consistent()
    return {
        "wall": wall,
        "cpu": cpu,
        "peak_mb": peak,
        "base": len(result.base),
        "inertial": result.n_inertial,
        "in_sample": result.in_sample.with_standstill,
        "held_out": held.with_standstill,
        "held_out_moving": held.total,
        "held_out_model_file": written.with_standstill,
        "friction_deviation": worst,
    }


if __name__ == "__main__":
    print(json.dumps(main(Path(sys.argv[1]))))
