"""Friction over the time of torques: chosen by stamps, bounded, whatever the clocks do."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from robot_energy.pipeline import FrictionStage
from robot_energy.pipeline.friction_timeline import MAX_ROWS, FrictionTimeline
from robot_energy.timeline.blocks import FrictionBlock, TemperatureBlock

S = 10**9


def rows(stamps_s, degc) -> FrictionBlock:
    """Friction rows as a stage makes them of one temperature each."""
    parts = []
    for stamp, value in zip(stamps_s, degc, strict=True):
        stage = FrictionStage(robots.two_link())
        block = stage.step(TemperatureBlock(np.array([round(stamp * S)]), np.full((1, 2), value)))
        assert block is not None
        parts.append(block)
    return FrictionBlock.concatenate(parts)


def timeline(*blocks) -> FrictionTimeline:
    made = FrictionTimeline(FrictionStage(robots.two_link()).initial())
    for block in blocks:
        made.add(block)
    return made


def degc(made: FrictionTimeline, *stamps_s: float) -> list[float]:
    line, row = made.at(np.array([round(stamp * S) for stamp in stamps_s]))
    return line.motor_temperature_degc[row, 0].tolist()


def test_each_row_holds_from_its_stamp_on():
    made = timeline(rows([100, 101], [20, 21]))
    assert degc(made, 100, 100.9, 101, 150) == [20, 20, 21, 21]


def test_after_a_loop_of_both_the_row_in_use_goes_on_until_the_first_of_the_new_run():
    first, again = rows([100, 130], [20, 30]), rows([100.5, 110], [31, 32])
    for known in (True, False):  # before torque has jumped, or after
        made = timeline(first, again) if known else timeline(first)
        assert degc(made, 101, 131) == [20, 30]
        made.jump_back(100 * S)
        if not known:
            assert degc(made, 100.2) == [30]
            made.add(again)
        assert degc(made, 100.4, 100.5, 111) == [30, 31, 32]


def test_a_row_of_the_future_does_not_stop_those_that_follow():
    """Two clocks that are two hours apart and take turns at will: never far behind."""
    made = timeline()
    for second in range(100, 160):
        made.add(rows([second, second + 7200], [second, -1]))
        assert degc(made, second)[0] >= second - 11
        assert made.rows < 100
    made.add(rows([161, 162, 163], [161, 162, 163]))
    assert degc(made, 163.5)[0] > 150


def test_temperatures_of_a_clock_that_jumps_alone_are_followed():
    made = timeline(rows([7300, 7301], [20, 20]), rows([100, 101, 112], [30, 31, 32]))
    assert degc(made, 112.5) == [32]


def test_torque_that_jumps_alone_takes_the_stamps_as_they_are_after_ten_seconds():
    made = timeline(rows([100, 140], [20, 30]))
    assert degc(made, 141) == [30]
    made.jump_back(120 * S)
    assert degc(made, 120, 130) == [30, 30]
    assert degc(made, 130.1, 140) == [20, 30]


@pytest.mark.parametrize("ahead", [7200, -7200])
def test_a_first_row_of_another_time_holds_at_the_start_only(ahead):
    start = 10_000
    made = timeline(rows([start + ahead], [50]))
    assert degc(made, start, start + 4.9) == [50, 50]
    line, row = made.at(np.array([(start + 6) * S]))
    expected = 0 if ahead > 0 else (start + ahead) * S  # none yet, or one that is stale
    assert line.temperature_stamp_ns[row, 0].tolist() == [expected]


def test_rows_ahead_of_all_torques_are_bounded():
    block = rows([100], [20])
    many = block[np.zeros(MAX_ROWS // 2, dtype=np.int64)]
    made = timeline()
    for part in range(4):
        stamp = 10**6 * S + (part * len(many) + np.arange(len(many))) * S // 10
        made.add(replace(many, stamp_ns=stamp))
    assert made.rows == MAX_ROWS + 1


def refused(*degc: float) -> str:
    """What a stage says of values that came one second after another."""
    stage = FrictionStage(robots.two_link())
    stamps = S * np.arange(1, len(degc) + 1)
    stage.step(TemperatureBlock(stamps, np.repeat(np.array(degc)[:, None], 2, axis=1)))
    return stage.refused


def test_thermometers_of_two_robots_on_one_topic_are_named():
    said = refused(*[60.0, 20.0] * 10)
    assert said.startswith("of 40 values of motor temperatures 20 jumped and 0 were outside")
    assert "40 values of motor temperatures 0 jumped and 20" in refused(*[60.0, 5000.0] * 10)
    assert refused(*[60.0] * 12, 20.0, *[60.0] * 7) == ""
