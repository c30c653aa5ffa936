"""Many recordings in order teach what one long recording teaches."""

from pathlib import Path

import pytest

from robot_energy.foundation.errors import BagError, ParameterError
from robot_energy.replay.api import condition_over

BAGS = Path(__file__).parents[3] / "bags"
COLD, WARM = BAGS / "kr16_cold", BAGS / "kr16_warm"


def test_each_recording_begins_with_what_the_one_before_has_taught():
    first = condition_over([COLD], "kr16", effort="motor_torque")
    both = condition_over([COLD, WARM], "kr16", effort="motor_torque")
    for one, two in zip(first.joints, both.joints, strict=True):
        assert two.motion > 1.5 * one.motion
    assert both.wear == ()
    assert both.learning == "observe"


def test_nothing_and_unknown_words_are_refused():
    with pytest.raises(BagError, match="no recording"):
        condition_over([], "kr16")
    with pytest.raises(ParameterError, match="one of off, observe, apply"):
        condition_over([COLD], "kr16", learning="always")
