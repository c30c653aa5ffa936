"""Some bags out of many, and what they say of all."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from robot_energy.advice.claims import Claim
from robot_energy.api.replay import ReplayOptions
from robot_energy.fleet.dataset import scan
from robot_energy.uncertainty.band import Z90

MAX_BAGS = 5
STUDENT = {3: 2.920, 4: 2.353, 5: 2.132}
"""95 % quantile of Student's t by number of bags; fewer than three say nothing of their spread."""
MIN_BAGS = min(STUDENT)


@dataclass(frozen=True)
class SampledBag:
    """A bag of a dataset that is still where it was.

    Attributes:
        address: Of the bag.
        options: With which it is replayed: as for the dataset, but for those given now and without
            jobs, which change no energy.
    """

    address: str
    options: dict[str, Any]


def evenly(count: int) -> list[int]:
    """Return `MAX_BAGS` places in a list at most, evenly spread.

    Args:
        count: Length of the list.
    """
    chosen = min(MAX_BAGS, count)
    places: list[int] = ((np.arange(chosen) + 0.5) * count / max(chosen, 1)).astype(int).tolist()
    return places


def bag_sample(
    folder: str | Path, keys: Sequence[str], options: ReplayOptions
) -> tuple[list[SampledBag], int]:
    """Return bags of a dataset that can be looked at again, evenly spread over a list.

    They are `MAX_BAGS` at most, and none where fewer than `MIN_BAGS` can be read from this host.
    The number is that of bags that are there, but were replayed with a file of inputs, of which a
    dataset keeps a hash alone.

    Args:
        folder: Of the dataset.
        keys: Of the rows that count, by robot and time.
        options: That go before those with which a bag was replayed.
    """
    rows = scan(folder).select("key", "bag", "settings").collect().iter_rows()
    known = {key: SampledBag(bag, _options(settings)) for key, bag, settings in rows}
    given = {name: value for name, value in options.items() if value is not None}
    there = [known[key] for key in keys if Path(known[key].address).exists()]
    usable = [one for one in there if "inputs" in given or "inputs" not in one.options]
    chosen = [usable[k] for k in evenly(len(usable))] if len(usable) >= MIN_BAGS else []
    bags = [replace(one, options=one.options | given) for one in chosen]
    return bags, len(there) - len(usable)


def _options(settings: str | None) -> dict[str, Any]:
    """Options of the replay, as far as a dataset keeps them."""
    known = ReplayOptions.__annotations__.keys() - {"jobs"}
    given: dict[str, Any] = json.loads(settings) if settings else {}
    return {name: value for name, value in given.items() if name in known and value is not None}


def of_all(
    claims: Sequence[Claim | None], time: Sequence[float], whole: float, bags: int
) -> Claim | None:
    """Return what a change saves in all bags, from what it saves in some.

    ``S = T sum_i S_i / sum_i t_i``. Errors of the model are common to the bags, so their standard
    deviations add up; the spread between the bags is that of a ratio of n of N bags,
    ``T^2 (1 - n/N) n/(n - 1) sum_i (S_i - r t_i)^2 / (sum_i t_i)^2`` with ``r = S / T``.

    Args:
        claims: Of each bag; None: it saves nothing there.
        time: Predicted of each bag. [s]
        whole: Predicted of all. [s]
        bags: How many there are.

    Returns:
        The claim; None where no bag has one, or only one or two of more were looked at.
    """
    found = [one for one in claims if one is not None]
    count = len(claims)
    if not found or count < min(MIN_BAGS, bags):
        return None
    saved = np.array([0.0 if one is None else one.energy for one in claims])
    taken = np.asarray(time)
    scale = whole / float(taken.sum())
    rate = float(saved.sum() / taken.sum())
    spread = 0.0
    if count < bags:
        variance = (1.0 - count / bags) * count / (count - 1) * ((saved - rate * taken) ** 2).sum()
        spread = scale * np.sqrt(variance) * STUDENT[count] / Z90
    common = scale * sum(one.half for one in found) / Z90
    most = max(found, key=lambda one: one.energy)
    return replace(
        most,
        energy=scale * float(saved.sum()),
        columns=np.array([common, spread]),
        found=f"in {len(found)} of {count} bags that were looked at, of {bags}; where it saves "
        f"most: {most.found}",
    )
