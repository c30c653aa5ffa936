import numpy as np
import pytest

from joint_messages import NAMES, SECOND, batch, limits, message, take
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.inputs.sources import JointStateSource
from robot_energy.timeline.blocks import Quality


def test_joints_are_matched_by_name_in_every_message():
    ingest = JointStateIngest(NAMES)
    block = take(
        ingest,
        [
            message(1.0),
            message(1.1, ("b", "a"), (2.0, 1.0), (4.0, 3.0)),
            message(1.2, ("x", "b", "a"), (9.0, 2.0, 1.0), (9.0, 4.0, 3.0)),
        ],
    )
    np.testing.assert_array_equal(block.joint_position, [[1.0, 2.0]] * 3)
    np.testing.assert_array_equal(block.joint_velocity, [[3.0, 4.0]] * 3)
    assert ingest.ignored_joints == {"x"}


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        ({"names": ("x",), "position": (1.0,), "velocity": (1.0,)}, "unknown_joint"),
        ({"names": ()}, "unknown_joint"),
        ({"names": ("a", "b", "b"), "position": (1.0,) * 3, "velocity": ()}, "repeated_joint"),
        ({"position": (1.0, 2.0, 3.0)}, "wrong_length"),
        ({"velocity": (1.0,)}, "wrong_length"),
        ({"position": (1.0, np.nan)}, "not_finite"),
        ({"velocity": (1.0, np.inf)}, "not_finite"),
    ],
)
def test_bad_message_is_rejected_with_its_reason_and_its_neighbours_stay(bad, reason):
    ingest = JointStateIngest(NAMES)
    block = take(ingest, [message(1.0), message(1.1, **bad), message(1.2)])
    assert len(block) == 2
    assert ingest.rejections.rejected == {reason: 1}


def test_stamps_must_be_set_and_newer():
    ingest = JointStateIngest(NAMES)
    block = take(ingest, [message(t) for t in (0.0, 2.0, 2.0, 1.5, 2.1)])
    np.testing.assert_array_equal(block.stamp_ns, [2 * SECOND, 2_100_000_000])
    assert ingest.rejections.rejected == {"zero_stamp": 1, "duplicate_stamp": 1, "older_stamp": 1}


@pytest.mark.parametrize(("again", "reason"), [(1.3, "duplicate_stamp"), (1.25, "older_stamp")])
def test_a_stamp_is_not_newer_than_the_last_one_that_came_before(again, reason):
    ingest = JointStateIngest(NAMES)
    for stamps in ((1.0, 1.1), (1.2, 1.3), (again, 1.4)):  # those in the middle rise
        take(ingest, [message(t) for t in stamps], flush=False)
    assert ingest.rejections.rejected == {reason: 1}


def test_missing_velocity_stays_nan_for_the_derivative():
    block = take(
        JointStateIngest(NAMES), [message(1.0, velocity=()), message(1.1, velocity=(np.nan, 4.0))]
    )
    np.testing.assert_array_equal(np.isnan(block.joint_velocity), [[True, True], [True, False]])


def test_gap_begins_a_segment_and_is_flagged():
    stamps = [*np.arange(1, 2, 0.01), *np.arange(2.2, 2.3, 0.01)]
    block = take(JointStateIngest(NAMES), [message(t) for t in stamps])
    np.testing.assert_array_equal(np.unique(block.segment), [0, 1])
    flagged = np.flatnonzero(block.quality & Quality.AFTER_GAP)
    np.testing.assert_array_equal(flagged, [100])


def test_slow_stream_is_not_all_gaps():
    # 4 Hz: 0.25 s is the period, not a gap; 2 s is one
    stamps = [*np.arange(1, 11, 0.25), 13.0, 13.25]
    block = take(JointStateIngest(NAMES), [message(t) for t in stamps])
    np.testing.assert_array_equal(block.segment, [0] * 40 + [1] * 2)


def test_bag_loop_begins_a_new_epoch():
    ingest = JointStateIngest(NAMES)
    loop = [message(t) for t in np.arange(1, 6, 0.5)]
    block = take(ingest, loop + loop + loop)
    assert ingest.rejections.accepted == 30
    assert ingest.order.jumps == 2
    assert block.segment[-1] == 2


def test_garbage_is_counted_as_malformed():
    ingest = JointStateIngest(NAMES)
    good = message(1.0)
    block = take(ingest, [good, b"", b"\x00\x01", good[:-9], b"\xff" * 80, message(2.0)])
    assert len(block) == 2
    assert ingest.rejections.rejected["malformed"] == 4


def test_effort_is_matched_by_name_and_its_absence_rejects_nothing():
    messages = [
        message(1.0, ("a", "b"), (0.0,) * len(("a", "b")), (), effort=(5.0, 6.0)),
        message(1.1, ("b", "x", "a"), (0.0,) * len(("b", "x", "a")), (), effort=(6.0, 9.0, 5.0)),
        message(1.2, ("a", "b"), (0.0,) * len(("a", "b")), (), effort=()),
        message(1.3, ("a", "b"), (0.0,) * len(("a", "b")), (), effort=(5.0,)),
        message(1.4, ("a", "b"), (0.0,) * len(("a", "b")), (), effort=(np.nan, np.inf)),
    ]
    nothing = [np.nan, np.nan]
    block = take(JointStateIngest(NAMES, effort=True), messages)
    expected = [[5.0, 6.0], [5.0, 6.0], nothing, nothing, [np.nan, np.inf]]
    np.testing.assert_array_equal(block.joint_effort, expected)
    unread = take(JointStateIngest(NAMES), messages)
    assert np.isnan(unread.joint_effort).all()
    assert len(unread) == len(block) == 5


def test_message_of_strange_joints_only_is_said_from_a_part():
    ingest = JointStateIngest(NAMES)
    assert take(ingest, [message(1.0, ("x", "y"))]) is None
    assert ingest.rejections.rejected == {"unknown_joint": 1}
    assert ingest.missing_joints == {"a", "b"}


@pytest.mark.parametrize("positions", range(4))
@pytest.mark.parametrize("velocities", range(4))
@pytest.mark.parametrize("efforts", range(4))
def test_arrays_of_any_length_are_used_or_refused_but_never_zero(positions, velocities, efforts):
    """Two names: position needs two entries, velocity two or none; absent is NaN, as is an
    effort of any other length."""
    one = message(
        1.0, position=(1.0,) * positions, velocity=(2.0,) * velocities, effort=(3.0,) * efforts
    )
    ingest = JointStateIngest(NAMES, effort=True)
    block = take(ingest, [one])
    if positions == 2 and velocities in (0, 2):
        assert np.isnan(block.joint_velocity).all() == (velocities == 0)
        assert np.isnan(block.joint_effort).all() == (efforts != 2)
    else:
        assert block is None
        assert ingest.rejections.rejected == {"wrong_length": 1}


def test_a_delayed_message_of_the_run_before_a_loop_is_a_stray():
    """It must not send the stamps ahead, where everything that follows would be old."""
    loop = [message(t) for t in np.arange(10, 15, 0.01)]
    ingest = JointStateIngest(NAMES)
    block = take(ingest, loop + loop[:200] + [loop[-1]] + loop[200:])
    assert ingest.order.jumps == 1
    assert ingest.rejections.accepted == len(block) == 1000
    assert ingest.rejections.rejected == {"stray_stamp": 1}


def test_one_message_of_the_past_begins_no_epoch():
    run = [message(t) for t in np.arange(10, 15, 0.01)]
    ingest = JointStateIngest(NAMES)
    take(ingest, [*run[:200], message(3.0), *run[200:]])
    assert ingest.order.jumps == 0
    assert ingest.rejections.rejected == {"stray_stamp": 1}


def test_forward_jump_is_a_gap_and_the_stamps_go_on_from_there():
    stamps = [*np.arange(1, 2, 0.01), *np.arange(3600, 3601, 0.01)]
    ingest = JointStateIngest(NAMES)
    block = take(ingest, [message(t) for t in stamps])
    assert len(block) == 200
    np.testing.assert_array_equal(np.flatnonzero(np.diff(block.segment)), [99])


def test_a_message_that_comes_last_waits_no_longer_than_the_end():
    ingest = JointStateIngest(NAMES)
    assert take(ingest, [message(1.0), message(9.0)], flush=False).stamp_ns.tolist() == [SECOND]
    assert ingest.rejections.waiting == 1
    assert ingest.flush().stamp_ns.tolist() == [9 * SECOND]


def test_two_clocks_that_take_turns_are_a_conflict():
    """Publishers ten minutes apart, each in bursts: no epoch after epoch is integrated."""
    bursts = [
        message(start + tick * 0.04 + row * 0.01)
        for tick in range(50)
        for start in (1000.0, 400.0)
        for row in range(4)
    ]
    ingest = JointStateIngest(NAMES)
    block = take(ingest, bursts)
    assert ingest.rejections.rejected["conflicting_publisher"] > 300
    assert len(block) < 20
    assert any("contradict" in finding.sentence for finding in ingest.findings())


def test_all_zero_stamps_are_a_finding_and_give_nothing():
    ingest = JointStateIngest(NAMES)
    assert take(ingest, [message(0.0)] * 5) is None
    assert ingest.rejections.rejected == {"zero_stamp": 5}
    (finding,) = ingest.findings()
    assert "all 5 joint states have a zero stamp" in finding.sentence
    assert finding.severe


def test_time_of_receipt_counts_only_if_configured():
    ingest = JointStateIngest(NAMES, source=JointStateSource(stamp_source="receive"))
    block = ingest.step(batch([message(0.0)] * 3, received=[5 * SECOND, 6 * SECOND, 7 * SECOND]))
    np.testing.assert_array_equal(block.stamp_ns, [5 * SECOND, 6 * SECOND, 7 * SECOND])


def test_order_within_the_window_is_restored_and_beyond_it_dropped():
    late = [1.0, 1.1, 1.3, 1.2, 1.4, 1.5, 1.35, 1.6, 1.15, 1.7]
    ingest = JointStateIngest(NAMES, source=JointStateSource(reorder_window=0.2))
    block = take(ingest, [message(t) for t in late])
    np.testing.assert_allclose(block.stamp_ns / SECOND, sorted(set(late) - {1.15}))
    assert ingest.rejections.rejected == {"older_stamp": 1}
    plain = JointStateIngest(NAMES)
    take(plain, [message(t) for t in late])
    assert plain.rejections.rejected == {"older_stamp": 3}


@pytest.mark.parametrize("share", [0.01, 0.3, 0.9])
def test_any_loss_leaves_observed_and_gap_time_that_sum_to_the_span(share):
    rng = np.random.default_rng(round(share * 100))
    stamps = 1.0 + np.cumsum(rng.uniform(0.009, 0.011, 2000))
    kept = stamps[rng.random(2000) > share]
    block = take(JointStateIngest(NAMES), [message(t) for t in kept])
    elapsed = np.diff(block.stamp_ns)
    gap = np.diff(block.segment) > 0
    assert len(block) == len(kept)
    assert elapsed[~gap].max() <= 0.1 * SECOND or share == 0.9
    assert elapsed[gap].sum() + elapsed[~gap].sum() == block.stamp_ns[-1] - block.stamp_ns[0]


# --- plausibility ---------------------------------------------------------------------


def moving(positions, velocities=None, names=NAMES, rate=100.0, start=1.0):
    """Messages at a rate; both joints alike."""
    stamps = start + np.arange(len(positions)) / rate
    if velocities is None:
        velocities = np.gradient(positions, 1 / rate)
    return [
        message(t, names, (q,) * len(names), (v,) * len(names))
        for t, q, v in zip(stamps, positions, velocities, strict=True)
    ]


def sway(scale=1.0, seconds=10.0):
    return scale * (1.0 + 0.5 * np.sin(np.arange(0, seconds, 0.01) * 2))


def sentences(ingest):
    return [finding.sentence for finding in ingest.findings()]


def test_degrees_are_flagged_within_ten_seconds_named_and_left_as_they_are():
    ingest = JointStateIngest(NAMES, limits=limits())
    block = take(ingest, moving(sway(180 / np.pi)))
    flagged = (block.quality & Quality.JOINT_STATE_IMPLAUSIBLE) > 0
    assert flagged.all()
    np.testing.assert_allclose(block.joint_position[:, 0], sway(180 / np.pi))
    assert sentences(ingest) == [
        "a is at 85.94, its limits are -3 to 3 rad: the joint states look like degrees"
    ]
    assert ingest.findings()[0].wrong_power


def test_another_robot_is_said_from_another_unit():
    ingest = JointStateIngest(NAMES, limits=limits())
    take(ingest, moving(sway() + 1000.0))
    assert "is this the model of the robot" in sentences(ingest)[0]
    assert not ingest.findings()[0].wrong_power


def test_millimetres_are_recognised_on_prismatic_joints():
    ingest = JointStateIngest(NAMES, limits=limits(prismatic=True))
    take(ingest, moving(sway(1000.0)))
    assert "limits are -3 to 3 m: the joint states look like millimetres" in sentences(ingest)[0]


def test_velocities_in_degrees_are_recognised_by_limit_and_by_position():
    q = sway()
    fast = np.gradient(q, 0.01) * 180 / np.pi
    ingest = JointStateIngest(NAMES, limits=limits())
    take(ingest, moving(q, fast))
    assert any("velocities look like degrees per second" in text for text in sentences(ingest))
    ingest = JointStateIngest(NAMES)  # no limits at all
    take(ingest, moving(q, fast))
    assert sentences(ingest) == [
        "the velocity of a is 57.3 times the change of its "
        "positions: it looks like degrees per second"
    ]


def test_velocity_of_the_wrong_sign_is_found():
    q = sway()
    ingest = JointStateIngest(NAMES, limits=limits())
    take(ingest, moving(q, -np.gradient(q, 0.01)))
    assert sentences(ingest) == [
        "the velocity of a has the opposite sign of the change of its positions"
    ]


def test_velocities_that_stay_zero_are_found():
    ingest = JointStateIngest(NAMES, limits=limits())
    take(ingest, moving(sway(), np.zeros(1000)))
    assert sentences(ingest) == [
        "the velocity of a stays 0 while its positions move: set joint_states.velocity_source to "
        "positions"
    ]
    again = JointStateIngest(NAMES, limits=limits())
    zero = np.zeros(1000)
    take(again, moving(np.where(np.arange(1000) < 500, zero, zero + 0.01), zero))
    assert not sentences(again)  # its zero is set again at rest


@pytest.mark.parametrize("size", [1, 3, 8, 1000])
def test_states_that_a_driver_repeats_are_used_and_named(size):
    """Positions of 50 Hz at 250 Hz: each step is far too large for 4 ms, but not for 20 ms."""
    at = np.arange(1000) // 5 * 0.02
    sent = moving(1.5 * np.sin(1.8 * at), 2.7 * np.cos(1.8 * at), rate=250.0)
    ingest = JointStateIngest(NAMES, limits=limits())
    for start in range(0, len(sent), size):
        take(ingest, sent[start : start + size], flush=False)
    ingest.flush()
    assert ingest.samples == 1000
    assert sentences(ingest) == [
        "positions stay the same for 5 messages (20 ms) and then step, as of a driver that "
        "repeats its states: let it send each state once, or give derivative_window at least 0.1 s"
    ]


def test_stamps_that_are_too_coarse_or_stand_still_are_named():
    q = sway(seconds=4.0)
    coarse, frozen = (
        [message(t, NAMES, (p, p), ()) for t, p in zip(stamps, q, strict=True)]
        for stamps in (1 + np.arange(400) // 4 * 0.04, 1 + np.minimum(np.arange(400), 200) * 0.01)
    )
    for sent, same in ((coarse, 300), (frozen, 199)):
        ingest = JointStateIngest(NAMES, limits=limits())
        take(ingest, sent)
        (finding,) = ingest.findings()
        assert f"{same} joint states have the stamp of the one before" in finding.sentence
        assert finding.setting == "joint_states: {stamp_source: receive}"
        assert finding.severe


@pytest.mark.parametrize("cut", [1, 7, 1000])
def test_stamps_rounded_near_the_period_are_no_second_publisher(cut):
    """125 Hz rounded to 10 ms: after a state that is left out the next step looks too fast."""
    at = np.arange(1000) / 125
    q, stamp = 1.5 * np.sin(2.6 * at), 1 + np.round(at, 2)
    sent = [message(t, NAMES, (p, 0.3 * p), ()) for t, p in zip(stamp, q, strict=True)]
    ingest = JointStateIngest(NAMES, limits=limits())
    for row in range(0, len(sent), cut):
        take(ingest, sent[row : row + cut], flush=False)
    ingest.flush()
    assert ingest.conflicting_joints == {"a"}
    (finding,) = ingest.findings()
    assert finding.sentence.startswith("stamps are coarser than the states, multiples of 10 ms: ")
    assert "publishers" not in finding.sentence
    assert finding.setting == "joint_states: {stamp_source: receive}"


@pytest.mark.parametrize("cut", [1, 7, 1000])
def test_stamps_rounded_below_the_period_are_mended_by_times_of_receipt(cut):
    """125 Hz rounded to 5 ms: steps of 5 and 10 ms, of which the short ones look too fast."""
    at = np.arange(1000) / 125
    q, stamp = 1.5 * np.sin(2.6 * at), 1 + np.round(at / 0.005) * 0.005
    sent = [message(t, NAMES, (p, 0.3 * p), ()) for t, p in zip(stamp, q, strict=True)]
    ingest = JointStateIngest(NAMES, limits=limits())
    for row in range(0, len(sent), cut):
        take(ingest, sent[row : row + cut], flush=False)
    ingest.flush()
    (finding,) = ingest.findings()
    assert "the stamps are multiples of 5 ms: if the driver rounds them" in finding.sentence
    assert finding.setting == "joint_states: {stamp_source: receive}"


@pytest.mark.parametrize(
    ("late", "words"),
    [(0.0, "let the driver send a stamp for each state"), (0.006, "stamps are rounded or late")],
)
def test_times_of_receipt_are_not_advised_where_they_are_in_use(late, words):
    """125 Hz received in steps of 10 ms, or every second state late."""
    at = np.arange(1000) / 125
    q = 0.9 * np.sin(4.3 * at)
    received = 1 + (at + late * (np.arange(1000) % 2) if late else np.round(at, 2))
    sent = [message(t, NAMES, (p, 0.3 * p), ()) for t, p in zip(at, q, strict=True)]
    source = JointStateSource(stamp_source="receive")
    ingest = JointStateIngest(NAMES, limits=limits(), source=source)
    ingest.step(batch(sent, received=np.rint(received * SECOND).astype(np.int64)))
    (finding,) = ingest.findings()
    assert words in finding.sentence
    assert finding.setting == ""


def test_all_exactly_zero_for_seconds_is_flagged_and_still_used():
    ingest = JointStateIngest(NAMES, limits=limits())
    block = take(ingest, moving(np.zeros(1000)))
    flagged = np.flatnonzero(block.quality & Quality.JOINT_STATE_IMPLAUSIBLE)
    assert len(block) == 1000
    np.testing.assert_array_equal(flagged, np.arange(500, 1000))
    assert "all joints have been exactly zero" in sentences(ingest)[0]
    ingest = JointStateIngest(NAMES, limits=limits())
    take(ingest, moving(np.concatenate([np.zeros(499), [1e-9], np.zeros(499)])))
    assert not ingest.findings()


def test_zeros_count_across_blocks():
    ingest = JointStateIngest(NAMES)
    messages = moving(np.zeros(600))
    blocks = [ingest.step(batch(messages[row : row + 7])) for row in range(0, 600, 7)]
    flagged = np.concatenate([block.quality for block in blocks]) > 0
    np.testing.assert_array_equal(np.flatnonzero(flagged), np.arange(500, 600))


def test_no_unit_is_named_that_explains_only_half():
    ingest = JointStateIngest(NAMES, limits=limits())
    take(ingest, moving(sway(180 / np.pi), velocities=np.full(1000, 1e4)))
    assert "is this the model of the robot" in sentences(ingest)[0]


def test_a_healthy_robot_gives_no_finding():
    ingest = JointStateIngest(NAMES, limits=limits())
    block = take(ingest, moving(sway()))
    assert not block.quality.any()
    assert not ingest.findings()


def test_findings_of_long_ago_are_left_out_if_asked():
    ingest = JointStateIngest(NAMES, limits=limits())
    take(ingest, moving([90.0] * 10) + moving(sway(seconds=30.0), start=2.0))
    assert len(ingest.findings()) == 1
    assert not ingest.findings(within=10.0)


def test_findings_of_before_a_jump_back_are_of_long_ago():
    """Their stamps are later than the newest one: they were shown until these came again."""
    ingest = JointStateIngest(NAMES, limits=limits())
    take(ingest, moving([90.0] * 10, start=3600.0), flush=False)
    assert ingest.findings(within=10.0)
    take(ingest, moving(sway(seconds=30.0), start=2.0))
    assert ingest.order.jumps == 1
    assert ingest.findings()
    assert not ingest.findings(within=10.0)


def test_names_that_never_repeat_do_not_fill_the_memory():
    """A driver that puts a counter into its joint names, or one made to harm."""
    ingest = JointStateIngest(NAMES)
    for start in range(0, 1000, 100):
        numbers = range(start, start + 100)
        take(
            ingest,
            [message(1 + n / 100, (*NAMES, f"x{n}"), (1.0,) * 3, (1.0,) * 3) for n in numbers],
        )
    assert ingest.rejections.received == ingest.rejections.accepted == 1000
    assert len(ingest.ignored_joints) <= 100
    assert len(ingest._reader._columns) <= 100


@pytest.mark.parametrize(
    ("period", "max_gap", "found", "setting"),
    [
        (10.0, 0.0, True, "max_gap: 20"),
        (100.0, 0.0, True, ""),  # beyond what max_gap can be
        (0.2, 0.1, True, "max_gap: 0.4"),
        (10.0, 20.0, False, ""),
        (0.5, 0.0, False, ""),
        (1e-4, 0.0, False, ""),
        (1e-5, 0.0, True, ""),
    ],
)
def test_times_in_another_unit_are_named(period, max_gap, found, setting):
    findings = spacing_findings(np.full(40, period), max_gap)
    assert [finding.severe for finding in findings] == [True] * found
    assert [finding.setting for finding in findings] == [setting] * found


@pytest.mark.parametrize(("jitter", "found"), [(0.0, False), (0.05, True)])
def test_a_slow_driver_that_jitters_is_named_with_its_remedy(jitter, found):
    """Half of the steps of 1 s are longer than the 1 s that are bridged at most."""
    steps = 1.0 + np.random.default_rng(1).uniform(-jitter, jitter, 40)
    findings = spacing_findings(steps, 0.0)
    assert len(findings) == found
    if found:
        advised = float(findings[0].setting.removeprefix("max_gap: "))
        assert advised == pytest.approx(2.0, rel=0.05)
        assert spacing_findings(steps, advised) == []


def spacing_findings(steps, max_gap):
    ingest = JointStateIngest(NAMES, max_gap=max_gap)
    for stamp in 1000.0 + np.cumsum(steps):
        take(ingest, [message(stamp)], flush=False)
    return ingest.stream_findings()
