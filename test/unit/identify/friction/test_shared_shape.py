"""A temperature shape that axes have in common, lent to one that shows none of its own."""

from dataclasses import replace

import numpy as np
import pytest

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.physics.friction import viscous_law
from robot_energy_identify.friction.friction import fit_axes
from robot_energy_identify.friction.shared_shape import common_shape, share_shape
from unit.identify.friction.test_friction import A, B, C, measurement, viscous

SIZES = {"one": 1.0, "two": 3.0, "three": 0.5}


def axis(name, size=1.0, degc=(20.0, 70.0), seed=0):
    def law(temperature):
        return size * viscous(temperature)

    return replace(measurement(seed, degc=degc, law=law), name=name)


@pytest.fixture(scope="module")
def lenders():
    return [axis(name, size, seed=k) for k, (name, size) in enumerate(SIZES.items())]


def test_the_common_shape_is_that_of_the_plants(lenders):
    shape = common_shape(fit_axes(lenders)[0])
    assert shape.lenders == tuple(SIZES)
    assert shape.scale == pytest.approx(C, rel=0.1)
    assert shape.ratio == pytest.approx(A / B, rel=0.2)
    degc = np.linspace(20.0, 70.0, 20)
    truth = viscous(degc) / viscous(shape.reference_degc)
    np.testing.assert_allclose(shape.at(degc), truth, rtol=0.03)
    assert shape.spread < 0.03
    assert "one, two, three" in str(shape)


def test_an_axis_at_one_temperature_is_right_at_others(lenders):
    axes = [*lenders, axis("cold", 2.0, (22.0, 24.0), 7)]
    fits, _ = fit_axes(axes)
    assert fits[-1].chosen == "constant"
    lent = share_shape(fits, axes, "bags")[-1]
    degc = np.linspace(20.0, 70.0, 20)
    found = viscous_law(lent.law).viscous(degc)
    np.testing.assert_allclose(found, 2.0 * viscous(degc), rtol=0.06)
    assert (np.abs(found - 2.0 * viscous(degc)) < 4.0 * lent.law.std).all()
    assert {lent.law.a.tag, lent.law.b.tag, lent.law.c.tag} == {"derived"}
    assert "temperature shape of one, two, three" in lent.law.a.source
    assert lent.warnings == (f"cold: its own range is too small; its law has {common_shape(fits)}",)
    assert share_shape(fits, axes)[:3] == fits[:3]


def test_an_axis_at_one_temperature_keeps_its_viscous_exponent(lenders):
    data = axis("cold", 2.0, (22.0, 24.0), 7)
    w, fv = data.motor_velocity, 2.0 * viscous(data.motor_temperature_degc)
    power = 120.0 * np.sign(w) * (np.abs(w) / 120.0) ** 0.6
    bent = replace(data, friction_torque=data.friction_torque + fv * (power - w))
    axes = [*lenders, bent]
    lent = share_shape(fit_axes(axes)[0], axes, "bags")[-1]
    exponent, std, velocity = lent.exponent
    assert lent.chosen == "exponential"
    assert exponent == pytest.approx(0.6, abs=3 * std)
    unit = velocity * (120.0 / velocity) ** 0.6 / 120.0  # fv by the other velocity
    found = viscous_law(lent.law).viscous(np.array([22.0, 60.0])) * unit
    np.testing.assert_allclose(found, 2.0 * viscous(np.array([22.0, 60.0])), rtol=0.08)


def test_an_axis_at_one_speed_says_coulomb_by_what_temperature_does(lenders):
    data = axis("even", 2.0)
    random = np.random.default_rng(1)
    speed = np.sign(data.motor_velocity) * random.normal(200.0, 0.5, len(data))
    truth = 0.4 * np.sign(speed) + 2.0 * viscous(data.motor_temperature_degc) * speed
    noise = random.normal(scale=0.05, size=len(data))
    axes = [*lenders, replace(data, motor_velocity=speed, friction_torque=truth + noise)]
    lent = share_shape(fit_axes(axes)[0], axes)[-1]
    assert lent.coulomb == pytest.approx(0.4, abs=0.1)
    found = float(viscous_law(lent.law).viscous(np.array(45.0)))
    assert found == pytest.approx(2 * viscous(45.0), rel=0.08)


def test_shapes_that_differ_or_too_few_are_not_lent(lenders):
    fits, _ = fit_axes(lenders)
    with pytest.raises(NotIdentifiableError, match="1 of 1 axes show an exponential law"):
        common_shape(fits[:1])
    steep = measurement(5, law=lambda degc: 2e-4 + 4e-2 * np.exp(-degc / 12.0))
    other = fit_axes([lenders[0], replace(steep, name="steep")])[0]
    with pytest.raises(NotIdentifiableError, match="differ by"):
        common_shape(other)
    axes = [lenders[0], axis("cold", 2.0, (22.0, 24.0), 7)]
    fits, _ = fit_axes(axes)
    kept = share_shape(fits, axes)[-1]
    assert kept.law == fits[-1].law
    assert "the shape of the others is not taken" in kept.warnings[-1]
