"""The wall of paper B."""

import numpy as np
import pytest

from places import ROOT
from robot_energy_papers.wall import Wall
from robot_energy_plan.motion.gcode import load_gcode, read_gcode
from robot_energy_plan.motion.tool_motion import TimedPath

EXAMPLE = ROOT / "src" / "examples" / "programs" / "wall_layer.gcode"


def bounds(path):
    """Least and greatest coordinates of all ends."""
    ends = np.array([place for segment in path.segments for place in (segment.start, segment.end)])
    return tuple(ends.min(axis=0)), tuple(ends.max(axis=0))


def test_one_layer_is_the_outline_at_125_mm_per_second():
    """Twice 1200 mm and 300 mm: 3 m, 24 s."""
    path = read_gcode(Wall().gcode()).path
    assert path.length == pytest.approx(3.0)
    assert bounds(path) == ((0.0, 0.0, 0.0), (1.2, 0.3, 0.0))
    assert {segment.speed for segment in path.segments} == {0.125}
    motion = TimedPath(path)
    assert motion.duration == pytest.approx(24.0, abs=0.1)
    assert motion.full_speed_share > 0.98


def test_a_hundred_layers_make_a_metre():
    path = read_gcode(Wall(layers=100).gcode()).path
    low, high = bounds(path)
    assert high[2] - low[2] + 0.01 == pytest.approx(1.0)
    assert path.length == pytest.approx(100 * 3.0 + 99 * 0.01)


def test_the_example_is_what_the_module_makes():
    assert EXAMPLE.read_text() == Wall().gcode()
    assert load_gcode(EXAMPLE).notes == ()
