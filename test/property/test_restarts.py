"""Laws of the books, on random power: cuttings, restarts, intervals, resets."""

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel

from accounts import IDENTITY, power_block, restarted
from robot_energy.accounting.account import EnergyAccount
from robot_energy.timeline.blocks import MeterBlock, MeterLocation, MeterMeaning, PowerBlock

SIZE = 300
indices = st.lists(st.integers(1, SIZE - 1), max_size=12, unique=True).map(sorted)
seeds = st.integers(0, 2**31)


def random_power(seed: int) -> PowerBlock:
    """Odd powers of both signs, with a gap, a jump back and a NaN."""
    rng = np.random.default_rng(seed)
    stamp = 10**12 + np.cumsum(rng.integers(1, 9_999_999, SIZE))
    segment = np.zeros(SIZE, dtype=np.int64)
    gap, jump = sorted(rng.choice(np.arange(1, SIZE), 2, replace=False).tolist())
    stamp[gap:] += 3_000_000_007
    segment[gap:] += 1
    stamp[jump:] -= 20_000_000_000
    segment[jump:] += 1
    grid = rng.normal(100, 200, SIZE)
    grid[rng.integers(SIZE)] = np.nan
    return power_block(stamp, grid, segment)


def lifetime_counter(block: PowerBlock, seed: int) -> MeterBlock:
    rng = np.random.default_rng(seed)
    stamp = int(block.stamp_ns[0]) + np.cumsum(rng.integers(10**6, 10**8, 40))
    energy = 5e5 + np.cumsum(rng.uniform(0, 9, 40))
    none = np.full(40, np.nan)
    return MeterBlock(stamp, none, energy, none, MeterMeaning.CUMULATIVE, MeterLocation.GRID)


def apart(block: PowerBlock, cuts: list[int]) -> PowerBlock:
    """The same power with a gap in front of each cut, for a reference in one piece."""
    extra = np.zeros(SIZE, dtype=np.int64)
    extra[cuts] = 1
    return power_block(block.stamp_ns, block.grid_power, block.segment + np.cumsum(extra))


def added_up(values: list):
    """Numbers added; dictionaries and rows entry by entry, models field by field."""
    first = values[0]
    if isinstance(first, BaseModel):
        return type(first)(
            **{
                name: added_up([getattr(value, name) for value in values])
                for name in type(first).model_fields
            }
        )
    if isinstance(first, dict):
        return {key: added_up([value[key] for value in values]) for key in first}
    if isinstance(first, tuple):
        return tuple(map(added_up, map(list, zip(*values, strict=True))))
    return sum(values)


@settings(deadline=None, max_examples=25)
@given(seed=seeds, cuts=indices)
def test_restarts_cost_exactly_the_intervals_they_interrupt(seed, cuts):
    """Restarting at any samples = counting in one piece with gaps at these samples."""
    block = random_power(seed)
    reference = EnergyAccount(2)
    reference.step(apart(block, cuts))
    account = EnergyAccount(2)
    for number, (start, stop) in enumerate(pairwise([0, *cuts, SIZE])):
        account = restarted(account) if number else account
        account.step(block[slice(start, stop)])
    np.testing.assert_array_equal(account.registers.microjoule, reference.registers.microjoule)
    np.testing.assert_array_equal(account.registers.remainder, reference.registers.remainder)
    time, expected = account.registers.time, reference.registers.time
    assert (time.observed_ns, time.gap_ns, time.jumps) == (
        expected.observed_ns,
        expected.gap_ns,
        expected.jumps,
    )
    assert (time.start_ns, time.end_ns) == (expected.start_ns, expected.end_ns)
    assert (account.counts.phase_ns == reference.counts.phase_ns).all()
    np.testing.assert_array_equal(account.shaft.microjoule, reference.shaft.microjoule)
    assert (account.shaft.compared_ns == reference.shaft.compared_ns).all()
    assert account.shaft.compared_ns.any()
    assert account.counts.samples + account.repeated == reference.counts.samples == SIZE
    np.testing.assert_equal(account.counts.peak_power, reference.counts.peak_power)


@settings(deadline=None, max_examples=25)
@given(seed=seeds, bounds=indices, cuts=indices, restart=st.none() | st.integers(1, SIZE - 1))
def test_adjacent_intervals_add_up_to_the_registers_whatever_the_cutting(
    seed, bounds, cuts, restart
):
    """To the microjoule and nanosecond, across cuts, a reset and a restart."""
    block = random_power(seed)
    edges = sorted({0, *bounds, *cuts, *([restart] if restart else []), SIZE})
    account, whole = EnergyAccount(2), None
    before = None
    for start, stop in pairwise(edges):
        if start == restart:
            account = restarted(account)
        if start in bounds:
            if before is not None:
                account.close_interval(before.name)
            else:
                whole = account.open_interval("whole")
            before = account.open_interval(f"from {start}")
        account.measure(lifetime_counter(block, seed)) if start == 0 else None
        account.step(block[slice(start, stop)])
    if before is None:
        return
    account.close_interval(before.name)
    total = account.close_interval(interval_id=whole.interval_id).counted
    parts = [entry.counted for entry in account.list_intervals()[:-1]]
    assert len(parts) == len(bounds)
    for name in type(total).model_fields:
        values = [getattr(part, name) for part in parts]
        assert added_up(values) == getattr(total, name), name


@settings(deadline=None, max_examples=20)
@given(seed=seeds, cuts=indices, other=indices, reset=st.integers(1, SIZE - 1))
def test_state_does_not_depend_on_the_cutting(seed, cuts, other, reset):
    """The whole record, with an interval and a reset at a given sample."""
    block = random_power(seed)

    def run(bounds: list[int]):
        account = EnergyAccount(2)
        account.measure(lifetime_counter(block, seed))
        for start, stop in pairwise(sorted({0, reset, SIZE, *bounds})):
            account.step(block[slice(start, stop)])
            if stop == reset:
                account.reset("for the test")
                account.open_interval("job")
        return account.state(IDENTITY)

    assert run(cuts) == run(other)


@settings(deadline=None, max_examples=20)
@given(seed=seeds, resets=indices)
def test_resets_lose_and_add_nothing(seed, resets):
    """What the trace holds of every reset and what was counted since add up to one piece."""
    block = random_power(seed)
    whole, account = EnergyAccount(2), EnergyAccount(2)
    whole.step(block)
    for start, stop in pairwise([0, *resets, SIZE]):
        if start:
            account.reset("for the test")
        account.step(block[slice(start, stop)])
    parts = [entry.totals for entry in account.trace.entries] + [account.totals()]
    for name, total in whole.totals().cabinet_energy_microjoule.items():
        assert sum(part.cabinet_energy_microjoule[name] for part in parts) == total
    for name in ("observed_ns", "gap_ns", "jumps"):
        assert sum(getattr(part, name) for part in parts) == getattr(whole.totals(), name)
