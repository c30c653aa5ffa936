"""The test for wear over the bags of a robot, one joint after the other.

A bag stands for the time around it: its hours of motion are the hours since the first bag times
the share of motion in the bags. Bags differ by more than their own scatter, as gears are warmer
or colder than their motors say. How much, the differences of neighbours in time show, which a
change of friction hardly touches; it is added to the variance of every record.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from robot_energy.certainty.band import MEDIAN_TO_STD
from robot_energy.condition.drift import BAGS, MIN_AFTER, MIN_BEFORE, DriftTest
from robot_energy.condition.wear_records import WearRecord
from robot_energy.foundation.units import HOUR_NS

MIN_RECORDS = MIN_BEFORE + MIN_AFTER  # without which no change is seen
MIN_HOURS = BAGS.min_hours  # of motion that they span, likewise [h]
MAX_KEPT = 48  # records of a joint; more are merged, neighbour with neighbour


def wear_history(records: Sequence[WearRecord], duty: float) -> DriftTest:
    """Return the test of one joint of one robot, after all records.

    Args:
        duty: Share of motion in the time of the bags. [-]
    """
    test = DriftTest(BAGS)
    if not records:
        return test
    first_ns = records[0].stamp_ns
    dated = [
        record._replace(hours=(record.stamp_ns - first_ns) / HOUR_NS * duty) for record in records
    ]
    merged = _merged(dated)
    between = _between(merged)
    test.take([record._replace(variance=record.variance + between) for record in merged])
    return test


def is_enough(test: DriftTest) -> bool:
    """Return whether a change could be seen."""
    return len(test.records) >= MIN_RECORDS and test.records[-1].hours >= MIN_HOURS


def _merged(records: list[WearRecord]) -> list[WearRecord]:
    groups = min(len(records), MAX_KEPT)
    edges = [number * len(records) // groups for number in range(groups + 1)]
    found: list[WearRecord] = []
    for first, last in pairwise(edges):
        one = records[first]
        for later in records[first + 1 : last]:
            one = one.merged(later)
        found.append(one)
    return found


def _between(records: list[WearRecord]) -> float:
    """Variance between neighbours beyond that of their own scatter."""
    if len(records) < 3:
        return 0.0
    steps = np.abs(np.diff([record.excess for record in records]))
    variance = (MEDIAN_TO_STD * float(np.median(steps))) ** 2 / 2.0
    return max(variance - float(np.median([record.variance for record in records])), 0.0)
