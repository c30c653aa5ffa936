"""Torque constants that fall, recovered from torque in a warm-up, and refused without one."""

from dataclasses import replace

import numpy as np
import pytest

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy_identify.friction.samples import FrictionData
from robot_energy_identify.friction.torque_constants import fit_fall

FALL = 0.001  # 1/K
PERIOD = 0.04  # s


def recorded(seconds, degc, seed, fall=FALL, load=2.0, run=0, given=None):
    """One axis that lifts and turns while its motor warms between two temperatures.

    Args:
        load: Size of the torque of its bodies; the model is ``given`` another one.
    """
    rng = np.random.default_rng(seed)
    count = round(seconds / PERIOD)
    time = PERIOD * np.arange(count)
    speed = np.repeat(rng.uniform(20.0, 100.0, -(-count // 25)), 25)[:count]
    speed *= np.where((time // 2.0) % 2 == 0, 1.0, -1.0)
    rigid = np.repeat(rng.standard_normal(-(-count // 25)), 25)[:count]
    motor = np.linspace(*degc, count)
    viscous = 0.002 + 0.02 * np.exp(-motor / 25.0)
    friction = 0.3 * np.sign(speed) + viscous * speed + 0.05 * np.sign(speed) * np.abs(load * rigid)
    read = (load * rigid + friction) / (1.0 - fall * (motor - 20.0))
    known = (load if given is None else given) * rigid
    torque = read - known + 0.05 * rng.standard_normal(count)
    return FrictionData(
        "axle", speed, torque, motor, 10_000 * run + np.arange(count) // 125,
        np.full(count, run), np.empty((count, 0)), load=np.abs(known), rigid=known,
    )  # fmt: skip


def together(parts):
    names = ("motor_velocity", "friction_torque", "motor_temperature_degc", "block", "run")
    names += ("nuisance", "load", "rigid")
    return replace(
        parts[0],
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names},
    )


def test_a_fall_is_found_in_a_warm_up():
    fall = fit_fall(recorded(1200.0, (20.0, 70.0), 1), "here").fall
    assert fall.value == pytest.approx(FALL, rel=0.03)
    assert 0.0 < fall.std < 0.02 * FALL
    assert (fall.tag, fall.source) == ("identified", "here")


def test_bodies_of_another_mass_do_not_look_like_magnets():
    found = fit_fall(recorded(1200.0, (20.0, 70.0), 2, given=1.6))
    assert found.fall.value == pytest.approx(FALL, rel=0.05)
    with pytest.raises(NotIdentifiableError, match="grows by"):
        fit_fall(recorded(1200.0, (20.0, 70.0), 2, fall=0.0, given=1.6))


def test_a_payload_of_the_warm_recording_does_not_look_like_magnets():
    parts = [
        recorded(600.0, (20.0, 32.0), 3, fall=0.0),
        recorded(600.0, (50.0, 62.0), 4, fall=0.0, load=2.4, given=2.0, run=1),
    ]
    with pytest.raises(NotIdentifiableError, match="grows by"):
        fit_fall(together(parts))


def test_soaked_recordings_do_not_show_it():
    parts = [
        recorded(60.0, (degc, degc + 2.0), run, run=run)
        for run, degc in enumerate((20.0, 40.0, 60.0))
    ]
    with pytest.raises(NotIdentifiableError, match="warms by 2 K"):
        fit_fall(together(parts))


def test_a_fall_that_no_magnet_has_is_refused():
    with pytest.raises(NotIdentifiableError, match="grows by"):
        fit_fall(recorded(1200.0, (20.0, 70.0), 5, fall=0.008))
