"""A tool in time: speed, corners, acceleration, rest - against what can be worked out."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_energy.foundation.errors import MotionError
from robot_energy_plan.motion.gcode import read_gcode
from robot_energy_plan.motion.tool_corners import Arc, Dwell, LineSegment, ToolPath
from robot_energy_plan.motion.tool_motion import TimedPath, ToolLimits

HEAD = "G21 G90\nG0 X0 Y0 Z0\n"
SHARP = ToolLimits(acceleration=1.0, corner_tolerance=0.0, smoothing=0.0)


def path(text):
    return read_gcode(HEAD + text).path


def speed(motion, time):
    return np.linalg.norm(motion.sample(time).velocity, axis=1)


def test_one_line_lasts_as_worked_out():
    """0.5 m at 0.125 m/s with ramps of 0.125 s at 1 m/s^2: 0.5 / 0.125 + 0.125 s."""
    motion = TimedPath(path("G1 X500 F7500\n"), SHARP)
    assert motion.duration == pytest.approx(4.125, rel=1e-12)
    assert motion.length == pytest.approx(0.5, rel=1e-12)
    at = motion.sample(np.array([0.05, 0.125, 2.0, 4.0, 4.125]))
    np.testing.assert_allclose(at.position[:, 0], [0.00125, 0.0078125, 0.2421875, 0.4921875, 0.5])
    np.testing.assert_allclose(at.velocity[:, 0], [0.05, 0.125, 0.125, 0.125, 0.0], atol=1e-12)
    np.testing.assert_allclose(at.acceleration[:2, 0], [1.0, 0.0])
    # Way at the programmed speed: all but the ramps of 0.125^2 / 2 m each.
    assert motion.full_speed_share == pytest.approx(1 - 2 * 0.0078125 / 0.5)


def test_a_short_line_never_reaches_its_feed():
    """1 mm at 1 m/s^2 from rest to rest: 2 sqrt(0.001) s, peak sqrt(0.001) m/s."""
    motion = TimedPath(path("G1 X1 F7500\n"), SHARP)
    assert motion.duration == pytest.approx(2 * math.sqrt(1e-3))
    assert speed(motion, np.array([motion.duration / 2]))[0] == pytest.approx(math.sqrt(1e-3))


def test_a_rounded_corner_as_worked_out():
    """Ninety degrees within 1 mm at 1 m/s^2: r = 1 / (sqrt 2 - 1) mm = 2.414 mm, passed at
    sqrt(r) = 49.1 mm/s; the way is shorter by 2 r - r pi / 2."""
    limits = ToolLimits(1.0, 1e-3, 0.0)
    motion = TimedPath(path("G1 X200 F7500\nG1 Y200\n"), limits)
    radius = 1e-3 / (math.sqrt(2) - 1)
    assert motion.length == pytest.approx(0.4 - 2 * radius + radius * math.pi / 2, rel=1e-12)
    time = np.linspace(0, motion.duration, 200_001)
    tool = motion.sample(time)
    nearest = np.linalg.norm(tool.position - [0.2, 0.0, 0.0], axis=1)
    assert nearest.min() == pytest.approx(1e-3, rel=1e-6)
    assert speed(motion, time[[int(nearest.argmin())]])[0] == pytest.approx(math.sqrt(radius))
    assert motion.stops == 0
    # Two lines of 0.2 m - r, from rest to 125 mm/s and down to v, and the arc at v.
    v, v0 = math.sqrt(radius), 0.125
    cruise = 0.2 - radius - v0**2 / 2 - (v0**2 - v**2) / 2
    expected = 2 * (v0 + (v0 - v) + cruise / v0) + radius * math.pi / 2 / v
    assert motion.duration == pytest.approx(expected, rel=1e-9)


def test_a_corner_is_no_larger_than_the_speed_needs():
    """At 125 mm/s and 2 m/s^2, r = 7.8125 mm is enough whatever the tolerance."""
    motion = TimedPath(path("G1 X200 F7500\nG1 Y200\n"), ToolLimits(2.0, 0.05, 0.0))
    radius = 0.125**2 / 2
    assert motion.length == pytest.approx(0.4 - 2 * radius + radius * math.pi / 2)
    time = np.linspace(0.2, motion.duration - 0.2, 1000)
    np.testing.assert_allclose(speed(motion, time), 0.125, rtol=1e-12)


def test_smoothing_is_taken_off_the_tolerance():
    """1 mm allowed, of which 2 m/s^2 (0.05 s)^2 / 24 = 0.208 mm are left to smoothing."""
    limits = ToolLimits(2.0, 1e-3, 0.05)
    assert limits.averaging_deviation == pytest.approx(2.083e-4, rel=1e-3)
    motion = TimedPath(path("G1 X200 F60000\nG1 Y200\n"), limits)
    tool = motion.sample(np.linspace(0.0, motion.duration, 20_001)).position
    away = np.minimum(np.abs(tool[:, 1]), np.abs(tool[:, 0] - 0.2)).max()
    corner = np.linalg.norm(tool - [0.2, 0.0, 0.0], axis=1).min()
    assert away < corner <= 1e-3 + 1e-9
    assert corner > 0.95e-3


def test_corners_close_together_share_the_line_between_them():
    """Lines of 2 mm, tolerance without bounds: each corner takes half, nothing is left over:
    quarter circles of radius 1 mm, passed at sqrt(0.001) m/s."""
    text = "".join(f"G1 X{2 * k + 2} F60000\nG1 Y{2 * k + 2}\n" for k in range(10))
    motion = TimedPath(path(text), ToolLimits(1.0, 1.0, 0.0))
    assert motion.length == pytest.approx(0.002 + 19 * 0.001 * math.pi / 2, rel=1e-9)
    time = np.linspace(0.1, motion.duration - 0.1, 5000)
    np.testing.assert_allclose(speed(motion, time), math.sqrt(1e-3), rtol=1e-9)


def test_speed_is_built_up_over_short_lines():
    """Ten lines of 1 mm in a row are one of 10 mm: from rest to rest 2 sqrt(0.01 / 1) s."""
    text = "".join(f"G1 X{k + 1} F60000\n" for k in range(10))
    motion = TimedPath(path(text), SHARP)
    assert motion.duration == pytest.approx(0.2)
    assert np.abs(np.diff(motion.sample(np.linspace(0, 0.2, 1001)).position[:, 0])).max() < 2.1e-5


def test_without_tolerance_every_corner_is_a_stop():
    motion = TimedPath(path("G1 X200 F7500\nG1 Y200\nG1 X0\n"), SHARP)
    assert motion.stops == 2
    # Three lines of 0.2 m, each v / a longer than at constant speed.
    assert motion.duration == pytest.approx(3 * (0.2 / 0.125 + 0.125))


def test_circles_are_passed_at_constant_speed_within_the_acceleration():
    """Radius 5 mm at 1 m/s^2: 0.8 of it sideways makes sqrt(0.004) = 63.2 mm/s."""
    motion = TimedPath(path("G3 I5 F7500\nG3 I5\nG3 I5\n"), SHARP)
    time = np.linspace(0.25, motion.duration - 0.25, 500)
    np.testing.assert_allclose(speed(motion, time), math.sqrt(0.8 * 0.005), rtol=1e-9)
    away = motion.sample(time).position - [0.005, 0.0, 0.0]
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 0.005, rtol=1e-9)


def test_a_helix_climbs_evenly():
    motion = TimedPath(path("G2 X0 Y0 Z20 I100 J0 F7500\n"), SHARP)
    time = np.linspace(0.3, motion.duration - 0.3, 100)
    rise = np.diff(motion.sample(time).position[:, 2]) / np.diff(time)
    np.testing.assert_allclose(rise, 0.125 * 0.02 / motion.length, rtol=1e-9)


def test_a_dwell_is_rest_of_its_length_with_smoothing_too():
    limits = ToolLimits(1.0, 1e-3, 0.05)
    motion = TimedPath(path(";FLAVOR:Marlin\nG1 X100 F6000\nG4 P700\nG1 X200\n"), limits)
    time = np.arange(0, motion.duration, 1e-4)
    middle = (time > 0.2) & (time < motion.duration - 0.2)
    rest = time[middle & (speed(motion, time) < 1e-12)]
    assert rest[-1] - rest[0] == pytest.approx(0.7, abs=3e-4)
    assert motion.stops == 0  # it was asked for


def test_starts_and_ends_at_rest_where_the_program_does():
    motion = TimedPath(path(";FLAVOR:Marlin\nG4 P200\nG1 X100 F6000\nG4 P300\n"))
    at = motion.sample(np.array([-1.0, 0.1, motion.duration - 0.1, motion.duration + 1.0]))
    np.testing.assert_allclose(at.position[:, 0], [0, 0, 0.1, 0.1], atol=1e-12)
    assert not at.velocity.any()


def test_the_line_of_the_program_is_known():
    motion = TimedPath(path("G1 X100 F6000\nG1 Y100\n"))
    np.testing.assert_array_equal(
        motion.source_line(np.array([0.0, 0.5, motion.duration])), [3, 3, 4]
    )


def tilted(points, feeds):
    ends = [tuple(p) for p in points]
    return [
        LineSegment(a, b, f, 1) for a, b, f in zip(ends, ends[1:], feeds, strict=False) if a != b
    ]


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(*[st.integers(-20, 20)] * 3), min_size=3, max_size=8),
    st.lists(st.floats(0.01, 0.5), min_size=8, max_size=8),
    st.floats(0.2, 5.0),
    st.floats(0.5, 5.0),
    st.sampled_from([0.0, 0.01, 0.02]),
)
def test_any_polygon_keeps_its_bounds(points, feeds, acceleration, tolerance, smoothing):
    """Speed, acceleration, and distance from the programmed lines, in space."""
    lines = tilted([(0.01 * x, 0.01 * y, 0.01 * z) for x, y, z in points], feeds)
    if not lines:
        return
    limits = ToolLimits(acceleration, tolerance * 1e-3, smoothing)
    motion = TimedPath(ToolPath(lines), limits)
    time = np.linspace(0.0, motion.duration, 3000)
    tool = motion.sample(time)
    assert np.linalg.norm(tool.velocity, axis=1).max() <= max(x.speed for x in lines) * (1 + 1e-9)
    assert np.linalg.norm(tool.acceleration, axis=1).max() <= acceleration * (1 + 1e-9)
    steps = np.linalg.norm(np.diff(tool.position, axis=0), axis=1)
    fastest = max(x.speed for x in lines)
    assert steps.max() <= fastest * np.diff(time).max() * (1 + 1e-6) + 1e-9  # nothing jumps
    distance = np.full(len(time), np.inf)
    for line in lines:
        start, end = np.array(line.start), np.array(line.end)
        share = np.clip((tool.position - start) @ (end - start) / line.length**2, 0, 1)
        away = tool.position - start - share[:, None] * (end - start)
        distance = np.minimum(distance, np.linalg.norm(away, axis=1))
    assert distance.max() <= tolerance * 1e-3 + 1e-9
    np.testing.assert_allclose(tool.position[0], lines[0].start, atol=1e-9)
    np.testing.assert_allclose(tool.position[-1], lines[-1].end, atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.02, 0.1]))
def test_velocity_and_acceleration_are_the_slopes(seed, smoothing):
    """Lines, arcs and helices: integrals of what is returned give what is returned."""
    draw = np.random.default_rng(seed)
    at, segments = (0.0, 0.0, 0.0), []
    for _ in range(4):
        end = tuple(np.round(at + draw.uniform(-0.2, 0.2, 3), 4).tolist())
        centre = (at[0] + 0.05, at[1])
        kind = draw.integers(3)
        if kind == 0:
            end = (*at[:2], end[2])
            segments.append(Arc(at, end, centre, 2 * math.pi * draw.choice([-1, 1]), 0.2, 1))
        elif kind == 1:
            segments.append(Dwell(float(draw.uniform(0, 0.3))))
            continue
        else:
            segments.append(LineSegment(at, end, float(draw.uniform(0.05, 0.4)), 1))
        at = end
    segments.append(LineSegment(at, (0.5, 0.0, 0.0), 1.0, 1))
    motion = TimedPath(ToolPath(segments), ToolLimits(2.0, 2e-3, smoothing))
    step = 1e-4
    time = draw.uniform(0.0, motion.duration - step, 1000)
    begin, middle, end = (motion.sample(time + part * step) for part in (0.0, 0.5, 1.0))
    np.testing.assert_allclose(
        (end.position - begin.position) / step, middle.velocity, atol=0.3 * 2.0 * step + 1e-8
    )
    if smoothing:
        np.testing.assert_allclose(
            (end.velocity - begin.velocity) / step,
            middle.acceleration,
            atol=2 * 2.0 * step / smoothing + 0.06 * step / smoothing,
        )


@pytest.mark.parametrize(
    ("figures", "text"),
    [
        ((0.0, 1e-3, 0.0), "acceleration is 0"),
        ((1.0, -1e-3, 0.0), "corner tolerance"),
        ((1.0, 1e-3, 2.0), "smoothing is 2"),
        ((2.0, 1e-4, 0.1), "leaves the path"),
    ],
)
def test_figures_without_sense(figures, text):
    with pytest.raises(MotionError, match=text):
        ToolLimits(*figures)
