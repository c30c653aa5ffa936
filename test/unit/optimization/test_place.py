"""Place of the workpiece: the tool moves with it, limits hold, and nothing gets worse."""

import numpy as np
import pytest

import robot_energy as re
from places import ROOT
from robot_energy.foundation.errors import MotionError, RobotDescriptionError
from robot_energy.model import load
from robot_energy.physics.collision import SelfCollision, touching_moves
from robot_energy.physics.rigid_body import Robot
from robot_energy_plan.motion.ptp_file import program_for, read_program

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


SHAPES = {  # of the KR 16 class: link, shape, middle [m]
    "base_link": ('<box size="0.5 0.5 0.4"/>', "0 0 0.2"),
    "link_1": ('<cylinder radius="0.2" length="0.5"/>', "0.05 0 -0.05"),
    "link_2": ('<box size="0.9 0.16 0.24"/>', "0.34 -0.13 0"),
    "link_3": ('<box size="0.7 0.2 0.2"/>', "0.25 0 0"),
    "link_4": ('<sphere radius="0.09"/>', "0 0 0"),
    "link_5": ('<mesh filename="package://nowhere/link_5.stl"/>', "0 0 0"),
    "link_6": ('<box size="0.3 0.14 0.14"/>', "0.2 0 0"),
}


def with_shapes(**changes):
    text = load("kr16").urdf_xml
    for link, (shape, middle) in (SHAPES | changes).items():
        head = f'<link name="{link}">'
        element = f'<origin xyz="{middle}"/><geometry>{shape}</geometry>'
        assert head in text
        text = text.replace(head, f"{head}<collision>{element}</collision>")
    return load("kr16", urdf_xml=text)


def test_links_touch_where_their_shapes_overlap():
    """The tool box, 0.3 m long, and the base box: by where the tool is, worked out from poses."""
    model = with_shapes()
    shapes, robot = SelfCollision(model), Robot.from_model(model)
    assert shapes.without == ("link_5",)
    # overlapping corners follow from the frames: link_6 points along its x from the wrist
    random = np.random.default_rng(3)
    low, high = np.radians([-20, -120, 60, -10, -60, 0]), np.radians([20, 20, 150, 10, 110, 1])
    found = 0
    for q in random.uniform(low, high, (300, 6)):
        place, turn = robot.link_pose(q, "link_6")
        grid = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 15)] * 3), axis=-1).reshape(-1, 3)
        inside = (np.array([0.2, 0, 0]) + grid * [0.3, 0.14, 0.14]) @ turn.T + place
        overlap = (np.abs(inside - [0, 0, 0.2]) <= [0.25, 0.25, 0.2]).all(axis=1).any()
        if overlap:
            found += 1
            assert shapes.touching(q[None]) is not None
    assert found >= 5
    away = np.radians([[30, -80, 90, 0, 60, 0], [-40, -65, 90, 0, 60, 90]])
    assert shapes.touching(away) is None


def test_neighbours_and_shapes_that_overlap_at_zero_are_not_compared():
    """15 pairs of six shapes, less four of neighbours and the wrist in the hand's box."""
    shapes = SelfCollision(with_shapes())
    assert shapes.pairs == 15 - 4 - 1
    wide = with_shapes(link_6=('<box size="3 0.1 0.1"/>', "0 0 0"))  # through the arm at zero
    assert SelfCollision(wide).pairs < 10


def test_a_cheaper_place_where_the_robot_touches_itself_is_left_out(tmp_path):
    box = (0.3, 0.0, 0.3)
    free = re.optimize(MOVES, "kr16", 40.0, place=box)
    assert any("were not checked" in note for note in free.report.notes)
    wide = with_shapes(base_link=('<box size="4 4 0.2"/>', "0 0 1.62"))  # a ceiling
    found = re.optimize(MOVES, wide, 40.0, place=box)
    found.write(tmp_path / "placed.yaml")
    program = program_for(read_program(tmp_path / "placed.yaml"), Robot.from_model(wide).limits)
    assert touching_moves(SelfCollision(wide), program.program.via) is None
    free.write(tmp_path / "free.yaml")
    program = program_for(read_program(tmp_path / "free.yaml"), Robot.from_model(wide).limits)
    assert touching_moves(SelfCollision(wide), program.program.via) is not None
    assert any("would touch itself" in note for note in found.report.notes)


def test_a_program_that_touches_itself_is_named():
    model = with_shapes(base_link=('<box size="3 3 0.9"/>', "0 0 0.45"))
    with pytest.raises(MotionError, match=r"move \d to \d of .* links '.*' and '.*' touch"):
        re.optimize(MOVES, model, 40.0, place=(0.1, 0.0, 0.1))


@pytest.mark.parametrize("shape", ['<box size="1 1"/>', '<sphere radius="-1"/>',
                                   '<sphere radius="nan"/>'])  # fmt: skip
def test_shapes_that_make_no_sense_are_refused(shape):
    with pytest.raises(RobotDescriptionError, match="of link 'link_3' has the"):
        SelfCollision(with_shapes(link_3=(shape, "0 0 0")))
