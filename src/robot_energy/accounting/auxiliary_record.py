"""Counts of auxiliary loads -> parts of the record that is kept, and back."""

from __future__ import annotations

import numpy as np

from robot_energy.accounting.auxiliary import AuxiliaryAccount
from robot_energy.accounting.exact_sum import ExactSum
from robot_energy.accounting.record import AccountRecord
from robot_energy.accounting.totals import LoadStateTotals, LoadTotals


def load_totals(account: AuxiliaryAccount) -> dict[str, LoadTotals]:
    """Return what was counted of each load, by its name.

    Args:
        account: The loads.
    """
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


def load_remainders(account: AuxiliaryAccount) -> dict[str, tuple[int, int]]:
    """Return what the energies of each load hold beyond whole microjoules, by its name.

    Args:
        account: The loads.
    """
    rows = zip(account.energy.remainder, account.together.remainder[1:], strict=True)
    names = [curve.load.name for curve in account.curves]
    return {name: (int(a), int(b)) for name, (a, b) in zip(names, rows, strict=True)}


def state_totals(account: AuxiliaryAccount) -> dict[str, dict[str, LoadStateTotals]]:
    """Return what was counted in each state, by the names of loads and states.

    Args:
        account: The loads.
    """
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


def carry_loads(account: AuxiliaryAccount, record: AccountRecord) -> None:
    """Put what a record has counted of the loads before what an account has counted.

    Loads and states that the record lacks begin at zero.

    Args:
        account: The loads.
        record: What was kept.
    """
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
