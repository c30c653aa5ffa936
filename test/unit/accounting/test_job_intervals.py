"""Energy of jobs and cycles."""

import pytest

from accounts import SECOND, restarted, steady
from refusals import refused
from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.job_intervals import MAX_CLOSED, MAX_OPEN
from robot_energy.foundation.errors import RegisterError
from robot_energy.messages.registers import interval_fields


@pytest.fixture
def account() -> EnergyAccount:
    books = EnergyAccount(2)
    books.step(steady(0, 1))
    return books


def counted(interval) -> int:
    return interval.counted.cabinet_energy_microjoule["grid_import"]


def test_an_interval_counts_from_sample_to_sample(account: EnergyAccount) -> None:
    opened = account.open_interval("cycle 1")
    assert (opened.start_ns, opened.end_ns, counted(opened)) == (SECOND, SECOND, 0)
    account.step(steady(1.01, 3, watt=200.0))
    closed = account.close_interval("cycle 1")
    assert not closed.is_open
    assert (closed.start_ns, closed.end_ns) == (SECOND, 3 * SECOND)
    # the first trapezoid of 10 ms goes from 100 W to 200 W
    assert counted(closed) == pytest.approx((0.01 * 150 + 1.99 * 200) * 1e6, abs=1)
    fields = interval_fields(closed, ["shoulder", "elbow"], account.calibration)
    assert fields["predicted_mean_power"] == pytest.approx(399.5 / 2.0)
    assert fields["predicted_peak_power"] == 200.0
    assert fields["coverage"] == 1.0
    assert fields["measured_energy"] != fields["measured_energy"]  # no meter: NaN
    assert fields["joints"][0]["shaft_energy_positive"] == pytest.approx(399.5 * 0.1599)


def test_several_are_open_and_closed_by_name_or_number(account: EnergyAccount) -> None:
    job = account.open_interval("job")
    account.step(steady(1.01, 2))
    account.open_interval("cycle")
    account.step(steady(2.01, 3))
    assert [entry.name for entry in account.list_intervals()] == ["job", "cycle"]
    cycle = account.close_interval("cycle")
    account.step(steady(3.01, 4))
    whole = account.close_interval("", job.interval_id)
    assert (counted(cycle), counted(whole)) == (100_000_000, 300_000_000)
    assert account.list_intervals() == [cycle, whole]


def test_a_reset_takes_nothing_from_an_open_interval(account: EnergyAccount) -> None:
    account.open_interval("job")
    account.step(steady(1.01, 2))
    account.reset("why not")
    account.step(steady(2.01, 3))
    assert counted(account.close_interval("job")) == 200_000_000
    assert account.registers.cabinet("grid_import") == pytest.approx(100.0)


def test_an_open_interval_survives_restarts_with_the_gap_inside(account: EnergyAccount) -> None:
    account.open_interval("job")
    account.step(steady(1.01, 2, watt=500.0))
    account = restarted(restarted(account))
    account.step(steady(5, 6))
    closed = account.close_interval("job")
    assert (closed.counted.gap_ns, closed.counted.gap_count) == (3 * SECOND, 1)
    assert closed.counted.observed_ns == 2 * SECOND
    assert closed.peak_power_watt == 500.0
    assert counted(closed) == pytest.approx((0.01 * 300 + 0.99 * 500 + 100) * 1e6, abs=1)
    assert account.open_interval("next").interval_id == closed.interval_id + 1


def test_refusals(account: EnergyAccount) -> None:
    for name in ("", "  ", "x" * 101):
        with refused(RegisterError, expected="1 to 100"):
            account.open_interval(name)
    with refused(RegisterError, found="sample", expected="joint state"):
        EnergyAccount(2).open_interval("job")
    with refused(RegisterError, found="'a'", expected="none"):
        account.close_interval("a")
    account.open_interval("a")
    with refused(RegisterError, found="'a'", remedy="close"):
        account.open_interval("a")
    with refused(RegisterError, found="7", expected="'a'"):
        account.close_interval("a", 7)
    for number in range(MAX_OPEN - 1):
        account.open_interval(f"more {number}")
    with refused(RegisterError, found=str(MAX_OPEN), remedy="close"):
        account.open_interval("one too many")
    with refused(RegisterError, found="reason"):
        account.reset(" ")
    with refused(RegisterError, found="sample"):
        EnergyAccount(2).reset("fresh")


def test_only_the_latest_closed_ones_are_kept(account: EnergyAccount) -> None:
    for number in range(MAX_CLOSED + 3):
        account.open_interval(str(number))
        account.close_interval(str(number))
    names = [entry.name for entry in account.list_intervals()]
    assert names == [str(number) for number in range(3, MAX_CLOSED + 3)]
    assert len(restarted(account).list_intervals()) == MAX_CLOSED
