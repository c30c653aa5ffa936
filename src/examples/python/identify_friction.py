"""Identify friction over motor temperature from a cold and a warm recording.

Two recordings show how it is done. A model to rely on needs temperatures in between as well,
and the losses of the drives: `re.identify_all` does everything in order.
"""

import tempfile
from pathlib import Path

import robot_energy as re

BAGS = Path(__file__).resolve().parents[3] / "bags"

result = re.identify_friction(
    [BAGS / "kr16_cold", BAGS / "kr16_warm"], model="kr16", effort="motor_torque"
)
for joint in result.model.joints:
    friction = joint.friction
    print(f"{joint.name}: Coulomb {friction.coulomb.value:.3f} N m, viscous {friction.viscous.law}")

with tempfile.TemporaryDirectory() as folder:
    result.save(Path(folder) / "my_robot.yaml")  # the model file that the monitor runs
    print(f"wrote model {re.load_model(Path(folder) / 'my_robot.yaml').model_id}")
