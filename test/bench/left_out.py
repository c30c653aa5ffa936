"""Bands and intervals on recordings that no fit has seen, each left out in turn.

    python test/bench/left_out.py [--data FOLDER] [--plants N] [--first SEED] [--seconds S]

Real robots, where ``--data`` or ``ROBOT_ENERGY_DATA`` names the folder of their recordings; then
plants of the rig drawn at random, three short recordings each: simulated. Three minutes.

Real robots: the energy of a UR3e at its DC bus, whose friction was never measured and stays at its
prior; the energy of a Yu-Cobot with measured torque; the friction power of an xArm 6 at
temperatures that were left out. `robot_energy_studies.ecbot.WITHOUT` says why others have no power.
Plants of the rig have the bodies of the UR3e, all effects, and friction and losses that its model
file does not know; their recordings have no torque.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np

from robot_energy.certainty.deviation import FORM_SHARE, Z90
from robot_energy.foundation.described import Described
from robot_energy.foundation.files.temporary_folder import TemporaryFolder
from robot_energy.model import RobotModel, load
from robot_energy.physics.friction import viscous_law
from robot_energy.replay.bag_replay import replay
from robot_energy.results.replay import replay_report
from robot_energy_identify.api.bag_source import BagSource
from robot_energy_identify.drives.all_drives import find_drives
from robot_energy_identify.drives.drive_data import drive_data
from robot_energy_identify.drives.total_covariance import total_covariance
from robot_energy_identify.drives.total_power import fit_total, predict
from robot_energy_identify.drives.total_sums import sums
from robot_energy_identify.friction.friction import fit_friction
from robot_energy_identify.friction.laws import fit_law, nuisance
from robot_energy_identify.friction.samples import friction_data_of_log, moving_samples
from robot_energy_logs.log_formats import LOG_FORMATS
from robot_energy_logs.log_import import open_logs
from robot_energy_logs.mapping import load_mapping
from robot_energy_rig import RigConfig, random_profile
from robot_energy_studies.band_coverage import DrawnRig, Recorded
from robot_energy_studies.ecbot import EXAMPLES, WITHOUT, cobot_data

DEGC = (30.0, 34.0, 38.0)  # of motors and gears at the start of each short recording
DWELL, RATE = 0.2, 50.0  # s of rest after every motion; Hz of the joint states
MIN_SAMPLES = 100  # of friction at one temperature
GOAL_UR3E = 4.0  # mean half width over the RMS of the errors
GOAL_DRAWN = 0.85  # of the energies within the band of 90 %


class LeftOut(Described):
    """One recording, or temperature, that the fit has not seen."""

    robot: str
    name: str
    error: Annotated[float, "Predicted over measured, less 1. [-]"]
    half: Annotated[float, "Half width of the 90 % band over what is predicted. [-]"]

    @property
    def inside(self) -> bool:
        """Whether the band holds what was measured."""
        return abs(self.error) <= self.half


def width_ratio(rows: Sequence[LeftOut]) -> float:
    """Return the mean half width over the RMS of the errors; 1.64 for normal errors. [-]"""
    errors = np.array([row.error for row in rows])
    return float(np.mean([row.half for row in rows]) / np.sqrt(np.mean(errors**2)))


def energies(robot: str, bags: Sequence[Path], model: RobotModel) -> Iterator[LeftOut]:
    """Yield the energy at the meter of each bag, with the losses of the drives from the others."""
    for left_out in bags:
        others = [bag for bag in bags if bag != left_out]
        recordings = BagSource(others).recordings(model)
        data = drive_data(recordings, [None] * len(others), measured_torque=False)
        known, _ = find_drives(data, model).write(model, "the others")
        found = replay_report(replay(left_out, known)).comparison
        error, half = found.predicted_minus_measured_relative, found.half_relative
        yield LeftOut(robot, left_out.stem, float(error or 0.0), float(half or 0.0))


def ur3e(folder: Path) -> Iterator[LeftOut]:
    """Yield the energies of a UR3e at its DC bus, by the RTDE interface.

    Args:
        folder: With ``L*.csv``.
    """
    model, recording = load("ur3e"), LOG_FORMATS["ur-rtde"].recording
    assert recording is not None
    with TemporaryFolder() as scratch:
        bags = [
            recording(str(file), scratch.path / file.stem, model.joint_names).bag
            for file in sorted(folder.glob("L*.csv"))
        ]
        yield from energies("UR3e", [Path(bag) for bag in bags], model)


def yu_cobot(file: Path) -> Iterator[LeftOut]:
    """Yield the energies of a Yu-Cobot with measured torque of its motors, at its DC supply."""
    pieces = sums(cobot_data(file), None)
    for number in np.unique(pieces.recording).tolist():
        out = pieces.recording == number
        train, test = pieces[~out], pieces[out]
        fit = fit_total(train)
        covariance = total_covariance(train, fit, None, None)
        assert covariance is not None
        weight = test.duration / test.duration.sum()
        terms = np.concatenate([[1.0], weight @ test.terms.reshape(len(test), -1)])
        predicted = float(weight @ predict(test, fit))
        of_form = FORM_SHARE * (predicted - float(weight @ test.shaft) - fit.constant)
        variance = float(terms @ np.array(covariance.matrix) @ terms) + of_form**2
        error = predicted / float(weight @ test.measured) - 1.0
        yield LeftOut("Yu-Cobot", str(number + 1), error, Z90 * variance**0.5 / predicted)


def xarm_friction(file: Path) -> Iterator[LeftOut]:
    """Yield the friction power of joint 3 of an xArm 6 at each temperature, fitted to the others.

    Motor current stands for torque.
    """
    mapping = load_mapping(EXAMPLES / "mappings" / "xarm6_joint3.yaml")
    rows = [log.whole() for log in open_logs([str(file)], mapping)]
    axis = moving_samples(friction_data_of_log(rows, mapping.joints.names, 0))
    degc = np.rint(axis.motor_temperature_degc)
    for at in np.unique(degc).tolist():
        out = degc == at
        if out.sum() < MIN_SAMPLES:
            continue
        fit, unseen = fit_friction(axis[~out]), axis[out]
        rest = nuisance(fit_law(fit.chosen, axis[~out])[1], unseen)
        curve, speed = viscous_law(fit.law), np.abs(unseen.motor_velocity)
        temperature = unseen.motor_temperature_degc
        power = float(np.mean(fit.coulomb * speed + curve.viscous(temperature) * speed**2))
        measured = float(np.mean((unseen.friction_torque - rest) * unseen.motor_velocity))
        std = np.hypot(fit.coulomb_std * np.mean(speed), np.mean(curve.std(temperature) * speed**2))
        half = Z90 * float(std) / power
        yield LeftOut("xArm 6, joint 3", f"{at:.0f} degC", power / measured - 1.0, half)


def drawn(folder: Path, seeds: Sequence[int], seconds: float) -> Iterator[LeftOut]:
    """Yield the energies of drawn plants with the bodies of the UR3e at the grid.

    Args:
        folder: For their bags.
        seeds: Of the plants.
        seconds: Of each recording. [s]
    """
    model = load("ur3e")
    for seed in seeds:
        rig = DrawnRig(random_profile("ur3e", seed), RigConfig.hard(), folder / str(seed))
        short = [Recorded(f"{degc:.0f} degC", degc, seconds, DWELL, rate=RATE) for degc in DEGC]
        bags = [rig.record(one, 10 * seed + place) for place, one in enumerate(short)]
        yield from energies(f"plant {seed}", bags, model)


def shown(title, rows):
    """Print some rows and what they come to; return them."""
    kept = []
    for row in rows:
        kept.append(row)
        print(f"{row.robot:16} {row.name:12} error {row.error:+7.2%}  band +- {row.half:6.2%}",
              flush=True)  # fmt: skip
    inside, errors = sum(row.inside for row in kept), np.array([row.error for row in kept])
    print(
        f"{title}: {inside} of {len(kept)} within; RMS error {np.sqrt(np.mean(errors**2)):.2%}, "
        f"mean half width {np.mean([row.half for row in kept]):.2%}, "
        f"ratio {width_ratio(kept):.2f}\n",
        flush=True,
    )
    return kept


def main():
    """Print the tables; exit code 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=os.environ.get("ROBOT_ENERGY_DATA"))
    parser.add_argument("--plants", type=int, default=12)
    parser.add_argument("--first", type=int, default=5200, metavar="SEED")
    parser.add_argument("--seconds", type=float, default=12.0, help="of each drawn recording")
    args = parser.parse_args()
    missed = False
    if args.data is None:
        print("real robots: skipped, no data folder (ROBOT_ENERGY_DATA)\n")
    else:
        data = Path(args.data)
        rows = shown("energy of the UR3e", ur3e(data / "rad_ur3e"))
        missed |= width_ratio(rows) > GOAL_UR3E or not all(row.inside for row in rows)
        shown("energy of the Yu-Cobot", yu_cobot(data / "voraus" / "test.parquet"))
        shown(
            "friction power of the xArm 6, a temperature left out",
            xarm_friction(data / "xarm6_j3" / "no_payload.csv.gz"),
        )
        for name, why in WITHOUT.items():
            print(f"{name}: no energy, {why}")
        print()
    with TemporaryFolder() as folder:
        seeds = range(args.first, args.first + args.plants)
        rows = shown("energy of drawn plants", drawn(folder.path, seeds, args.seconds))
    missed |= sum(row.inside for row in rows) < GOAL_DRAWN * len(rows)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
