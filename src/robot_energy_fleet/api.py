"""Fleets: many bags into one dataset, its report, and one friction model from it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Unpack

from robot_energy.foundation.options import takes
from robot_energy.model import RobotModel
from robot_energy.presets import ROBOTS
from robot_energy.replay.options import ReadOptions
from robot_energy.replay.setup import ModelName, model_of
from robot_energy_fleet import report
from robot_energy_fleet.bag_list import FleetModels, list_bags
from robot_energy_fleet.dataset import Dataset, read_tables
from robot_energy_fleet.fleet_run import open_history, run_fleet, where_asked
from robot_energy_fleet.identify import identify_fleet
from robot_energy_fleet.options import FleetOptions
from robot_energy_fleet.results.fleet import FleetFriction, FleetReport, FleetRunReport
from robot_energy_identify.api.identify import IdentificationResult
from robot_energy_identify.stats.systematic import DEFAULT_LIMITS, SensorLimits
from robot_energy_report.page.settings import load_settings


@takes(FleetOptions)
def fleet_run(
    bags: str | Path,
    out: str | Path,
    model: ModelName | None = None,
    **options: Unpack[FleetOptions],
) -> FleetRunReport:
    """Replay many bags into one dataset: those that it does not hold yet.

    Args:
        bags: Folder, pattern, bag, or CSV table of bags.
        out: Folder of the dataset.
        model: Of bags for which a table names none: the model, its file, or the name of a
            shipped one.
        **options: How bags are replayed and read: see `FleetOptions`.

    Returns:
        What was done, with the bags that could not be used or were read in part.

    Raises:
        DatasetError: If bags or dataset cannot be used, or the scheduler is lost.
        RobotEnergyError: If a model cannot be used.
    """
    models, dataset = FleetModels(), Dataset(out)
    named = models.add(model) if isinstance(model, RobotModel) else model and str(model)
    if robot := options.get("robot"):
        named = ROBOTS[robot].model_or(named)
    read = {name: one for name, one in options.items() if name in ReadOptions.__annotations__}
    split = options.get("split_files", False)
    listed = list_bags(str(bags), models, named, read, options.get("name"), split)
    where = options.get("scheduler"), options.get("workers"), options.get("memory", "2GB")
    progress = options.get("progress", lambda done: None)
    with (
        dataset.locked(),
        open_history(options.get("history")) as store,
        where_asked(*where) as replays,
    ):
        done = run_fleet(listed, models.models, dataset, replays, progress=progress, history=store)
        dataset.pack()
    return done.report(dataset)


def fleet_report(
    dataset: str | Path,
    page_settings: str | Path | None = None,
    shifts: Sequence[int] = report.SHIFTS,
) -> FleetReport:
    """Report on the dataset of a fleet: energy, standby, model error, wear, unlike robots.

    Args:
        dataset: Folder that `fleet_run` wrote.
        page_settings: File of prices and emissions; None for none.
        shifts: Hours of the day, local time, at which a shift begins; rising. [h]

    Returns:
        The report.

    Raises:
        RobotEnergyError: If dataset or settings cannot be used.
    """
    settings = load_settings(str(page_settings or ""))
    return report.fleet_report(read_tables(dataset), str(dataset), settings, shifts)


def fleet_identify(
    dataset: str | Path, model: ModelName, *, sensors: SensorLimits = DEFAULT_LIMITS
) -> IdentificationResult[FleetFriction]:
    """Identify one friction model from all bags of a fleet, through the sums of its dataset.

    Args:
        dataset: Folder that `fleet_run` wrote.
        model: With which its bags were run: the model, its file, or the name of a shipped one.
        sensors: Limits of the constant errors of the sensors.

    Returns:
        Laws per axis with held-out errors, and the model with them.

    Raises:
        NotIdentifiableError: If no bag was run with this model, or no joint moves enough.
        ImplausibleIdentificationError: If what was found contradicts physics.
        RobotEnergyError: If dataset or model cannot be used.
    """
    tables = read_tables(dataset)
    found, written = identify_fleet(tables, model_of(model), str(dataset), sensors)
    return IdentificationResult(written, found)
