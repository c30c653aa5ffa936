"""G-code: what is read, what is noted, what is refused."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from refusals import refused
from robot_energy.errors import MotionError
from robot_energy.motion.gcode import load_gcode, read_gcode
from robot_energy.motion.gcode_words import words_of
from robot_energy.motion.tool_path import Arc, Dwell, LineSegment, ToolPath

HEAD = "G21 G90\nG0 X0 Y0 Z0\n"


def moves(text):
    return list(read_gcode(text).path.segments)


def test_lines_feeds_and_rapids():
    """F 7500 mm/min is 125 mm/s (paper B, 5.2.2); G0 runs at the assumed 0.25 m/s."""
    first, second, third = moves(HEAD + "G1 X1200 F7500\nY300 ; modal\nG0 X0 (back)\n")
    assert first == LineSegment((0, 0, 0), (1.2, 0, 0), 0.125, 3)
    assert (second.end, second.speed, second.rapid) == ((1.2, 0.3, 0.0), 0.125, False)
    assert (third.end, third.speed, third.rapid) == ((0.0, 0.3, 0.0), 0.25, True)


def test_a_rapid_with_a_feed_of_its_own_moves_at_it():
    assert moves(HEAD + "G0 X60 F600\n")[0].speed == pytest.approx(0.01)


def test_inches_and_relative_coordinates():
    (line,) = moves("G20 G91\nG1 X1 Y-2 F60\n")
    np.testing.assert_allclose(line.end, [0.0254, -0.0508, 0.0])
    assert line.speed == pytest.approx(0.0254)


def test_the_tool_begins_where_the_program_first_puts_each_axis():
    (line,) = moves("G90\nG0 X10 Y20\nG0 Z5\nG1 X30 F600\n")
    assert line.start == (0.01, 0.02, 0.005)


def test_quarter_circles_by_centre_and_by_radius_agree():
    """From (0, 0) to (100, 100) mm about (100, 0): clockwise, a quarter of radius 100 mm."""
    (by_centre,) = moves(HEAD + "G2 X100 Y100 I100 J0 F6000\n")
    (by_radius,) = moves(HEAD + "G2 X100 Y100 R100 F6000\n")
    for arc in (by_centre, by_radius):
        assert isinstance(arc, Arc)
        assert arc.angle == pytest.approx(-math.pi / 2)
        assert arc.length == pytest.approx(0.1 * math.pi / 2)
        np.testing.assert_allclose(arc.centre, [0.1, 0.0], atol=1e-12)


def test_a_negative_radius_takes_the_longer_arc():
    (arc,) = moves(HEAD + "G3 X100 Y100 R-100 F6000\n")
    assert arc.angle == pytest.approx(1.5 * math.pi)
    (arc,) = moves(HEAD + "G2 X100 Y100 R-100 F6000\n")
    assert arc.angle == pytest.approx(-1.5 * math.pi)


def test_a_full_circle_and_a_helix():
    """One turn of radius 50 mm that climbs 10 mm: sqrt((2 pi 50)^2 + 10^2) mm."""
    circle, helix = moves(HEAD + "G3 I50 F6000\nG3 X0 Y0 Z10 I50\n")
    assert circle.length == pytest.approx(0.1 * math.pi)
    assert helix.length == pytest.approx(math.hypot(0.1 * math.pi, 0.01))
    assert helix.end == (0.0, 0.0, 0.01)


def test_rounded_centres_are_taken_and_ends_stay_on_the_circle():
    """Words rounded to 0.001 mm, as slicers write them."""
    (arc,) = moves(HEAD + "G3 X70.711 Y29.289 I0 J100 F6000\nG1 X0\n")[:1]
    assert math.dist(arc.end[:2], arc.centre) == pytest.approx(arc.radius, abs=1e-9)


def test_dwells_in_milliseconds_and_seconds():
    assert [s.time for s in moves(HEAD + "G4 P500\nG4 S2\nG1 X1 F60\n")[:2]] == [0.5, 2.0]


def test_extrusion_absolute_and_relative():
    text = HEAD + "M82\nG92 E0\nG1 X10 E1 F600\nG1 X20 E1\nM83\nG1 X30 E0.5\nG1 X40 E-1\n"
    program = read_gcode(text)
    assert [m.extruding for m in program.path.segments] == [True, False, True, False]
    assert program.path.printed_length == pytest.approx(0.02)


def test_without_extrusion_all_but_rapids_count_as_printed():
    path = read_gcode(HEAD + "G1 X10 F600\nG0 X30\n").path
    assert (path.length, path.printed_length) == pytest.approx((0.03, 0.01))


def test_g92_shifts_the_coordinates():
    first, second = moves(HEAD + "G1 X10 F600\nG92 X0\nG1 X5\n")
    assert (second.start, second.end) == (first.end, (0.015, 0.0, 0.0))


def test_unknown_machine_codes_are_noted_and_read_over():
    program = read_gcode(HEAD + "M104 S200 X99\nM117 Layer (1 of G1 X5\nT1\nG28 X0\nG1 X1 F60\n")
    assert program.unknown == {
        "M104": 1,
        "M117": 1,
        "T1": 1,
        "G28 (homing; the position is kept)": 1,
    }
    assert len(program.path.segments) == 1
    assert all("no effect" in note for note in program.notes)


def test_nothing_after_the_end_counts():
    assert len(moves(HEAD + "G1 X1 F60\nM30\nG1 X2\nnonsense\n")) == 1


def test_line_numbers_and_checksums():
    """Checksum: exclusive or of all bytes before the star."""
    text = "N3 G1 X5 F60"
    checksum = 0
    for byte in text.encode():
        checksum ^= byte
    assert len(moves(f"{HEAD}{text}*{checksum}\n")) == 1
    with refused(MotionError, ("line 3", f"'{checksum ^ 1}'"), str(checksum)):
        read_gcode(f"{HEAD}{text}*{checksum ^ 1}\n")


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("G1 X1.2.3 F60", r"line 3: 'X1\.2\.3 F60' is not a word"),
        ("G1 X10 hello F60", "line 3: 'hello F60' is not a word"),
        ("G1 X Y5 F60", "'X Y5 F60' is not a word"),
        ("G1 Xnan F60", "'Xnan F60' is not a word"),
        ("G1 X1 (open F60", r"a '\(' without its partner"),
        ("G1 X10", "no feed has been given"),
        ("X10 Y5 F60", "line 3"),
        ("G1 X1 X2 F60", "X stands twice"),
        ("G0 X1 G1 Y2 F60", "G0 and G1 stand in one line"),
        ("G1 A5 X1 F60", "a move of the axis A"),
        ("G18", "vertical plane"),
        ("G5 X1 F60", "G5 is not known"),
        ("G1.5 X1 F60", "G1.5 is not known"),
        ("G1 X1 F0", "the feed F0"),
        ("G1 X1 F-5", "the feed F-5"),
        ("G1 X2000000 F60", "far outside"),
        ("G2 X10 Y0 F60", "no I, J or R"),
        ("G2 X10 Y0 R5 I5 F60", "R together with I or J"),
        ("G2 X10 Y0 R4 F60", "radius 4 mm"),
        ("G2 X10 Y0 I2 F60", "begins 2 mm from its centre and ends 8 mm"),
        ("G2 X0 Y0 R5 F60", "ends where it begins"),
        ("G2 X10 Y0 K5 F60", "no I, J or R|vertical plane"),
        ("G4 P-5", "the dwell lasts"),
        ("G1 X1 F60 " + ";" * 2000, "2010 characters"),
    ],
)
def test_what_could_change_the_motion_is_refused_with_its_line(line, text):
    start = HEAD if not line.startswith("X10") else "G21\nG90\n"
    with pytest.raises(MotionError, match=text) as error:
        read_gcode(start + line + "\nG1 X5 F60\n")
    assert "line 3" in str(error.value)


def test_a_program_without_a_move_is_refused():
    with refused(MotionError, expected="G1"):
        read_gcode("G21\nG0 X5 Y5 Z0\nM2\n")


def test_an_arc_from_nowhere_is_refused():
    with refused(MotionError, found="line 1", expected="G0 or G1"):
        read_gcode("G2 X10 Y0 I5 F60\n")


def test_files_that_are_none(tmp_path):
    with pytest.raises(MotionError, match="no G-code file"):
        load_gcode(tmp_path)
    with pytest.raises(MotionError, match="no G-code file"):
        load_gcode(tmp_path / "none.gcode")


def test_a_path_with_a_hole_is_refused():
    lines = [
        LineSegment((0, 0, 0), (1, 0, 0), 0.1),
        Dwell(1.0),
        LineSegment((1, 0, 0.1), (2, 0, 0), 0.1, 7),
    ]
    with refused(MotionError, found=("line 7", "[1, 0, 0.1]"), expected="[1, 0, 0]"):
        ToolPath(lines)


@given(st.text(alphabet="GMXYZIJREFNS0123456789.-+* ();\t%/x\u00e9", max_size=60))
def test_any_line_is_words_or_a_refusal(line):
    try:
        words = words_of(line, "it")
    except MotionError:
        return
    assert all(word.letter.isupper() and math.isfinite(word.value) for word in words)


@given(
    st.lists(
        st.tuples(st.floats(-500, 500), st.floats(-500, 500), st.integers(0, 3)),
        min_size=1, max_size=12,
    ),
    st.booleans(),
)  # fmt: skip
def test_absolute_and_relative_programs_are_the_same_path(points, inch):
    """Written with full precision, a program means the same in either mode."""
    unit = 25.4 if inch else 1.0
    x = y = 0.0
    absolute, relative = ["G90", "G0 X0 Y0 Z0"], ["G91"]
    for a, b, _ in points:
        absolute.append(f"G1 X{a / unit:.12f} Y{b / unit:.12f} F600")
        relative.append(f"G1 X{(a - x) / unit:.12f} Y{(b - y) / unit:.12f} F600")
        x, y = a, b
    head = "G20\n" if inch else "G21\n"
    try:
        one, two = (read_gcode(head + "\n".join(text)).path for text in (absolute, relative))
    except MotionError as error:
        assert "moves nothing" in str(error)  # noqa: PT017
        return
    assert one.length == pytest.approx(two.length, abs=1e-9)
    np.testing.assert_allclose(one.segments[-1].end, [x / 1e3, y / 1e3, 0.0], atol=1e-9)
