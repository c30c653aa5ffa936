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

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from robot_energy.foundation.shown_text import shown
from robot_energy_cli.command import REQUIRED, Command, Options, flags, positive
from robot_energy_cli.replay_arguments import DAMAGED, options_given, replay_options
from robot_energy_cli.terminal import (
    JSON_OPTION,
    check_outputs,
    console,
    progress,
    write_json,
    wrote,
)
from robot_energy_fleet.options import WHERE, FleetOptions

if TYPE_CHECKING:
    from robot_energy_fleet.bag_list import FleetBag, FleetModels
    from robot_energy_fleet.fleet_run import FleetRun
    from robot_energy_fleet.results.fleet import FleetRunReport

SHOWN = 10  # reasons, and damaged bags
PACKED_WATCHING = 64  # rows of a robot and day that are merged while watching
LOG_EVERY = 30.0  # between two lines without a terminal [s]
OPTIONS: Options = {
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


def _run(args: Namespace) -> int:
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


COMMAND = Command.of(__doc__, _run, OPTIONS)
