"""Small generated fleets, as tables and as datasets."""

from contextlib import contextmanager
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

import fleet_study
import polars as pl
import pytest
from fleet_study import fleet_tables

from robot_energy_fleet.dataset import Dataset, RowKey, row_bytes
from robot_energy_fleet.tables import TABLES, FleetTables
from robot_energy_rig import virtual_rig
from robot_energy_studies import generated_fleet
from robot_energy_studies.generated_fleet import FleetPlan


def fleet(robots, faults=True, days=5, cycles=3, pause=20.0) -> FleetTables:
    """A week of some robots; with faults one has another payload, one stands by at night."""
    return _fleet(robots, faults, days, cycles, pause)


@cache
def _fleet(robots, faults, days, cycles, pause) -> FleetTables:
    with short_bags(days, cycles, pause):
        return fleet_tables(FleetPlan(robots=robots, weeks=1, seed=3, faults=faults))


@contextmanager
def short_bags(days, cycles=3, pause=20.0):
    """Bags of so many cycles while this lasts, on so many days of a week; rarely sampled.

    Each is made and read in one step, and ends with a pause of at most so many seconds.
    Temperatures are held for ten seconds: at night the rig would take one step for two samples.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(generated_fleet, "CYCLES", cycles)
        patch.setattr(generated_fleet, "WORKDAYS", days)
        patch.setattr(generated_fleet, "RATE", 25.0)
        patch.setattr(generated_fleet, "MAX_PAUSE", pause)
        patch.setattr(generated_fleet, "NIGHT_RATE", 1.0)
        patch.setattr(virtual_rig, "BLOCK", 10.0)
        patch.setattr(fleet_study, "STEP", 3600.0)
        yield


def dataset(folder, robots, faults=True, days=5, pause=20.0) -> Path:
    """The same as the dataset of `fleet run`."""
    return written(folder, fleet(robots, faults, days, pause=pause))


def written(folder, tables) -> Path:
    """Tables as a dataset."""
    parts = {
        name: getattr(tables, name).partition_by("key", as_dict=True)
        for name in TABLES
        if hasattr(tables, name)
    }
    place = Dataset(folder)
    for run in tables.runs.iter_rows(named=True):
        name = f"{run['key']:0>8}-0-0"
        date = datetime.fromtimestamp(run["start_ns"] // 10**9, UTC).date().isoformat()
        row = exact(run) | {"name": name, "date": date}
        for table, own in parts.items():
            rows = own.get((run["key"],), pl.DataFrame()).iter_rows(named=True)
            known = TABLES[table]
            row[table] = [{k: v for k, v in exact(one).items() if k in known} for one in rows]
        place.add(RowKey(*map(row.get, RowKey._fields)), date, row_bytes(row))
    place.pack()
    return Path(folder)


def exact(row) -> dict:
    """A row with energies and times as the whole numbers of a dataset."""
    found = {}
    for name, value in row.items():
        if "_energy" in name:
            name = name.replace("grid", "predicted_import").replace("energy", "microjoule")
            value = None if value is None else round(value * 1e6)
        elif name.endswith("_time") and "joint" not in row:
            name, value = f"{name[:-4]}ns", None if value is None else round(value * 1e9)
        found[name] = value
    return found
