"""What a driver may do to joint states, and what it costs in joules: the arm of two links.

Messages go through the ingest and the whole pipeline, as live and in replay. Each docstring
says what must come out.
"""

import numpy as np
import pytest

import robots
from joint_messages import JOINT_STATE, batch, message
from robot_energy.bag.cdr.decode import Encoder, RawBatch, stamp_columns
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.inputs.sources import JointStateSource
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.timeline.blocks import Quality

MODEL = robots.two_link()
NAMES = MODEL.joint_names
SECOND = 10**9
PERIOD = 0.01
START = 1000.0
IN_A_LOOP = np.arange(0, 10, PERIOD)
ALL_JOINTS = (0, 1)


def motion(t):
    """Positions and velocities that end where they begin after 10 s, shape (N, 2)."""
    w = 2 * np.pi * np.array([0.3, 0.5])
    angle = np.asarray(t)[:, None] * w
    return 0.4 + 0.3 * np.sin(angle), 0.3 * w * np.cos(angle)


def rows(t, velocity=True, joints=ALL_JOINTS, scale=1.0, at=None):
    """Serialised messages of the motion at times t, stamped at START + t or as said."""
    t = np.asarray(t, dtype=float)
    stamp = np.rint((START + (t if at is None else at)) * SECOND).astype(np.int64)
    q, v = motion(t)
    size = len(joints)
    lengths = {"position": size, "velocity": size * velocity, "effort": 0}
    encoder = Encoder(JOINT_STATE, {"name": tuple(NAMES[joint] for joint in joints)}, lengths)
    columns = stamp_columns(stamp) | {
        "position": scale * q[:, joints],
        "velocity": scale * v[:, joints][:, : size * velocity],
        "effort": np.zeros((len(t), 0)),
    }
    return [row.tobytes() for row in encoder.encode(columns, len(t))]


class Chain:
    """Ingest and pipeline with their accounts checked."""

    def __init__(self, **source):
        self.pipeline = EnergyPipeline(MODEL, Settings(power_period=None))
        self.ingest = JointStateIngest(
            NAMES, limits=self.pipeline.torque.robot.limits, source=JointStateSource(**source)
        )

    def take(self, *topics):
        """Messages of one topic, or of several."""
        batches = [
            batch(topic, f"/topic_{number}") if not isinstance(topic, RawBatch) else topic
            for number, topic in enumerate(topics)
        ]
        self.pipeline.step(self.ingest.step(batches))
        assert self.ingest.rejections.balanced
        return self

    def end(self):
        self.pipeline.step(self.ingest.flush())
        self.pipeline.flush()
        assert self.ingest.rejections.balanced
        assert not self.ingest.rejections.waiting
        time = self.time
        assert time.span_ns == time.observed_ns + time.gap_ns
        return self

    @property
    def time(self):
        return self.pipeline.account.registers.time

    @property
    def exact(self):
        """All registers with their remainders. [uJ]"""
        books = self.pipeline.account.registers
        return [
            int(whole) * 2**40 + int(rest)
            for whole, rest in zip(books.microjoule, books.remainder, strict=True)
        ]

    @property
    def energy(self):
        return self.pipeline.account.registers.cabinet("grid_import")

    @property
    def rejected(self):
        return dict(self.ingest.rejections.rejected)


@pytest.fixture(scope="module")
def once():
    return Chain().take(rows(IN_A_LOOP)).end()


def test_a_loop_of_ten_seconds_a_hundred_times_is_a_hundred_times_its_energy(once):
    """+-1 uJ in every register, 99 jumps; a delayed message of the run before is left out."""
    loop, chain = batch(rows(IN_A_LOOP)), Chain()
    for number in range(100):
        if number == 50:  # after a third of a second a message of the end comes late
            chain.take(rows(IN_A_LOOP[:33])).take(rows(IN_A_LOOP[-1:])).take(rows(IN_A_LOOP[33:]))
        else:
            chain.take(loop)
    chain.end()
    assert chain.time.jumps == chain.ingest.order.jumps == 99
    assert chain.time.gap_count == 0
    assert chain.rejected == {"stray_stamp": 1}
    assert chain.time.observed_ns == 100 * once.time.observed_ns
    energies = chain.pipeline.account.registers.deviations.start
    for total, single in zip(chain.exact[:energies], once.exact[:energies], strict=True):
        assert abs(total - 100 * single) <= 2**40
    for total, single in zip(chain.exact[energies:], once.exact[energies:], strict=True):
        assert total == pytest.approx(100 * single, rel=0.01)  # noise that is correlated


def test_a_constant_power_counts_although_nothing_changes():
    """Standing for an hour draws what standing draws: 30 W + 20 W and holding, times 3600 s."""
    stamps = np.arange(0, 3600, 0.25)
    chain = Chain().take(rows(np.zeros(len(stamps)), velocity=False, at=stamps)).end()
    held = Chain().take(rows(np.zeros(9), velocity=False, at=np.arange(9) * 0.25)).end()
    assert chain.time.gap_ns == 0
    assert chain.energy == pytest.approx(held.energy * 3599.75 / 2.0, rel=1e-9)
    assert chain.energy == pytest.approx(50.0 * 3599.75, rel=1e-9)


@pytest.mark.parametrize("share", [0.01, 0.1, 0.5, 0.9])
def test_loss_at_random_costs_what_the_gaps_hide(once, share):
    """observed + gap = span exactly, from first to last message kept; the rest is bridged."""
    rng = np.random.default_rng(round(100 * share))
    kept = np.flatnonzero(rng.random(len(IN_A_LOOP)) > share)
    chain = Chain().take(rows(IN_A_LOOP[kept])).end()
    span = round((IN_A_LOOP[kept[-1]] - IN_A_LOOP[kept[0]]) * SECOND)
    assert chain.time.span_ns == span
    if share <= 0.5:
        assert chain.energy == pytest.approx(once.energy * chain.time.observed_ns / span, rel=0.05)


def test_any_order_within_the_window_gives_the_same_joules(once):
    """Messages up to 50 ms late, sorted within 60 ms: the registers are equal to the last bit."""
    rng = np.random.default_rng(3)
    late = np.argsort(IN_A_LOOP + rng.uniform(0, 0.05, len(IN_A_LOOP)), kind="stable")
    messages = rows(IN_A_LOOP)
    chain = Chain(reorder_window=0.06).take([messages[row] for row in late]).end()
    assert chain.exact == once.exact
    assert chain.rejected == {}
    unsorted = Chain().take([messages[row] for row in late]).end()
    assert unsorted.rejected["older_stamp"] > 100
    assert unsorted.energy == pytest.approx(once.energy, rel=0.01)


def test_no_stamps_at_all_give_no_energy_and_one_sentence():
    chain = Chain().take(rows(IN_A_LOOP, at=np.full(len(IN_A_LOOP), -START))).end()
    assert chain.energy == 0
    assert chain.time.span_ns == 0
    (finding,) = chain.ingest.findings()
    assert "zero stamp" in finding.sentence


def test_two_topics_with_a_joint_each_cost_what_one_message_costs(once):
    """The elbow comes 3 ms later and at another rate: the same energy, nothing is held."""
    elbow = np.arange(0, 10, 0.008) + 0.003
    shoulder = rows(IN_A_LOOP, joints=(0,))
    chain = Chain().take(shoulder, rows(elbow, joints=(1,))).end()
    power = chain.energy / chain.time.observed_ns
    assert power == pytest.approx(once.energy / once.time.observed_ns, rel=1e-3)
    assert chain.time.gap_ns == 0
    assert chain.rejected.get("missing_joint", 0) <= 2  # before the elbow's first, after its last


@pytest.mark.parametrize("together", [True, False])
def test_a_joint_whose_publisher_dies_ends_the_energy(together):
    """The elbow is silent from 4 s to 7 s: three seconds of gap on all registers; also where
    the time of receipt says nothing, as when a stalled node takes all at once."""
    silent = IN_A_LOOP[(IN_A_LOOP < 4) | (IN_A_LOOP > 7)] + 0.003
    topics = [
        batch(rows(t, joints=(joint,)), received=np.zeros(len(t)) if together else t * SECOND)
        for joint, t in enumerate((IN_A_LOOP, silent))
    ]
    chain = Chain().take(*topics).end()
    assert chain.time.gap_count == 1
    assert chain.time.gap_ns == pytest.approx(3 * SECOND, abs=0.03 * SECOND)
    assert chain.rejected["missing_joint"] == pytest.approx(300, abs=3)


@pytest.mark.parametrize("together", [True, False])
def test_two_topics_loop_together(together):
    """A joint per topic, played twice, all taken at once: one jump, twice the energy."""
    elbow = IN_A_LOOP + 0.003
    single = Chain().take(rows(IN_A_LOOP, joints=(0,)), rows(elbow, joints=(1,))).end()
    received = [np.concatenate([t, t + 10]) * SECOND for t in (IN_A_LOOP, elbow)]
    topics = [
        batch(rows(t, joints=(joint,)) * 2, received=np.zeros(2 * len(t)) if together else times)
        for joint, (t, times) in enumerate(zip((IN_A_LOOP, elbow), received, strict=True))
    ]
    chain = Chain().take(*topics).end()
    assert chain.ingest.order.jumps == 1
    assert chain.energy == pytest.approx(2 * single.energy, rel=1e-9)


def test_a_topic_that_has_jumped_already_waits_for_the_other():
    """Taken at once: of the elbow only what follows the jump, of the shoulder both sides."""
    half = len(IN_A_LOOP) // 2
    shoulder, elbow = rows(IN_A_LOOP, joints=(0,)), rows(IN_A_LOOP + 0.003, joints=(1,))
    chain = Chain().take(
        *(batch(topic[:half], received=np.zeros(half)) for topic in (shoulder, elbow))
    )
    topics = [shoulder[half - 5 : half] + shoulder[:half], elbow[:half]]
    chain.take(*(batch(topic, received=np.zeros(len(topic))) for topic in topics)).end()
    assert chain.ingest.order.jumps == 1
    assert chain.rejected.get("missing_joint", 0) <= 4
    assert chain.ingest.samples >= 2 * half - 4


@pytest.mark.parametrize("offset", [0.0, 0.004])
@pytest.mark.parametrize("velocity", [True, False])
def test_a_publisher_of_zeros_next_to_the_driver_changes_no_energy(once, offset, velocity):
    """From 4 s to 6 s zeros come in between: they are left out, and all else is counted."""
    chain = beside_the_driver((0.0, 0.0), offset, velocity)
    alone = Chain().take(rows(IN_A_LOOP, velocity=velocity)).end()
    assert chain.exact == alone.exact
    assert chain.rejected == {"zero_state": 200}


def beside_the_driver(pose, offset, velocity):
    """The motion, and from 4 s to 6 s a second publisher of a pose."""
    times = 4 + np.arange(0, 2, PERIOD) + offset
    lie = [message(START + t, NAMES, pose, ()) for t in times]
    sent = list(zip(IN_A_LOOP, rows(IN_A_LOOP, velocity=velocity), strict=True))
    mixed = sorted([*sent, *zip(times, lie, strict=True)], key=lambda pair: pair[0])
    return Chain().take([entry for _, entry in mixed]).end()


@pytest.mark.parametrize("offset", [0.0, 0.004])
@pytest.mark.parametrize("velocity", [True, False])
def test_a_second_publisher_next_to_the_driver_adds_no_energy(once, offset, velocity):
    """From 4 s to 6 s a pose comes in between: until 7 s nothing is counted. What is, is what the
    undisturbed run has in the same time: not one false sample became energy."""
    chain = beside_the_driver((-0.5, -0.5), offset, velocity)
    assert chain.time.gap_ns == pytest.approx(3 * SECOND, abs=0.05 * SECOND)
    covered = IN_A_LOOP[(IN_A_LOOP < 4) | (IN_A_LOOP > 7)]
    alone = Chain().take(rows(covered, velocity=velocity)).end()
    assert chain.energy == pytest.approx(alone.energy, rel=0.01)
    assert any("contradict" in finding.sentence for finding in chain.ingest.findings())
    if offset:
        assert chain.ingest.conflicting_joints == {"shoulder", "elbow"}


def test_degrees_are_said_within_ten_seconds_and_counted_as_they_are():
    """Flagged in every sample, the sentence names joint, value, limits and the likely unit."""
    chain = Chain().take(rows(IN_A_LOOP, scale=180 / np.pi)).end()
    account = chain.pipeline.account
    assert account.counts.quality[Quality.JOINT_STATE_IMPLAUSIBLE] > 0.9 * account.counts.samples
    (finding,) = chain.ingest.findings()
    assert finding.sentence == (
        "shoulder is at 40.11, its limits are -3 to 3 rad: the joint states look like degrees"
    )
    assert finding.last_ns - finding.first_ns > 9 * SECOND
    assert not chain.rejected


def test_a_robot_at_exactly_zero_keeps_its_energy():
    """Standing at zero is flagged after 5 s, with a question; not a joule is left out."""
    stamps = np.arange(0, 10, PERIOD)
    still = [message(START + t, NAMES, (0.0, 0.0), (0.0, 0.0)) for t in stamps]
    chain = Chain().take(still).end()
    account = chain.pipeline.account
    assert account.counts.quality[Quality.JOINT_STATE_IMPLAUSIBLE] == 500
    assert chain.energy == pytest.approx(50.0 * stamps[-1], rel=1e-9)
    assert "exactly zero" in chain.ingest.findings()[0].sentence
