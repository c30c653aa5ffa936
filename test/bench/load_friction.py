"""Friction by load and by a power of the speed: what `identify friction` finds, what it is worth.

    python test/bench/load_friction.py [--body kr16] [--plants 3]
    python test/bench/load_friction.py --terms --plants 5 --data FOLDER

Drawn plants of the virtual rig with every effect (simulated), bodies known, two programs of 20
motions at 20 and 60 degC to identify from, and another at 40 degC to test. Errors are those of
the friction torque, over its RMS, without and with the terms.

With ``--terms`` plants are robots of the second simulator, with bodies as `identify dynamics`
finds them, tested on other motions at other temperatures; for real recordings see `RECORDINGS`.
Errors are those of every term of friction, on torque that its fit has not seen.
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

import robot_energy as re
import sound_recordings
from friction_terms import TERMS, TermErrors, held_out_terms, term_errors
from robot_energy.model import RobotModel, load
from robot_energy.physics.friction import FrictionModel
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_identify.data.log_channels import model_of, read_channels
from robot_energy_identify.data.recordings import Recording, read_recording
from robot_energy_identify.dynamics.dynamics import identify_dynamics
from robot_energy_identify.dynamics.dynamics_model import to_model
from robot_energy_identify.friction.friction import (
    FrictionFit,
    fit_friction,
    fit_laws,
    with_friction,
)
from robot_energy_identify.friction.laws import folds_of_axis
from robot_energy_identify.friction.samples import (
    FrictionData,
    friction_data,
    friction_data_of_log,
    moving_rows,
    moving_samples,
)
from robot_energy_identify.stats.cross_validation import contiguous_folds, relative_error
from robot_energy_logs.log_import import open_logs
from robot_energy_logs.mapping import load_mapping
from robot_energy_logs.ur_rtde import import_ur_rtde
from robot_energy_papers.experiment import MOVES, make_programs
from robot_energy_papers.mantis import LEAD, AfterRest
from robot_energy_report.printing import table
from robot_energy_rig import RigConfig, VirtualRig, random_profile
from robot_energy_rig.record import record
from robot_energy_studies.independent import QUICK, published, recorded_sets
from robot_energy_studies.simulator.drawn import drawn_robot
from sound_recordings import IDENTIFY, MAPPINGS

CONSOLE = Console(width=180)
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
    """Return the relative error of the friction torque of one axis as a model file has it. [-]"""
    friction = FrictionModel.from_model(with_friction(model, [fit], "bench"))
    shape = len(test), len(model.joints)
    speed, degc, rigid = (
        np.repeat(values[:, None], shape[1], axis=1)
        for values in (test.motor_velocity, test.motor_temperature_degc, test.load)
    )
    coulomb = np.broadcast_to(friction.coulomb, shape)
    standing = np.zeros(shape, dtype=np.bool_)
    torque = friction.torque(
        speed, coulomb, friction.viscous(degc), motor_torque_rigid=rigid, standing=standing
    )[:, joint]
    return relative_error(torque - test.friction_torque, test.friction_torque)


def independent_plant(seed: int) -> dict[str, TermErrors]:
    """Return the errors of each axis of a robot of the second simulator."""
    robot = drawn_robot(seed)
    with tempfile.TemporaryDirectory() as folder:
        made = recorded_sets(robot, seed, QUICK, Path(folder))
        bags = [entry.path for entry in made.train]
        model = re.identify_dynamics(bags, published(robot), "motor_torque").model
        train, test = (
            [read_recording(path, model, EffortMeaning.MOTOR_TORQUE) for path in paths]
            for paths in (bags, [entry.path for entry in made.test])
        )
    return {
        name: term_errors(
            moving_samples(friction_data(train, joint)), moving_samples(friction_data(test, joint))
        )
        for joint, name in enumerate(model.joint_names)
    }


def in_motion(data: FrictionData) -> FrictionData:
    """Return the samples in motion, also where they are too few for `identify friction`."""
    return data[moving_rows(data)]


def kr300(data: Path, folder: Path) -> dict[str, TermErrors]:
    """Bodies and friction from one recording of 10 s, tested on the other, both ways."""
    mapping = load_mapping(IDENTIFY / "kr300.yaml")
    first = model_of(mapping, [data / "kr300", IDENTIFY])
    parts = read_channels([data / "kr300"], mapping, first).values()
    models = [to_model(identify_dynamics([one], first)) for part in parts for one in part]
    bags = [sound_recordings.kr300(data, folder, part).bag for part in "AB"]
    found: dict[str, TermErrors] = {}
    for ways, model in enumerate(models):
        train, test = (
            [read_recording(bag, model, EffortMeaning.MOTOR_TORQUE)]
            for bag in (bags[ways], bags[1 - ways])
        )
        for joint, name in enumerate(model.joint_names):
            data_of = (in_motion(friction_data(part, joint)) for part in (train, test))
            found[f"{name}, {'AB'[1 - ways]} from {'AB'[ways]}"] = term_errors(*data_of)
    return found


def tx40(data: Path, folder: Path) -> dict[str, TermErrors]:
    """Bodies from the whole recording of 9 s; friction in five blocks, each from the others."""
    one = sound_recordings.tx40(data, folder)
    return by_folds(one.model, [read_recording(one.bag, one.model, one.effort)])


def ur3e(data: Path, folder: Path) -> dict[str, TermErrors]:
    """Bodies and torque constants of the shipped model; three recordings of 5 s in all."""
    model, recordings = load("ur3e"), list[Recording]()
    for file in sorted((data / "rad_ur3e").glob("L*.csv")):
        import_ur_rtde([file], folder / file.stem)
        recordings.append(read_recording(folder / file.stem, model, EffortMeaning.MOTOR_CURRENT))
    return by_folds(model, recordings)


def by_folds(model: RobotModel, recordings: list[Recording]) -> dict[str, TermErrors]:
    """Return the errors on recordings held out, or on blocks where an axis moves in one alone."""
    found: dict[str, TermErrors] = {}
    for joint, name in enumerate(model.joint_names):
        data = in_motion(friction_data(recordings, joint))
        if len(data):
            several = len(np.unique(data.run)) > 1
            found[name] = held_out_terms(data, data.run if several else contiguous_folds(len(data)))
    return found


def xarm6(data: Path, folder: Path) -> dict[str, TermErrors]:
    """85 runs of one joint at steady speeds, 20 to 38 degC; temperatures held out. [A]"""
    del folder
    logs = open_logs(
        [data / "xarm6_j3/no_payload.csv.gz"], load_mapping(MAPPINGS / "xarm6_joint3.yaml")
    )
    seen = moving_samples(friction_data_of_log([log.whole() for log in logs], ["joint3"], 0))
    return {"joint3": held_out_terms(seen, folds_of_axis(seen)[1])}


RECORDINGS = {"KR 300": kr300, "TX40": tx40, "UR3e": ur3e, "xArm 6": xarm6}
"""Real recordings, and how bodies and friction of each are known; none knows its friction."""


def terms(plants: int, data: Path | None) -> None:
    """Print the errors of every term."""
    found: dict[str, dict[str, TermErrors]] = {}
    for seed in range(1, plants + 1):
        found[f"plant {seed} (simulated)"] = independent_plant(seed)
    for name, recording in {} if data is None else RECORDINGS.items():
        with tempfile.TemporaryDirectory() as folder:
            found[f"{name} (real)"] = recording(data, Path(folder))
    rows = [
        [f"{name}, {axis}", f"{one.torque:.3g}", *shares(one), one.shown]
        for name, axes in found.items()
        for axis, one in axes.items()
    ]
    columns = ["axis", "RMS, N m or A", *TERMS, "found"]
    table(CONSOLE, "error of the friction torque that no fit has seen, over it", columns, rows)
    simulated = [one for name in found if "simulated" in name for one in found[name].values()]
    groups = {"drawn plants (simulated)": simulated} if simulated else {}
    groups |= {name: list(axes.values()) for name, axes in found.items() if "real" in name}
    table(
        CONSOLE,
        "the same: median, least and greatest over the axes",
        ["recordings", "axes", *TERMS],
        [[name, *spread(group)] for name, group in groups.items()],
    )


def shares(one: TermErrors) -> list[str]:
    """Return the relative errors in words; - where the samples do not determine a term."""
    values = one.relative.values()
    return ["-" if np.isnan(value) else f"{100 * value:.1f} %" for value in values]


def spread(group: list[TermErrors]) -> list[str]:
    """Return how many axes there are, and median and range of each term where it can be fitted."""
    words = [str(len(group))]
    for name in TERMS:
        known = [100 * one.relative[name] for one in group if not np.isnan(one.relative[name])]
        text = f"{np.median(known):.1f} ({min(known):.1f} to {max(known):.1f}) %" if known else "-"
        words.append(text if len(known) in (0, len(group)) else f"{text}, of {len(known)}")
    return words


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--body", default="kr16")
    parser.add_argument("--plants", type=int, default=3)
    parser.add_argument("--terms", action="store_true", help="every term, on other recordings")
    parser.add_argument("--data", type=Path, help="folder of the real recordings, with --terms")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    if args.terms:
        terms(args.plants, args.data)
        return
    model, rows = load(args.body), list[list[str]]()
    for seed in range(1, args.plants + 1):
        truth = random_profile(args.body, seed)
        with tempfile.TemporaryDirectory() as folder:
            recordings = runs(args.body, model, seed, Path(folder))
        for joint, name in enumerate(model.joint_names):
            data = friction_data(recordings[:2], joint)
            plain, fit = fit_laws(data), fit_friction(data)
            test = moving_samples(friction_data(recordings[2:], joint))
            errors = [f"{100 * error(model, joint, one, test):.1f} %" for one in (plain, fit)]
            share = exponent = "refused"
            if fit.load is not None:
                share = f"{100 * fit.load[0]:.1f} +- {100 * fit.load[1]:.1f} %"
            if fit.exponent is not None:
                exponent = f"{fit.exponent[0]:.2f} +- {fit.exponent[1]:.2f}"
            rows.append(
                [
                    f"{seed} {name}",
                    f"{100 * truth.load_coulomb[joint]:.1f} %",
                    share,
                    f"{truth.hard.viscous_exponent:.2f}",
                    exponent,
                    errors[0],
                    errors[1] if (fit.load, fit.exponent) != (None, None) else "-",
                ]
            )
    columns = ["plant, axis", "true share", "found", "true exponent", "found"]
    columns += ["error without", "with"]
    table(
        CONSOLE,
        f"friction by load and speed, drawn plants of {args.body} (simulated)",
        columns,
        rows,
    )


if __name__ == "__main__":
    main()
