"""Payloads set at run time: right torque, from their stamp on, and nothing impossible."""

import numpy as np
import pytest

import robots
from refusals import refused
from robot_energy.foundation.errors import PayloadError, RobotDescriptionError
from robot_energy.model.payload import payload
from robot_energy.pipeline import TorqueStage
from robot_energy.pipeline.torque_stage import MAX_COMING
from robot_energy.timeline.blocks import TorqueBlock

MASS, LEVER = 3.0, 0.25
BODY = payload("fore", MASS, (LEVER, 0, 0), (0.01, 0.02, 0.02, 0, 0, 0))
SECOND_NS = 10**9


def held(seconds=4.0):
    """The two-link arm stretched out horizontally, at rest."""
    stamp = np.arange(round(seconds * 100)) / 100
    zero = np.zeros((len(stamp), 2))
    return robots.joint_block(stamp, zero, zero)


def swing(seconds=4.0):
    stamp = np.arange(round(seconds * 100)) / 100
    phase = stamp[:, None] * [5.0, 7.0]
    return robots.joint_block(stamp, np.sin(phase), np.cos(phase) * [5.0, 7.0])


def run(block, *changes, model=None):
    stage = TorqueStage(model or robots.two_link())
    for body, from_ns in changes:
        stage.set_payload(body, from_ns)
    parts = [stage.step(block), stage.flush()]
    return TorqueBlock.concatenate([part for part in parts if part is not None])


def test_static_pendulum_by_hand_from_the_stamp_on():
    block = held()
    extra = run(block, (BODY, 2 * SECOND_NS)).joint_torque_rigid - run(block).joint_torque_rigid
    weight = MASS * robots.G
    loaded = [weight * (robots.L1 + LEVER), weight * LEVER]  # m g r about each axis
    after = block.stamp_ns >= 2 * SECOND_NS
    assert 0 < after.sum() < len(after)
    np.testing.assert_allclose(extra, np.where(after[:, None], loaded, 0.0), atol=1e-12)


def test_equal_to_a_model_file_with_that_payload_for_all_later_samples():
    block = swing()
    model = robots.two_link(payload=[BODY.model_dump()])
    changed, filed, bare = run(block, (BODY, SECOND_NS)), run(block, model=model), run(block)
    after = block.stamp_ns >= SECOND_NS
    for name in ("joint_torque_rigid", "motor_torque_rigid", "payload_mass"):
        value = getattr(changed, name)
        np.testing.assert_array_equal(value[after], getattr(filed, name)[after])
        np.testing.assert_array_equal(value[~after], getattr(bare, name)[~after])
        assert (getattr(filed, name) != getattr(bare, name)).all()
    np.testing.assert_array_equal(changed.payload_mass, np.where(after, MASS, 0.0))


def test_one_body_per_link_replaces_what_the_model_file_says():
    model = robots.two_link(
        payload=[
            {"link": "fore", "mass": 1.0, "tag": "assumed"},
            {"link": "fore", "mass": 0.5, "tag": "assumed"},
            {"link": "upper", "mass": 2.0, "tag": "assumed"},
        ]
    )
    nothing = payload("fore", 0.0)
    out = run(held(), (BODY, SECOND_NS), (nothing, 2 * SECOND_NS), model=model)
    second = out.stamp_ns // SECOND_NS
    np.testing.assert_array_equal(
        out.payload_mass, np.select([second < 1, second < 2], [3.5, 2.0 + MASS], 2.0)
    )


def test_changes_count_by_their_stamps_whatever_the_order_of_the_requests():
    light = payload("fore", 1.0)
    later, sooner = (BODY, 3 * SECOND_NS), (light, SECOND_NS)
    np.testing.assert_array_equal(
        run(held(), later, sooner).payload_mass, run(held(), sooner, later).payload_mass
    )


def test_default_is_from_the_next_joint_state_on():
    stage, block = TorqueStage(robots.two_link()), held()
    assert stage.set_payload(payload("upper", 1.0)).from_ns == 0  # from the start
    first = stage.step(block[slice(0, 100)])
    change = stage.set_payload(BODY)
    assert change.from_ns == int(block.stamp_ns[99]) + 1
    rest = TorqueBlock.concatenate([first, stage.step(block[slice(100, None)]), stage.flush()])
    np.testing.assert_array_equal(
        rest.payload_mass, np.where(np.arange(len(block)) < 100, 1.0, 1.0 + MASS)
    )


def test_stamp_that_has_passed_counts_from_the_next_torque_and_says_so():
    stage, block = TorqueStage(robots.two_link()), held()
    done = stage.step(block[slice(0, 100)])
    change = stage.set_payload(BODY, SECOND_NS // 2)
    assert change.from_ns == int(done.stamp_ns[-1]) + 1
    rest = TorqueBlock.concatenate([stage.step(block[slice(100, None)]), stage.flush()])
    assert (done.payload_mass == 0).all()
    assert (rest.payload_mass == MASS).all()
    assert stage.coming_payloads == ()


def test_payload_stays_across_a_backward_jump_of_the_stamps():
    block = held()
    block.stamp_ns[200:] -= 2 * SECOND_NS
    block.segment[200:] = 1
    out = run(block, (BODY, SECOND_NS))
    np.testing.assert_array_equal(out.payload_mass, np.where(np.arange(400) < 100, 0.0, MASS))


def test_unknown_link_is_refused_and_the_old_payload_stays():
    stage = TorqueStage(robots.two_link())
    stage.set_payload(BODY)
    with refused(RobotDescriptionError, found="'hand'", expected="link"):
        stage.set_payload(payload("hand", 1.0))
    stage.step(held())
    assert stage.robot.payload == (BODY,)


def test_waiting_changes_are_bounded():
    stage = TorqueStage(robots.two_link())
    for number in range(MAX_COMING):
        stage.set_payload(BODY, 10**18 + number)
    with refused(PayloadError, found="100", remedy="stamps"):
        stage.set_payload(BODY, 10**18)


@pytest.mark.parametrize(
    ("mass", "inertia", "words"),
    [
        (-1.0, (0.0,) * 6, "'mass' is -1.0"),
        (np.nan, (0.0,) * 6, "'mass' is nan; expected a finite"),
        (np.inf, (0.0,) * 6, "'mass' is inf; expected a finite"),
        (1.0, (np.nan,) + (0.0,) * 5, "'inertia.0' is nan"),
        (1.0, (0.1, 0.1, 0.1, 0.2, 0, 0), "one is < 0"),
        (1.0, (0.1, 0.1, 0.3, 0, 0, 0), "more than the sum of the other two"),
        (1.0, (0.2, 0.2, 0.1, 0.15, 0, 0), "more than the sum of the other two"),
        (0.0, (0.1, 0.1, 0.1, 0, 0, 0), "without mass"),
        (1.0, (0.1, 0.1), "'inertia' is a list; expected 6 entries"),
    ],
)
def test_body_that_cannot_exist_is_refused(mass, inertia, words):
    with pytest.raises(PayloadError, match=words) as error:
        payload("fore", mass, (0, 0, 0), inertia)
    assert "'fore'" in str(error.value)
    assert "\n" not in str(error.value)


def test_bodies_at_the_edge_of_what_exists_are_accepted():
    payload("fore", 1.0, (0, 0, 0), (0.1, 0.1, 0.2, 0, 0, 0))  # a flat disc
    payload("fore", 1.0, (0, 0, 0), (0.1, 0.1, 0.0, 0, 0, 0))  # a thin rod
    payload("fore", 1.0, (0, 0, 0), (0.0867, 0.0433, 0.1300, 0, 0, 0))  # rounded figures
