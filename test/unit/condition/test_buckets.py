import numpy as np

from robot_energy.condition.joint_friction import (
    BUCKET_DEGC,
    BUCKET_SPEED,
    DEGC_BUCKETS,
    SPEED_BUCKETS,
    degc_place,
    interpolated,
    shares,
    speed_place,
)


def test_a_bucket_lies_at_its_own_place():
    np.testing.assert_allclose(speed_place(BUCKET_SPEED), np.arange(SPEED_BUCKETS), atol=1e-12)
    np.testing.assert_allclose(degc_place(BUCKET_DEGC), np.arange(DEGC_BUCKETS))


def test_outside_the_outermost_buckets_hold():
    np.testing.assert_array_equal(speed_place(np.array([0.0, 1e-9, 1e9])), [0, 0, 3])
    np.testing.assert_array_equal(degc_place(np.array([-40.0, 200.0])), [0, 9])


def test_shares_sum_to_one_and_fall_to_the_next_bucket():
    place = np.array([0.0, 0.25, 2.9, 3.0])
    found = shares(place, 4)
    np.testing.assert_allclose(found.sum(axis=1), 1.0)
    np.testing.assert_allclose(found[1], [0.75, 0.25, 0.0, 0.0])


def test_a_plane_is_interpolated_exactly():
    rows, columns = np.arange(DEGC_BUCKETS)[:, None], np.arange(SPEED_BUCKETS)[None, :]
    table = np.stack([1.0 + 0.1 * rows + 0.02 * columns, 2.0 - 0.1 * rows + 0.0 * columns])
    rng = np.random.default_rng(0)
    degc, speed = rng.uniform(0, 9, (50, 2)), rng.uniform(0, 3, (50, 2))
    found = interpolated(table, degc, speed)
    np.testing.assert_allclose(found[:, 0], 1.0 + 0.1 * degc[:, 0] + 0.02 * speed[:, 0])
    np.testing.assert_allclose(found[:, 1], 2.0 - 0.1 * degc[:, 1])
    edge = interpolated(table, np.full((1, 2), 9.0), np.full((1, 2), 3.0))
    np.testing.assert_allclose(edge, [[1.96, 1.1]])
