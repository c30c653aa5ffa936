"""Stamps at and beyond the limits of their types: refused where they enter, never more."""

from __future__ import annotations

import numpy as np
import pytest
import stamps
from stamps import KINDS, START, Message, Monitors, clean, mixed, spoiled, stamped
from target import JOINTS

import robots
from joint_messages import SECOND, batch, message
from robot_energy.bag.cdr import typestore
from robot_energy.inputs.joint_states.joint_states import JOINT_STATE
from robot_energy.messages.friction import JOINT_FRICTION, FrictionWriter
from robot_energy.messages.payload import PAYLOAD
from robot_energy.messages.torque import JOINT_TORQUE
from robot_energy.pipeline import FrictionStage
from robot_energy.timeline.stamps import MAX_STAMP_NS, MIN_STAMP_NS, bounded

INT32 = 2**31
BAD = {
    "minus one second": (-1, 0, -SECOND),
    "minus 1 ns": (-1, SECOND - 1, -1),
    "least": (-INT32, 0, -(2**63)),
    "greatest": (INT32 - 1, 2**32 - 1, 2**63 - 1),
    "end of int32": (INT32 - 1, 0, (INT32 - 1) * SECOND),
    "a whole second of ns": (1000, SECOND, MAX_STAMP_NS + SECOND),
    "beyond the range": (*divmod(MAX_STAMP_NS + 1, SECOND), MAX_STAMP_NS + 1),
}
POSSIBLE = {
    "zero": (0, 0, 0),
    "1 ns": (0, 1, 1),
    "last": (*divmod(MAX_STAMP_NS, SECOND), MAX_STAMP_NS),
}
PLACES = (1, len(clean()) // 2, len(clean()))


@pytest.mark.parametrize("stamp", BAD.values(), ids=BAD)
def test_a_bad_stamp_changes_nothing_first_in_the_middle_and_last(stamp):
    """Of every kind of message, all in one run."""
    bad = [(place, spoiled(kind, *stamp)) for place in PLACES for kind in KINDS]
    figures, monitors = mixed(bad)
    assert figures == stamps.clean_figures()
    for kind in KINDS:
        assert monitors.rejections(kind).rejected["bad_stamp"] == len(PLACES), kind


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("stamp", POSSIBLE.values(), ids=POSSIBLE)
def test_a_possible_stamp_far_away_leaves_every_account_exact(stamp, place):
    _, monitors = mixed([(place, spoiled(kind, *stamp)) for kind in KINDS])
    for kind in KINDS:
        account = monitors.rejections(kind)
        assert account.rejected["bad_stamp"] == 0
        no_zero_stamp = kind in (PAYLOAD, JOINT_TORQUE, JOINT_FRICTION)
        assert (account.rejected["zero_stamp"] == 1) == (not any(stamp) and not no_zero_stamp)


@pytest.mark.parametrize("log_ns", [-1, -(2**63), 2**63 - 1, MAX_STAMP_NS + 1])
def test_a_bad_time_of_receipt_changes_nothing_where_it_counts(log_ns):
    figures = []
    states = [one for one in clean() if one.kind == JOINT_STATE]
    for extra in (0, 1):
        monitors = Monitors(receive=True)
        for one in clean():
            if extra and one in (states[0], states[len(states) // 2]):
                monitors.take(Message(JOINT_STATE, log_ns, one.data), mixed_in=True)
            monitors.take(one)
        figures.append(monitors.finish())
        assert monitors.joints.rejections.rejected["bad_stamp"] == 2 * extra
    assert figures[0] == figures[1]


def test_joint_states_received_at_time_zero_are_refused_and_said():
    monitors = Monitors(receive=True)
    rows = [message(0.0, JOINTS)] * 5
    assert monitors.joints.step(batch(rows, received=[0] * 5)) is None
    assert monitors.joints.rejections.rejected == {"zero_stamp": 5}
    (finding,) = monitors.joints.findings()
    assert "start the source of /clock" in finding.sentence


def test_a_bad_temperature_stamp_in_a_friction_is_refused():
    model = robots.two_link()
    row = FrictionWriter(model).encode(FrictionStage(model).latest())[0].tobytes()
    store = typestore()
    decoded = store.deserialize_cdr(stamped(row, 1000, 1), JOINT_FRICTION)
    decoded.temperature_stamp[1].nanosec = SECOND
    data = bytes(store.serialize_cdr(decoded, JOINT_FRICTION))
    figures, monitors = mixed([(place, Message(JOINT_FRICTION, START, data)) for place in PLACES])
    assert figures == stamps.clean_figures()
    assert monitors.friction.rejections.rejected == {"bad_stamp": len(PLACES)}


@pytest.mark.parametrize(
    ("stamp", "expected"),
    [(-5, MIN_STAMP_NS), (7, 7), (2**63, MAX_STAMP_NS), (MAX_STAMP_NS + 1, MAX_STAMP_NS)],
)
def test_a_derived_stamp_is_bounded(stamp, expected):
    assert bounded(stamp) == expected
    assert np.int64(bounded(stamp)) == expected
