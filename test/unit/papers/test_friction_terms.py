"""Errors of friction term by term, on samples that hold one of the terms."""

import numpy as np
import pytest

from friction_terms import SHOWN, TERMS, held_out_terms, term_errors
from robot_energy_identify.friction.samples import moving_samples
from robot_energy_identify.stats.cross_validation import contiguous_folds
from unit.identify.friction.test_friction import bent, falling_measurement, loaded, measurement

NOISE = 0.05  # N m, of the samples


def halves(data):
    """Samples for the fit and for the test, of the same temperatures."""
    data = moving_samples(data)
    other = np.arange(len(data)) // 50 % 2 == 1
    return data[~other], data[other]


@pytest.mark.parametrize(
    ("data", "first"),
    [
        (measurement(minutes=15, law=lambda degc: np.full_like(degc, 4e-3)), "constant"),
        (measurement(minutes=15), "temperature"),
        (loaded(0.06), "+ load"),
        (bent(0.6), "+ exponent"),
    ],
)
def test_the_error_is_the_noise_from_the_term_on_that_the_samples_hold(data, first):
    found = term_errors(*halves(data))
    known = [name for name in TERMS if not np.isnan(found.rms[name])]
    before = known[: known.index(first)]
    for name in known:
        if name == "Stribeck":
            continue
        if name in before:
            assert found.rms[name] > 1.1 * NOISE
        else:
            assert found.rms[name] == pytest.approx(NOISE, rel=0.08)
    assert found.relative[first] == pytest.approx(found.rms[first] / found.torque, rel=0.01)


def test_friction_that_falls_is_a_stribeck_term():
    found = term_errors(*halves(falling_measurement()))
    assert found.shown == "constant, Stribeck"
    assert found.rms["Stribeck"] == found.rms[SHOWN] == pytest.approx(0.03, rel=0.08)
    assert found.rms["constant"] > 2.0 * found.rms["Stribeck"]


def test_terms_that_samples_cannot_show_are_no_numbers():
    """Bodies unknown: no load. Held out in blocks, each from the others."""
    data = moving_samples(measurement(minutes=5))
    found = held_out_terms(data, contiguous_folds(len(data)))
    assert np.isnan(found.rms["+ load"])
    assert np.isfinite(found.rms["+ exponent"])
    few = data[np.arange(len(data)) < 150]
    found = held_out_terms(few, contiguous_folds(len(few)))
    assert found.shown == "refused"
    assert np.isnan(found.rms[SHOWN])
    assert np.isfinite(found.rms["constant"])
