"""Bands and intervals on recordings that no fit has seen, each left out in turn.

    python test/bench/left_out.py [--data FOLDER] [--plants N] [--first SEED] [--seconds S]

Real robots, where ``--data`` or ``ROBOT_ENERGY_DATA`` names the folder of their recordings; then
plants of the rig drawn at random, three short recordings each: simulated. Three minutes.
"""

import argparse
import os
import sys
from pathlib import Path

import numpy as np

from robot_energy.foundation.files.temporary_folder import TemporaryFolder
from robot_energy_studies.ecbot import WITHOUT
from robot_energy_studies.left_out import drawn, ur3e, width_ratio, xarm_friction, yu_cobot

GOAL_UR3E = 4.0  # mean half width over the RMS of the errors
GOAL_DRAWN = 0.85  # of the energies within the band of 90 %


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
