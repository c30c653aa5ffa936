"""Meters and states of auxiliary loads: topics, types and meanings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from robot_energy.inputs.meter.source import BY_TYPE, MeterSource
from robot_energy.inputs.parameters import HEADER, RECEIVE, named_groups, parameter

STATE_TYPE = "std_msgs/msg/UInt8"


@dataclass(frozen=True, kw_only=True)
class StateSource:
    """The topic that says in which state a load is: the number of the state, from 0."""

    load: str = parameter("Name of the load in the model file.", "")
    topic: str = parameter("Topic of the numbers.", "state")
    type: str = parameter("Type of the messages.", STATE_TYPE)
    value_path: str = parameter("Path of the number in the messages.", "data")
    stamp_source: str = parameter(
        "Where the stamps come from: the header, or the receive time; by_type: the header "
        "where there is one.",
        BY_TYPE,
        choices=(BY_TYPE, HEADER, RECEIVE),
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
