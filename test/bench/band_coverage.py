"""Shares of measured powers and energies within the 90 % bands of predictions, on the rig.

    python test/bench/band_coverage.py [--quick] [--plants N] [--first SEED]

Ten plants drawn at random, with effects that no model has a term for (`simulate --plant-seed N
--hard`), five held-out runs of a minute each; then the standard plant. About fifteen minutes;
with --quick one plant. The constants of the bands were chosen on the plants 10 to 22 and 100 to
109, so the plants begin at 500.
"""

import argparse
import sys
from statistics import NormalDist

from robot_energy.files.temporary_folder import TemporaryFolder
from robot_energy_papers.band_coverage import RUNS, SHARES, band_coverage, score_quantiles, summary

GOALS = {
    "power, with meter": (0.87, 0.93),
    "energy, with meter": (0.87, 0.93),
    "power, without": (0.85, 1.0),
    "energy, without": (0.85, 1.0),
}
WITHIN = {run.name for run in RUNS[:3]}  # runs within the identified temperatures
MAX_STANDARD = 0.03  # half width of the energy of a minute on the standard plant


def shown(rows):
    for row in rows:
        print(
            f"{row.plant:10} {row.run:24} error {row.error:+7.1%}  band +- {row.half:6.1%}  "
            f"alone +- {row.half_alone:6.1%}  readings inside {row.inside / row.readings:6.1%}  "
            f"means inside, alone {row.inside_alone / row.means:6.1%}",
            flush=True,
        )
        yield row


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one plant")
    parser.add_argument("--plants", type=int, default=10)
    parser.add_argument("--first", type=int, default=500, metavar="SEED")
    args = parser.parse_args()
    plants = range(args.first, args.first + (1 if args.quick else args.plants))
    missed = 0
    with TemporaryFolder() as folder:
        rows = list(shown(band_coverage(folder.path, plants)))
        standard = list(shown(band_coverage(folder.path, [None], hard=False)))
    print(f"\n{len(rows)} runs of {len(plants)} plants; simulated")
    for name, share in summary(rows).items():
        goal = GOALS.get(name)
        text = ""
        if goal is not None:
            met = goal[0] <= share <= goal[1]
            missed += not met
            text = f"   goal {goal[0]:.0%} to {goal[1]:.0%}{'' if met else ', missed'}"
        print(f"{name:40} {share:6.1%}{text}")
    print("\nerrors over the standard deviation that the band implies")
    print(f"{'quantile':40}" + "".join(f"{share:8.0%}" for share in SHARES))
    normal = {"normal distribution": [NormalDist().inv_cdf(share) for share in SHARES]}
    for name, found in (normal | score_quantiles(rows)).items():
        print(f"{name:40}" + "".join(f"{value:+8.2f}" for value in found))
    widest = max(row.half for row in standard if row.run in WITHIN)
    missed += widest > MAX_STANDARD
    text = "" if widest <= MAX_STANDARD else ", missed"
    print(f"standard plant, widest band of a minute  {widest:6.1%}   goal {MAX_STANDARD:.0%}{text}")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
