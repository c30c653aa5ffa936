"""Books across a restart: totals go on, the time between is a gap, nothing counts twice."""

import json

import pytest

from accounts import IDENTITY, SECOND, counter, power_block, restarted, steady
from refusals import refused
from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.exact_sum import PER_JOULE
from robot_energy.accounting.record import FORMAT_VERSION, AccountRecord
from robot_energy.foundation.errors import StateFileError


def imported(account: EnergyAccount) -> float:
    return float(account.registers.cabinet("grid_import"))


def test_totals_go_on_and_the_downtime_is_one_gap_exact_in_ns() -> None:
    """10 s and 5 s at 100 W with 3.000000007 s in between: 1500 J, and not one of the gap."""
    account = EnergyAccount(2)
    account.step(steady(10, 20))
    account = restarted(account)
    assert imported(account) == 1000.0
    second = steady(23, 28)
    account.step(power_block(second.stamp_ns + 7, second.grid_power))
    assert imported(account) == pytest.approx(1500.0, abs=1e-6)
    time = account.registers.time
    assert (time.gap_ns, time.gap_count, time.jumps) == (3 * SECOND + 7, 1, 0)
    assert time.observed_ns == 15 * SECOND
    assert time.span_ns == time.observed_ns + time.gap_ns == time.end_ns - time.start_ns
    assert time.start_ns == 10 * SECOND
    assert account.counts.samples == 1001 + 501
    assert account.restarts == 1


def test_stamps_that_went_back_over_a_restart_are_a_jump() -> None:
    account = EnergyAccount(2)
    account.step(steady(100, 110))
    account = restarted(account)
    account.step(steady(0, 10))
    time = account.registers.time
    assert (time.gap_ns, time.gap_count, time.jumps) == (0, 0, 1)
    assert imported(account) == 2000.0
    account.step(steady(10.01, 20))
    assert imported(account) == pytest.approx(3000.0)


def test_samples_that_are_sent_again_after_a_restart_do_not_count_twice() -> None:
    """A latched or buffered input repeats its last half second."""
    account = EnergyAccount(2)
    account.step(steady(0, 10))
    account = restarted(account)
    again = steady(9.5, 12)
    account.step(again[slice(0, 20)])  # in two blocks, the first wholly repeated
    account.step(again[slice(20, None)])
    assert account.repeated == 51
    assert imported(account) == pytest.approx(1199.0)  # without the interval after the restart
    assert account.registers.time.gap_ns == SECOND // 100
    assert account.registers.time.jumps == 0


def test_a_lifetime_counter_is_not_counted_across_the_downtime() -> None:
    """The meter counts on while the monitor is away; what it counted lies in the gap."""
    account = EnergyAccount(2)
    account.measure(counter(0, 10))
    account.step(steady(0, 10))
    assert account.comparison.measured_energy == pytest.approx(900.0, abs=1e-5)
    account = restarted(account)
    account.measure(counter(11.5, 20))  # within the longest gap that readings may have
    account.step(steady(11.5, 20))
    books = account.comparison
    assert books.compared_ns == round(18.5 * SECOND)
    assert books.measured_energy == pytest.approx(90.0 * 18.5, abs=1e-5)
    assert books.predicted_energy == pytest.approx(100.0 * 18.5, abs=1e-5)


def test_a_pause_counts_like_a_restart() -> None:
    account = EnergyAccount(2)
    account.measure(counter(0, 10))
    account.step(steady(0, 10))
    account.interrupt()
    account.measure(counter(10.1, 20))
    account.step(steady(10.05, 20))  # the same segment, and hardly any time has passed
    assert imported(account) == pytest.approx(1995.0)
    assert account.registers.time.gap_ns == round(0.05 * SECOND)
    assert account.comparison.compared_ns == round(19.95 * SECOND)


def test_a_pause_within_a_gap_is_a_gap_of_its_own() -> None:
    account = EnergyAccount(2)
    block = steady(0, 1)
    block.grid_power[-10:] = float("nan")
    account.step(block)
    account.interrupt()
    account.step(steady(2, 3))
    assert account.registers.time.gap_count == 2
    assert account.registers.time.gap_ns == round(1.1 * SECOND)


def test_everything_the_books_show_survives() -> None:
    account = EnergyAccount(2)
    account.measure(counter(0, 10))
    account.step(steady(0, 10, watt=33.5))
    account.open_interval("job")
    account.reset("new shift")
    account.step(steady(10.01, 15, watt=210.0))
    after = restarted(account)
    assert after.totals() == account.totals()
    assert after.counts.peak_power == 210.0
    assert after.counts.quality == account.counts.quality
    assert (after.counts.phase_ns == account.counts.phase_ns).all()
    assert after.list_intervals() == account.list_intervals()
    assert after.trace.entries == account.trace.entries
    first, second = (books.state(IDENTITY) for books in (account, after))
    assert second == first.model_copy(update={"restarts": 1})


def test_what_was_counted_before_the_file_could_be_read_is_added() -> None:
    """A disk that is mounted late: the file ends at 10 s, the monitor counts from 12 s."""
    before = EnergyAccount(2)
    before.step(steady(0, 10))
    job = before.open_interval("job")
    late = EnergyAccount(2)
    late.step(steady(12, 15, watt=300.0))
    late.precede(before.state(IDENTITY))
    assert imported(late) == 1900.0
    assert late.registers.time.start_ns == 0
    assert late.registers.time.gap_ns == 2 * SECOND
    late.step(steady(15.01, 16))
    assert late.registers.time.span_ns == 16 * SECOND
    closed = late.close_interval(interval_id=job.interval_id)
    assert closed.peak_power_watt == 300.0
    assert closed.counted.gap_ns == 2 * SECOND


def test_reset_leaves_a_trace_and_a_new_start() -> None:
    account = EnergyAccount(2)
    account.step(steady(5, 10))
    account.reset("  calibrated  ")
    assert imported(account) == 0.0
    time = account.registers.time
    assert (time.start_ns, time.span_ns) == (10 * SECOND, 0)
    entry = account.trace.entries[-1]
    assert (entry.kind, entry.text, entry.stamp_ns) == ("reset", "calibrated", 10 * SECOND)
    assert entry.energy_start_ns == 5 * SECOND
    assert entry.totals is not None
    assert entry.totals.cabinet_energy_microjoule["grid_import"] == 500 * PER_JOULE
    account.step(steady(10.01, 11))
    assert imported(account) == pytest.approx(100.0)
    assert account.phase_time(2) == pytest.approx(1.0)


def test_many_restarts_do_not_push_out_the_trace_of_a_reset() -> None:
    account = EnergyAccount(2)
    account.step(steady(0, 1))
    account.reset("the only one")
    for number in range(40):
        account.trace.add(
            account.trace.entries[0].model_copy(update={"kind": "restart", "text": str(number)})
        )
    kinds = [entry.kind for entry in account.trace.entries]
    assert kinds == ["reset", *["restart"] * 16]
    assert account.trace.entries[-1].text == "39"


def record_json(**changes: object) -> dict:
    account = EnergyAccount(2)
    account.step(steady(0, 1))
    return json.loads(account.state(IDENTITY).to_json()) | changes


def test_a_record_without_its_unit_is_refused() -> None:
    data = record_json()
    data["totals"]["measured_energy"] = data["totals"].pop("measured_energy_microjoule")
    with refused(StateFileError, found="totals.measured_energy_microjoule"):
        AccountRecord.from_json(json.dumps(data).encode())


@pytest.mark.parametrize(
    "changes",
    [
        {"format_version": 4},
        {"format_version": 6},
        {"samples": 1.0},
        {"samples": -1},
        {"end_ns": None},
        {"peak_power_watt": "100 W"},
        {"colour": "red"},
    ],
    ids=str,
)
def test_a_record_that_is_not_exactly_right_is_refused(changes: dict[str, object]) -> None:
    AccountRecord.from_json(json.dumps(record_json()).encode())
    with refused(StateFileError, expected=f"format {FORMAT_VERSION}"):
        AccountRecord.from_json(json.dumps(record_json(**changes)).encode())


@pytest.mark.parametrize("kind", ["adopted", "repaired"])
def test_events_that_are_not_written_any_more_are_read(kind: str) -> None:
    """Files of this format hold them; refusing one would set the registers to zero."""
    event = {"kind": kind, "stamp_ns": None, "text": "of another node"}
    record = AccountRecord.from_json(json.dumps(record_json(trace=[event])).encode())
    assert record.trace[0].kind == kind


def test_every_energy_and_time_of_a_record_names_its_unit() -> None:
    totals = record_json()["totals"]
    totals |= totals.pop("auxiliary")  # by load, empty here
    assert all(key.endswith(("_microjoule", "_ns", "_count", "jumps")) for key in totals)
