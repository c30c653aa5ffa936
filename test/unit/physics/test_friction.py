import numpy as np
import pytest
from pydantic import ValidationError

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


def test_a_constant_seen_at_one_temperature_is_used_everywhere_and_flagged_elsewhere():
    curve = law(
        ConstantLaw, law="constant", viscous=figure(3.0) | {"std": 0.1}, fitted_degc=[18, 25]
    )
    degc = np.array([17.9, 18.0, 25.0, 60.0])
    np.testing.assert_array_equal(curve.viscous(degc), 3.0)
    np.testing.assert_array_equal(curve.extrapolated(degc), [True, False, False, True])
    np.testing.assert_array_equal(curve.std(degc), [np.nan, 0.1, 0.1, np.nan])
    plain = law(ConstantLaw, law="constant", viscous=figure(3.0) | {"std": 0.1})
    assert not plain.extrapolated(degc).any()
    np.testing.assert_array_equal(plain.std(degc), 0.1)


# Covariance of a, b, c by the inverse of the information of 40 measurements of fv, one at each
# temperature between 20 and 59 degC, each with a standard deviation of 0.05, on the law
# 2 + 8 exp(-T/20): numpy.linalg.inv(J.T @ J / 0.05**2), to ten digits.
MEASURED = np.arange(20.0, 60.0)


def covariance():
    decay = np.exp(-MEASURED / 20.0)
    slopes = np.stack([np.ones(40), decay, 8.0 * decay * MEASURED / 400.0], axis=1)
    return np.linalg.inv(slopes.T @ slopes / 0.05**2)


def fitted(outside=None, matrix=None):
    entry = {
        "law": "exponential",
        "a": figure(2.0),
        "b": figure(8.0),
        "c": figure(20.0),
        "fitted_degc": [20, 59],
        "covariance": (covariance() if matrix is None else matrix).tolist(),
    }
    return law(ExponentialLaw, **entry, **({"outside": outside} if outside else {}))


def test_hold_and_extend_by_hand():
    assert fitted("hold").viscous(0.0) == fitted("hold").viscous(20.0)
    assert fitted("extend").viscous(0.0) == pytest.approx(10.0, rel=1e-12)  # 2 + 8 exp(0)
    bare = {"law": "exponential", "a": figure(2.0), "b": figure(8.0), "c": figure(20.0)}
    extended = law(ExponentialLaw, **bare, fitted_degc=[20, 59], outside="extend")
    assert extended.viscous(0.0) == pytest.approx(10.0, rel=1e-12)
    with pytest.raises(ValidationError, match="there is no covariance"):
        law(ExponentialLaw, **bare, fitted_degc=[20, 59], outside="auto")


def test_auto_carries_on_while_the_change_is_known_better_than_its_size():
    """Monte Carlo: laws drawn from the covariance; the scatter of their change from the edge."""
    curve = fitted()
    cold, hot = curve.used
    assert cold < 10.0  # this law is well known a decade below its edge
    assert hot > 70.0
    draws = np.random.default_rng(0).multivariate_normal([2.0, 8.0, 20.0], covariance(), 20_000)

    def share(degc, edge):
        a, b, c = draws.T
        change = (a + b * np.exp(-degc / c)) - (a + b * np.exp(-edge / c))
        return abs(8 * (np.exp(-degc / 20) - np.exp(-edge / 20))) / change.std()

    noisy = fitted(matrix=100.0 * covariance())  # ten times the noise
    for edge, end in ((20.0, noisy.used[0]), (59.0, noisy.used[1])):
        assert -40.0 < end != edge
        assert share(0.5 * (end + edge), edge) / 10 > 1.0
        assert share(end + np.sign(end - edge) * 20.0, edge) / 10 < 1.0
    assert noisy.viscous(-39.0) == noisy.viscous(noisy.used[0])
    lost = fitted(matrix=1e6 * covariance())
    assert lost.used == (20.0, 59.0)  # nothing is sure: held at the edges
    assert lost.extrapolated(np.array([19.0, 30.0])).tolist() == [True, False]


@pytest.mark.parametrize("outside", ["hold", "extend", "auto"])
@pytest.mark.parametrize("scale", [1.0, 100.0, 1e4])
def test_the_band_widens_all_the_way(outside, scale):
    curve = fitted(outside, scale * covariance())
    for degc in (np.linspace(20, -30, 60), np.linspace(59, 150, 60)):
        std = curve.std(degc)
        assert (np.diff(std) >= -1e-12 * std[:-1]).all()
        assert std[-1] > 1.2 * std[0]
    inside = np.array([25.0, 40.0, 55.0])
    decay = np.exp(-inside / 20.0)
    slopes = np.stack([np.ones(3), decay, 8.0 * decay * inside / 400.0], axis=1)
    by_hand = np.sqrt(np.diag(slopes @ (scale * covariance()) @ slopes.T))
    np.testing.assert_allclose(curve.std(inside), by_hand, rtol=1e-9)


def test_what_is_no_covariance_is_refused():
    for entry, row, column in ((9.0, 0, 1), (-1.0, 0, 0)):
        wrong = covariance()
        wrong[row, column] = entry
        with pytest.raises(ValidationError, match="covariance is none"):
            fitted(matrix=wrong)


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


def friction_entry(**entries):
    base = {"coulomb": figure(0.5), "viscous": {"law": "constant", "viscous": figure(0.02)}}
    return JointFriction.model_validate({**base, **entries})


def friction(**entries):
    return FrictionModel([friction_entry(**entries)])


def torque(model, velocity, rigid=0.0):
    shape = (len(velocity), 1)
    return model.torque(
        np.reshape(velocity, shape),
        np.full(shape, 0.5),
        np.full(shape, 0.02),
        motor_torque_rigid=np.full(shape, rigid),
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
    limit = friction(load_coulomb=figure(0.1), load_saturation=figure(4.0))
    np.testing.assert_allclose(torque(limit, [10.0, -10.0], rigid=-7.0), [0.5 + 0.4 + 0.2, -1.1])
    np.testing.assert_allclose(torque(limit, [10.0, -10.0], rigid=-3.0), [0.5 + 0.3 + 0.2, -1.0])


def test_a_viscous_exponent_bends_the_axis_that_has_one_and_leaves_the_other():
    bent = friction_entry(viscous_exponent={"exponent": figure(0.5), "velocity": figure(25.0)})
    both = FrictionModel([bent, friction_entry()])
    speed = np.array([[100.0, 100.0], [-4.0, -4.3], [0.0, 0.0]])
    np.testing.assert_allclose(both.viscous_velocity(speed)[:, 0], [50.0, -10.0, 0.0])
    found = both.torque(speed, np.full((3, 2), 0.5), np.full((3, 2), 0.02))
    np.testing.assert_allclose(found[:, 0], [0.5 + 1.0, -0.5 - 0.2, 0.0])
    np.testing.assert_array_equal(found[:, 1], torque(friction(), speed[:, 1]))
    assert friction().viscous_velocity(speed) is speed


@pytest.mark.parametrize("key", ["exponent", "velocity"])
def test_a_viscous_exponent_of_zero_is_refused(key):
    term = {"exponent": figure(0.5), "velocity": figure(25.0), key: figure(0.0)}
    with pytest.raises(ValidationError, match=f"{key}\n  Value error, must be > 0, found 0"):
        friction_entry(viscous_exponent=term)


def test_a_model_without_a_viscous_exponent_keeps_its_identity():
    assert "viscous_exponent" not in friction_entry().model_dump()


def test_standing_axis_has_no_friction_torque():
    result = friction().torque(
        np.array([[1e-3]]),
        np.full((1, 1), 0.5),
        np.full((1, 1), 0.02),
        standing=np.ones((1, 1), dtype=bool),
    )
    assert result[0, 0] == 0.0


def test_fixed_friction_freezes_the_law_at_one_temperature():
    fixed = FrictionModel.from_model(with_fixed_friction(robots.two_link(), 60.0))
    expected = 1e-4 + 1e-3 * np.exp(-3.0)
    np.testing.assert_allclose(
        fixed.viscous(np.array([[20.0, 20.0], [80.0, 80.0]])), [[expected, 2e-4]] * 2, rtol=1e-14
    )
    assert with_fixed_friction(robots.two_link(), 60.0).model_id != robots.two_link().model_id


def test_fixed_friction_is_known_as_its_law_is():
    """The least known figure of a law counts, and the deviation at that temperature."""
    degc = {"motor_temperature_degc": [20.0, 40.0], "viscous": [2.0, 1.0]}
    viscous = (
        {"law": "table", **degc, "std": [0.1, 0.3], "tag": "identified"},
        {
            "law": "exponential",
            "a": {"value": 2.0, "tag": "identified"},
            "b": {"value": 8.0, "tag": "published"},
            "c": {"value": 20.0, "tag": "identified"},
            "fitted_degc": [20, 80],
        },
    )
    joints = robots.two_link_data()["joints"]
    for joint, entry in zip(joints, viscous, strict=True):
        joint["friction"]["viscous"] = entry
    fixed = with_fixed_friction(robots.two_link(joints=joints), 30.0)
    table, exponential = (joint.friction.viscous.viscous for joint in fixed.joints)
    assert (table.tag, table.std) == ("identified", pytest.approx(0.2))
    assert (exponential.tag, exponential.std) == ("published", None)


def test_an_unknown_temperature_adds_the_distance_over_the_fitted_range():
    # Law 2 + 8 exp(-T/20) over 20 to 80, assumed at 60: by Simpson's rule on a fine grid.
    degc = np.linspace(20, 80, 6001)
    off = 8 * (np.exp(-degc / 20) - np.exp(-60 / 20))
    weight = np.ones(6001)
    weight[1:-1:2], weight[2:-1:2] = 4, 2
    spread = np.sqrt((weight * off**2).sum() / weight.sum())
    curve = exponential()
    assert curve.spread(60.0) == pytest.approx(spread, rel=5e-3)
    assert law(ConstantLaw, law="constant", viscous=figure(2.0)).spread(60.0) == 0.0


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
    # Outside, one kelvin times the slope of -1/20 between the points.
    np.testing.assert_allclose(found, [np.hypot(0.1, 0.05), 0.1, 0.2, np.hypot(0.3, 0.05)])
    assert np.isnan(law(ConstantLaw, law="constant", viscous=figure(2.0)).std(60.0))
