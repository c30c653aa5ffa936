"""Stages of a replay in processes of their own: the same figures, errors and ends."""

import os
import signal
from itertools import pairwise
from multiprocessing import active_children
from pathlib import Path

import numpy as np
import pytest

from robot_energy.accounting.record import Identity
from robot_energy.foundation.errors import BagError, MissingTopicError
from robot_energy.model import load
from robot_energy.pipeline import Settings
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.read_ahead import read_ahead
from robot_energy.replay.recorded_jobs import Job
from robot_energy.replay.setup import ReplaySetup
from robot_energy.timeline.blocks import Block, EffortMeaning, Learning

BAG = Path(__file__).parents[2] / "bags/kr16_cold"
MODEL = load("kr16")


def joined(blocks: list[Block]) -> dict[str, bytes]:
    """Every array of some blocks, in order of the samples, to the bit."""
    whole = type(blocks[0]).concatenate(blocks).__dict__
    return {
        name: np.ascontiguousarray(values).tobytes()
        for name, values in whole.items()
        if isinstance(values, np.ndarray)
    }


def figures(processes: int, bounds: list[float], bag: Path = BAG) -> dict[str, object]:
    """Replay; jobs cut it into steps. All figures, with every sample."""
    torque, power, means = [], [], []

    def take(output):
        for kept, block in ((torque, output.torque), (power, output.power), (means, output.means)):
            if block is not None:
                kept.append(block)

    result = replay(
        bag,
        MODEL,
        ReplaySetup(
            settings=Settings(learning=Learning.APPLY, effort=EffortMeaning.MOTOR_TORQUE),
            jobs=[
                Job(name=f"job {number}", begin=begin, end=end)
                for number, (begin, end) in enumerate(pairwise(bounds))
            ],
            processes=processes,
        ),
        on_output=take,
    )
    identity = Identity(
        robot_type="", robot_serial="", joint_names=MODEL.joint_names, model_id="", node=""
    )
    account, stages = result.account, result.pipeline
    return {
        "torque": joined(torque),
        "power": joined(power),
        "means": joined(means),
        "account": account.state(identity),
        "learned": stages.condition.state(),
        "warm": stages.power.watch.rise.tolist(),
        "inputs": [
            (each.rejections.received, each.rejections.accepted, dict(each.rejections.rejected))
            for each in (result.joint_states, result.temperatures, result.meter, result.payload)
        ],
        "known": [result.joint_states.samples, result.joint_states.newest_ns],
        "said": [result.notes, result.problems, stages.torque.effort_check.doubts()],
        "jobs": result.jobs.closed,
    }


@pytest.mark.parametrize(("processes", "seed"), [(2, 1), (3, 2)])
def test_figures_do_not_depend_on_processes(processes, seed):
    start = replay(BAG, MODEL).account.start_ns * 1e-9
    cuts = np.sort(np.random.default_rng(seed).uniform(0.0, 36.0, 12)) + start
    expected = figures(1, cuts.tolist())
    assert expected["jobs"]
    assert figures(processes, cuts.tolist()) == expected


@pytest.mark.parametrize("processes", [2, 3])
def test_an_error_of_this_process_ends_the_others(processes):
    def fail(_output):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        replay(BAG, MODEL, ReplaySetup(processes=processes), on_output=fail)
    assert not active_children()


def test_an_error_of_the_other_process_is_raised_here():
    def broken():
        yield 1
        raise MissingTopicError("no /x", "one of /y", "name it")

    found = []
    with pytest.raises(MissingTopicError, match="no /x; expected one of /y") as raised:
        found.extend(read_ahead(broken()))
    assert found == [1]
    assert raised.value.remedy == "name it"


def test_a_killed_process_is_an_error_and_not_an_end():
    def killed():
        yield os.getpid()
        os.kill(os.getpid(), signal.SIGKILL)

    items = read_ahead(killed())
    assert next(items) != os.getpid()
    with pytest.raises(BagError, match="ended with code -9"):
        next(items)


def test_who_stops_taking_ends_the_process():
    items = read_ahead(iter(range(10**9)))
    assert [next(items) for _ in range(3)] == [0, 1, 2]
    items.close()
    assert not active_children()


def test_a_stage_may_read_ahead_of_one_that_does():
    def doubled(items):
        for item in items:
            yield 2 * item

    assert list(read_ahead(doubled(read_ahead(iter(range(5)))))) == [0, 2, 4, 6, 8]
