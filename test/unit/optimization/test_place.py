"""Place of the workpiece: the tool moves with it, limits hold, and nothing gets worse."""

import numpy as np
import pytest

import robot_energy as re
from places import ROOT
from robot_energy.errors import MotionError
from robot_energy.model import load
from robot_energy.motion.ptp_file import program_for, read_program
from robot_energy.physics.rigid_body import Robot

MOVES = ROOT / "src/examples/programs/kr16_pick_and_place.yaml"


def test_the_tool_goes_with_the_workpiece(tmp_path):
    robot = Robot.from_model(load("kr16"))
    found = re.optimize(MOVES, "kr16", 40.0, place=(0.1, 0.0, 0.15))
    found.write(tmp_path / "placed.yaml")
    before, after = (
        program_for(read_program(path), robot.limits).program.via
        for path in (MOVES, tmp_path / "placed.yaml")
    )
    poses = [[robot.link_pose(q, "tool0") for q in via] for via in (before, after)]
    shifts = np.array([b[0] - a[0] for a, b in zip(*poses, strict=True)])
    assert shifts == pytest.approx(np.tile(shifts[0], (4, 1)), abs=1e-6)
    assert (np.abs(shifts[0]) <= np.array([0.1, 0.0, 0.15]) + 1e-6).all()
    assert np.abs(shifts[0]).max() > 0.01
    for (_, was), (_, now) in zip(*poses, strict=True):
        assert now == pytest.approx(was, abs=1e-6)
    row = next(one for one in found.report.measures if one.name == "place")
    assert row.saving.energy > 0
    assert row.cycle.duration <= found.report.before.duration * (1 + 1e-6)
    assert found.report.problems == ()
    assert any("mm in the base frame" in note for note in found.report.notes)


@pytest.mark.parametrize("box", [(0.0, 0.0, 0.0), (-0.1, 0.1, 0.1), (0.1, 0.1)])
def test_a_box_that_makes_no_sense_is_refused(box):
    with pytest.raises(MotionError, match="the box has half widths"):
        re.optimize(MOVES, "kr16", 40.0, place=box)
