"""FIGAROH on the TX40 recording: a script for its own environment, which has no robot_energy.

Calls FIGAROH's own identification class. What it leaves to the user is filled in here: reading
the files, motor to joint (coupled wrist, zero offsets of the URDF) and the three columns of the
coupled wrist. Prints its figures as one line of JSON.
"""

import json
import re
import sys
import time
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
from figaroh.identification.base_identification import BaseIdentification
from pinocchio import buildModelFromUrdf
from pinocchio.robot_wrapper import RobotWrapper

RATIO = np.diag([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])
RATIO[5, 4] = 32.0
ZERO = np.array([0.0, -np.pi / 2, np.pi / 2, 0.0, 0.0, 0.0])
RATE, FOLDS = 5000.0, 5


class Tx40(BaseIdentification):
    """The recording as FIGAROH wants it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        model = buildModelFromUrdf(str(folder / "tx40_mdh_modified.urdf"))  # without its meshes
        super().__init__(RobotWrapper(model), str(folder / "TX40_config.yaml"))
        self.identif_config["act_idxq"] = self.identif_config["act_idxv"] = list(range(6))
        self.filter_config["filter_params"] = {"f_butter": 100.0, "f_sample": RATE}

    def load_trajectory_data(self):
        """Joint positions and torques."""
        read = [
            np.loadtxt(self.folder / name, delimiter=",", skiprows=1)
            for name in ("pos_read_data.csv.gz", "curr_data.csv.gz")
        ]
        return {
            "timestamps": np.arange(len(read[0])) / RATE,
            "positions": read[0] @ np.linalg.inv(RATIO).T + ZERO,
            "velocities": None,
            "accelerations": None,
            "torques": read[1] @ RATIO,
        }

    def add_additional_parameters(self):
        """Friction and inertia of the motor that two joints turn."""
        v, a = self.processed_data["velocities"], self.processed_data["accelerations"]
        count = self.num_samples
        extra = np.zeros((6 * count, 3))
        fifth, sixth = slice(4 * count, 5 * count), slice(5 * count, None)
        extra[fifth, 0], extra[sixth, 0] = a[:, 5], a[:, 4]
        extra[fifth, 1], extra[sixth, 1] = v[:, 5], v[:, 4]
        extra[fifth, 2] = extra[sixth, 2] = np.sign(v[:, 4] + v[:, 5])
        self.dynamic_regressor = np.column_stack([self.dynamic_regressor, extra])
        self.standard_parameter.update({"Iam6": 0.0, "fvm6": 0.0, "fsm6": 0.0})


def held_out(columns: np.ndarray, torque: np.ndarray) -> float:
    """Refit FIGAROH's own rows without one contiguous block after the other."""
    columns, torque = columns.reshape(6, -1, columns.shape[1]), torque.reshape(6, -1)
    fold = np.arange(torque.shape[1]) * FOLDS // torque.shape[1]
    error = np.zeros_like(torque)
    for test in (fold == number for number in range(FOLDS)):
        train = columns[:, ~test].reshape(-1, columns.shape[2])
        values = np.linalg.lstsq(train, torque[:, ~test].ravel(), rcond=None)[0]
        error[:, test] = torque[:, test] - columns[:, test] @ values
    return float(np.linalg.norm(error) / np.linalg.norm(torque))


def main(folder: Path) -> dict[str, float]:
    """Identify and return the figures."""
    begin, spent = time.perf_counter(), time.process_time()
    tool = Tx40(folder)
    tool.initialize()
    tool.solve(decimate=True, decimation_factor=10, plotting=False)
    wall, cpu = time.perf_counter() - begin, time.process_time() - spent
    peak = int(re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[1]) / 1024
    rest = tool.tau_noised - tool.tau_identif
    return {
        "wall": wall,
        "cpu": cpu,
        "peak_mb": peak,
        "base": len(tool.params_base),
        "in_sample": float(np.linalg.norm(rest) / np.linalg.norm(tool.tau_noised)),
        "held_out": held_out(tool.dynamic_regressor_base, tool.tau_noised),
    }


if __name__ == "__main__":
    with redirect_stdout(sys.stderr):
        figures = main(Path(sys.argv[1]))
    print(json.dumps(figures))
