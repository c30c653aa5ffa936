"""Replay a recorded bag and show where its energy went."""

from pathlib import Path

import numpy as np

import robot_energy as re

BAGS = Path(__file__).resolve().parents[3] / "bags"

result = re.replay(BAGS / "kr16_cold", model="kr16")

energy, comparison = result.energy, result.comparison
print(f"from the grid {energy.grid_import:.0f} J, friction {energy.friction:.0f} J")
print(f"measured {comparison.measured_energy:.0f} J, coverage {comparison.coverage:.1%}")
print(f"predicted minus measured {comparison.predicted_minus_measured_relative:+.1%}")
for joint in result.joints:
    print(f"{joint.name}: friction {joint.friction_energy:.0f} J, last motor temperature "
          f"{joint.last_motor_temperature_degc:.1f} degC")  # fmt: skip

power = result.power  # one row per sample; power.to_pandas() makes a data frame of it
peak = int(np.nanargmax(power["predicted_grid_power"]))
print(f"peak {power['predicted_grid_power'][peak]:.0f} W at {power.time[peak]:.2f} s, "
      f"measured {power['measured_power'][peak]:.0f} W")  # fmt: skip
