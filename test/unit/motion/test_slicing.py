"""STL shapes -> programs, against shapes whose outlines are known."""

import math
import struct

import numpy as np
import pytest

from boat import DEPTH, ROOF, boat, cabin_outline, hull_outline, stl
from places import ROOT
from robot_energy import predict
from robot_energy.foundation.errors import MotionError
from robot_energy_cli.main import main
from robot_energy_papers.wall import Wall
from robot_energy_plan.motion.gcode import read_gcode
from robot_energy_plan.motion.load_motion import ToolOptions
from robot_energy_plan.motion.slicing import Slicing, slice_stl
from robot_energy_plan.motion.tool_motion import ToolPlacement

EXAMPLE = ROOT / "src/examples/programs/wall.stl"  # 1200 mm by 300 mm by 1000 mm
BASE = ToolPlacement(-1.2, -0.2, 0.0)


def prism(outlines, height, tilt=0.0):
    """Walls of a shape, and no lid: triangles of shape (K, 3, 3). [mm]"""
    triangles = []
    for outline in outlines:
        for (x, y), (u, v) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            low, high = [(x, y, 0.0), (u, v, 0.0)], [(x + tilt, y, height), (u + tilt, v, height)]
            triangles += [(*low, high[1]), (low[0], high[1], high[0])]
    return np.asarray(triangles)


def write_stl(path, triangles):
    rows = b"".join(struct.pack("<12fH", 0, 0, 1, *t.ravel(), 0) for t in triangles)
    path.write_bytes(bytes(80) + struct.pack("<I", len(triangles)) + rows)
    return path


def circle(radius, points=360):
    angle = 2 * np.pi * np.arange(points) / points
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def printed(shape):
    return read_gcode(shape.gcode).path


def test_the_wall_of_paper_b_costs_what_its_program_costs(tmp_path):
    """100 layers are 1 m; two of them have the way and, within 1 %, the energy of the program."""
    assert slice_stl(EXAMPLE).layers == 100
    two = write_stl(tmp_path / "two.stl", prism([[(0, 0), (1200, 0), (1200, 300), (0, 300)]], 20))
    program = tmp_path / "wall.gcode"
    program.write_text(Wall(layers=2).gcode())
    assert printed(slice_stl(two)).printed_length == pytest.approx(2 * 3.0)
    tool = ToolOptions(placement=BASE)
    of_shape, of_program = (
        predict(path, "mantis", 40.0, tool=tool).energy.grid_import for path in (two, program)
    )
    assert of_shape == pytest.approx(of_program, rel=0.01)


def test_a_ring_has_two_outlines_and_a_bead_stays_inside(tmp_path):
    """Radii 200 and 100 mm: a bead of 20 mm runs at 190 and 110 mm, and their sum stays."""
    walls = [circle(200.0), circle(100.0)[::-1]]  # the inner one faces inward
    ring = write_stl(tmp_path / "ring.stl", prism(walls, 30.0))
    around = 3 * 2 * math.pi * 0.3
    plain = printed(slice_stl(ring))
    assert plain.printed_length == pytest.approx(around, rel=1e-3)
    bead = slice_stl(ring, Slicing(bead_width=0.02))
    assert printed(bead).printed_length == pytest.approx(around, rel=1e-3)
    places = np.array([segment.end[:2] for segment in printed(bead).segments if segment.extruding])
    radii = np.hypot(*places.T)
    assert np.allclose(np.where(radii > 0.15, 0.19, 0.11), radii, atol=3e-4)


def test_a_leaning_shape_is_cut_in_the_middle_of_each_layer(tmp_path):
    """Walls that lean by 30 mm over 30 mm: the layers stand 5, 15 and 25 mm aside, and on top of
    each other."""
    leaning = prism([[(0, 0), (100, 0), (100, 100), (0, 100)]], 30.0, tilt=30.0)
    path = printed(slice_stl(write_stl(tmp_path / "leaning.stl", leaning)))
    places = np.array([segment.end for segment in path.segments if segment.extruding])
    heights = np.unique(places[:, 2])
    assert heights == pytest.approx([0.01, 0.02, 0.03])
    left = [places[places[:, 2] == height, 0].min() for height in heights]
    assert left == pytest.approx([0.005, 0.015, 0.025], abs=1e-6)


def test_units_and_open_shapes_are_named(tmp_path):
    square = [(0, 0), (4, 0), (4, 4), (0, 4)]
    inch = write_stl(tmp_path / "inch.stl", prism([square], 1.0))
    shape = slice_stl(inch, Slicing(unit="inch", layer_height=0.0127))
    assert printed(shape).printed_length == pytest.approx(2 * 16 * 0.0254, abs=1e-5)
    gap = write_stl(tmp_path / "open.stl", np.concatenate(
        [prism([square], 20.0), prism([circle(300.0)], 20.0)[:-2]]
    ))  # fmt: skip
    assert any("2 open cuts" in note for note in slice_stl(gap).notes)


def box(low, high):
    """A closed body between two corners, normals outward. [mm]"""
    (x, y, z), (u, v, w) = low, high
    bottom = [(x, y, z), (x, v, z), (u, v, z), (u, y, z)]
    top = [(x, y, w), (u, y, w), (u, v, w), (x, v, w)]
    lids = [each for a, b, c, d in (bottom, top) for each in ((a, b, c), (a, c, d))]
    walls = prism([[(x, y), (u, y), (u, v), (x, v)]], w - z)
    return np.concatenate([np.asarray(lids), np.add(walls, [0.0, 0.0, z])])


TALL, LOW = box((0, 0, 0), (300, 200, 100)), box((300, 0, 0), (700, 200, 50))
INNER = box((100, 50, 0), (200, 150, 100))


@pytest.mark.parametrize(
    ("bodies", "around"),
    [
        pytest.param([TALL, LOW], [1800, 1000], id="touch along a wall"),
        pytest.param([TALL, box((300, 100, 0), (700, 300, 50))], [2000, 1000], id="half a wall"),
        pytest.param([TALL, box((200, 0, 0), (700, 200, 50))], [1800, 1000], id="overlap"),
        pytest.param([TALL, TALL], [1000, 1000], id="one twice"),
        pytest.param([TALL, INNER], [1000, 1000], id="one inside"),
        pytest.param([TALL, INNER[:, ::-1]], [1400, 1400], id="a hole"),
        pytest.param([TALL[:, ::-1]], [1000, 1000], id="all normals inward"),
        pytest.param([TALL, box((300.0001, 0, 0), (700, 200, 50))], [1800, 1000], id="nearly"),
        pytest.param([TALL, box((900, 0, 0), (950, 50, 50))], [1200, 1000], id="apart"),
    ],
)
def test_bodies_that_touch_or_overlap_are_one_outline_in_each_layer(tmp_path, bodies, around):
    shape = slice_stl(
        write_stl(tmp_path / "bodies.stl", np.concatenate(bodies)), Slicing(layer_height=0.05)
    )
    moves = [move for move in printed(shape).segments if move.extruding]
    for layer, way in enumerate(around, 1):
        height = pytest.approx(0.05 * layer)
        here = math.fsum(move.length for move in moves if move.end[2] == height)
        assert here == pytest.approx(1e-3 * way, abs=1e-5)
    assert not any("open" in note or "agree" in note for note in shape.notes)


def test_a_layer_that_is_cut_along_a_lid_belongs_to_what_stands_above(tmp_path):
    """The middle of the only layer is the top of the low body."""
    shape = write_stl(tmp_path / "bodies.stl", np.concatenate([TALL, LOW]))
    assert printed(slice_stl(shape, Slicing(layer_height=0.1))).printed_length == pytest.approx(1.0)


def test_triangles_that_face_both_ways_are_said_and_holes_kept(tmp_path):
    mixed = np.concatenate([TALL, INNER])
    mixed[::3] = mixed[::3, ::-1]
    shape = slice_stl(write_stl(tmp_path / "mixed.stl", mixed), Slicing(layer_height=0.05))
    assert printed(shape).printed_length == pytest.approx(2 * 1.4)
    assert any("in 2 layers the normals" in note for note in shape.notes)


def test_layers_without_outline_are_said(tmp_path):
    apart = np.concatenate([box((0, 0, 0), (50, 50, 20)), box((0, 0, 40), (50, 50, 60))])
    shape = slice_stl(write_stl(tmp_path / "apart.stl", apart), Slicing(layer_height=0.02))
    assert any("1 of 3 layers have no outline" in note for note in shape.notes)


def test_why_nothing_can_be_printed_is_said(tmp_path):
    walls = write_stl(tmp_path / "walls.stl", TALL[4:-2])
    with pytest.raises(MotionError, match=r"2 open cuts.*closed surface"):
        slice_stl(walls, Slicing(layer_height=0.05))
    thin = write_stl(tmp_path / "thin.stl", box((0, 0, 0), (300, 2, 100)))
    with pytest.raises(MotionError, match="wider than a bead of 20 mm"):
        slice_stl(thin, Slicing(bead_width=0.02))


@pytest.mark.parametrize(
    ("content", "options"),
    [
        (b"", {}),
        (b"solid nothing\nendsolid nothing\n", {}),
        (b"\x00" * 200, {}),
        (None, {"layer_height": 5.0}),
        (None, {"layer_height": 1e-6}),
        (None, {"bead_width": 2.0}),
        (None, {"unit": "m"}),
    ],
)
def test_what_cannot_be_printed_is_refused(tmp_path, content, options):
    path = EXAMPLE if content is None else tmp_path / "bad.stl"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(MotionError):
        slice_stl(path, Slicing(**options))


def test_one_command_goes_from_shape_to_energy(capsys):
    words = ["predict", str(EXAMPLE), "--layer-height", "250", "--print-speed", "200"]
    assert main([*words, "--model", "mantis", "--base=-1.2,-0.2,0", "--temperature", "40"]) == 0
    output = capsys.readouterr().out
    assert "12.000 m of the program printed" in output
    assert "4 layers, 4 outlines" in output


def perimeter(outline):
    return float(np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1).sum())


def test_a_boat_goes_from_shape_to_energy():
    """Its layers have the perimeters of hull and cabin; the file is what its script writes."""
    example = ROOT / "src/examples/programs/boat.stl"
    assert example.read_bytes() == stl(boat())
    slicing = Slicing(layer_height=0.1)
    middles = np.arange(50.0, ROOF, 100.0)
    outlines = [hull_outline(z / DEPTH) if z < DEPTH else cabin_outline() for z in middles]
    way = printed(slice_stl(example, slicing)).printed_length
    assert way == pytest.approx(1e-3 * sum(map(perimeter, outlines)), rel=1e-3)
    tool = ToolOptions(placement=ToolPlacement(-1.0, 0.0, 0.0), slicing=slicing)
    found = predict(example, "mantis", 40.0, tool=tool)
    assert found.energy.grid_import > 100.0 * way / slicing.speed  # constant losses alone
