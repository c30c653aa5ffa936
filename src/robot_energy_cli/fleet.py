"""Commands on many bags: `robot-energy fleet run`, `report`, `identify`, and `advise`."""

from __future__ import annotations

import sys
import time
from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from robot_energy.foundation.process_memory import keep_freed_memory
from robot_energy.foundation.shown_text import shown
from robot_energy_cli.command import LIST, REQUIRED, Command, Options, flags, keywords_of, positive
from robot_energy_cli.identify_inputs import SENSOR_OPTIONS, IdentifyInputs, result_options
from robot_energy_cli.replay_arguments import (
    BAG,
    DAMAGED,
    PAGE_SETTINGS,
    model_named,
    options_given,
    replay_options,
)
from robot_energy_cli.terminal import (
    JSON_OPTION,
    OUTPUTS,
    check_outputs,
    console,
    present,
    progress,
    write_json,
    wrote,
)
from robot_energy_fleet.options import WHERE, YEAR, AdviseOptions, FleetOptions

if TYPE_CHECKING:
    from robot_energy_fleet.bag_list import FleetBag, FleetModels
    from robot_energy_fleet.fleet_run import FleetRun
    from robot_energy_fleet.results.fleet import FleetRunReport

SHOWN = 10  # reasons, and damaged bags
PACKED_WATCHING = 64  # rows of a robot and day that are merged while watching
LOG_EVERY = 30.0  # between two lines where there is no terminal [s]

RUN_OPTIONS: Options = {
    "bags FOLDER|PATTERN|CSV": "where the bags are",
    "--out DATASET": ("folder of the dataset", REQUIRED),
    **flags(FleetOptions, ""),
    "--watch S": (
        "look for new bags again after this many seconds, until stopped; a bag that is still being "
        "written is replayed once it is complete",
        {"type": positive},
    ),
    **JSON_OPTION,
    WHERE: {
        **flags(FleetOptions, WHERE),
        "--scratch GB": (
            "size up to which a bag from a URL is copied to the host that replays it (default 20)",
            {"type": positive, "default": 20.0},
        ),
    },
    **flags(FleetOptions, "jobs"),
    **replay_options(fixed=False),
}


def _fleet_run(args: Namespace) -> int:
    r"""`robot-energy fleet run`: replay many bags into one dataset.

    Replay many bags, one task each, and put one row of each into a dataset of Parquet files by
    robot and date. Bags that the dataset holds unchanged are not replayed again, so the same
    command continues a run that was stopped. A bag that cannot be used becomes a row with the
    reason; what can be read of a damaged one counts.

    Bags are those of a folder, of a pattern ("/bags/2026-*/*"), or of a CSV table with the columns
    bag, model, robot, programme, shift, jobs, effort (bag is needed). Addresses may be URLs such as
    s3://recordings/2026 where their fsspec package is installed.

    examples:
      robot-energy fleet run /bags --model kr16 --out energy
      robot-energy fleet run bags.csv --out energy --workers 8
      robot-energy fleet run s3://recordings/hall3 --model hall3.yaml --out energy \
          --scheduler tcp://10.0.0.5:8786
      robot-energy fleet run /bags --model kr16 --out energy --watch 30
    """
    from robot_energy_fleet.bag_list import FleetModels
    from robot_energy_fleet.dataset import Dataset
    from robot_energy_fleet.fleet_run import FleetRun, open_history, run_fleet, where_asked

    check_outputs(args)
    models, dataset = FleetModels(), Dataset(args.out)
    bags = None if args.watch else _bags(args, models)
    scratch = int(args.scratch * 1e9)
    done = FleetRun()
    with dataset.locked(), open_history(args.history) as store:
        nothing = bags is not None and all(
            bag.place.problem is not None
            or (dataset.has(bag.name) and (store is None or store.has_bag(bag.name)))
            for bag in bags
        )
        where = (None, 0) if nothing else (args.scheduler, args.workers)
        with where_asked(*where, args.memory, scratch) as replays:
            for round_ in [bags] if bags is not None else _rounds(args, models):
                if args.watch:
                    done.bags = done.there = 0
                with _shown(round_, done) as show:
                    run_fleet(round_, models.models, dataset, replays, done, show, store)
                dataset.pack(PACKED_WATCHING if args.watch else 2)
                if args.json is not None:
                    write_json(args.json, done.report(dataset).to_dict())
    if args.json != "-":
        _print(args, done.report(dataset))
        if done.overlap_ns:
            console().print(
                f"  {done.overlap_ns / 3.6e12:.3f} h of these bags are in the history from others "
                "already, and are left out there"
            )
    return DAMAGED if done.refused or done.damaged else 0


def _bags(args: Namespace, models: FleetModels) -> list[FleetBag]:
    from robot_energy.presets import ROBOTS
    from robot_energy_fleet.bag_list import list_bags

    model = ROBOTS[args.robot].model_or(args.model) if args.robot else args.model
    options = options_given(args)
    watched = args.watch is not None
    return list_bags(args.bags, models, model, options, args.name, args.split_files, watched)


def _rounds(args: Namespace, models: FleetModels) -> Iterator[list[FleetBag]]:
    while True:
        yield _bags(args, models)
        time.sleep(args.watch)


@contextmanager
def _shown(
    bags: list[FleetBag], done: FleetRun
) -> Generator[Callable[[FleetRun], None], None, None]:
    """A bar with the time left on a terminal; else a line every half minute."""
    from robot_energy_report.formats import counted

    named, last = counted(len(bags), "bag"), time.monotonic()
    whole, before = max(1, sum(bag.place.size for bag in bags)), done.done_size
    tty = sys.stderr.isatty() and sys.stdout.isatty()
    with progress(f"replaying {named}") as bar:

        def show(now: FleetRun) -> None:
            nonlocal last
            bar((now.done_size - before) / whole)
            if not tty and time.monotonic() - last >= LOG_EVERY:
                last = time.monotonic()
                count = now.there + now.read + len(now.refused)
                print(f"{count} of {named}", file=sys.stderr, flush=True)

        yield show


def _print(args: Namespace, report: FleetRunReport) -> None:
    from robot_energy_fleet.fleet_run import why_refused
    from robot_energy_report.formats import counted, jobs_left_out

    out, time_ = console(), report.observed_time
    out.print(
        f"{counted(report.bags, 'bag')}: {report.replayed} replayed, {report.there} there already, "
        f"{len(report.refused)} refused, {len(report.damaged)} damaged or doubtful; "
        f"dataset {shown(args.out)}"
    )
    if report.replayed:
        hours = time_ / 3600.0
        out.print(
            f"{hours:.3f} recorded hours in {report.elapsed_time:.1f} s "
            f"({time_ / report.elapsed_time:.0f} recorded seconds per second); "
            f"{report.row_size / 1e3 / max(hours, 1e-9):.0f} kB of rows per recorded hour; "
            f"most memory of a worker {report.peak_memory / 1e6:.0f} MB"
        )
    for reason, count in why_refused(report.refused)[:SHOWN]:
        out.print(f"  {count} refused: {reason}")
    for bag in report.damaged[:SHOWN]:
        problems = "; ".join(bag.problems)
        out.print(f"  damaged or doubtful: {bag.bag}: {problems}")
    if more := len(report.damaged[SHOWN:]):
        out.print(f"  {more} more damaged or doubtful: see `robot-energy fleet report`")
    if report.jobs_left_out:
        out.print(f"  {jobs_left_out(report.jobs_left_out)}")
    if args.json is not None:
        wrote(out, args.json, "all figures as JSON")


RUN = Command.of(_fleet_run.__doc__, _fleet_run, RUN_OPTIONS)


def _hours(text: str) -> tuple[int, ...]:
    try:
        hours = tuple(int(part) for part in text.split(","))
    except ValueError:
        hours = ()
    if not hours or list(hours) != sorted(set(hours)) or not 0 <= hours[0] <= hours[-1] <= 23:
        raise ArgumentTypeError(f"'{text[:40]}' is not a rising list of hours such as 6,14,22")
    return hours


def _report(args: Namespace) -> int:
    """`robot-energy fleet report`: energy and condition of a fleet.

    Report on the dataset of a fleet: energy of robots, programmes and shifts, standby and its cost,
    the error of the model by temperature, friction over temperature and time, and robots that
    differ from their sisters at equal temperature or have changed: wear, a wrong payload, standby;
    with how sure that is.

    examples:
      robot-energy fleet report dataset
      robot-energy fleet report dataset --html fleet.html --page-settings prices.yaml
      robot-energy fleet report dataset --json report.json
    """
    from robot_energy_fleet.dataset import read_tables
    from robot_energy_fleet.report import fleet_report
    from robot_energy_report.formats import counted
    from robot_energy_report.page.settings import load_settings

    check_outputs(args, [args.dataset, args.page_settings])
    settings = load_settings(args.page_settings or "")
    report = fleet_report(read_tables(args.dataset), args.dataset, settings, args.shifts)
    present(args, report, f"Fleet: {counted(len(report.robots), 'robot')}", settings=settings)
    return 0


REPORT_OPTIONS: Options = {
    "dataset": "folder that `fleet run` wrote",
    "--html/--report FILE": (
        "the report as one page: .html, or .pdf where a Chromium is installed",
        {"dest": "report"},
    ),
    **JSON_OPTION,
    "--shifts H,H,...": (
        "hours of the day, local time, at which shifts begin (default 6,14,22)",
        {"type": _hours, "default": (6, 14, 22)},
    ),
    **PAGE_SETTINGS,
}
REPORT = Command.of(_report.__doc__, _report, REPORT_OPTIONS)


def _identify(args: Namespace) -> int:
    """`robot-energy fleet identify`: one friction model from all bags.

    Identify one model of friction over temperature from all bags of a fleet, through the sums that
    `fleet run` has kept: no bag is read again. Robots that differ from their sisters, or have
    changed, are left out. Figures on the newest fifth of the bags, which their fit has not seen,
    say how good it is.

    example:
      robot-energy fleet identify dataset --model kr16 --out fleet.yaml
    """
    from robot_energy.model import load
    from robot_energy_fleet.dataset import read_tables
    from robot_energy_fleet.identify import identify_fleet
    from robot_energy_report.identification import friction_over_temperature

    IdentifyInputs(args).check_results()
    tables = read_tables(args.dataset)
    found, model = identify_fleet(
        tables, load(args.model), args.dataset, IdentifyInputs(args).sensor_limits()
    )
    present(
        args,
        found,
        "Friction of a fleet",
        f"Identified from {args.dataset}.",
        plot=lambda path: friction_over_temperature(found.axes, path, title=args.dataset),
        model=model,
    )
    return 0


IDENTIFY_OPTIONS: Options = {
    "dataset": "folder that `fleet run` wrote",
    "--model FILE|NAME": ("model file or shipped model with which the bags were run", REQUIRED),
    **SENSOR_OPTIONS,
    **result_options("this friction", "write the laws over temperature as a figure"),
}
IDENTIFY = Command.of(_identify.__doc__, _identify, IDENTIFY_OPTIONS)

ADVISE_OPTIONS: Options = {
    "recordings BAG|DATASET": (f"{BAG}; or the folder that `fleet run` wrote", LIST),
    **flags(AdviseOptions, "rest_states"),
    "--no-speeds": "do not look for other speeds, which takes longest",
    YEAR: flags(AdviseOptions, YEAR),
    "outputs": OUTPUTS,
    **replay_options(fixed=False),
}


def _advise(args: Namespace) -> int:
    """`robot-energy advise`: what would save how much energy, from recordings alone.

    Rank what would save energy, from recordings alone: standby in breaks and at night, a supply
    that returns braking energy, a warmer start, other speeds, other places to wait. Each has a 90 %
    band and says what it rests on; a saving smaller than its band is listed apart, as not proven.

    examples:
      robot-energy advise monday tuesday --model my_robot.yaml --price 0.25 --co2 0.38
      robot-energy advise dataset --model my_robot.yaml --report advice.html
      robot-energy advise bag --model m.yaml --rest-states states.yaml --hours-per-day 16
    """
    from robot_energy_fleet.advice.advise import advise

    named = model_named(args)
    check_outputs(args, [*args.recordings, named, args.inputs, args.rest_states])
    keep_freed_memory()
    with progress("reading recordings") as show:
        options: dict[str, Any] = keywords_of(advise, args) | {
            "look_at_speeds": not args.no_speeds,
            "progress": show,
        }
        found = advise(args.recordings, named, **options)
    present(
        args,
        found.report,
        "What would save energy",
        "From recordings alone, through the model of the robot. No change was tried.",
    )
    return DAMAGED if found.report.problems else 0


ADVISE = Command.of(_advise.__doc__, _advise, ADVISE_OPTIONS)
