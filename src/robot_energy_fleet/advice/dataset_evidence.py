"""Evidence from the dataset of a fleet: sums of its bags, and some of the bags, for all of them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from robot_energy.certainty.deviation import Z90
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import DatasetError
from robot_energy.foundation.units import HOUR_NS
from robot_energy.model import RobotModel
from robot_energy.replay.options import ReplayOptions
from robot_energy_fleet.advice.claims import LONG_REST, Claim
from robot_energy_fleet.advice.evidence import DEGC_BINS, RecordedEvidence, RecordedRest
from robot_energy_fleet.dataset import collected, read_tables, scan
from robot_energy_fleet.tables import counted_twice, is_history
from robot_energy_report.formats import counted

FULL = 0.99  # of an hour in standby: it was one rest
MAX_BAGS = 5
STUDENT = {3: 2.920, 4: 2.353, 5: 2.132}
"""95 % quantile of Student's t by number of bags; fewer than three say nothing of their spread."""
MIN_BAGS = min(STUDENT)


class SampledBag(Described):
    """A bag of a dataset that is still where it was."""

    address: str
    options: Annotated[
        dict[str, Any],
        "With which it is replayed: as for the dataset, but for those given now and without jobs, "
        "which change no energy.",
    ]


def evenly(count: int) -> list[int]:
    """Return `MAX_BAGS` places in a list at most, evenly spread."""
    chosen = min(MAX_BAGS, count)
    places: list[int] = ((np.arange(chosen) + 0.5) * count / max(chosen, 1)).astype(int).tolist()
    return places


def _bag_sample(
    folder: str | Path, keys: Sequence[str], options: ReplayOptions
) -> tuple[list[SampledBag], int]:
    """Bags of a dataset that can be looked at again, evenly spread over the list of keys.

    They are `MAX_BAGS` at most, and none where fewer than `MIN_BAGS` can be read from this host.
    The number is that of bags that are there, but were replayed with a file of inputs, of which a
    dataset keeps a hash alone. A history does not say where its bags are.
    """
    if is_history(folder):
        return [], 0
    rows = collected(scan(folder).select("key", "bag", "settings"), folder).iter_rows()
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
        time: Predicted of each bag. [s]
        whole: Predicted of all. [s]

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
        found=f"in {len(found)} of {count} analysed bags, of {bags} in all; where it saves most: "
        f"{most.found}",
    )


def dataset_evidence(
    folder: str | Path, model: RobotModel, options: ReplayOptions | None = None
) -> tuple[RecordedEvidence, list[SampledBag]]:
    """Return what a dataset shows of the robots with one model, and bags to look at again.

    How often a robot rested within an hour is not in it: hours that were all standby are one rest
    with their neighbours, standby in others is taken as rests of `LONG_REST`, the shortest that
    count as standby, so that no state is claimed to pay that might not.

    Args:
        options: With which bags are looked at, before those of the dataset.
    """
    tables = read_tables(folder)
    everything = tables.runs
    used = (everything["reason"] == "") & (everything["model_id"] == model.model_id)
    runs = everything.filter(used)
    if runs.is_empty():
        others = ", ".join(sorted(set(tables.runs["model_id"].to_list()) - {""})) or "none"
        raise DatasetError(
            f"{folder} holds no bag of model {model.model_id}, but of {others}",
            "the model that the bags were replayed with",
        )
    keys = runs.sort("robot", "start_ns", "bag")["key"].to_list()
    sample, without_inputs = _bag_sample(folder, keys, options or {})
    largest = runs.sort("grid_energy", "bag", descending=[True, False])["bag"][0]
    bags = (
        f"{len(sample)} of its {len(runs)} bags are analysed, spread over robots and time; the "
        "bands include how much they differ"
        if sample
        else f"name bags instead, such as {largest}, which took most energy: fewer than {MIN_BAGS} "
        "can still be read at their places"
    )
    what = "history" if is_history(folder) else "dataset"
    if what == "history":
        bags = "name bags instead: a history does not state where those of this robot are"
    found = RecordedEvidence(
        recordings=len(runs),
        observed_time=float(runs["observed_time"].sum()),
        grid_energy=float(runs["grid_energy"].sum()),
        brake_energy=float(runs["brake_energy"].sum()),
        start_ns=int(runs["start_ns"].to_numpy().min()),
        end_ns=int(runs["end_ns"].to_numpy().max()),
        metered=False,
        robots=tuple(sorted(runs["robot"].unique().to_list())),
        places=False,
        fine=False,
        notes=[
            f"a {what} cannot separate short and long rests within an hour",
            f"a {what} holds sums: for warm-up, speeds and waiting poses {bags}",
        ],
    )
    if without_inputs:
        found.notes.append(
            f"not analysed: {counted(without_inputs, 'bag')} replayed with a file of inputs, which "
            "a dataset does not keep; name bags instead, and that file with --inputs"
        )
    found.notes += counted_twice(runs)
    hours = tables.hours.join(runs.select("key"), on="key", how="semi")
    moved = float(hours["motion_time"].sum())
    found.rest_time = float(hours["observed_time"].sum()) - moved
    shape = len(model.joints), len(DEGC_BINS) - 1
    found.squared_speed, found.motion_time = np.zeros(shape), np.zeros(shape)
    still = np.zeros(len(model.joints))
    columns = ["robot", "hour_ns", "standby_time", "standby_energy"]
    summed = hours.select(columns).group_by(columns[:2], maintain_order=True).sum()
    last: tuple[str, int] | None = None
    for robot, hour_ns, time, energy in summed.sort("robot", "hour_ns").iter_rows():
        if time >= FULL * 3600.0:
            if last == (robot, hour_ns):
                found.rests[-1].end_ns += round(time * 1e9)
                found.rests[-1].energy += energy
            else:
                end_ns = hour_ns + round(time * 1e9)
                found.rests.append(RecordedRest(hour_ns, end_ns, energy, still))
            last = robot, hour_ns + HOUR_NS
        elif time >= LONG_REST:
            count = int(time // LONG_REST)
            length = round(time / count * 1e9)
            found.rests += [
                RecordedRest(hour_ns, hour_ns + length, energy / count, still) for _ in range(count)
            ]
    return found, sample
