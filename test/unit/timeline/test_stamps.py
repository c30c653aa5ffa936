"""Gaps of the joint states, and the longest one that is bridged."""

import numpy as np
import pytest

import robot_energy as re
from joint_messages import NAMES, SECOND, message, take
from logbook import wheel_bag, wheel_model
from robot_energy.foundation.errors import BagError, ParameterError
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.pipeline import Settings
from robot_energy.timeline.streams import StampOrder
from robot_energy_cli.main import main


def segments(max_gap, *pauses, period=0.01):
    steps = np.concatenate([[*[period] * 20, pause] for pause in pauses])
    stamp = SECOND + np.cumsum(np.rint(steps * SECOND)).astype(np.int64)
    order = StampOrder(max_gap)
    found = order.segments(stamp)
    assert order.gaps == order.segment == int(found[-1])
    return order.gaps


def test_by_default_five_periods_are_bridged_within_a_tenth_and_one_second():
    assert segments(0.0, 0.099, 0.1) == 0
    assert segments(0.0, 0.101, 0.9) == 2
    assert segments(0.0, 0.45, 0.55, period=0.1) == 1
    assert segments(0.0, 1.1, period=0.5) == 1


def test_max_gap_says_how_much_is_bridged_whatever_the_period():
    for period in (0.001, 0.01, 0.1):
        assert segments(2.0, 1.9, 2.0, period=period) == 0
        assert segments(2.0, 2.1, 30.0, period=period) == 2
    assert segments(0.03, 0.029, 0.031, 0.099) == 2


@pytest.mark.parametrize("value", [-1.0, 0.0005, 61.0, float("nan"), float("inf")])
def test_a_longest_gap_that_makes_no_sense_is_refused(value, tmp_path):
    for refuse in (
        lambda: StampOrder(value),
        lambda: JointStateIngest(NAMES, max_gap=value),
        lambda: re.OnlineMonitor("kr16", settings=Settings(max_gap=value)),
    ):
        with pytest.raises(ParameterError) as caught:
            refuse()
        assert "max_gap" in caught.value.found
        assert caught.value.remedy
    file = tmp_path / "node.yaml"
    file.write_text(f"/**:\n  ros__parameters:\n    max_gap: {value}\n".replace("nan", ".nan"))
    with pytest.raises(ParameterError):
        read_inputs(file)


@pytest.mark.parametrize(("max_gap", "bridged"), [(0.0, False), (1.0, False), (2.0, True)])
def test_a_pause_of_the_driver_is_bridged_or_not(max_gap, bridged):
    stamps = [*np.arange(0, 1, 0.01), *np.arange(2.5, 4, 0.01)]
    ingest = JointStateIngest(NAMES, max_gap=max_gap)
    block = take(ingest, [message(10 + t, position=(np.sin(t), t / 10)) for t in stamps])
    assert len(block) == len(stamps)
    assert ingest.order.gaps == (not bridged)


def test_joints_of_several_publishers_wait_as_long_as_is_bridged():
    """The second joint comes every 1.5 s: by default that is a gap, and no sample is whole."""
    found = []
    for max_gap in (0.0, 2.0):
        ingest = JointStateIngest(NAMES, max_gap=max_gap)
        messages = [
            message(10 + t, (NAMES[j],), (0.1 * t,), (0.1,))
            for t in np.arange(0, 12, 0.1).round(1).tolist()
            for j in (0, 1)
            if j == 0 or t % 1.5 < 0.05
        ]
        block = take(ingest, messages)
        found.append(0 if block is None else len(block))
        assert ingest.rejections.balanced
    assert found[0] < 20
    assert found[1] > 90


def test_file_option_and_python_bridge_the_same(tmp_path, capsys):
    bag, model = wheel_bag(tmp_path, rate=10.0), wheel_model(tmp_path)
    file = tmp_path / "node.yaml"
    file.write_text("/**:\n  ros__parameters:\n    max_gap: 0.05\n")
    words = ["replay", str(bag), "--model", str(model)]
    assert main(words) == 0
    said = []
    for more in (["--inputs", str(file)], ["--max-gap", "0.05"]):
        assert main([*words, *more]) == 2
        said.append(capsys.readouterr().err)
    assert "nothing is predicted; expected steps of at most 0.05 s" in said[0]
    assert said[0] == said[1]
    assert re.replay(bag, model=model).replay.account.registers.time.observed_ns > 0
    with pytest.raises(BagError, match=r"at most 0\.05 s"):
        re.replay(bag, model=model, max_gap=0.05)
