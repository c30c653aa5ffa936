"""Learn friction at work and find wear: hours of a simulated robot in less than a minute.

A virtual robot repeats a program. Its friction is another than that of the model file, so the
monitor learns a factor for each axis. Later the friction of axis 2 rises by 15 %: an alarm.
"""

import numpy as np

import robot_energy as re
from robot_energy_plan.motion.ptp import random_program
from robot_energy_rig import VirtualRig, random_profile

WORN_AFTER, RATE = 5, 10  # [h], [Hz]

plant = random_profile("kr16", 3)
program = random_program(plant.motion_limits(plant.mechanics()[0]), 5)
rig = VirtualRig(plant, program, rate_hz=RATE, start_temperature_degc=45.0)
monitor = re.OnlineMonitor("kr16", effort="motor_torque")
learned = monitor.pipeline.condition

for minute in range((WORN_AFTER + 1) * 60):
    if minute == WORN_AFTER * 60:
        rig.change(wear=np.where(np.arange(6) == 1, 1.15, 1.0))
    out = rig.step(60 * RATE)
    if out.temperatures is not None:
        temperatures = out.temperatures
        monitor.push_temperatures(temperatures.stamp_ns, temperatures.motor_temperature_degc)
    joints = out.joints
    monitor.push(
        joints.stamp_ns, joints.joint_position, joints.joint_velocity, joints.measured_motor_torque
    )
    if minute % 60 == 59:
        factors = " ".join(f"{factor:.2f}" for factor in learned.friction.filtered)
        print(f"{(minute + 1) // 60} h: friction over that of the model file, by axis: {factors}")
    if learned.wear.alarms:
        later = minute + 1 - 60 * WORN_AFTER
        print(f"{later} min after the friction rose: {learned.wear.alarms[0].sentence}")
        break
