"""Loads outside of the cabinet: by hand, whatever the cutting, and where a meter is silent."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from accounts import IDENTITY, NAMES, steady
from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.auxiliary import AuxiliaryAccount
from robot_energy.accounting.load_curve import COLUMNS, LoadCurve, Remark
from robot_energy.accounting.power_curve import MeterLimits
from robot_energy.accounting.record import AccountRecord
from robot_energy.inputs.auxiliary import LoadTopics
from robot_energy.inputs.meter.kinds import FLOAT64
from robot_energy.inputs.meter.source import MeterSource
from robot_energy.model.auxiliary import AuxiliaryLoad
from robot_energy.store.account_store import load_account
from robot_energy.timeline.blocks import MeterBlock, MeterLocation, MeterMeaning, PowerBlock
from robots import two_link

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


def test_silent_states_fall_back_to_the_model_file():
    """On at 12 s, once more at 14 s; silent for 3 s from 17 s on: off, as the model file says."""
    account = AuxiliaryAccount([load(state="off")], {"pump": LoadTopics(None, None, 3.0)})
    curve = account["pump"]
    curve.switch(np.array([12, 14]) * SECOND, np.array([1.0, 1.0]))
    rows = curve.shown(np.array([16, 17, 19]) * SECOND)
    assert rows[:, COLUMNS.index("state")].tolist() == [1, 0, 0]
    remarks = [Remark.OK, Remark.STATE_ASSUMED, Remark.STATE_ASSUMED]
    assert rows[:, COLUMNS.index("remarks")].tolist() == remarks
    account.step(steady(10.0, 20.0))
    account.flush()
    assert account.energy.joule == pytest.approx([5 * 800.0 + 5 * 10.0])


def test_what_is_shown_is_the_newest_reading_until_it_is_stale():
    """Means of 1 s up to 13 s are shown for 2 s more; a refused one is unknown at once."""
    curve = LoadCurve(load(metered=True, state="on"), MeterLimits(max_power=1000.0))
    curve.measure(means([11, 12, 13], [500.0, 510.0, 520.0]))

    def at(*seconds):
        rows = curve.shown((np.array(seconds) * SECOND).astype(np.int64))
        return rows[:, COLUMNS.index("power")], rows[:, COLUMNS.index("remarks")].astype(int)

    power, remarks = at(10.0, 12.5, 15.0, 15.1)
    assert np.array_equal(power, [np.nan, 510.0, 520.0, np.nan], equal_nan=True)
    known = [one & ~Remark.STATE_ASSUMED for one in remarks]
    assert known == [Remark.METER_MISSING, 0, 0, Remark.METER_STALE]
    curve.measure(means([14, 14.5], [5000.0, np.nan]))
    power, remarks = at(13.9, 14.2)
    assert np.array_equal(power, [520.0, np.nan], equal_nan=True)
    assert remarks[1] & Remark.METER_REFUSED
    curve.measure(means([15], [530.0]))
    assert at(15.0)[0] == [530.0]


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 1999), st.integers(0, 2), st.booleans())
def test_a_restart_anywhere_loses_only_what_waited(cut, lag, killed):
    """After it: known and missing time are the observed time, and nothing fell."""
    loads = [load(metered=True, state="on"), load("lamp", {"a": 1.0, "b": 4.0}, state="a")]
    block = steady(10.0, 30.0)
    stamps = np.arange(11, 31)
    seen = stamps + lag <= block.stamp_ns[cut] / SECOND

    def fresh():
        account = EnergyAccount(2)
        account.auxiliary = AuxiliaryAccount(loads)
        return account

    account = fresh()
    account.auxiliary["pump"].measure(means(stamps[seen], np.full(seen.sum(), 500.0)))
    account.step(block[slice(0, cut)])
    if not killed:
        account.flush()
    shown = account.totals()
    text = account.state(IDENTITY).to_json()
    record = AccountRecord.from_json(text).arranged(NAMES, ["pump", "lamp"])
    again = fresh()
    again.restore(record)
    again.auxiliary["pump"].measure(means(stamps[~seen], np.full((~seen).sum(), 500.0)))
    again.step(block[slice(cut, None)])
    again.flush()
    totals = again.totals()
    for name, one in totals.auxiliary.items():
        assert one.known_ns + one.missing_ns == totals.observed_ns, name
        assert one.known_ns >= shown.auxiliary[name].known_ns
        assert one.energy_microjoule >= shown.auxiliary[name].energy_microjoule
    pump = totals.auxiliary["pump"]
    assert pump.energy_microjoule == pytest.approx(pump.known_ns * 500.0 / 1000.0, abs=2)
    known = again.auxiliary.energy.microjoule
    assert totals.outlet_ns <= min(one.known_ns for one in totals.auxiliary.values())
    assert totals.outlet_energy_microjoule == pytest.approx(
        totals.outlet_ns * (100.0 + 500.0 + 1.0) / 1000.0, abs=4
    )
    assert known.tolist() == [one.energy_microjoule for one in totals.auxiliary.values()]


def test_job_intervals_and_resets_hold_the_loads():
    account = EnergyAccount(2)
    account.auxiliary = AuxiliaryAccount([load("panel", {"on": 35.0})])
    account.step(steady(10.0, 12.0))
    account.open_interval("job")
    account.step(steady(12.01, 15.0))
    account.reset("a new shift")
    account.step(steady(15.01, 16.0))
    job = account.close_interval("job").counted
    assert job.auxiliary["panel"].energy_microjoule == pytest.approx(4 * 35e6, abs=2)
    assert job.outlet_energy_microjoule == pytest.approx(4 * 135e6, abs=3)
    assert account.totals().auxiliary["panel"].energy_microjoule == pytest.approx(35e6, abs=2)


def test_a_load_that_the_model_lost_is_said_and_one_it_gained_counts_from_here(tmp_path):
    model = two_link()

    def kept(*loads):
        account = EnergyAccount(2)
        account.auxiliary = AuxiliaryAccount(loads)
        store = load_account(account, model, tmp_path)
        store.open()
        return account, store

    account, store = kept(load("panel", {"on": 35.0}))
    account.step(steady(10.0, 12.0))
    assert store.close()
    account, store = kept(load("oven", {"on": 900.0}))
    assert any(
        "no auxiliary load 'panel' any more; it had counted 70.0 J" in n for n in store.notices
    )
    assert list(account.totals().auxiliary) == ["oven"]
    assert any("'oven' counts from here" in entry.text for entry in account.trace.entries)
    store.close()


def test_an_error_in_the_middle_of_a_step_takes_all_of_it_back(monkeypatch):
    account = EnergyAccount(2)
    account.auxiliary = AuxiliaryAccount([load("panel", {"on": 35.0})])
    account.step(steady(10.0, 12.0))
    before = account.totals()

    def fail(_self, _time):
        raise RuntimeError("injected")

    with monkeypatch.context() as patch:
        patch.setattr(AuxiliaryAccount, "_decide", fail)
        with pytest.raises(RuntimeError):
            account.step(steady(12.01, 13.0))
    assert account.totals().auxiliary == before.auxiliary
    assert account.totals().observed_ns == before.observed_ns
    account.step(steady(13.01, 14.0))
    account.flush()
    totals = account.totals()
    assert totals.auxiliary["panel"].known_ns == totals.observed_ns
