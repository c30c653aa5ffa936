"""Run the monitor in one's own loop, on samples of one's own source.

Here the samples are made up: a joint that swings. A real loop reads them from a controller.
"""

import numpy as np

import robot_energy as re

monitor = re.OnlineMonitor("kr16")
joints = len(monitor.model.joints)
start_ns, period_ns = 1_700_000_000_000_000_000, 10_000_000

rows = 0
for step in range(500):  # 5 s at 100 Hz
    time = step * period_ns * 1e-9
    position, velocity = np.zeros(joints), np.zeros(joints)
    position[0], velocity[0] = np.sin(time), np.cos(time)
    power = monitor.push(
        start_ns + step * period_ns,
        position,
        velocity,
        motor_temperature_degc=np.full(joints, 35.0) if step % 100 == 0 else None,
    )
    if rows // 100 < (rows + len(power)) // 100:  # a line for each second
        print(f"{time:.1f} s: {power['predicted_grid_power'][-1]:.0f} W, about 0.1 s late")
    rows += len(power)
rows += len(monitor.flush())
print(f"{rows} samples, {monitor.energy.grid_import:.0f} J from the grid")
print(f"refused: {monitor.rejected}")
