"""Friction by load: what `identify friction` finds of it, and what it is worth on another motion.

    python test/bench/load_friction.py [--body kr16] [--plants 3]

Drawn plants of the virtual rig with every effect (simulated), bodies known, two programs of 20
motions at 20 and 60 degC to identify from, and another at 40 degC to test. Errors are those of
the friction torque, over its RMS, without and with the term.
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

from robot_energy.model import RobotModel, load
from robot_energy.physics.friction import FrictionModel
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_identify.data.recordings import Recording, read_recording
from robot_energy_identify.friction.friction import FrictionFit, fit_friction, with_friction
from robot_energy_identify.friction.samples import FrictionData, friction_data, moving_samples
from robot_energy_identify.stats.cross_validation import relative_error
from robot_energy_papers.experiment import MOVES, make_programs
from robot_energy_papers.mantis import LEAD, AfterRest
from robot_energy_report.printing import table
from robot_energy_rig import RigConfig, VirtualRig, random_profile
from robot_energy_rig.record import record

CONSOLE = Console(width=110)
RATE = 250.0
RUNS = (("train", 20.0), ("train", 60.0), ("test", 40.0))


def runs(body: str, model: RobotModel, seed: int, folder: Path) -> list[Recording]:
    """Return the recordings of one plant."""
    profile = random_profile(body, seed)
    programs = make_programs(profile, seed, MOVES)
    found: list[Recording] = []
    for number, (name, degc) in enumerate(RUNS):
        program = getattr(programs, name)
        motion = AfterRest(program, program.period)
        rig = VirtualRig(
            profile, motion, RigConfig.hard(), 10 * seed + number, degc, degc, rate_hz=RATE
        )
        path = folder / f"{seed}_{number}"
        record(rig, program.period + 2.0 * LEAD, path)
        found.append(read_recording(path, model, EffortMeaning.MOTOR_TORQUE))
    return found


def error(model: RobotModel, joint: int, fit: FrictionFit, test: FrictionData) -> float:
    """Return the relative error of the friction torque of one axis. [-]"""
    friction = FrictionModel.from_model(with_friction(model, [fit], "bench"))
    shape = len(test), len(model.joints)
    speed, degc, rigid = (
        np.repeat(values[:, None], shape[1], axis=1)
        for values in (test.motor_velocity, test.motor_temperature_degc, test.load)
    )
    coulomb = np.broadcast_to(friction.coulomb, shape)
    standing = np.zeros(shape, dtype=np.bool_)
    torque = friction.torque(speed, rigid, coulomb, friction.viscous(degc), standing)[:, joint]
    return relative_error(torque - test.friction_torque, test.friction_torque)


def without_load(data: FrictionData) -> FrictionData:
    """Return the samples of an axis whose bodies are not known."""
    return FrictionData(**{**data.__dict__, "load": np.empty(0)})


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--body", default="kr16")
    parser.add_argument("--plants", type=int, default=3)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    model, rows = load(args.body), list[list[str]]()
    for seed in range(1, args.plants + 1):
        truth = random_profile(args.body, seed).load_coulomb
        with tempfile.TemporaryDirectory() as folder:
            recordings = runs(args.body, model, seed, Path(folder))
        for joint, name in enumerate(model.joint_names):
            data = friction_data(recordings[:2], joint)
            fits = fit_friction(without_load(data)), fit_friction(data)
            test = moving_samples(friction_data(recordings[2:], joint))
            plain, loaded = (f"{100 * error(model, joint, fit, test):.1f} %" for fit in fits)
            share = fits[1].load
            found = ["refused", "-"]
            if share is not None:
                found = [f"{100 * share[0]:.1f} +- {100 * share[1]:.1f} %", loaded]
            rows.append(
                [f"{seed} {name}", f"{100 * truth[joint]:.1f} %", found[0], plain, found[1]]
            )
    columns = ["plant, axis", "true share", "found", "error without", "with"]
    table(CONSOLE, f"friction by load, drawn plants of {args.body} (simulated)", columns, rows)


if __name__ == "__main__":
    main()
