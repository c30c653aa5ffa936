"""The compiled kernels, against the numpy and Pinocchio forms that they stand for."""

import json
import os
import struct
import subprocess
import sys
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import robots
from places import ROOT
from robot_energy.accounting.comparison import _compared, _compiled
from robot_energy.accounting.exact_sum import ExactSum
from robot_energy.accounting.registers import Registers
from robot_energy.bag.cdr.decode import Decoder, Encoder, RawBatch, stamp_columns
from robot_energy.bag.mcap_records import walked_block
from robot_energy.certainty.deviation import CABINET_DEVIATIONS, JOINT_DEVIATIONS
from robot_energy.foundation.units import MAX_COUNTER
from robot_energy.model import load, shipped_models
from robot_energy.physics import kernels
from robot_energy.physics.derivative import Derivative
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import HeldRows, PowerBlock
from robot_energy.timeline.pieces import CoveredPieces

seeds = st.integers(0, 2**32 - 1)


@pytest.fixture
def without(monkeypatch):
    """Give a function that runs another one without the kernels."""

    def run(function, *arguments):
        with monkeypatch.context() as patch:
            patch.setattr(kernels, "compiled", None)
            return function(*arguments)

    return run


def in_numpy(function, *arguments):
    """Run a function without the kernels, in tests with many examples."""
    compiled, kernels.compiled = kernels.compiled, None
    try:
        return function(*arguments)
    finally:
        kernels.compiled = compiled


def test_the_set_up_has_compiled_them():
    assert kernels.compiled is not None


def test_they_can_be_switched_off():
    code = "from robot_energy.physics import kernels; print(kernels.compiled)"
    command = [sys.executable, "-c", code]
    done = subprocess.run(
        command,
        env=os.environ | {kernels.SWITCH: "off"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "None"


# Rigid-body torque


def motion(rng, rows, joints):
    scale = np.array([3.0, 2.0, 20.0])[:, None, None]
    return rng.normal(size=(3, rows, joints)) * scale


def close(torque, expected):
    """Whether torques agree to the last digits of the greatest one."""
    return np.abs(torque - expected).max() <= 1e-13 * np.abs(expected).max()


@pytest.mark.parametrize("name", shipped_models())
def test_torque_of_each_shipped_robot_is_that_of_pinocchio(name, without):
    robot = Robot.from_model(load(name))
    moved = motion(np.random.default_rng(1), 1001, robot.n_joints)
    assert close(robot.joint_torque(*moved), without(robot.joint_torque, *moved))


def tree(rng, size):
    """A URDF with any axes, offsets and inertias, and the names of its joints."""
    text = ['<robot name="r"><link name="l0"/>']
    names = rng.permutation(size).tolist()  # not in the order of the tree
    for link in range(1, size + 1):
        axis = rng.normal(size=3) if rng.random() < 0.6 else np.eye(3)[rng.integers(3)]
        kind = rng.choice(["continuous", "prismatic", "revolute"])
        words = [" ".join(map(repr, values.tolist())) for values in rng.normal(size=(3, 3))]
        ixx, iyy = rng.uniform(1.0, 2.0, 2).tolist()
        limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
        text.append(
            f'<joint name="j{names[link - 1]}" type="{kind}"><parent link="l{rng.integers(link)}"/>'
            f'<child link="l{link}"/><origin xyz="{words[0]}" rpy="{words[1]}"/>'
            f'<axis xyz="{" ".join(map(repr, axis.tolist()))}"/>'
            f"{'' if kind == 'continuous' else limit}</joint>"
            f'<link name="l{link}"><inertial><origin xyz="{words[2]}" rpy="0.1 0.2 0.3"/>'
            f'<mass value="{rng.uniform(0.5, 9.0)}"/><inertia ixx="{ixx}" iyy="{iyy}" izz="1.5" '
            'ixy="0.1" ixz="-0.2" iyz="0.05"/></inertial></link>'
        )
    return "".join([*text, "</robot>"]), tuple(f"j{number}" for number in range(size))


@given(seeds, st.integers(1, 9), st.integers(1, 40))
def test_torque_of_any_tree_is_that_of_pinocchio(seed, size, rows):
    rng = np.random.default_rng(seed)
    robot = Robot(*tree(rng, size), gravity=rng.normal(size=3) * 10)
    moved = motion(rng, rows, size)
    if rng.random() < 0.5:
        moved = [np.asfortranarray(values) for values in moved]
    assert close(robot.joint_torque(*moved), in_numpy(robot.joint_torque, *moved))


@given(seeds, st.lists(st.integers(0, 60), max_size=6))
def test_torque_has_the_same_bits_in_every_block(seed, cuts):
    robot = Robot.from_model(load("kr16"))
    moved = motion(np.random.default_rng(seed), 60, 6)
    whole = robot.joint_torque(*moved)
    parts = np.split(moved, sorted(cuts), axis=1)
    np.testing.assert_array_equal(np.concatenate([robot.joint_torque(*p) for p in parts]), whole)


@pytest.mark.parametrize("turns", [0.0, 1e5, 1.6e5, 1e9, 1e15])
def test_angles_of_any_size(turns, without):
    robot = Robot.from_model(robots.two_link())
    angle = turns * 2 * np.pi + np.linspace(-np.pi, np.pi, 33)[:, None] * np.ones(2)
    still = np.zeros_like(angle)
    expected = without(robot.joint_torque, angle, still, still)
    np.testing.assert_allclose(
        robot.joint_torque(angle, still, still), expected, atol=1e-13 * np.abs(expected).max()
    )


@pytest.mark.parametrize("which", [0, 1, 2])
@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_none_spoils_its_own_sample(which, joint, bad):
    robot = Robot.from_model(load("kr16"))
    moved = motion(np.random.default_rng(3), 24, 6)
    expected = robot.joint_torque(*moved)
    moved[which, 11, joint] = bad
    torque = robot.joint_torque(*moved)
    assert not np.isfinite(torque[11]).any()
    rest = np.arange(24) != 11
    np.testing.assert_array_equal(torque[rest], expected[rest])


def test_a_payload_reaches_the_kernel(without):
    robot = Robot.from_model(load("kr16")).with_payload(())
    moved = motion(np.random.default_rng(4), 9, 6)
    light, heavy = robot, Robot.from_model(load("kr16"))
    assert not close(light.joint_torque(*moved), heavy.joint_torque(*moved))
    assert close(light.joint_torque(*moved), without(light.joint_torque, *moved))


# Slopes


@given(
    seeds,
    st.integers(1, 70),
    st.sampled_from([0.0, 0.01, 0.02]),
    st.sampled_from([0.0005, 0.001, 0.002, 0.005]) | st.floats(2e-4, 0.02),
    st.booleans(),
)
def test_slopes_have_the_bits_of_numpy(seed, rows, lag, period, even):
    rng = np.random.default_rng(seed)
    steps = np.full(rows, period) if even else rng.uniform(0.2, 3.0, rows) * period
    velocity = rng.normal(size=(rows, 3))
    block = robots.joint_block(100.0 + np.cumsum(steps), velocity, velocity)
    cut = int(rng.integers(rows + 1))

    def acceleration():
        stage = Derivative(lag=lag)
        parts = [slice(0, cut), slice(cut, None)]
        out = [*(p for part in parts for p in stage.step(block[part])), *stage.flush()]
        return np.concatenate([part.joint_acceleration for part in out])

    found, expected = acceleration(), in_numpy(acceleration)
    np.testing.assert_array_equal(found.view(np.int64), expected.view(np.int64))


def test_a_window_of_more_samples_than_the_kernel_takes(without):
    stamp = np.arange(2000) * 2e-5  # 1000 in a window of 20 ms
    velocity = np.sin(50 * stamp)[:, None]
    block = robots.joint_block(stamp, velocity, velocity)

    def acceleration():
        stage = Derivative()
        return np.concatenate([p.joint_acceleration for p in [*stage.step(block), *stage.flush()]])

    np.testing.assert_array_equal(acceleration(), without(acceleration))


# Exact sums


def exact_sum(values):
    """The sum of floats as a fraction, by whole numbers of equal exponent."""
    mantissa, exponent = np.frexp(values)
    whole = np.ldexp(mantissa, 53).astype(np.int64)
    return sum(
        sum(whole[exponent == power].tolist()) * Fraction(2) ** (power - 53)
        for power in np.unique(exponent).tolist()
    )


@given(
    seeds,
    st.sampled_from([1, 7, 8, 9, 4095, 4096, 4097, 30_000]),
    st.sampled_from(["C", "F"]),
    st.sampled_from([1e-12, 1e-3, 1.0, 1.9e6]),
)
def test_sums_have_the_bits_of_numpy_and_are_exact(seed, rows, order, greatest):
    rng = np.random.default_rng(seed)
    energy = rng.uniform(-greatest, greatest, (rows, 3))
    energy[:, 1] = np.abs(energy[:, 1])  # sums beyond 2^53 microjoules
    energy = np.asarray(energy, order=order)

    def sums():
        total = ExactSum(5)
        total.add(energy, 1)
        return total.microjoule.tolist(), total.remainder.tolist()

    found = sums()
    assert found == in_numpy(sums)
    microjoule, remainder = found
    for column in range(3):
        exact = exact_sum(energy[:, column] * 1e6)
        counted = microjoule[1 + column] + Fraction(remainder[1 + column], 2**40)
        assert abs(counted - exact) <= rows * Fraction(1, 2**41)
    assert (microjoule[0], microjoule[4], remainder[0], remainder[4]) == (0, 0, 0, 0)


# Energies of the registers


def power_block(rng, rows, joints):
    """Power samples of any sizes, with gaps and now and then a number that is none."""
    stamp = np.cumsum(rng.integers(1, 5_000_000, rows))
    sizes = {name: (rows,) for name in PowerBlock.__dataclass_fields__}
    sizes |= {name: (rows, joints) for name in ("rigid_power", "friction_power", "drive_loss")}
    values = {name: np.asfortranarray(rng.normal(size=size) * 1e3) for name, size in sizes.items()}
    if rng.random() < 0.3:
        values["friction_power"][rng.integers(rows), 0] = rng.choice([np.nan, np.inf, 1e300])
    columns = len(CABINET_DEVIATIONS) + len(JOINT_DEVIATIONS) * joints
    held = HeldRows(np.zeros((1, columns)), np.zeros(rows, int), np.arange(rows) == 0)
    segment = np.cumsum(rng.random(rows) < 0.02)
    phase = np.ones(rows, dtype=np.uint8)
    counted = {"stamp_ns": stamp, "segment": segment, "phase": phase, "deviation": held}
    return PowerBlock(**{**values, **counted})


@given(seeds, st.integers(1, 7), st.sampled_from([1, 2, 8, 9, 1023, 1024, 1025, 2100]))
def test_registers_have_the_bits_of_numpy(seed, joints, rows):
    block = power_block(np.random.default_rng(seed), rows, joints)
    cut = np.random.default_rng(seed + 1).integers(rows + 1)

    def count():
        registers = Registers(joints)
        found = []
        for part in (slice(0, cut), slice(cut, None)):
            if len(block[part]):
                intervals, _ = registers.step(block[part])
                found.append((intervals.energy, intervals.duration_ns))
        energy, duration = (np.concatenate(each) for each in zip(*found, strict=True))
        return energy, duration, registers.microjoule, registers.remainder, registers.time

    *found, time = count()
    *expected, time_in_numpy = in_numpy(count)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)
    assert time == time_in_numpy


def test_a_register_that_is_nearly_full_stays_full():
    block = power_block(np.random.default_rng(1), 50, 2)

    def count():
        registers = Registers(2)
        full = np.full(len(registers.microjoule), MAX_COUNTER - 1000)
        registers.add_sums(full, np.zeros_like(full))
        registers.step(block)
        return registers.microjoule

    np.testing.assert_array_equal(count(), in_numpy(count))
    assert count().max() == MAX_COUNTER


# Comparison of two curves


def curve(rng, pieces):
    """Pieces of a power curve, most of which touch."""
    times = np.cumsum(rng.integers(1, 9, 2 * pieces)) + int(rng.integers(20))
    start, end = times[::2], times[1::2]
    touch = np.append(rng.random(pieces - 1) < 0.8, False)
    end = np.where(touch, np.append(start[1:], 0), end)
    return CoveredPieces(start, end, *rng.normal(size=(2, pieces)) * 1e3)


@given(seeds, st.integers(1, 30), st.integers(1, 30))
def test_compared_curves_have_the_bits_of_numpy(seed, one, other):
    rng = np.random.default_rng(seed)
    measured, predicted = curve(rng, one), curve(rng, other)
    start = int(rng.integers(0, 60))
    until = start + int(rng.integers(1, 200))
    found, energy = _compiled(kernels.compiled, predicted, measured, start, until)
    expected, energy_in_numpy, _ = _compared(predicted, measured, start, until)
    for name, values in expected.__dict__.items():
        np.testing.assert_array_equal(getattr(found, name), values)
    np.testing.assert_array_equal(energy, energy_in_numpy)


# Columns of messages


@given(seeds, st.integers(1, 60), st.booleans())
def test_columns_are_those_of_numpy(seed, count, other_names):
    rng = np.random.default_rng(seed)
    encoder = Encoder(
        "sensor_msgs/msg/JointState",
        {"name": ("a", "bc")},
        {"position": 2, "velocity": 2, "effort": 0},
    )
    stamp = rng.integers(1, 2**60, count)
    position, velocity = rng.normal(size=(2, count, 2))
    values = {"position": position, "velocity": velocity, "effort": np.empty((count, 0))}
    rows = encoder.encode({**stamp_columns(stamp), **values}, count)
    messages = [bytes(row) for row in rows]
    if other_names:
        place = int(rng.integers(count))
        messages[place] = messages[place].replace(b"bc", b"xy")
    lengths = np.array([len(one) for one in messages])
    buffer = np.frombuffer(b"".join(messages), dtype=np.uint8)
    batch = RawBatch("/t", encoder.msgtype, stamp, buffer, np.cumsum(lengths) - lengths, lengths)

    def decoded():
        fields = ("name", "header.stamp.sec", "header.stamp.nanosec", "position", "velocity")
        return [
            (run.rows.tolist(), {k: np.asarray(v).tolist() for k, v in run.columns.items()})
            for run in Decoder(encoder.msgtype, fields).decode(batch).runs
        ]

    assert decoded() == in_numpy(decoded)


# Messages of a bag


def record(kind, body):
    return struct.pack("<BQ", kind, len(body)) + body


@st.composite
def blocks(draw):
    """Records of a chunk, whole or cut off."""
    parts = []
    for _ in range(draw(st.integers(0, 30))):
        kind = draw(st.sampled_from([5, 5, 5, 5, 3, 4, 7, 2]))
        size = draw(st.integers(0, 40))
        body = struct.pack(
            "<HIQQ", draw(st.integers(0, 3)), 0, draw(st.integers(0, 2**64 - 1)), 0
        ) + bytes(size)
        parts.append(record(kind, body[: draw(st.integers(0, 22))] if size == 0 else body))
    data = b"".join(parts)
    return data[: draw(st.integers(0, len(data)))] if draw(st.booleans()) else data


def described(block):
    found = {
        channel: [each.tolist() for each in (m.log_time_ns, m.offset, m.length)]
        for channel, m in block.messages.items()
    }
    return found, block.end, block.count


@given(blocks(), st.none() | st.integers(0, 10))
def test_messages_are_those_of_the_walk(data, limit):
    def walk():
        met = []
        block = walked_block(data, lambda kind, body: met.append((kind, bytes(body))), limit)
        return described(block), met

    assert walk() == in_numpy(walk)


def test_more_definitions_than_the_kernel_takes():
    message = record(5, struct.pack("<HIQQ", 1, 0, 9, 9) + b"x")
    met = []
    block = walked_block(record(3, b"s") * 1500 + message, lambda *one: met.append(one))
    assert (len(met), block.count) == (1500, 1)


def test_a_length_beyond_all_numbers_ends_the_walk():
    data = (
        record(5, struct.pack("<HIQQ", 1, 0, 9, 9)) + struct.pack("<BQ", 5, 2**64 - 1) + b"x" * 40
    )
    assert walked_block(data, lambda *_: None).count == 1


# Arrays that do not fit

END = 2**63 - 1
SLOPES = (np.arange(3), np.zeros((3, 1)), np.zeros((3, 1)))
CURVE = (np.zeros(1, int), np.ones(1, int), np.zeros(1), np.zeros(1))
ROOM = (np.zeros(1, int), np.zeros(1, int), np.zeros((2, 1)).T)


@pytest.mark.parametrize(
    ("name", "arguments", "error"),
    [
        ("add_exactly", (np.zeros((2, 1), int), np.zeros(1, int), np.zeros(1, int)), TypeError),
        ("add_exactly", (np.zeros((2, 2)), np.zeros(1, int), np.zeros(2, int)), ValueError),
        ("add_exactly", (np.zeros(2), np.zeros(2, int), np.zeros(2, int)), TypeError),
        ("add_exactly", (object(), np.zeros(2, int), np.zeros(2, int)), TypeError),
        ("messages", (b"", np.zeros((3, 5), int), np.zeros(5, int), 1), ValueError),
        ("messages", (b"", np.zeros((4, 10), int)[:, ::2], np.zeros(5, int), 1), ValueError),
        ("slopes", (np.zeros(3, int), np.zeros((3, 2)), np.zeros((3, 2)), *[0] * 5, 1.0),
         ValueError),
        ("slopes", (np.zeros(3, int), np.zeros((3, 1)), np.zeros((3, 1)), 1, *[0] * 4, 1.0),
         ValueError),
        ("integrate", ((np.zeros(2),) * 4, (np.zeros((2, 1)),) * 3, np.zeros(11), np.zeros(2),
                       np.zeros(11), np.zeros((11, 2)).T, np.zeros(11, int), np.zeros(11, int)),
         TypeError),
        ("integrate", ((np.zeros(3),) * 5, (np.zeros((2, 1)),) * 3, np.zeros(11), np.zeros(2),
                       np.zeros(11), np.zeros((11, 2)).T, np.zeros(11, int), np.zeros(11, int)),
         ValueError),
        ("integrate", ((np.zeros(2),) * 5, (np.zeros((2, 1)),) * 3, np.zeros(11), np.zeros(2),
                       np.zeros(11), np.zeros((12, 2)).T, np.zeros(11, int), np.zeros(11, int)),
         ValueError),
        ("compare", ((np.zeros(0, int),) * 4, (np.zeros(0, int),) * 4, 0, 1, np.zeros(1, int),
                     np.zeros(1, int), np.zeros((2, 1)).T), ValueError),
        ("compare", ((np.zeros(1, int), np.ones(1, int), np.zeros(1), np.zeros(1)),) * 2
         + (0, 1, np.zeros(0, int), np.zeros(0, int), np.zeros((2, 0)).T), ValueError),
        ("columns", (bytes(9), np.array([5]), bytes(5), np.zeros(0, int), np.zeros(0, int), (), ()),
         ValueError),
        ("columns", (bytes(9), np.array([4]), bytes(5), np.array([2]), np.array([6]), (), ()),
         ValueError),
        ("columns", (bytes(9), np.array([4]), bytes(5), np.zeros(0, int), np.zeros(0, int), (0,),
                     (np.zeros(1),)), ValueError),
        ("columns", (bytes(9), np.array([0]), bytes(9), np.zeros(0, int), np.zeros(0, int), (0,),
                     (np.zeros(2),)), ValueError),
        ("columns", (bytes(9), np.array([0]), bytes(9), *[np.zeros(0, int)] * 2, (0,),
                     (np.array([None]),)), TypeError),
        ("columns", (bytes(9), np.array([0]), bytes(9), *[np.zeros(0, int)] * 2, (0,),
                     (np.array(["12"], "S8"),)), TypeError),
        ("columns", (bytes(9), np.array([0]), bytes(9), *[np.zeros(0, int)] * 2, (END - 4,),
                     (np.zeros(1),)), ValueError),
        ("columns", (bytes(9), np.array([0]), bytes(9), *[np.zeros(0, int)] * 2, (END + 1,),
                     (np.zeros(1),)), OverflowError),
        ("slopes", (*SLOPES, END, *[0] * 4, 1.0), ValueError),
        ("slopes", (*SLOPES, END + 1, *[0] * 4, 1.0), OverflowError),
        ("slopes", (*SLOPES, 0, END, 0, 0, 0, 1.0), ValueError),
        ("slopes", (*SLOPES, 0, 0, -1, 0, 0, 1.0), ValueError),
        ("slopes", (*SLOPES, 0, 0, 0, -END, 0, 1.0), ValueError),
        ("slopes", (np.array([-END, 0, END]), *SLOPES[1:], 0, 1, 1, 1, 1, 1.0), ValueError),
        ("slopes", (np.array([2, 1, 3]), *SLOPES[1:], 0, 1, 1, 1, 1, 1.0), ValueError),
        ("compare", (CURVE, CURVE, -END, 1, *ROOM), ValueError),
        ("compare", (CURVE, CURVE, 0, END, *ROOM), ValueError),
        ("compare", (CURVE, CURVE, 0, END + 1, *ROOM), OverflowError),
        ("compare", ((np.array([-END]), *CURVE[1:]), CURVE, 0, 1, *ROOM), ValueError),
        ("inverse_dynamics", (np.full((1, 27), np.nan), np.zeros(3), *[np.zeros((2, 1))] * 4),
         ValueError),
        ("inverse_dynamics", (np.ones((1, 27)), np.zeros(3), *[np.zeros((2, 1))] * 4), ValueError),
        ("inverse_dynamics", (np.zeros((65, 27)), np.zeros(3), *[np.zeros((2, 65))] * 4),
         ValueError),
        ("inverse_dynamics", (np.zeros((1, 27)), np.zeros(3), *[np.zeros((2, 2))] * 4), ValueError),
    ],
)  # fmt: skip
def test_arrays_that_do_not_fit_are_refused(name, arguments, error):
    with pytest.raises(error):
        getattr(kernels.compiled, name)(*arguments)


def test_an_array_that_may_not_be_written_to_is_refused():
    locked = np.zeros(1, int)
    locked.flags.writeable = False
    with pytest.raises((ValueError, BufferError)):
        kernels.compiled.add_exactly(np.zeros((2, 1)), locked, np.zeros(1, int))


def test_samples_that_a_window_has_at_least_may_be_more_than_there_are():
    stamp, values = np.arange(5) * 10**6, np.asfortranarray(np.arange(5.0)[:, None])
    out = np.zeros((5, 1), order="F")
    assert kernels.compiled.slopes(stamp, values, out, 0, 0, 0, END, END, 1e-3)
    assert out == pytest.approx(1000.0)


# The whole


def test_a_replay_without_them_counts_the_same():
    code = (
        "import json, robot_energy as re;"
        "found = re.replay('bags/kr16_cold', model='kr16').to_dict();"
        "print(json.dumps([found[key] for key in ('energy', 'joints', 'comparison')]))"
    )
    found = [
        subprocess.run(
            [sys.executable, "-c", code],
            cwd=ROOT, env=os.environ | {kernels.SWITCH: state}, capture_output=True, text=True,
            check=True,
        ).stdout
        for state in ("on", "off")
    ]  # fmt: skip
    with_them, without_them = (flat(json.loads(one)) for one in found)
    assert len(with_them) > 50
    assert with_them == pytest.approx(without_them, rel=1e-9, abs=2e-6)


def flat(value):
    """All numbers of nested lists and dictionaries."""
    if isinstance(value, dict | list):
        return [n for v in (value.values() if isinstance(value, dict) else value) for n in flat(v)]
    return [value] if isinstance(value, float) else []
