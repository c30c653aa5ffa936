import numpy as np
import pytest

import robots
from robot_energy.model.friction_laws import ConstantLaw, ExponentialLaw, TableLaw
from robot_energy.model.joint import JointFriction
from robot_energy.physics.friction import FrictionModel, viscous_law, with_fixed_friction
from robots import figure


def law(kind, **entries):
    return viscous_law(kind.model_validate(entries))


def exponential():
    return law(
        ExponentialLaw,
        law="exponential",
        a=figure(2.0),
        b=figure(8.0),
        c=figure(20.0),
        fitted_degc=[20, 80],
    )


def test_exponential_law_by_hand():
    # 2 + 8 exp(-40/20) = 2 + 8 * 0.1353352832 = 3.0826822659
    assert exponential().viscous(40.0) == pytest.approx(3.0826822659, rel=1e-10)


def test_outside_the_fitted_range_the_edge_is_held_and_flagged():
    curve = exponential()
    assert curve.viscous(5.0) == curve.viscous(20.0)
    assert curve.viscous(200.0) == curve.viscous(80.0)
    np.testing.assert_array_equal(
        curve.extrapolated(np.array([19.9, 20.0, 80.0, 80.1])), [True, False, False, True]
    )


def test_table_law_meets_its_points_and_never_overshoots():
    points, values = [20.0, 30.0, 40.0, 80.0], [10.0, 6.0, 5.9, 3.0]
    curve = law(
        TableLaw, law="table", motor_temperature_degc=points, viscous=values, tag="identified"
    )
    np.testing.assert_allclose(curve.viscous(np.array(points)), values, rtol=1e-14)
    between = curve.viscous(np.linspace(20, 80, 500))
    assert (np.diff(between) <= 1e-12).all()
    assert curve.viscous(300.0) == pytest.approx(3.0)


def test_unknown_temperature_gives_nan():
    assert np.isnan(exponential().viscous(np.nan))


def friction(**entries):
    base = {"coulomb": figure(0.5), "viscous": {"law": "constant", "viscous": figure(0.02)}}
    return FrictionModel([JointFriction.model_validate({**base, **entries})])


def torque(model, velocity, rigid=0.0):
    shape = (len(velocity), 1)
    return model.torque(
        np.reshape(velocity, shape),
        np.full(shape, rigid),
        np.full(shape, 0.5),
        np.full(shape, 0.02),
        np.zeros(shape, dtype=bool),
    )[:, 0]


def test_coulomb_and_viscous_by_hand():
    np.testing.assert_allclose(
        torque(friction(), [10.0, -10.0, 0.0]), [0.5 + 0.2, -0.7, 0.0], rtol=1e-15
    )


def test_optional_terms_by_hand():
    smooth = torque(friction(smooth_velocity=figure(5.0)), [5.0])
    assert smooth[0] == pytest.approx(0.5 * np.tanh(1.0) + 0.1)
    stribeck = {"torque": figure(0.3), "velocity": figure(2.0)}
    assert torque(friction(stribeck=stribeck), [4.0])[0] == pytest.approx(
        0.5 + 0.3 * np.exp(-4.0) + 0.08
    )
    load = torque(friction(load_coulomb=figure(0.1)), [10.0, -10.0], rigid=-7.0)
    np.testing.assert_allclose(load, [0.5 + 0.7 + 0.2, -1.4])


def test_standing_axis_has_no_friction_torque():
    result = friction().torque(
        np.array([[1e-3]]),
        np.zeros((1, 1)),
        np.full((1, 1), 0.5),
        np.full((1, 1), 0.02),
        np.ones((1, 1), dtype=bool),
    )
    assert result[0, 0] == 0.0


def test_fixed_friction_freezes_the_law_at_one_temperature():
    fixed = FrictionModel.from_model(with_fixed_friction(robots.two_link(), 60.0))
    expected = 1e-4 + 1e-3 * np.exp(-3.0)
    np.testing.assert_allclose(
        fixed.viscous(np.array([[20.0, 20.0], [80.0, 80.0]])), [[expected, 2e-4]] * 2, rtol=1e-14
    )
    assert with_fixed_friction(robots.two_link(), 60.0).model_id != robots.two_link().model_id


def test_friction_at_an_assumed_temperature_is_less_certain():
    # Law 2 + 8 exp(-T/20) over 20 to 80, assumed at 60: by Simpson's rule on a fine grid.
    degc = np.linspace(20, 80, 6001)
    off = 8 * (np.exp(-degc / 20) - np.exp(-60 / 20))
    weight = np.ones(6001)
    weight[1:-1:2], weight[2:-1:2] = 4, 2
    spread = np.sqrt((weight * off**2).sum() / weight.sum())
    curve = exponential()
    assert curve.std_unknown(60.0) == pytest.approx(spread, rel=5e-3)
    known = law(
        ExponentialLaw,
        law="exponential",
        a=figure(2.0),
        b=figure(8.0),
        c=figure(20.0),
        fitted_degc=[20, 80],
        std=0.3,
    )
    assert known.std(60.0) == 0.3
    assert known.std_unknown(60.0) == pytest.approx(np.hypot(curve.std_unknown(60.0), 0.3))
    assert known.std_unknown(60.0) > known.std(60.0)


def test_no_deviation_is_invented():
    assert np.isnan(exponential().std(np.array([10.0, 40.0, np.nan]))).all()
    table = {
        "law": "table",
        "motor_temperature_degc": [20.0, 40.0],
        "viscous": [2.0, 1.0],
        "tag": "identified",
    }
    assert np.isnan(law(TableLaw, **table).std(30.0))
    found = law(TableLaw, **table, std=[0.1, 0.3]).std(np.array([19.0, 20.0, 30.0, 41.0]))
    np.testing.assert_allclose(found, [np.nan, 0.1, 0.2, np.nan])
    assert np.isnan(law(ConstantLaw, law="constant", viscous=figure(2.0)).std_unknown(60.0))
