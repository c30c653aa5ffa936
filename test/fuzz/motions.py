"""Motion programs and trajectories: anything or a refusal."""

from dataclasses import replace

import numpy as np
import yaml
from target import JOINTS, done, in_file

import robots
from boat import stl
from robot_energy.bag.cdr import typestore
from robot_energy.physics.rigid_body import Robot
from robot_energy_papers.wall import Wall
from robot_energy_plan.motion.gcode import load_gcode, read_gcode
from robot_energy_plan.motion.joint_trajectory import MESSAGE as JOINT_TRAJECTORY
from robot_energy_plan.motion.joint_trajectory import (
    decode_trajectory,
    read_csv_trajectory,
    read_points,
)
from robot_energy_plan.motion.ptp_file import program_for, read_program
from robot_energy_plan.motion.slicing import Slicing, slice_stl
from robot_energy_plan.motion.tool_motion import TimedPath


def gcode(data: bytes) -> bool:
    """A program is refused, or becomes a motion that stays finite and within its speed."""
    path = in_file("program.gcode", data)

    def read() -> None:
        program = load_gcode(path)
        motion = TimedPath(program.path)
        assert 0 < motion.duration < np.inf
        time = np.linspace(-1.0, motion.duration + 1.0, 200)
        tool = motion.sample(time)
        for values in (tool.position, tool.velocity, tool.acceleration):
            assert np.isfinite(values).all()
        fastest = max(getattr(segment, "speed", 0.0) for segment in program.path.segments)
        assert np.linalg.norm(tool.velocity, axis=1).max() <= fastest * (1 + 1e-6) + 1e-6

    return done(read)


def gcode_seeds() -> list[bytes]:
    """The wall, and all that is understood."""
    rich = (
        "%\n( all codes )\nG21 G90 G17\nM82\nG92 E0\nM104 S200\nN10 G0 X0 Y0 Z0\n"
        "G1 X20 E1 F3000\nG2 X30 Y10 I0 J10\nG3 X20 Y20 R10\nG3 X20 Y20 I5 J0 Z2\nG4 P200\n"
        "G91\nG1 X-5 Y1\nG20\nG1 Y.1 F50\nG90 G21\nG0 X5 F600 ; back\nM117 Hello (\nM2\n"
    )
    printer = (
        "\ufeff;FLAVOR:Marlin\nM203 X500 Z10\nM84 X Y E\nG28 X Y\nM220 S50\nG0 X0 Y0 Z0 F3000\n"
        "G1 X9 E2\nG1 E-1 F900\nM220 B\nM220 R\nG0 X0\nG29.1 Z0\nTx\nM1002 g_x : 2\nG4 S1\n"
    )
    klipper = (
        "PRINT_START BED=60\nG0 X0 Y0 Z0\nSET_VELOCITY_LIMIT VELOCITY=40 ACCEL=9\nG1 X9 F600\n"
        "EXCLUDE_OBJECT_START NAME=a\nG4 P9\nG1 X5\nPRINT_END\n"
    )
    milling = (
        "$H\nG54 G17 G90.1\nG0 X0 Y0 Z0\nG2 X10 Y10 I10 J0 F600\nG18 G91.1\nG3 X15 Z5 I5 K0 P3\n"
        "G19\nG2 Y20 Z9 R20\nG1 X5 M8\nG53 G0 Z0\nM30\n"
    )
    return [
        Wall(layers=2).gcode().encode(),
        *(text.encode() for text in (rich, printer, klipper)),
        milling.replace("$H\n", "").encode("utf-16"),
    ]


def shape(data: bytes) -> bool:
    """A shape is refused, or becomes a program that is read."""
    path = in_file("shape.stl", data)

    def read() -> None:
        for slicing in (Slicing(layer_height=0.05), Slicing(layer_height=0.03, bead_width=0.01)):
            sliced = slice_stl(path, slicing)
            assert read_gcode(sliced.gcode).path.printed_length > 0.0

    return done(read)


def shape_seeds() -> list[bytes]:
    """Two pyramids that overlap; one as text, twice."""
    corners = np.array([(0, 0, 0), (0, 200, 0), (300, 200, 0), (300, 0, 0), (0, 0, 90)])
    sides = corners[[(0, 1, 2), (0, 2, 3), (0, 3, 4), (3, 2, 4), (2, 1, 4), (1, 0, 4)]]
    facets = "".join(
        "facet normal 0 0 1\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*corner) for corner in side.tolist())
        + "endloop\nendfacet\n"
        for side in sides
    )
    both = np.concatenate([sides, np.add(sides, [150, 0, 0])])
    return [stl(both), f"solid it\n{facets * 2}endsolid it\n".encode()]


def moves_file(data: bytes) -> bool:
    """A program of moves is refused, or made for a robot."""
    path = in_file("moves.yaml", data)
    limits = Robot(robots.TWO_LINK_URDF, JOINTS).limits
    limits = replace(limits, velocity=np.array([4.0, 4.0]))

    def read() -> None:
        loaded = program_for(read_program(path), limits)
        time = np.linspace(0.0, loaded.program.period, 100)
        assert np.isfinite(loaded.program.sample(time).joint_acceleration).all()

    return done(read)


def moves_seeds() -> list[bytes]:
    """Moves of two joints."""
    via = [{"shoulder": 0.0, "elbow": 10}, {"shoulder": 45.5, "elbow": -30}]
    data = {"schema_version": 1, "motion": "point_to_point", "angle_unit": "deg", "via": via}
    rich = {"dwell": [0.5, 0], "override": 0.5, "acceleration": {"shoulder": 9.0, "elbow": 8}}
    return [yaml.safe_dump(each).encode() for each in (data, {**data, **rich, "repeat": 3})]


def trajectory(data: bytes) -> bool:
    """A JointTrajectory is refused, or can be followed."""

    def read() -> None:
        found = read_points(decode_trajectory(typestore(), data, "it"), "it")
        time = np.linspace(0.0, found.duration, 100)
        assert np.isfinite(found.sample(time).joint_position).all()

    return done(read)


def trajectory_seeds() -> list[bytes]:
    """Three points of two joints."""
    kinds = typestore().types
    rows = [
        kinds["trajectory_msgs/msg/JointTrajectoryPoint"](
            positions=np.array([0.1, 0.2]) * k,
            velocities=np.array([0.1, 0.2]),
            accelerations=np.zeros(2),
            effort=np.empty(0),
            time_from_start=kinds["builtin_interfaces/msg/Duration"](sec=k, nanosec=5),
        )
        for k in range(3)
    ]
    stamp = kinds["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    message = kinds[JOINT_TRAJECTORY](header=header, joint_names=list(JOINTS), points=rows)
    return [bytes(typestore().serialize_cdr(message, JOINT_TRAJECTORY))]


def trajectory_csv(data: bytes) -> bool:
    """A table of points is refused, or can be followed."""
    path = in_file("points.csv", data)
    return done(lambda: read_csv_trajectory(path).sample(np.linspace(0.0, 1.0, 50)))


def trajectory_csv_seeds() -> list[bytes]:
    """Points with and without derivatives."""
    plain = "time,position_a,position_b\n0,0,0\n0.5,1,2\n1,2,1\n"
    rich = "time,position_a,velocity_a,acceleration_a\n0,0,0,0\n0.5,1,2,3\n1,2,0,0\n"
    return [plain.encode(), rich.encode()]
