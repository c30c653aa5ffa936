import numpy as np
import pytest

import robots
from refusals import refused
from robot_energy.foundation.errors import ModelFileError
from robot_energy.model.drive_models import EfficiencyMap, LossDrive, LossMap
from robot_energy.physics.drives_and_cabinet import (
    EfficiencyMaps,
    Ideal,
    LossMaps,
    LossModel,
    drive_from_model,
)
from robots import figure


def test_ideal_drive_loses_nothing():
    power, extrapolated = Ideal().input_power(*[np.array([[-3.0]])] * 4)
    assert power[0, 0] == -3.0
    assert extrapolated is None


def losses():
    return LossDrive.model_validate(
        {
            "constant": figure(2.0),
            "linear": figure(0.1),
            "quadratic": figure(0.01),
            "copper": figure(3.0),
        }
    )


def test_loss_model_by_hand():
    # w = -10, tau = 2, 70 degC: 2 + 1 + 1 + 3 (1 + 0.0039 * 50) 4 = 18.34; shaft -20
    power, _ = LossModel([losses()]).input_power(
        np.array([[-20.0]]), np.array([[-10.0]]), np.array([[2.0]]), np.array([[70.0]])
    )
    assert power[0, 0] == pytest.approx(-20 + 18.34, rel=1e-14)


def test_holding_costs_copper_loss_where_an_efficiency_would_be_zero():
    power, _ = LossModel([losses()]).input_power(
        np.zeros((1, 1)), np.zeros((1, 1)), np.array([[5.0]]), np.array([[20.0]])
    )
    assert power[0, 0] == pytest.approx(2.0 + 75.0)


def test_map_takes_the_nearest_point_in_standardised_distance():
    rng = np.random.default_rng(4)
    torque, speed = rng.normal(size=200) * 0.1, rng.normal(size=200) * 300
    eta = rng.uniform(0.3, 1.4, 200)
    maps = EfficiencyMaps(
        [
            EfficiencyMap(
                motor_velocity=list(speed),
                motor_torque=list(torque),
                efficiency=list(eta),
                tag="identified",
                reach=0.3,
            )
        ]
    )
    query = rng.normal(size=(100, 2)) * [0.12, 350]
    points = np.stack([torque, speed], axis=1)
    scale = points.std(axis=0, ddof=1)
    distance = np.linalg.norm((query[:, None, :] - points) / scale, axis=2)
    shaft = query[:, :1] * query[:, 1:]
    power, extrapolated = maps.input_power(shaft, query[:, 1:], query[:, :1], shaft)
    np.testing.assert_allclose(power[:, 0], shaft[:, 0] / eta[distance.argmin(axis=1)])
    np.testing.assert_array_equal(extrapolated[:, 0], distance.min(axis=1) > 0.3)


def test_map_gives_nan_for_nan_and_does_not_raise():
    maps = EfficiencyMaps(
        [EfficiencyMap(motor_velocity=[1.0], motor_torque=[1.0], efficiency=[0.875], tag="assumed")]
    )
    power, _ = maps.input_power(
        np.array([[np.nan], [7.0]]), np.ones((2, 1)), np.array([[np.nan], [7.0]]), np.ones((2, 1))
    )
    assert np.isnan(power[0, 0])
    assert power[1, 0] == pytest.approx(8.0)


SQUARE = {"motor_velocity": [0.0, 10.0, 40.0], "motor_torque": [0.0, 2.0]}


def loss_map(loss=((3.0, 7.0), (5.0, 13.0), (8.0, 16.0))):
    return LossMap(**SQUARE, loss=[list(row) for row in loss], tag="identified")


def test_loss_map_by_hand():
    """Inside, at rest under load, beyond each end, and with windings at 70 degC."""
    speed = np.array([[-5.0], [0.0], [20.0], [60.0], [0.0], [np.nan]])
    torque = np.array([[1.0], [-2.0], [3.0], [3.0], [1.0], [1.0]])
    degc = np.array([[20.0]] * 4 + [[70.0]] + [[20.0]])
    power, outside = LossMaps([loss_map()]).input_power(speed * torque, speed, torque, degc)
    warm = 3.0 + 0.5 * np.sqrt(1.0 + 0.0039 * 50.0) * 4.0
    # middle of (3, 7, 5, 13); corner; 14 + half of 14 - 6; 16 + 20/30 (16 - 13) + half of 8
    by_hand = [7.0, 7.0, 14.0 + 0.5 * 8.0, 16.0 + 2.0 + 4.0, warm, np.nan]
    np.testing.assert_allclose((power - speed * torque)[:, 0], by_hand, rtol=1e-12)
    np.testing.assert_array_equal(outside[:, 0], [False, False, True, True, False, False])


@pytest.mark.parametrize("seed", range(5))
def test_no_loss_map_falls_with_speed_or_torque_inside_or_beyond_its_knots(seed):
    """Of maps drawn at random, whose slopes fall along the other axis as often as they rise."""
    loss = np.random.default_rng(seed).uniform(0.0, 10.0, (4, 4))
    loss = np.sort(np.sort(loss, axis=0), axis=1)  # rises along both
    knots = {"motor_velocity": [0.0, 1.0, 3.0, 6.0], "motor_torque": [0.0, 1.0, 2.0, 3.0]}
    drawn = LossMap(**knots, loss=loss.tolist(), tag="identified")
    speed, torque = np.meshgrid(np.linspace(0.0, 20.0, 81), np.linspace(0.0, 12.0, 73))
    wide = [values.reshape(-1, 1) for values in (speed * torque, speed, torque)]
    power, outside = LossMaps([drawn]).input_power(*wide, np.full((speed.size, 1), 20.0))
    found = (power - wide[0]).reshape(speed.shape)
    assert 0 < outside.sum() < outside.size
    for axis in (0, 1):
        assert np.diff(found, axis=axis).min() > -1e-9


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"loss": [[3.0, 2.0]] * 3}, "falls"),
        ({"loss": [[3.0, 4.0], [2.0, 5.0], [3.0, 6.0]]}, "falls"),
        ({"loss": [[3.0, 4.0]] * 2}, "3 rows of 2"),
        ({"motor_velocity": [1.0, 2.0, 3.0]}, "rise from 0"),
    ],
)
def test_an_impossible_loss_map_is_refused(change, words):
    given = loss_map().model_dump() | change
    with pytest.raises(ValueError, match=words):
        LossMap.model_validate(given)


def test_drive_without_its_figures_is_refused_at_load():
    with refused(ModelFileError, found=("'shoulder'", "losses")):
        robots.two_link(drive="loss_model")
    assert isinstance(drive_from_model(robots.two_link()), Ideal)
