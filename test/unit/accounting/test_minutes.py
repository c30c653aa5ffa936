"""Registers at every minute of UTC, and standby: both the same however the input is cut."""

from dataclasses import replace

import numpy as np
import pytest

import accounts
from robot_energy.accounting.account import EnergyAccount
from robot_energy.timeline.blocks import Phase

MINUTE = 60 * accounts.SECOND


def readings(block, size):
    """What is read at minutes when the account takes blocks of a size: minute, end, totals."""
    account, found = EnergyAccount(2), []
    account.on_reading = lambda minute: found.append((minute, account.end_ns, account.totals()))
    for start in range(0, len(block), size):
        account.step(block[slice(start, start + size)])
    return account, found


@pytest.mark.parametrize("size", [1, 7, 100_000])
def test_a_minute_holds_all_samples_up_to_it_and_none_after(size):
    block = accounts.steady(59.005, 181.0, rate=10)
    account, found = readings(block, size)
    assert [minute for minute, _, _ in found] == [MINUTE, 2 * MINUTE, 3 * MINUTE]
    stamps = block.stamp_ns
    assert [end for _, end, _ in found] == [stamps[stamps <= each].max() for each, _, _ in found]
    first, second, _ = (totals for _, _, totals in found)
    assert (second - first).cabinet_energy_microjoule["grid_import"] == 6_000_000_000
    plain = EnergyAccount(2)
    plain.step(block)
    assert account.totals() == plain.totals()


def test_a_minute_at_a_sample_holds_that_sample():
    _, found = readings(accounts.steady(59.0, 61.0, rate=10), 3)
    assert [(minute, end) for minute, end, _ in found] == [(MINUTE, MINUTE)]


def test_a_gap_ends_in_the_last_minute_before_the_next_sample():
    block = accounts.steady(59.0, 59.5)
    later = accounts.steady(321.0, 321.5)
    account, found = EnergyAccount(2), []
    account.on_reading = lambda minute: found.append((minute, account.end_ns))
    account.step(block)
    account.step(replace(later, segment=later.segment + 1))
    assert found == [(5 * MINUTE, 59.5 * accounts.SECOND)]


def test_stamps_that_jump_back_are_read_before_the_jump():
    account, found = EnergyAccount(2), []
    account.on_reading = lambda minute: found.append((minute, account.end_ns))
    account.step(accounts.steady(200.0, 201.0))
    account.step(accounts.steady(100.0, 101.0))
    assert found == [(0, 201 * accounts.SECOND)]


def test_registers_are_read_before_they_are_set_to_zero():
    account, found = EnergyAccount(2), []
    account.step(accounts.steady(10.0, 11.0))
    account.on_reading = lambda minute: found.append((minute, account.totals()))
    whole = account.totals()
    account.reset("test")
    assert found == [(0, whole)]


def resting(start_s, end_s, rests):
    block = accounts.steady(start_s, end_s, rate=10)
    hold = np.zeros(len(block), dtype=bool)
    for begin, end in rests:
        hold |= (block.stamp_ns >= begin * accounts.SECOND) & (
            block.stamp_ns < end * accounts.SECOND
        )
    return replace(block, phase=np.where(hold, Phase.HOLD, Phase.MOTION).astype(np.uint8))


@pytest.mark.parametrize("size", [1, 13, 100_000])
def test_a_rest_is_standby_from_its_beginning_once_it_has_lasted_a_minute(size):
    block = resting(10.0, 300.0, [(20, 79), (100, 170), (200, 300.1)])
    account = EnergyAccount(2)
    for start in range(0, len(block), size):
        account.step(block[slice(start, start + size)])
    standby = account.counts.standby
    assert standby.ns == 170 * accounts.SECOND  # 70 and 100 s; the rest of 59 s is none
    assert standby.energy.microjoule.tolist() == [17_000_000_000]
    account.reset("test")
    account.step(accounts.steady(300.1, 301.0))
    assert account.counts.standby.ns == accounts.SECOND // 10  # up to the first that moves


def test_standby_is_kept_across_a_restart_and_a_gap_ends_a_rest():
    account = EnergyAccount(2)
    account.step(resting(0.0, 70.0, [(0, 71)]))
    after = EnergyAccount(2)
    after.restore(account.state(accounts.IDENTITY))
    after.step(resting(80.0, 120.0, [(80, 121)]))
    assert after.counts.standby.ns == 70 * accounts.SECOND
    assert after.state(accounts.IDENTITY).standby_energy_microjoule == 7_000_000_000


def test_a_fault_takes_standby_back():
    account = EnergyAccount(2)
    account.step(resting(0.0, 70.0, [(0, 71)]))
    before = account.counts.standby.ns
    block = resting(70.1, 71.0, [(70, 72)])
    account._averager.step = lambda *_: account.counts.standby.ns and 1 / 0  # counts it
    with pytest.raises(ZeroDivisionError):
        account.step(block)
    assert account.counts.standby.ns == before
