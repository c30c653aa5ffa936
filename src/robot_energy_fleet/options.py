"""Options of the verbs about many bags: fleet run, advise."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from robot_energy.foundation.described import documented
from robot_energy.foundation.options import Option
from robot_energy.replay.options import ReadOptions, ReplayOptions

if TYPE_CHECKING:
    from robot_energy_fleet.fleet_run import FleetRun
    from robot_energy_plan.optimization.rest_states import RestState

WHERE, YEAR = "where it runs", "a year"


# fmt: off
@documented
class FleetOptions(ReadOptions, total=False):
    """How many bags are replayed, and how they are read; all may be left out."""

    name: Annotated[str | None, Option(
        "name of the robot in the fleet (default: that of the folder in which a recording lies); "
        "a column 'robot' of a table overrides it", value="NAME")]
    split_files: Annotated[bool, Option(
        "each MCAP file is a bag of its own, also in the folder of a split recording",
        default=False)]
    history: Annotated[str | Path | None, Option(
        "write what each robot used in each minute and job to a history as well, for "
        "`robot-energy history`; no recorder may write to it meanwhile", value="FOLDER")]
    scheduler: Annotated[str | None, Option(
        "address of a Dask scheduler, such as tcp://10.0.0.5:8786", value="URL", group=WHERE)]
    workers: Annotated[int | None, Option(
        "processes on this host (default: one for each core; 0: in this process, one bag after "
        "the other)", unit="1", group=WHERE)]
    memory: Annotated[str, Option(
        "memory of each process at most (default 2GB)", value="SIZE", default="2GB", group=WHERE)]
    progress: Annotated["Callable[[FleetRun], None]", "Called after each bag."]


@documented
class AdviseOptions(ReplayOptions, total=False):
    """What a saving is computed from, and how bags are read; all may be left out."""

    rest_states: Annotated["str | Path | Sequence[RestState] | None", Option(
        "power of standby and hibernation of this robot (default: assumed figures)",
        value="FILE")]
    look_at_speeds: Annotated[bool, Option(
        "whether other speeds are looked for, which takes longest", default=True)]
    hours_per_day: Annotated[float | None, Option(
        "hours a day of such work, all robots together (default: as recorded, where the "
        "recordings span a day)", unit="h", low=0.0, high=1e6, group=YEAR)]
    days_per_year: Annotated[float | None, Option(
        "days a year of such work (default: 365, where the recordings span a week); without hours "
        "and days no saving a year is stated", unit="d", low=0.0, high=366.0, group=YEAR)]
    price: Annotated[float | None, Option(
        "price of a kWh", unit="currency/kWh", value="X", low=0.0, high=1e6, group=YEAR)]
    currency: Annotated[str, Option(
        "currency of the price (default EUR)", value="NAME", default="EUR", group=YEAR)]
    co2: Annotated[float | None, Option(
        "emission factor [kg/kWh]", unit="kg/kWh", value="KG", low=0.0, high=100.0, group=YEAR)]
# fmt: on
