"""Limits that stand in a URDF because something must stand there."""

import numpy as np
import pytest

from robot_energy.physics.urdf.checks import joint_limits, parse
from robot_energy_identify.starter.model_remarks import limit_remarks


def limited(limit, kind="revolute"):
    return parse(
        '<robot name="r"><link name="a"/><link name="b"/>'
        f'<joint name="j" type="{kind}"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
        f"<limit {limit}/></joint></robot>"
    )


@pytest.mark.parametrize(
    ("kind", "limit", "effort", "velocity", "said"),
    [
        ("revolute", 'effort="90" velocity="2.5"', 90.0, 2.5, 0),
        ("revolute", 'effort="1e5" velocity="55"', 1e5, 55.0, 0),
        ("revolute", 'effort="10000000.0" velocity="1000"', np.inf, np.inf, 2),
        ("revolute", 'effort="1e+9" velocity="100"', np.inf, np.inf, 2),
        ("revolute", 'effort="0" velocity="0.0"', np.inf, np.inf, 0),
        ("revolute", 'effort="-1" velocity="-1"', np.inf, np.inf, 2),
        ("revolute", 'effort="inf" velocity="Infinity"', np.inf, np.inf, 0),
        ("continuous", 'effort="3" velocity="1e3"', 3.0, np.inf, 1),
        ("prismatic", 'effort="5e5" velocity="10"', 5e5, 10.0, 0),
        ("prismatic", 'effort="1e6" velocity="50"', np.inf, np.inf, 2),
    ],
)
def test_placeholders_count_as_not_given_and_are_named(kind, limit, effort, velocity, said):
    root = limited(limit, kind)
    found = joint_limits(root, ("j",))
    assert (found.effort[0], found.velocity[0]) == (effort, velocity)
    remarks = limit_remarks(root, ("j",))
    assert len(remarks) == said
    assert all("counts as not given" in text for text in remarks)


def test_a_range_the_wrong_way_round_is_named():
    root = limited('lower="2.8" upper="-2.8" effort="9" velocity="1"')
    assert joint_limits(root, ("j",)).lower[0] == -np.inf
    (said,) = limit_remarks(root, ("j",))
    assert "lower limit 2.8 is above the upper limit -2.8" in said
    assert limit_remarks(limited('lower="0" upper="0" effort="9" velocity="1"'), ("j",)) == []
