"""Predict the energy of a motion program, cold and warm, before it is run."""

from pathlib import Path

import robot_energy as re

PROGRAM = Path(__file__).resolve().parents[1] / "programs" / "kr16_pick_and_place.yaml"

for temperature in (20.0, 40.0, 60.0):
    result = re.predict(PROGRAM, "kr16", temperature)
    energy = result.energy
    print(f"{temperature:.0f} degC: {energy.grid_import:.0f} J in {result.duration:.1f} s, "
          f"friction {energy.friction:.0f} J, brake resistor {energy.brake:.0f} J")  # fmt: skip
