"""Tables of small generated fleets."""

from functools import cache

from robot_energy.fleet.tables import FleetTables, write_tables
from robot_energy_papers.fleet_study import fleet_tables
from robot_energy_papers.generated_fleet import FleetPlan


@cache
def fleet(robots, faults=True) -> FleetTables:
    """A week of some robots; with faults one has another payload, one stands by at night."""
    return fleet_tables(FleetPlan(robots=robots, weeks=1, seed=3, faults=faults))


def dataset(folder, robots, faults=True):
    """The same on disk."""
    write_tables(fleet(robots, faults), folder)
    return folder
