"""Compare friction at one fixed temperature with friction that follows the motors."""

from pathlib import Path

import robot_energy as re

BAGS = Path(__file__).resolve().parents[3] / "bags"

model = re.load_model("kr16")
for name in ("kr16_cold", "kr16_warm"):
    aware = re.replay(BAGS / name, model)
    fixed = re.replay(BAGS / name, model, temperature=40.0)
    print(f"{name}: measured {aware.comparison.measured_energy:.0f} J; error with friction "
          f"by temperature {aware.comparison.predicted_minus_measured_relative:+.1%}, "
          f"at 40 degC {fixed.comparison.predicted_minus_measured_relative:+.1%}")  # fmt: skip
