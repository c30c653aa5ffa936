"""An energy account -> one record that can be kept, and back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_energy.accounting.auxiliary import AuxiliaryAccount
from robot_energy.accounting.exact_sum import PER_JOULE, ExactSum, add_saturating
from robot_energy.accounting.record import AccountRecord, EventLog, Identity, Remainders
from robot_energy.accounting.registers import CABINET_REGISTERS, JOINT_REGISTERS, Coverage
from robot_energy.accounting.totals import (
    CABINET_DEVIATION_KEYS,
    CABINET_KEYS,
    JOINT_DEVIATION_KEYS,
    SHAFT_KEYS,
    LoadStateTotals,
    LoadTotals,
    Totals,
    saturated,
)
from robot_energy.timeline.blocks import Float, Int, Phase, Quality

if TYPE_CHECKING:
    from robot_energy.accounting.account import EnergyAccount

_ORDER = (*CABINET_REGISTERS, *JOINT_REGISTERS, *CABINET_DEVIATION_KEYS, *JOINT_DEVIATION_KEYS)


def totals_of(account: EnergyAccount, loads: AuxiliaryAccount | None) -> Totals:
    """Return all counters of an account as they stand."""
    time, comparison = account.registers.time, account.comparison
    cabinet, joints = _by_name(account.registers.microjoule, account.shaft.microjoule)
    return Totals(
        cabinet_energy_microjoule=cabinet,
        joint_energy_microjoule=joints,
        shaft_compared_ns=tuple(account.shaft.compared_ns.tolist()),
        measured_energy_microjoule=int(comparison.microjoule[0]),
        predicted_energy_at_meter_microjoule=int(comparison.microjoule[1]),
        compared_ns=saturated(comparison.compared_ns),
        observed_ns=time.observed_ns,
        gap_ns=time.gap_ns,
        gap_count=time.gap_count,
        jumps=time.jumps,
        outlet_cabinet_energy_microjoule=int(loads.together.microjoule[0]) if loads else 0,
        outlet_ns=loads.together_ns if loads else 0,
        auxiliary=_load_totals(loads) if loads else {},
    )


def record_of(account: EnergyAccount, identity: Identity) -> AccountRecord:
    """Return all that must be kept of an account."""
    registers, comparison, counts = account.registers, account.comparison, account.counts
    loads = account.auxiliary.flushed() if account.auxiliary is not None else None
    cabinet, joints = _by_name(registers.remainder, account.shaft.remainder)
    phases = [phase.name for phase in Phase]
    phase_energy = counts.phase_energy_sum
    entries, closed = account.intervals.state()
    return AccountRecord(
        identity=identity,
        energy_start_ns=account.start_ns,
        end_ns=account.end_ns,
        totals=totals_of(account, loads),
        remainders=Remainders(
            cabinet=cabinet,
            joints=joints,
            measured=int(comparison.remainder[0]),
            predicted_at_meter=int(comparison.remainder[1]),
            phases=dict(zip(phases, phase_energy.remainder.tolist(), strict=True)),
            standby=int(counts.standby.energy.remainder[0]),
            learned=int(counts.learned_energy_sum.remainder[0]),
            outlet_cabinet=int(loads.together.remainder[0]) if loads else 0,
            auxiliary=_load_remainders(loads) if loads else {},
        ),
        phase_energy_microjoule=dict(zip(phases, phase_energy.microjoule.tolist(), strict=True)),
        phase_observed_ns=dict(zip(phases, counts.phase_ns.tolist(), strict=True)),
        peak_power_watt=counts.peak_power if np.isfinite(counts.peak_power) else None,
        samples=counts.samples,
        standby_energy_microjoule=int(counts.standby.energy.microjoule[0]),
        standby_ns=counts.standby.ns,
        learned_energy_microjoule=int(counts.learned_energy_sum.microjoule[0]),
        quality_counts={
            str(Quality(bit).name): saturated(count)
            for bit, count in sorted(counts.quality.items())
        },
        restarts=saturated(account.restarts),
        next_interval_id=account.intervals.next_id,
        open_intervals=entries,
        closed_intervals=closed,
        trace=account.trace.entries,
        calibration=account.calibration.state(),
        auxiliary_states=_state_totals(loads) if loads else {},
    )


def carry_into(account: EnergyAccount, record: AccountRecord) -> None:
    """Put what a record has counted before what an account has counted."""
    registers, totals, rest = account.registers, record.totals, record.remainders
    empty = registers.time.end_ns is None
    registers.time.precede(
        Coverage(
            observed_ns=totals.observed_ns,
            gap_ns=totals.gap_ns,
            gap_count=totals.gap_count,
            jumps=totals.jumps,
            start_ns=record.energy_start_ns,
            end_ns=record.end_ns,
        )
    )
    if empty:
        registers.interrupt()
    energy = totals.joint_energy_microjoule
    registers.add_sums(
        _integers(*_in_order(totals.cabinet_energy_microjoule, energy)),
        _integers(*_in_order(rest.cabinet, rest.joints)),
    )
    account.shaft.add_sums(
        _integers(*_rows(energy, SHAFT_KEYS)),
        _integers(*_rows(rest.joints, SHAFT_KEYS)),
    )
    add_saturating(account.shaft.compared_ns, _integers(*totals.shaft_compared_ns))
    account.comparison.add_sums(
        _integers(totals.measured_energy_microjoule, totals.predicted_energy_at_meter_microjoule),
        _integers(rest.measured, rest.predicted_at_meter),
    )
    account.comparison.compared_ns += totals.compared_ns
    names = [phase.name for phase in Phase]
    account.counts.phase_energy_sum.add_sums(
        _integers(*(record.phase_energy_microjoule.get(name, 0) for name in names)),
        _integers(*(rest.phases.get(name, 0) for name in names)),
    )
    account.counts.learned_energy_sum.add_sums(
        _integers(record.learned_energy_microjoule), _integers(rest.learned)
    )
    account.counts.standby.add(record.standby_ns, record.standby_energy_microjoule, rest.standby)
    if account.auxiliary is not None:
        _carry_loads(account.auxiliary, record)
    account.intervals.restore(
        record.open_intervals, record.closed_intervals, record.next_interval_id
    )
    account.intervals.step(account.counts.peak_power)
    account.counts.add(
        record.samples,
        np.nan if record.peak_power_watt is None else record.peak_power_watt,
        {int(bit): record.quality_counts.get(str(bit.name), 0) for bit in Quality},
        _integers(*(record.phase_observed_ns.get(name, 0) for name in names)),
    )
    account.restarts += record.restarts
    if record.calibration is not None:
        account.calibrate(record.calibration)
    account.trace = EventLog((*record.trace, *account.trace.entries))


def deviation_of(counted: Totals) -> Float:
    """Return the integrals of the deviations, in the order of the registers, shape (K,). [J]"""
    cabinet, joints = counted.cabinet_energy_microjoule, counted.joint_energy_microjoule
    values = [cabinet[name] for name in CABINET_DEVIATION_KEYS]
    return np.array([*values, *_rows(joints, JOINT_DEVIATION_KEYS)]) / PER_JOULE


def _by_name(values: Int, shaft: Int) -> tuple[dict[str, int], dict[str, tuple[int, ...]]]:
    """Split registers, and those of the shaft comparison, into cabinet and joints."""
    n_joints = len(shaft) // len(SHAFT_KEYS)
    cabinet: dict[str, int] = {}
    joints: dict[str, tuple[int, ...]] = {}
    row = [*values.tolist(), *shaft.tolist()]
    for name in (*_ORDER, *SHAFT_KEYS):
        if name in CABINET_KEYS:
            cabinet[name], *row = row
        else:
            joints[name], row = tuple(row[:n_joints]), row[n_joints:]
    return cabinet, joints


def _in_order(cabinet: dict[str, int], joints: dict[str, tuple[int, ...]]) -> list[int]:
    """Values of the registers in the order of `Registers`."""
    return [
        value
        for name in _ORDER
        for value in ((cabinet[name],) if name in CABINET_KEYS else joints[name])
    ]


def _rows(joints: dict[str, tuple[int, ...]], names: Sequence[str]) -> list[int]:
    return [value for name in names for value in joints[name]]


def _integers(*values: int) -> Int:
    return np.array(values, dtype=np.int64)


def _load_totals(account: AuxiliaryAccount) -> dict[str, LoadTotals]:
    """What was counted of each load, by its name."""
    return {
        curve.load.name: LoadTotals(
            energy_microjoule=int(account.energy.microjoule[place]),
            outlet_energy_microjoule=int(account.together.microjoule[1 + place]),
            known_ns=int(account.known_ns[place]),
            missing_ns=int(account.missing_ns[place]),
            missing_count=int(account.missing_count[place]),
        )
        for place, curve in enumerate(account.curves)
    }


def _load_remainders(account: AuxiliaryAccount) -> dict[str, tuple[int, int]]:
    """What the energies of each load hold beyond whole microjoules, by its name."""
    rows = zip(account.energy.remainder, account.together.remainder[1:], strict=True)
    names = [curve.load.name for curve in account.curves]
    return {name: (int(a), int(b)) for name, (a, b) in zip(names, rows, strict=True)}


def _state_totals(account: AuxiliaryAccount) -> dict[str, dict[str, LoadStateTotals]]:
    """What was counted in each state, by the names of loads and states."""
    sums, found = account.state_energy, dict[str, dict[str, LoadStateTotals]]()
    for curve, first in zip(account.curves, account.offset.tolist(), strict=False):
        found[curve.load.name] = {
            name: LoadStateTotals(
                energy_microjoule=int(sums.microjoule[first + number]),
                remainder=int(sums.remainder[first + number]),
                ns=int(account.state_ns[first + number]),
            )
            for number, name in enumerate(curve.load.state_names)
        }
    return found


def _carry_loads(account: AuxiliaryAccount, record: AccountRecord) -> None:
    """Put what a record has counted of the loads before it; what the record lacks begins at 0."""
    totals, rest = record.totals, record.remainders
    names = [curve.load.name for curve in account.curves]
    loads = [totals.auxiliary.get(name, LoadTotals()) for name in names]
    carried = [rest.auxiliary.get(name, (0, 0)) for name in names]
    _add(
        account.energy,
        [load.energy_microjoule for load in loads],
        [remainder for remainder, _ in carried],
    )
    _add(
        account.together,
        [
            totals.outlet_cabinet_energy_microjoule,
            *(load.outlet_energy_microjoule for load in loads),
        ],
        [rest.outlet_cabinet, *(remainder for _, remainder in carried)],
    )
    states = [
        record.auxiliary_states.get(curve.load.name, {}).get(name, LoadStateTotals())
        for curve in account.curves
        for name in curve.load.state_names
    ]
    _add(
        account.state_energy,
        [state.energy_microjoule for state in states],
        [state.remainder for state in states],
    )
    account.add_times(
        np.array([[load.known_ns, load.missing_ns, load.missing_count] for load in loads]).T,
        np.array([state.ns for state in states]),
        totals.outlet_ns,
        totals.observed_ns,
    )


def _add(sums: ExactSum, microjoule: list[int], remainder: list[int]) -> None:
    sums.add_sums(np.array(microjoule, dtype=np.int64), np.array(remainder, dtype=np.int64))
