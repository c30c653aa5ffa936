"""One recorded cold run, many faults. Each docstring says what must come out.

The reference is the bundled bag itself: a fault may cost what it hides, but nothing else,
and everything it hides is accounted for.
"""

from collections.abc import Callable
from copy import deepcopy
from itertools import groupby
from typing import Any

import numpy as np
import pytest

from places import ROOT
from robot_energy.bag import BagReader, BagWriter
from robot_energy.bag.cdr.types import extended, typestore
from robot_energy.model import load
from robot_energy.replay.bag_replay import Replay, replay
from robot_energy.timeline.blocks import Quality

BAG = ROOT / "bags" / "kr16_cold"
JOINTS, TEMPERATURES, METER = "/joint_states", "/motor_temperatures", "/power_meter"
SECOND = 10**9
MODEL = load("kr16")
START_NS = BagReader(BAG).start_ns

Message = tuple[int, str, Any]  # log time, topic, decoded message
Fault = Callable[[list[Message]], list[Message]]


def recorded() -> tuple[list[Message], dict[str, str]]:
    """Every message of the bag in order of log time, decoded, and the type of each topic."""
    reader, store = BagReader(BAG), typestore()
    types = {topic: info.msgtype for topic, info in reader.topics.items()}
    messages = [
        (int(batch.log_time_ns[row]), topic, store.deserialize_cdr(batch.row(row), types[topic]))
        for part in reader.parts(list(types))
        for topic, batch in part.items()
        for row in range(len(batch))
    ]
    return sorted(messages, key=lambda message: message[0]), types


@pytest.fixture(scope="module")
def reference() -> Replay:
    return replay(BAG, MODEL)


@pytest.fixture
def faulty(tmp_path) -> Callable[[Fault], Replay]:
    """Replays the bag with a fault put into its messages."""

    def run(fault: Fault) -> Replay:
        messages, types = recorded()
        store = typestore()
        with BagWriter(tmp_path / "faulty") as bag:
            for topic, msgtype in types.items():
                bag.add_topic(topic, msgtype)
            for topic, run in groupby(fault(messages), key=lambda message: message[1]):
                times, rows = zip(*((time, message) for time, _, message in run), strict=True)
                data = [bytes(store.serialize_cdr(row, types[topic])) for row in rows]
                bag.write(topic, np.array(times), data)
        result = replay(tmp_path / "faulty", MODEL)
        check_accounts(result)
        return result

    return run


def check_accounts(result: Replay) -> None:
    """received = accepted + rejected, span = observed + gap, and the balance of the watts."""
    for ingest in (result.joint_states, result.temperatures, result.meter):
        assert ingest.rejections.balanced
    books = result.account.registers
    assert books.time.span_ns == books.time.observed_ns + books.time.gap_ns
    drawn = books.cabinet("grid_import") - books.cabinet("grid_return")
    parts = sum(float(books.joints(name).sum()) for name in ("rigid", "friction", "drive_loss"))
    parts += sum(books.cabinet(name) for name in ("loss_dc", "loss_grid", "brake", "capacitor"))
    assert drawn == pytest.approx(parts, abs=1e-3)


def energy(result: Replay) -> float:
    return result.account.registers.cabinet("grid_import")


def shift(message: Any, by_ns: int) -> None:
    stamp = message.header.stamp
    instant = stamp.sec * SECOND + stamp.nanosec + by_ns
    stamp.sec, stamp.nanosec = divmod(instant, SECOND)


def test_shuffled_joints_change_nothing(faulty, reference):
    """Joints are matched by name in every message: the registers are equal to the last bit."""
    rng = np.random.default_rng(0)

    def shuffle(messages):
        for _, topic, message in messages:
            if topic == JOINTS:
                order = rng.permutation(6)
                message.name = [message.name[index] for index in order]
                for field in ("position", "velocity", "effort"):
                    setattr(message, field, getattr(message, field)[order])
        return messages

    found = faulty(shuffle).account.registers.microjoule
    np.testing.assert_array_equal(found, reference.account.registers.microjoule)


def test_every_message_twice_counts_once(faulty, reference):
    """Duplicates are dropped and counted; the registers are equal to the last bit."""
    result = faulty(lambda messages: [message for message in messages for _ in range(2)])
    np.testing.assert_array_equal(
        result.account.registers.microjoule, reference.account.registers.microjoule
    )
    assert result.joint_states.rejections.rejected == {"duplicate_stamp": 9000}
    assert result.account.comparison.measured_energy == pytest.approx(
        reference.account.comparison.measured_energy, abs=1e-6
    )


def test_lost_joint_states_are_a_gap_on_both_sides(faulty, reference):
    """Three seconds without joint states: a gap, and the meter is not compared there either."""
    start = START_NS + 10 * SECOND

    def lose(messages):
        return [m for m in messages if m[1] != JOINTS or not start < m[0] < start + 3 * SECOND]

    result = faulty(lose)
    time = result.account.registers.time
    assert time.gap_count == 1
    assert time.gap_ns == pytest.approx(3 * SECOND, abs=SECOND // 100)
    lost = reference.account.comparison.compared_ns - result.account.comparison.compared_ns
    assert lost == pytest.approx(3 * SECOND, abs=SECOND // 50)
    assert energy(result) < energy(reference)


def test_no_temperature_at_all_falls_back_and_says_so(faulty, reference):
    """Friction of the reference temperature (22 degC) for a robot of 20: flagged, close, not 0."""
    result = faulty(lambda messages: [m for m in messages if m[1] != TEMPERATURES])
    assert result.account.counts.quality[Quality.TEMPERATURE_MISSING] == 9000
    assert energy(result) == pytest.approx(energy(reference), rel=0.05)


def test_error_codes_for_temperatures_change_nothing_and_are_flagged(faulty, reference):
    """After 10 s the sensors report 999 degC: the last good reading stays in use."""
    start = START_NS + 10 * SECOND

    def fail(messages):
        for time, topic, message in messages:
            if topic == TEMPERATURES and time > start:
                message.temperature_degc = np.full(6, 999.0)
        return messages

    result = faulty(fail)
    assert result.account.counts.quality[Quality.TEMPERATURE_IMPLAUSIBLE] > 6000
    assert result.pipeline.friction.rejections.rejected["temperature_implausible"] == 26 * 6
    assert energy(result) == pytest.approx(energy(reference), rel=0.02)


def test_a_forward_jump_of_the_clock_is_a_gap_without_energy(faulty, reference):
    """All stamps one hour later from the middle on: an hour of gap, the energy of one period."""
    middle = START_NS + 18 * SECOND

    def jump(messages):
        for time, _, message in messages:
            if time > middle:
                shift(message, 3600 * SECOND)
        return messages

    result = faulty(jump)
    time = result.account.registers.time
    assert time.gap_count == 1
    assert time.gap_ns == pytest.approx(3600 * SECOND, abs=SECOND // 10)
    assert energy(result) == pytest.approx(energy(reference), rel=1e-3)


def test_a_looped_recording_is_two_epochs(faulty, reference):
    """The run twice with the same stamps: twice the energy, nothing across the seam."""

    def loop(messages):
        length = messages[-1][0] - messages[0][0] + SECOND // 250
        return [*messages, *((time + length, topic, m) for time, topic, m in messages)]

    result = faulty(loop)
    assert result.account.registers.time.jumps == 1
    assert energy(result) == pytest.approx(2 * energy(reference), rel=1e-4)
    assert result.account.comparison.measured_energy == pytest.approx(
        2 * reference.account.comparison.measured_energy, rel=1e-3
    )


def test_spikes_that_are_not_numbers_are_left_out(faulty, reference):
    """Every hundredth position NaN: rejected by reason, bridged, a negligible difference."""

    def spike(messages):
        joints = [message for _, topic, message in messages if topic == JOINTS]
        for message in joints[50::100]:
            message.position = np.where(np.arange(6) == 2, np.nan, message.position)
        return messages

    result = faulty(spike)
    assert result.joint_states.rejections.rejected == {"not_finite": 90}
    assert energy(result) == pytest.approx(energy(reference), rel=2e-3)
    assert result.account.registers.time.gap_ns == 0


def test_without_velocities_they_are_derived_and_flagged(faulty, reference):
    """Positions alone carry the motion; encoder noise makes the result worse, not wrong."""

    def forget(messages):
        for _, topic, message in messages:
            if topic == JOINTS:
                message.velocity = np.empty(0)
        return messages

    result = faulty(forget)
    assert result.account.counts.quality[Quality.VELOCITY_DERIVED] == 9000
    assert energy(result) == pytest.approx(energy(reference), rel=0.02)


def test_a_silent_meter_is_not_compared(faulty, reference):
    """Ten seconds without readings: the prediction goes on, the comparison leaves them out."""
    start = START_NS + 10 * SECOND

    def silence(messages):
        return [m for m in messages if m[1] != METER or not start < m[0] < start + 10 * SECOND]

    result = faulty(silence)
    np.testing.assert_array_equal(
        result.account.registers.microjoule, reference.account.registers.microjoule
    )
    comparison, whole = result.account.comparison, reference.account.comparison
    assert whole.compared_ns - comparison.compared_ns == pytest.approx(10 * SECOND, rel=0.03)
    error = comparison.predicted_energy / comparison.measured_energy - 1
    assert abs(error) < 0.05


def test_late_delivery_of_temperatures_within_the_wait_changes_nothing(faulty, reference):
    """Temperatures logged 50 ms late count from their own stamp all the same."""

    def delay(messages):
        late = [
            (time + (50_000_000 if topic == TEMPERATURES else 0), topic, message)
            for time, topic, message in messages
        ]
        return sorted(late, key=lambda message: message[0])

    np.testing.assert_array_equal(
        faulty(delay).account.registers.microjoule, reference.account.registers.microjoule
    )


def test_a_bag_of_another_release_is_read_by_its_own_definitions(tmp_path, reference):
    """PowerReading once had another field in front of the power: the energies are the same."""
    messages, types = recorded()
    reading = "ros2_energy_msgs/msg/PowerReading"
    text = (BAG.parents[1] / "ros2_energy_msgs/msg/PowerReading.msg").read_text()
    old = typestore_of(
        reading, text.replace("float64 power\n", "float64 reactive\nfloat64 power\n")
    )
    made = old.types[reading]
    with BagWriter(tmp_path / "old", typestore=old) as bag:
        for topic, msgtype in types.items():
            bag.add_topic(topic, msgtype)
        for time, topic, message in messages:
            if topic == METER:
                fields = {
                    name: getattr(message, name)
                    for name in ("header", "meaning", "location", "power", "energy", "interval")
                }
                message = made(**fields, reactive=-1.0)
            row = bytes(old.serialize_cdr(message, types[topic]))
            bag.write(topic, np.array([time]), [row])
    result = replay(tmp_path / "old", MODEL)
    assert result.account.comparison.measured_energy == reference.account.comparison.measured_energy


def typestore_of(msgtype, text):
    """The known definitions with one message defined otherwise."""
    return extended(typestore(), {msgtype: ("ros2msg", text)})


def test_one_impossible_velocity_among_nine_thousand_changes_next_to_nothing(faulty, reference):
    """1,000 rad/s in one joint state: refused by name, and no thermometer is called stuck."""

    def spoil(messages):
        states = [message for _, topic, message in messages if topic == JOINTS]
        states[4500].velocity = np.array([0.0, 1000.0, 0.0, 0.0, 0.0, 0.0])
        return messages

    result = faulty(spoil)
    assert result.joint_states.rejections.rejected == {"impossible_velocity": 1}
    assert energy(result) == pytest.approx(energy(reference), rel=1e-3)
    assert result.account.counts.quality[Quality.TEMPERATURE_STUCK] == 0
    assert result.account.registers.time.gap_count == 0


def test_stamps_that_no_message_can_carry_again_change_nothing(faulty, reference):
    """The time that DDS calls infinite, before the first and after the last of every topic."""

    def spoil(messages):
        times = {"first": messages[0][0], "last": messages[-1][0]}
        extra = []
        for time in times.values():
            for topic in (JOINTS, TEMPERATURES, METER):
                message = deepcopy(next(one for _, name, one in messages if name == topic))
                message.header.stamp.sec, message.header.stamp.nanosec = 2**31 - 1, 2**32 - 1
                extra.append((time, topic, message))
        return [*extra[:3], *messages, *extra[3:]]

    result = faulty(spoil)
    for ingest in (result.joint_states, result.temperatures, result.meter):
        assert ingest.rejections.rejected == {"bad_stamp": 2}
    found = result.account.registers.microjoule
    np.testing.assert_array_equal(found, reference.account.registers.microjoule)
    assert result.account.registers.time == reference.account.registers.time
    assert result.account.comparison.measured_energy == reference.account.comparison.measured_energy
