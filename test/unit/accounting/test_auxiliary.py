"""Loads outside of the cabinet: by hand, whatever the cutting, and where a meter is silent."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from accounts import steady
from robot_energy.accounting.auxiliary import AuxiliaryAccount
from robot_energy.blocks import MeterBlock, MeterLocation, MeterMeaning, PowerBlock
from robot_energy.inputs.auxiliary import LoadTopics
from robot_energy.inputs.meter.kinds import FLOAT64
from robot_energy.inputs.meter.source import MeterSource
from robot_energy.model.auxiliary import AuxiliaryLoad

SECOND = 1_000_000_000
PUMP = {"off": 10.0, "on": 800.0}


def load(name="pump", states=None, **options):
    figures = {key: {"value": v, "tag": "assumed"} for key, v in (states or PUMP).items()}
    return AuxiliaryLoad.model_validate({"name": name, "states": figures, **options})


def means(stamps, power, interval=1.0):
    """Readings of a meter that reports means, stamped at their ends."""
    stamp, none = np.asarray(stamps) * SECOND, np.full(len(stamps), np.nan)
    return MeterBlock(
        stamp.astype(np.int64),
        np.asarray(power, dtype=float),
        none,
        np.full(len(stamps), interval),
        MeterMeaning.MEAN_OVER_INTERVAL,
        MeterLocation.GRID,
    )


def counted(stamps, energy):
    stamp, none = np.asarray(stamps) * SECOND, np.full(len(stamps), np.nan)
    return MeterBlock(
        stamp.astype(np.int64), none, np.asarray(energy, dtype=float), none,
        MeterMeaning.CUMULATIVE, MeterLocation.GRID,
    )  # fmt: skip


def parts(account):
    """Everything that was counted, as plain numbers."""
    sums = (account.energy, account.together, account.state_energy)
    return [
        *(array.tolist() for each in sums for array in (each.microjoule, each.remainder)),
        account.known_ns.tolist(),
        account.missing_ns.tolist(),
        account.missing_count.tolist(),
        account.state_ns.tolist(),
        account.together_ns,
        account.observed_ns,
    ]


def test_states_and_the_sum_of_the_outlet_by_hand():
    """10 s at 100 W of cabinet: pump on from 3 s to 7.5 s, a panel of 35 W all the time."""
    account = AuxiliaryAccount([load(state="off"), load("panel", {"on": 35.0})])
    account["pump"].switch(np.array([13_000_000_000, 17_500_000_000]), np.array([1.0, 0.0]))
    account.step(steady(10.0, 20.0))
    account.flush()
    pump = 5.5 * 10.0 + 4.5 * 800.0
    assert account.energy.joule == pytest.approx([pump, 350.0])
    assert account.state_energy.joule == pytest.approx([55.0, 3600.0, 350.0])
    assert account.state_ns.tolist() == [5.5 * SECOND, 4.5 * SECOND, 10 * SECOND]
    assert account.missing_ns.tolist() == [0, 0]
    assert account.observed_ns == account.together_ns == 10 * SECOND
    assert account.outlet_microjoule == pytest.approx((1000.0 + pump + 350.0) * 1e6, abs=2)
    assert account.outlet_microjoule == sum(account.together.microjoule.tolist())


def test_a_meter_outweighs_the_power_of_the_state_and_states_get_their_mean():
    account = AuxiliaryAccount([load(state="off", metered=True)])
    account["pump"].measure(means(range(11, 21), [20.0] * 5 + [900.0] * 5))
    account["pump"].switch(np.array([15 * SECOND]), np.array([1.0]))
    account.step(steady(10.0, 20.0))
    account.flush()
    assert account.energy.joule == pytest.approx([4600.0])
    assert account.state_energy.joule == pytest.approx([100.0, 4500.0])


def test_a_silent_meter_is_missing_and_never_zero_watts():
    """Readings over 3 s and, after a silence, over 2 s of 10 s."""
    account = AuxiliaryAccount(
        [load(metered=True, state="on"), load("panel", {"on": 35.0})], max_gap=1.5
    )
    account["pump"].measure(means([11, 12, 13], [500.0] * 3))
    account.step(steady(10.0, 15.0))
    account["pump"].measure(means([18, 19], [500.0] * 2))
    account.step(steady(15.01, 20.0))
    account.flush()
    assert account.known_ns[0] == 5 * SECOND
    assert account.missing_ns[0] == 4.99 * SECOND + 0.01 * SECOND
    assert account.missing_count.tolist() == [2, 0]
    assert account.energy.joule == pytest.approx([2500.0, 350.0])
    assert account.together_ns == 5 * SECOND  # the balance is that of known time alone
    assert account.outlet_microjoule == pytest.approx((500.0 + 2500.0 + 175.0) * 1e6, abs=3)


def test_no_meter_at_all_and_an_unknown_state_are_missing():
    metered, unsaid = load(metered=True, state="on"), load("lamp", {"dim": 1.0, "full": 5.0})
    account = AuxiliaryAccount([metered, unsaid])
    account["lamp"].switch(np.array([14, 16]) * SECOND, np.array([1.0, 7.0]))  # there is no 7
    account.step(steady(10.0, 20.0))
    account.flush()
    assert account.known_ns.tolist() == [0, 2 * SECOND]
    assert account.missing_ns.tolist() == [10 * SECOND, 8 * SECOND]
    assert account.together_ns == 0
    assert account.outlet_microjoule == 0


def test_a_prediction_goes_by_states_alone():
    account = AuxiliaryAccount([load(metered=True, state="on")], planned=True)
    account.step(steady(10.0, 12.0))
    account.flush()
    assert account.energy.joule == pytest.approx([1600.0])
    assert account.missing_ns[0] == 0


def test_a_counter_that_wraps_goes_on():
    meter = MeterSource(topic="pump", type=FLOAT64, unit="J", location="grid", wraps_at=1000.0)
    account = AuxiliaryAccount([load(metered=True, state="on")], {"pump": LoadTopics(meter, None)})
    energy = (700.0 + 50.0 * np.arange(21)) % 1000.0
    account["pump"].measure(counted(np.arange(5, 26), energy))
    account.step(steady(10.0, 22.0))
    account.flush()
    assert account["pump"].curve.counter.wraps == 1
    assert account.energy.joule == pytest.approx([50.0 * 12])


def test_gaps_and_unknown_power_of_the_cabinet_are_not_counted():
    first, later = steady(10.0, 12.0), steady(14.0, 16.0)
    hole = PowerBlock.concatenate([first, replace(later, segment=later.segment + 1)])
    account = AuxiliaryAccount([load(state="on")])
    account.step(hole)
    account.flush()
    assert account.observed_ns == 4 * SECOND
    assert account.energy.joule == pytest.approx([3200.0])


def test_stamps_that_go_back_end_what_waited():
    account = AuxiliaryAccount([load(metered=True, state="on")])
    account["pump"].measure(means(range(11, 16), [100.0] * 5))
    account.step(steady(10.0, 15.0))
    account.step(steady(2.0, 4.0))
    account.flush()
    assert account.observed_ns == 7 * SECOND
    assert account.known_ns[0] == 5 * SECOND


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(1, 1999), max_size=8), st.integers(0, 3))
def test_no_cutting_makes_a_difference(cuts, lag):
    """Samples in any pieces; readings and states arrive with them, or up to 3 s later."""
    block = steady(10.0, 30.0)
    stamps = np.arange(11, 31)
    power = 500.0 + 10.0 * (stamps % 7)
    changes = np.array([12.3, 17.77, 25.0]) * SECOND
    loads = [load(metered=True, state="off"), load("lamp", {"a": 1.0, "b": 4.0}, state="a")]

    def run(bounds, lag):
        account = AuxiliaryAccount(loads)
        measured = switched = 0
        for start, stop in pairwise(bounds):
            now = int(block.stamp_ns[stop - 1])
            due = int(np.searchsorted((stamps + lag) * SECOND, now, side="right"))
            if due > measured:
                account["pump"].measure(means(stamps[measured:due], power[measured:due]))
                measured = due
            said = int(np.searchsorted(changes, now, side="right"))
            if said > switched:
                state = np.array([1.0, 0.0, 1.0])[switched:said]
                for name in ("pump", "lamp"):
                    account[name].switch(changes[switched:said].astype(np.int64), state)
                switched = said
            account.step(block[slice(start, stop)])
        if measured < len(stamps):
            account["pump"].measure(means(stamps[measured:], power[measured:]))
        account.flush()
        return parts(account)

    whole = [0, len(block)]
    assert run(sorted({0, *(cut for cut in cuts if cut < len(block)), len(block)}), lag) == run(
        whole, 0
    )
