"""Loads outside of the cabinet: energy of each, mean power of its states, balance of the outlet."""

from typing import Annotated

from robot_energy.accounting.auxiliary import AuxiliaryAccount
from robot_energy.accounting.exact_sum import PER_JOULE
from robot_energy.results.base import Number, Result
from robot_energy.timeline.blocks import NANOSECOND


class LoadState(Result):
    """One state of a load, over the time in which the power of the load is known."""

    time: Annotated[float, "Time in this state. [s]"]
    energy: Annotated[float, "Energy over that time. [J]"]
    mean_power: Annotated[
        Number, "Mean power over that time: with a meter, what the state draws. [W]"
    ]
    model_power: Annotated[float, "Power of the state in the model file. [W]"]


class LoadEnergy(Result):
    """One load."""

    name: Annotated[str, "Name of the load."]
    metered: Annotated[bool, "Whether a meter of its own measures its power."]
    energy: Annotated[
        Number,
        "Energy over the observed time; None if the power is not known for a part of it. [J]",
    ]
    known_energy: Annotated[float, "Energy over the time in which the power is known. [J]"]
    known_ns: Annotated[int, "That time. [ns]"]
    missing_ns: Annotated[int, "Observed time in which the power is not known. [ns]"]
    missing_count: Annotated[int, "How often the power ceased to be known."]
    mean_power: Annotated[Number, "Mean power over the known time. [W]"]
    states: Annotated[dict[str, LoadState], "States by their names."]


class AuxiliaryReport(Result):
    """The auxiliary branch, and the outlet that feeds it and the cabinet."""

    loads: Annotated[tuple[LoadEnergy, ...], "Loads in the order of the model file."]
    balanced_ns: Annotated[int, "Time in which the powers of all loads are known. [ns]"]
    outlet_energy_microjoule: Annotated[
        int, "From the outlet over that time: cabinet and loads, exact. [uJ]"
    ]
    outlet_energy: Annotated[float, "The same. [J]"]
    cabinet_energy: Annotated[float, "Predicted energy of the cabinet over that time. [J]"]
    auxiliary_energy: Annotated[float, "Energy of all loads over that time. [J]"]


def auxiliary_report(account: AuxiliaryAccount | None) -> AuxiliaryReport | None:
    if account is None:
        return None
    outlet = account.outlet_microjoule
    return AuxiliaryReport(
        loads=tuple(_load(account, place) for place in range(len(account.curves))),
        balanced_ns=account.together_ns,
        outlet_energy_microjoule=outlet,
        outlet_energy=outlet / PER_JOULE,
        cabinet_energy=float(account.together.joule[0]),
        auxiliary_energy=float(account.together.joule[1:].sum()),
    )


def missing_sentences(report: AuxiliaryReport | None) -> list[str]:
    return [
        f"the power of {load.name} is not known for {load.missing_ns * NANOSECOND:.3f} s of the "
        "observed time: its energy there is not counted"
        for load in (report.loads if report is not None else ())
        if load.missing_ns
    ]


def _load(account: AuxiliaryAccount, place: int) -> LoadEnergy:
    curve = account.curves[place]
    known_ns, missing_ns = int(account.known_ns[place]), int(account.missing_ns[place])
    energy = float(account.energy.joule[place])
    states: dict[str, LoadState] = {}
    for column, (name, figure) in enumerate(curve.load.states.items(), account.offset[place]):
        time = float(account.state_ns[column]) * NANOSECOND
        drawn = float(account.state_energy.joule[column])
        states[name] = LoadState(time, drawn, drawn / time if time else None, figure.value)
    return LoadEnergy(
        name=curve.load.name,
        metered=curve.metered,
        energy=None if missing_ns else energy,
        known_energy=energy,
        known_ns=known_ns,
        missing_ns=missing_ns,
        missing_count=int(account.missing_count[place]),
        mean_power=energy / (known_ns * NANOSECOND) if known_ns else None,
        states=states,
    )
