"""G-code at other feeds: what is written is what was predicted."""

import numpy as np
import pytest

import robot_energy as re
from places import ROOT
from robot_energy.foundation.errors import MotionError
from robot_energy.model import load
from robot_energy_plan.motion.gcode import read_gcode
from robot_energy_plan.motion.gcode_words import with_feed
from robot_energy_plan.motion.load_motion import ToolOptions
from robot_energy_plan.motion.tool_corners import Dwell
from robot_energy_plan.motion.tool_motion import ToolLimits, ToolPlacement

LAYER = ROOT / "src/examples/programs/wall_layer.gcode"
MODEL = load("irb4600")
TOOL = ToolOptions(placement=ToolPlacement(-1.0, 0.15, 0.0))
HARD = ToolLimits(acceleration=50.0)
PROGRAM = """\
G21 (F100 is not a feed) ; F200 neither
M203 F50
G1 X0 Y0 Z0 F1000 ; first
G0 X10
g1 x20 f1500.5 E2
G4 P200
G1 E-2 F2400
G10 F300
G0 X0 F9000
G1 Y10
"""


def speeds(text):
    return [one.speed for one in read_gcode(text).path.segments if not isinstance(one, Dwell)]


def test_every_feed_is_multiplied_and_nothing_else_changes():
    twice = with_feed(PROGRAM, 2.0)
    # mm/min to mm/s; E makes it a program of a printer, where G0 moves at the last F
    wanted = [1000 / 60, 1500.5 / 60, 9000 / 60, 9000 / 60]
    assert np.multiply(speeds(PROGRAM), 1e3) == pytest.approx(wanted)
    factors = np.divide(speeds(twice), speeds(PROGRAM))
    assert factors == pytest.approx([2.0, 2.0, 2.0, 2.0])
    assert "(F100 is not a feed) ; F200 neither" in twice
    assert "M203 F50\n" in twice
    assert "G10 F300\n" in twice
    assert "G1 E-2 F4800\n" in twice
    assert with_feed(twice, 0.5).upper() == PROGRAM.upper()
    assert with_feed("NAME_OF_A_MACRO NAME=F100\r\n", 2.0) == "NAME_OF_A_MACRO NAME=F100\r\n"


def test_a_rapid_of_a_milling_machine_keeps_its_speed():
    program = "G1 X0 Y0 Z0 F1000\nG0 X10\nG1 X20 F1500\nG0 X0 F9000\nG1 Y10\n"
    factors = np.divide(speeds(with_feed(program, 2.0)), speeds(program))
    assert factors == pytest.approx([1.0, 2.0, 1.0, 2.0])


def test_what_is_written_costs_what_was_promised(tmp_path):
    """The prediction of the written file, which knows nothing of the search."""
    layer = tmp_path / "small.gcode"
    layer.write_text(LAYER.read_text().replace("1200", "400").replace("Y300", "Y100"))
    found = re.optimize(layer, MODEL, 40.0, tool=TOOL, max_feed=2.0)
    given = re.predict(layer, MODEL, 40.0, tool=TOOL)
    assert found.report.before.energy == pytest.approx(given.energy.net, rel=2e-3)
    assert found.report.after.duration < 0.6 * found.report.before.duration
    found.write(tmp_path / "fast.gcode")
    again = re.predict(tmp_path / "fast.gcode", MODEL, 40.0, tool=TOOL)
    assert again.energy.net == pytest.approx(found.report.after.energy, rel=2e-3)
    found.write(tmp_path / "fast.gcode")  # its own file may be replaced
    assert (tmp_path / "fast.gcode").read_text().count("Written by") == 1


@pytest.mark.long
def test_without_leave_a_program_never_becomes_faster_and_slack_makes_it_slower(tmp_path):
    layer = tmp_path / "corner.gcode"
    layer.write_text("G21\nG90\nG0 X0 Y0 Z0\nG1 X100 F7500\nG1 Y50\nM2\n")
    kept = re.optimize(layer, MODEL, 40.0, tool=TOOL).report
    assert kept.after.duration == pytest.approx(kept.before.duration)
    assert not kept.saving.claimed
    standby = MODEL.cabinet.model_copy(
        update={
            name: getattr(MODEL.cabinet, name).model_copy(update={"value": 0.0})
            for name in ("loss_grid", "loss_dc")
        }
    )
    idle = MODEL.changed(cabinet=standby)
    slack = re.optimize(layer, idle, 40.0, tool=TOOL, cycle_time=4.0).report
    assert slack.after.energy <= slack.before.energy


@pytest.mark.parametrize(
    ("feed", "text"), [(0.5, r"feeds is 0\.5"), (9.0, "moves at"), (11.0, "feeds is 11")]
)
def test_feeds_that_cannot_be_are_refused(feed, text):
    with pytest.raises(MotionError, match=text):
        re.optimize(LAYER, "testbed", 40.0, tool=ToolOptions(limits=HARD), max_feed=feed)


def test_a_print_has_no_time_laws(tmp_path):
    line = tmp_path / "line.gcode"
    line.write_text("G21\nG90\nG0 X0 Y0 Z0\nG1 X20 F7500\nM2\n")
    with pytest.raises(MotionError, match="states no time laws"):
        re.optimize(line, MODEL, 40.0, tool=TOOL, time_law=True)
