"""Velocities that no motion explains are refused; wrong limits and units are not."""

from itertools import pairwise

import numpy as np
import pytest

from joint_messages import NAMES, SECOND, batch, limits, message
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.inputs.sources import JointStateSource


def states(velocities, rate=100.0):
    """Both joints move by the first of velocities that are possible; the second is reported."""
    return [
        message(1.0 + index / rate, NAMES, (0.01 * index,) * 2, velocity)
        for index, velocity in enumerate(velocities)
    ]


def taken(rows, cut=None, **options):
    ingest = JointStateIngest(NAMES, limits=limits(velocity=4.0), **options)
    cuts = [0, len(rows)] if cut is None else [0, *cut, len(rows)]
    stamps = []
    for start, stop in pairwise(cuts):
        block = ingest.step(batch(rows[start:stop]))
        stamps += [] if block is None else block.stamp_ns.tolist()
        assert ingest.rejections.balanced
    block = ingest.flush()
    stamps += [] if block is None else block.stamp_ns.tolist()
    assert ingest.rejections.balanced
    assert not ingest.rejections.waiting
    return ingest, stamps


@pytest.mark.parametrize("place", [0, 1, 10, 19])
@pytest.mark.parametrize("velocity", [13.0, -1000.0, 1e300])
@pytest.mark.parametrize("cut", [None, list(range(1, 20))])
def test_one_impossible_velocity_is_refused_wherever_it_stands(place, velocity, cut):
    rows = states([(1.0, velocity if index == place else 1.0) for index in range(20)])
    ingest, stamps = taken(rows, cut)
    assert ingest.rejections.rejected == {"impossible_velocity": 1}
    assert stamps == [SECOND + index * SECOND // 100 for index in range(20) if index != place]
    assert len(ingest.findings()) == 1
    assert ingest.order.segment == 0  # no gap of its own


def test_a_lone_message_with_an_impossible_velocity_waits_and_is_refused():
    ingest = JointStateIngest(NAMES, limits=limits(velocity=4.0))
    assert ingest.step(batch(states([(1.0, 99.0)]))) is None
    assert ingest.rejections.waiting == 1
    assert ingest.flush() is None
    assert ingest.rejections.rejected == {"impossible_velocity": 1}


def test_motion_that_fast_by_its_positions_is_used():
    """The limit of the URDF is wrong, or everything is in degrees: said, and counted."""
    rows = [
        message(1.0 + index / 100, NAMES, (0.5 * index,) * 2, (50.0, 50.0)) for index in range(20)
    ]
    ingest, stamps = taken(rows)
    assert not ingest.rejections.rejected
    assert len(stamps) == 20
    assert ingest.findings()


def test_parts_of_the_robot_are_judged_each_by_its_own_positions():
    rows = []
    for index in range(20):
        for name in NAMES:
            velocity = 500.0 if (index, name) == (9, "b") else 1.0
            rows.append(message(1.0 + index / 100, (name,), (0.01 * index,), (velocity,)))
    ingest, stamps = taken(rows)
    assert ingest.rejections.rejected == {"impossible_velocity": 1}
    assert len(stamps) == 20  # interpolated over the one that is missing


def test_the_ratio_is_a_parameter_and_no_limit_refuses_nothing():
    rows = states([(1.0, 13.0 if index == 5 else 1.0) for index in range(10)])
    assert not taken(rows, source=JointStateSource(max_velocity_ratio=4.0))[0].rejections.rejected
    ingest = JointStateIngest(NAMES)
    block = ingest.step(batch(rows))
    assert len(block) == 10
    unlimited = JointStateIngest(NAMES, limits=limits(velocity=np.inf))
    assert len(unlimited.step(batch(rows))) == 10


def test_what_was_refused_still_says_the_unit():
    angle = 1.0 + 0.5 * np.sin(np.arange(0, 5, 0.01) * 2)
    speed = np.gradient(angle, 0.01) * 180 / np.pi
    rows = [
        message(1.0 + index / 100, NAMES, (q, q), (v, v))
        for index, (q, v) in enumerate(zip(angle, speed, strict=True))
    ]
    ingest, _ = taken(rows)
    assert ingest.rejections.rejected["impossible_velocity"] > 100
    assert "velocities look like degrees per second" in ingest.findings()[0].sentence
