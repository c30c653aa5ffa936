"""RMS of predicted minus measured power, with the response of the meter and without.

    python test/bench/meter_response.py [--model FILE]

On the drawn test bags. The model is identified from the three drawn training bags, a minute or
two, or is FILE. Simulated.
"""

import argparse
import sys
from pathlib import Path

from robot_energy.model import load
from robot_energy.model.schema import Meter
from robot_energy.replay.bag_replay import replay
from robot_energy_identify.api.identify import identify_all

BAGS = Path(__file__).parents[2] / "bags"
TRAINING = [BAGS / f"drawn_train_{name}" for name in ("cold", "middle", "warm")]
TESTS = ("drawn_test_cold", "drawn_test_warm")
GOAL = 80.0  # W


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", help="identified before")
    args = parser.parse_args()
    if args.model:
        model = load(args.model)
    else:
        model = identify_all(TRAINING, "kr16", "motor_torque", held_out=False).model
    print(f"meter: {model.meter}")
    missed = 0
    for name in TESTS:
        rms, energy = [], []
        for used in (model.changed(meter=Meter()), model):
            result = replay(BAGS / name, used)
            rms.append(result.power_error.rms)
            energy.append(result.account.comparison.predicted_energy)
        missed += rms[1] > GOAL or energy[0] != energy[1]
        print(f"{name}: {rms[0]:.1f} W without the response, {rms[1]:.1f} W with it")
    print(f"goal: at most {GOAL:g} W with it, and the same energy: {'missed' if missed else 'met'}")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
