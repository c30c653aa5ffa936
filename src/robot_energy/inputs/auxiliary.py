"""Meters and states of auxiliary loads: topics, types and meanings."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Annotated

from robot_energy.accounting.power_curve import MeterLimits
from robot_energy.foundation.described import Described
from robot_energy.inputs.meter.source import MeterSource, stamps_by_type
from robot_energy.inputs.parameters import named_groups, parameter
from robot_energy.model.auxiliary import AuxiliaryLoad

STATE_TYPE = "std_msgs/msg/UInt8"


@dataclass(frozen=True, kw_only=True)
class StateSource:
    """The topic that says in which state a load is: the number of the state, from 0."""

    load: str = parameter("Name of the load in the model file.", "")
    topic: str = parameter("Topic of the numbers.", "state")
    type: str = parameter("Type of the messages.", STATE_TYPE)
    value_path: str = parameter("Path of the number in the messages.", "data")
    stamp_source: str = stamps_by_type()
    latched: bool = parameter(
        "Whether its publisher keeps the last state for late subscribers (transient local); a "
        "monitor that starts later then has it at once. Only such publishers are read then.",
        False,
    )
    stale_after: float = parameter(
        "Silence after which the state of the model file is in force again; 0: a state holds "
        "until the next one [s].",
        0.0,
        (0.0, 86_400.0),
    )

    @property
    def source(self) -> MeterSource:
        """How to read the numbers: as those of a meter, where 1 stands for state 1."""
        return MeterSource(
            topic=self.topic,
            type=self.type,
            value_path=self.value_path,
            unit="W",
            meaning="instantaneous",
            location="grid",
            stamp_source=self.stamp_source,
        )


class LoadTopics(Described):
    """Where meter and states of one load come from."""

    meter: Annotated[MeterSource | None, "Its meter; None if there is none."]
    state: Annotated[MeterSource | None, "The numbers of its states; None if there are none."]
    stale_after: Annotated[float, "Of the states, see `StateSource`. [s]"] = 0.0

    @property
    def topics(self) -> tuple[str, ...]:
        """Full names of all topics."""
        return tuple(t for source in (self.meter, self.state) if source for t in source.topics)

    @property
    def limits(self) -> MeterLimits:
        """What is said of the readings of the meter, but for the longest gap."""
        if self.meter is None:
            return MeterLimits()
        return MeterLimits(max_power=self.meter.max_power, wraps_at=self.meter.wraps_at_joule)


@dataclass(frozen=True, kw_only=True)
class AuxiliaryInputs:
    """Parameters of the meters and states of auxiliary loads."""

    auxiliary_meters: Mapping[str, MeterSource] = named_groups(
        MeterSource,
        "Auxiliary loads whose meter is set here; others that have one send PowerReading on "
        "auxiliary/NAME/power.",
    )
    auxiliary_states: Mapping[str, StateSource] = named_groups(
        StateSource,
        "Topics of states that are set here: a name for each, which is not that of a load with a "
        "meter above. Other loads may send UInt8 on auxiliary/NAME/state.",
    )

    def meter_of(self, load: AuxiliaryLoad) -> MeterSource | None:
        """Return the meter of a load; None if it has none."""
        usual = MeterSource(topic=f"auxiliary/{load.name}/power")
        return self.auxiliary_meters.get(load.name, usual) if load.metered else None

    def state_of(self, load: AuxiliaryLoad) -> StateSource:
        """Return where the states of a load come from."""
        given = {source.load: source for source in self.auxiliary_states.values()}
        return given.get(load.name, StateSource(topic=f"auxiliary/{load.name}/state"))

    def unknown_loads(self, loads: Collection[AuxiliaryLoad]) -> list[str]:
        """Return a sentence for each entry that names none of the loads."""
        named = {*self.auxiliary_meters, *(one.load for one in self.auxiliary_states.values())}
        return [
            f"the inputs name the auxiliary load '{name}', which the model lacks"
            for name in sorted(named - {load.name for load in loads})
        ]
