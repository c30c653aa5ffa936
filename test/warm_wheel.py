"""One wheel whose gear warms by its own friction, and how it is turned."""

import numpy as np

import robots
from robot_energy.timeline.blocks import TemperatureBlock
from robots import figure

S = 10**9
SPEED = 40.0  # rad/s of the motor
CAPACITY, TO_MOTOR, TO_AIR = 600.0, 0.4, 0.2  # J/K, W/K
AIR, MOTOR = 20.0, 30.0  # degC
A, B, C, COULOMB = 0.01, 0.06, 25.0, 0.2
LAW = {
    "law": "exponential",
    "a": figure(A),
    "b": figure(B),
    "c": figure(C),
    "fitted_degc": [10.0, 110.0],
    "std": 2e-4,
}


def wheel(gear=True, ambient=AIR, std=0.5, hottest=110.0):
    joint = {
        "name": "axle",
        "gear_ratio": figure(10.0),
        "rotor_inertia": figure(0.01),
        "friction": {
            "coulomb": figure(COULOMB),
            "viscous": {**LAW, "fitted_degc": [10.0, hottest]},
        },
    }
    if gear:
        joint["gear"] = {
            "capacity": figure(CAPACITY),
            "motor_conductance": figure(TO_MOTOR),
            "ambient_conductance": figure(TO_AIR),
            "std": std,
        }
    temperature = {"fallback_degc": 40.0, "ambient_degc": {**figure(ambient), "std": 0.5}}
    return robots.one_wheel(joints=[joint], temperature=temperature)


def viscous(degc):
    return A + B * np.exp(-degc / C)


def integrated(seconds, motor, start, step=0.5):
    """Gear temperature by Euler's rule, every step."""
    degc = [start]
    for _ in range(round(seconds / step)):
        now = degc[-1]
        heat = COULOMB * SPEED + viscous(now) * SPEED**2
        flow = heat - TO_MOTOR * (now - motor) - TO_AIR * (now - AIR)
        degc.append(now + step * flow / CAPACITY)
    return np.array(degc)


def turning(seconds, start=100.0, period=0.5, effort=None):
    stamp = np.arange(start, start + seconds, period)
    position = (SPEED / 10.0 * (stamp - 100.0))[:, None]
    velocity = np.full((len(stamp), 1), SPEED / 10.0)
    torque = None if effort is None else effort[: len(stamp), None]
    return robots.joint_block(stamp, position, velocity, np.zeros_like(velocity), torque)


def readings(seconds, degc=MOTOR, start=100):
    stamp = np.arange(start, start + seconds, dtype=np.int64) * S
    return TemperatureBlock(stamp, np.full((len(stamp), 1), degc))
