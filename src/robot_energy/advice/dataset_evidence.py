"""RecordedEvidence from the dataset of a fleet: sums of its bags, without their samples."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robot_energy.advice.bag_sample import MIN_BAGS, SampledBag, bag_sample
from robot_energy.advice.claims import LONG_REST
from robot_energy.advice.evidence import DEGC_BINS, RecordedEvidence, RecordedRest
from robot_energy.api.replay import ReplayOptions
from robot_energy.errors import DatasetError
from robot_energy.fleet.dataset import read_tables
from robot_energy.fleet.tables import counted_twice
from robot_energy.model import RobotModel
from robot_energy.report.formats import counted
from robot_energy.units import HOUR_NS

FULL = 0.99  # of an hour in standby: it was one rest


def dataset_evidence(
    folder: str | Path, model: RobotModel, options: ReplayOptions | None = None
) -> tuple[RecordedEvidence, list[SampledBag]]:
    """Return what a dataset shows of the robots with one model, and bags to look at again.

    How often a robot rested within an hour is not in it: hours that were all standby are one rest
    with their neighbours, standby in others is taken as rests of `LONG_REST`, the shortest that
    count as standby, so that no state is claimed to pay that might not.

    Args:
        folder: Of the dataset.
        model: Of the robots.
        options: With which bags are looked at, before those of the dataset.

    Raises:
        DatasetError: If there is none, or no bag of this model in it.
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
    sample, without_inputs = bag_sample(folder, keys, options or {})
    largest = runs.sort("grid_energy", "bag", descending=[True, False])["bag"][0]
    bags = (
        f"{len(sample)} of its {len(runs)} bags are looked at, spread over robots and time; "
        "the bands hold how much they differ"
        if sample
        else f"name bags instead, such as {largest}, which took most energy: fewer than {MIN_BAGS} "
        "are where they were and can be read again"
    )
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
            "a dataset cannot separate short and long rests within an hour",
            f"a dataset holds sums: for warm-up, speeds and waiting poses {bags}",
        ],
    )
    if without_inputs:
        found.notes.append(
            f"not looked at: {counted(without_inputs, 'bag')} replayed with a file of "
            "inputs, which a dataset does not keep; name bags instead, and that file with --inputs"
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
