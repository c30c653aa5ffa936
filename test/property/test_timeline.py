"""Laws of time: any cutting of a stream into blocks gives the same, for each rule and the whole."""

from collections import Counter
from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import robots
from joint_messages import SECOND, batch, message
from robot_energy.accounting.registers import CLOCK_STEP_NS, Coverage
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.inputs.sources import JointStateSource
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.timeline.blocks import Block, Int
from robot_energy.timeline.stamps import Reach, first_needed, held_rows, newer, slow_reach
from robot_energy.timeline.streams import StampOrder, StreamSplitter

MODEL = robots.two_link()
REACHES = [Reach(), Reach(patient=False), Reach(prompt=True), slow_reach(60 * SECOND)]
cuts = st.lists(st.integers(0, 120), max_size=12)
seeds = st.integers(0, 2**31)


class Numbered(Block):
    """Messages with a number, of one of two kinds."""

    number: Int
    kind: Int


def kinds(block):
    return {bytes([kind]): np.flatnonzero(block.kind == kind) for kind in set(block.kind.tolist())}


def stream(seed, size=120):
    """Stamps with jitter, swaps, repetitions, outliers, a pause and a jump back."""
    rng = np.random.default_rng(seed)
    period = int(rng.choice([SECOND // 100, SECOND // 10, 2 * SECOND]))
    stamp = 1000 * SECOND + np.cumsum(rng.integers(period * 9 // 10, period * 11 // 10, size))
    for row in rng.integers(1, size - 1, 6).tolist():
        stamp[row - 1], stamp[row] = stamp[row], stamp[row - 1]
    repeated = rng.integers(1, size, 4)
    stamp[repeated] = stamp[repeated - 1]
    stamp[rng.integers(0, size, 2)] += rng.integers(-900, 900, 2) * SECOND
    pause, jump = rng.integers(1, size, 2)
    stamp[pause:] += int(rng.integers(0, 30)) * SECOND
    stamp[jump:] -= int(rng.integers(0, 500)) * SECOND
    return Numbered(stamp, np.arange(size), rng.integers(0, 2, size))


def pieces(block, bounds):
    edges = [0, *sorted(min(bound, len(block)) for bound in bounds), len(block)]
    parts = [block[slice(a, b)] for a, b in pairwise(edges)]
    return [part for part in parts if len(part)]


@settings(deadline=None, max_examples=25)
@given(
    seed=seeds,
    bounds=cuts,
    reach=st.sampled_from(REACHES),
    window=st.sampled_from([0, SECOND // 50, SECOND // 2]),
    max_gap=st.sampled_from([0.0, 0.005, 0.5, 20.0]),
)
def test_epochs_order_and_gaps_do_not_depend_on_the_cutting(seed, bounds, reach, window, max_gap):
    def run(parts):
        log: Counter[str] = Counter()
        splitter = StreamSplitter[Numbered](
            reach, lambda reason, count: log.update({reason: count}), window, kinds
        )
        order, last, taken, segments = StampOrder(max_gap), None, [], []
        for runs in [*map(splitter.step, parts), splitter.flush()]:
            for found, run in runs:
                last = None if run.new_epoch else last
                if not len(found):
                    continue
                fresh, again = newer(found.stamp_ns, last)
                assert not (run.rising and (again.any() or not fresh.all()))
                log.update(again=int(again.sum()), older=int((~fresh & ~again).sum()))
                new = found[fresh]
                if len(new):
                    last = int(new.stamp_ns[-1])
                    taken += new.number.tolist()
                    segments += order.segments(new.stamp_ns).tolist()
        assert splitter.waiting == 0
        assert len(taken) + log.total() == 120
        return taken, segments, log, order.gaps, order.jumps, splitter.epochs.strays

    block = stream(seed)
    assert run([block]) == run(pieces(block, bounds))


@given(seed=seeds, bounds=cuts)
def test_coverage_adds_up_and_does_not_depend_on_the_cutting(seed, bounds):
    rng = np.random.default_rng(seed)
    elapsed = rng.integers(0, SECOND, 120)
    elapsed[rng.integers(0, 120, 4)] = rng.choice([-SECOND, 3 * SECOND, CLOCK_STEP_NS + 1], 4)
    observed = (rng.random(120) < rng.random()) & (elapsed >= 0) & (elapsed <= CLOCK_STEP_NS)

    def run(rows):
        time = Coverage()
        for some in rows:
            time.take(elapsed[some], observed[some])
        return time

    whole = run([slice(None)])
    edges = [0, *sorted(bounds), 120]
    parts = [slice(a, b) for a, b in pairwise(edges) if b > a]
    assert run(parts) == whole
    jump = (elapsed < 0) | (elapsed > CLOCK_STEP_NS)
    assert whole.span_ns == int(elapsed[~jump].sum())
    assert whole.jumps == int(jump.sum())


@given(seed=seeds, age=st.none() | st.integers(0, 50))
def test_a_value_holds_until_the_next_or_until_it_is_too_old(seed, age):
    rng = np.random.default_rng(seed)
    times, at = np.sort(rng.integers(0, 200, 12)), np.sort(rng.integers(0, 200, 40))
    found = held_rows(times, at, age).tolist()
    for row, now in zip(found, at.tolist(), strict=True):
        known = [r for r, time in enumerate(times.tolist()) if time <= now]
        fresh = known and (age is None or now - times[known[-1]] <= age)
        assert row == (known[-1] if fresh else -1)
    first = first_needed(times, int(at[0]))
    later = held_rows(times[first:], at, age)
    np.testing.assert_array_equal(np.where(later < 0, -1, later + first), found)


def messages(seed, size=120):
    """Joint states of two joints with all that happens to their stamps; some in parts."""
    rng = np.random.default_rng(seed)
    block = stream(seed, size)
    in_parts = rng.random() < 0.5
    found = []
    for stamp in block.stamp_ns.tolist():
        at = max(stamp, 1) / SECOND
        names = ("shoulder", "elbow")
        position, velocity = (np.sin(at), 0.2 * np.cos(at)), (np.cos(at), -0.2 * np.sin(at))
        if in_parts and rng.random() < 0.6:
            joint = int(rng.integers(0, 2))
            names, position, velocity = (
                (names[joint],),
                (position[joint],),
                (velocity[joint],),
            )
        found.append(message(at, names, position, velocity))
    return found


@settings(deadline=None, max_examples=15)
@given(
    seed=seeds,
    bounds=cuts,
    window=st.sampled_from([0.0, 0.05]),
    max_gap=st.sampled_from([0.0, 1.5]),
)
def test_messages_give_the_same_energy_however_they_are_cut(seed, bounds, window, max_gap):
    def run(parts):
        pipeline = EnergyPipeline(MODEL, Settings(max_gap=max_gap))
        ingest = JointStateIngest(
            MODEL.joint_names,
            limits=pipeline.torque.robot.limits,
            source=JointStateSource(reorder_window=window),
            max_gap=max_gap,
        )
        for part in parts:
            pipeline.step(ingest.step(batch(part)))
            assert ingest.rejections.balanced
        pipeline.step(ingest.flush())
        pipeline.flush()
        assert ingest.rejections.balanced
        assert ingest.rejections.waiting == 0
        registers = pipeline.account.registers
        return (
            registers.microjoule.tolist(),
            registers.time,
            ingest.rejections,
            (ingest.order.gaps, ingest.order.jumps, ingest.order.segment),
            ingest.conflicts.count,
        )

    whole = messages(seed)
    edges = [0, *sorted(bounds), len(whole)]
    parts = [whole[a:b] for a, b in pairwise(edges) if b > a]
    assert run([whole]) == run(parts)
