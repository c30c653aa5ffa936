"""Clocks that are set, counters that are full, texts without end, files that grew too far."""

import json

import numpy as np
import pytest

from accounts import IDENTITY, SECOND, counter, power_block, restarted, steady
from refusals import refused
from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.exact_sum import ExactSum
from robot_energy.accounting.plain_text import MAX_NAME, MAX_REASON
from robot_energy.accounting.record import KEPT, AccountRecord
from robot_energy.accounting.registers import CLOCK_STEP_NS
from robot_energy.foundation.errors import RegisterError, StateFileError
from robot_energy.foundation.units import MAX_COUNTER
from robot_energy.messages.registers import RegistersWriter, interval_fields
from robot_energy.store.account_store import AccountStore
from robot_energy.store.slots import MAX_BYTES, MAX_SEQUENCE, SlotPair, wrap
from robot_energy.timeline.stamps import MAX_STAMP_NS

NOW = 1_790_000_000  # s


def shifted(start: float, stop: float, by_s: int, segment: int = 0):
    block = steady(start, stop)
    return power_block(block.stamp_ns + by_s * SECOND, block.grid_power, segment)


@pytest.mark.long
def test_a_thousand_boots_in_1970_leave_the_gap_time_alone():
    """Each boot counts a second in 1970 and one after the clock was set; 60 s lie between."""
    account = EnergyAccount(2)
    for boot in range(1000):
        account = restarted(account) if boot else account
        account.step(shifted(30, 31, 0))
        account.step(shifted(0, 1, NOW + 60 * boot, segment=1))
        time = account.registers.time
        assert time.gap_ns == 0
        assert time.jumps == 2 * boot + 1
        assert time.span_ns == time.observed_ns == (2 * boot + 2) * SECOND
    assert account.registers.cabinet("grid_import") == pytest.approx(200_000.0)
    assert account.state(IDENTITY).to_json()


@pytest.mark.parametrize(("step_ns", "gap"), [(CLOCK_STEP_NS, True), (CLOCK_STEP_NS + 1, False)])
@pytest.mark.parametrize("way", ["running", "restart", "late file"])
def test_the_longest_gap_is_the_same_rule_everywhere(step_ns, gap, way):
    first, second = steady(0, 1), steady(0, 1)
    stamp = second.stamp_ns + SECOND + step_ns
    second = power_block(stamp, second.grid_power, segment=1)
    account = EnergyAccount(2)
    account.step(first)
    if way == "late file":
        before, account = account, EnergyAccount(2)
        account.step(second)
        account.precede(before.state(IDENTITY))
    else:
        account = restarted(account) if way == "restart" else account
        account.step(second)
    time = account.registers.time
    assert (time.gap_ns, time.jumps) == ((step_ns, 0) if gap else (0, 1))
    assert time.span_ns == time.observed_ns + time.gap_ns == 2 * SECOND + (step_ns if gap else 0)


def test_many_longest_gaps_in_one_block_add_up_exactly():
    stamp = np.tile([0, CLOCK_STEP_NS], 3000)
    block = power_block(stamp, np.full(6000, 100.0), np.arange(6000))
    whole, cut = EnergyAccount(2), EnergyAccount(2)
    whole.step(block)
    for start in range(0, 6000, 700):
        cut.step(block[slice(start, start + 700)])
    assert whole.registers.time == cut.registers.time
    assert whole.registers.time.gap_ns == min(3000 * CLOCK_STEP_NS, MAX_COUNTER)


@pytest.mark.parametrize("cut", [1, 7, 1024, 3000])
def test_full_sums_stay_full_whatever_the_cutting(cut):
    energy = np.array([[1.5e6, -1.5e6, 3.25]] * 2500)
    sums = ExactSum(3)
    begin = np.array([MAX_COUNTER - 10**15, 10**15 - MAX_COUNTER, 0])
    sums.add_sums(begin, np.zeros(3, dtype=np.int64))
    for start in range(0, len(energy), cut):
        sums.add(energy[start : start + cut])
    assert sums.microjoule.tolist() == [MAX_COUNTER, -MAX_COUNTER, 8_125_000_000]


def full_record() -> dict:
    """A record with every counter at its limit, and intervals and resets of all kinds."""
    account = EnergyAccount(2)
    account.measure(counter(0, 3))
    account.step(steady(0, 1))
    account.open_interval("job")
    account.reset("why not")
    account.step(steady(1.01, 2))
    account.open_interval("cycle")
    account.close_interval("cycle")
    data = json.loads(account.state(IDENTITY).to_json())

    def fill(place):
        for key, value in place.items() if isinstance(place, dict) else enumerate(place):
            if isinstance(value, dict | list):
                fill(value)
            elif isinstance(value, int) and not isinstance(value, bool):
                stamp = str(key) in ("start_ns", "end_ns", "stamp_ns", "energy_start_ns")
                place[key] = MAX_STAMP_NS if stamp else MAX_COUNTER

    for key in ("totals", "phase_energy_microjoule", "phase_observed_ns", "open_intervals"):
        fill(data[key])
    for key in ("samples", "restarts", "next_interval_id"):
        data[key] = MAX_COUNTER
    return data


def test_counters_at_their_limits_count_on_and_never_raise():
    account = EnergyAccount(2)
    account.restore(AccountRecord.from_json(json.dumps(full_record()).encode()))
    writer = RegistersWriter(IDENTITY.joint_names, "m1")
    for second in range(3):
        account.step(steady(10 * second, 10 * second + 1))
        account.measure(counter(10 * second, 10 * second + 1))
        assert writer.encode(account) is not None
        for interval in account.list_intervals():
            interval_fields(interval, IDENTITY.joint_names, account.calibration)
        with refused(RegisterError, found="numbers", expected=str(MAX_COUNTER)):
            account.open_interval(f"job {second}")
        if second:
            account.reset("full")
        account = restarted(account)


@pytest.mark.parametrize(
    ("text", "fits"),
    [
        ("x" * MAX_REASON, True),
        ("\U0001f916" * MAX_REASON, True),
        ('"' * MAX_REASON, True),
        ("x" * (MAX_REASON + 1), False),
        ("x" * 5_000_000, False),
        ("a\n[ERROR] forged", False),
        ("a\x1b[2J", False),
        ("a\x00b", False),
        ("\ud800", False),
        ("a\u2028b", False),
    ],
    ids=lambda value: repr(value)[:20],
)
def test_reasons_are_bounded(text, fits):
    account = EnergyAccount(2)
    account.step(steady(0, 1))
    if fits:
        account.reset(text)
        assert restarted(account).trace.entries[-1].text == text
    else:
        with pytest.raises(RegisterError) as caught:
            account.reset(text)
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < 1000
        with pytest.raises(RegisterError):
            account.open_interval(text)
        assert account.registers.cabinet("grid_import") == 100.0


def test_an_unknown_name_of_any_kind_is_answered_in_one_short_line():
    account = EnergyAccount(2)
    account.step(steady(0, 1))
    with pytest.raises(RegisterError) as caught:
        account.close_interval("x\n" * 1_000_000)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 1000


def keeper(folder) -> AccountStore:
    slots = SlotPair(folder, "arm", 2, AccountRecord.from_json)
    return AccountStore(EnergyAccount(2), IDENTITY, slots)


def test_the_longest_texts_in_the_largest_number_are_kept(tmp_path):
    books = keeper(tmp_path)
    books.open()
    books.account.step(steady(0, 1))
    widest = "\U0001f916"
    for number in range(40):
        books.account.step(steady(1.01 + number, 2 + number))
        books.account.reset(f"{number:03}" + widest * (MAX_REASON - 3))
        name = f"{number:03}" + widest * (MAX_NAME - 3)
        books.account.open_interval(name)
        if number >= 15:
            books.account.close_interval(name)
    size = len(books.account.state(IDENTITY).to_json())
    assert size < MAX_BYTES / 50
    assert books.close()
    again = keeper(tmp_path)
    again.open()
    assert len(again.account.list_intervals()) == 15 + 16
    assert len([one for one in again.account.trace.entries if one.kind == "reset"]) == KEPT
    assert not again.notices


def test_a_state_that_could_not_be_read_back_is_not_written(tmp_path):
    slots = SlotPair(tmp_path, "arm", 2, bytes)
    slots.acquire()
    slots.write(b"good")
    for _ in range(2):
        with refused(StateFileError, found=str(MAX_BYTES + 1), expected=str(MAX_BYTES)):
            slots.write(b"x" * (MAX_BYTES + 1))
    slots.release()
    assert SlotPair(tmp_path, "arm", 2, bytes).acquire().value == b"good"


def test_sequence_numbers_begin_again_and_the_newest_state_is_used(tmp_path):
    (tmp_path / "arm.a.state").write_bytes(wrap(2, MAX_SEQUENCE - 1, b"old"))
    (tmp_path / "arm.b.state").write_bytes(wrap(2, MAX_SEQUENCE, b"new"))
    for number in range(4):
        slots = SlotPair(tmp_path, "arm", 2, bytes)
        stored = slots.acquire()
        assert stored.value == (b"new" if number == 0 else b"state %d" % (number - 1))
        assert not stored.notices
        slots.write(b"state %d" % number)
        slots.release()
