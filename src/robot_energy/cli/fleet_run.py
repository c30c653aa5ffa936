"""`robot-energy fleet run`: replay many bags into one dataset."""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING, Any

from robot_energy.cli.numbers import positive
from robot_energy.cli.replay_options import add_jobs, add_replay, options_of
from robot_energy.cli.terminal import add_command, console, progress
from robot_energy.shown_text import shown

if TYPE_CHECKING:
    from robot_energy.fleet.bag_list import FleetBag, FleetModels
    from robot_energy.fleet.run import FleetRun

DESCRIPTION = """\
Replay many bags, one task each, and put one row of each into a dataset of Parquet files by
robot and date. What the dataset holds unchanged is not done again, so a run that was stopped
is continued by the same command. A bag that cannot be used becomes a row with the reason.

Bags are those of a folder, of a pattern ("/bags/2026-*/*"), or of a CSV table with the columns
bag, model, robot, programme, shift, jobs, effort (bag is needed). Addresses may be URLs such as
s3://recordings/2026 where their fsspec package is installed.
"""
EPILOG = """\
examples:
  robot-energy fleet run /bags --model kr16 --out energy
  robot-energy fleet run bags.csv --out energy --workers 8
  robot-energy fleet run s3://recordings/hall3 --model hall3.yaml --out energy \\
      --scheduler tcp://10.0.0.5:8786
  robot-energy fleet run /bags --model kr16 --out energy --watch 30
"""
SHOWN = 10  # reasons
PACKED_WATCHING = 64  # rows of a robot and day that are merged while watching
LOG_EVERY = 30.0  # between two lines where there is no terminal [s]


def add_parser(commands: Any) -> None:
    """Add the sub-command.

    Args:
        commands: Of `robot-energy fleet`.
    """
    text = "replay many bags into one dataset"
    parser = add_command(commands, "run", run, text, DESCRIPTION, EPILOG)
    parser.add_argument("bags", metavar="FOLDER|PATTERN|CSV", help="where the bags are")
    parser.add_argument("--out", required=True, metavar="DATASET", help="folder of the dataset")
    parser.add_argument(
        "--name", metavar="NAME", help="name of the robot in the fleet (default: that of the "
        "folder in which a bag lies); a column 'robot' of a table goes before",
    )  # fmt: skip
    parser.add_argument(
        "--split-files",
        action="store_true",
        help="each MCAP file is a bag of its own, also in the folder of a split recording",
    )
    parser.add_argument(
        "--watch",
        metavar="S",
        type=positive,
        help="look again every so many seconds for new bags, until stopped; what is still being "
        "written is left until it is complete",
    )
    where = parser.add_argument_group("where it runs")
    where.add_argument("--scheduler", metavar="URL", help="of Dask, such as tcp://10.0.0.5:8786")
    where.add_argument(
        "--workers",
        metavar="N",
        type=int,
        help="processes on this host (default: one for each core; 0: in this process, one bag "
        "after the other)",
    )
    where.add_argument(
        "--memory", metavar="SIZE", default="2GB", help="of each at most (default 2GB)"
    )
    where.add_argument(
        "--scratch",
        metavar="GB",
        type=positive,
        default=20.0,
        help="size up to which a bag from a URL is copied to the host that replays it (default 20)",
    )
    add_jobs(parser)
    add_replay(parser, fixed=False)


def run(args: Namespace) -> int:
    """Replay what the dataset does not hold.

    Args:
        args: Of the sub-command.

    Returns:
        0, or 3 if a bag could not be used.

    Raises:
        RobotEnergyError: If bags, models or dataset cannot be used.
    """
    from robot_energy.cli.replay_options import DAMAGED
    from robot_energy.fleet.bag_list import FleetModels
    from robot_energy.fleet.dataset import Dataset
    from robot_energy.fleet.run import FleetRun, in_turn, on_dask, run_fleet

    begun, models, dataset = time.monotonic(), FleetModels(), Dataset(args.out)
    bags = None if args.watch else _bags(args, models)
    scratch = int(args.scratch * 1e9)
    done = FleetRun()
    with dataset.locked():
        nothing = bags is not None and all(dataset.has(bag.name) for bag in bags)
        if nothing or (args.workers == 0 and args.scheduler is None):
            pool = nullcontext(in_turn(scratch))
        else:
            pool = on_dask(args.scheduler, args.workers or _cores(), args.memory, scratch)
        with pool as replays:
            for round_ in [bags] if bags is not None else _rounds(args, models):
                if args.watch:
                    done.bags = done.there = 0
                with _shown(round_, done) as show:
                    run_fleet(round_, models.models, dataset, replays, done, show)
                dataset.pack(PACKED_WATCHING if args.watch else 2)
    _print(args, done, time.monotonic() - begun)
    return DAMAGED if done.refused else 0


def _cores() -> int:
    import os

    return len(os.sched_getaffinity(0))


def _bags(args: Namespace, models: FleetModels) -> list[FleetBag]:
    from robot_energy.fleet.bag_list import list_bags
    from robot_energy.presets import ROBOTS

    model = ROBOTS[args.robot].model_or(args.model) if args.robot else args.model
    options = options_of(args)
    watched = args.watch is not None
    return list_bags(args.bags, models, model, options, args.name, args.split_files, watched)


def _rounds(args: Namespace, models: FleetModels) -> Iterator[list[FleetBag]]:
    """The complete bags, again and again."""
    while True:
        yield _bags(args, models)
        time.sleep(args.watch)


@contextmanager
def _shown(
    bags: list[FleetBag], done: FleetRun
) -> Generator[Callable[[FleetRun], None], None, None]:
    """A bar with the time left on a terminal; else a line every half minute."""
    whole, before = max(1, sum(bag.place.size for bag in bags)), done.done_size
    begun = last = time.monotonic()
    skipped = 0
    tty = sys.stderr.isatty() and sys.stdout.isatty()
    with progress(f"replaying {len(bags)} bags") as bar:

        def show(now: FleetRun) -> None:
            nonlocal last, skipped, begun
            share = (now.done_size - before) / whole
            bar(share)
            if now.there and not now.read and not now.refused:
                skipped, begun = now.done_size - before, time.monotonic()
            elapsed = time.monotonic() - begun
            if tty or time.monotonic() - last < LOG_EVERY or share * whole <= skipped:
                return
            last = time.monotonic()
            left = elapsed * (whole * (1.0 - share)) / (share * whole - skipped)
            count = now.there + now.read + len(now.refused)
            print(f"{count} of {len(bags)} bags, {share:.0%}, {_time(left)} left", file=sys.stderr,
                  flush=True)  # fmt: skip

        yield show


def _time(seconds: float) -> str:
    minutes = round(seconds / 60.0)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min"


def _print(args: Namespace, done: FleetRun, elapsed: float) -> None:
    from robot_energy.fleet.run import why_refused

    out = console()
    out.print(
        f"{done.bags} bags: {done.read} replayed, {done.there} there already, "
        f"{len(done.refused)} refused; dataset {shown(args.out)}",
        soft_wrap=True,
    )
    if done.read:
        hours = done.observed_time / 3600.0
        out.print(
            f"{hours:.3f} recorded hours in {elapsed:.1f} s ({done.observed_time / elapsed:.0f} "
            f"recorded seconds per second); {done.written / 1e3 / max(hours, 1e-9):.0f} kB of rows "
            f"per recorded hour; most memory of a worker {done.peak_memory / 1e6:.0f} MB",
            soft_wrap=True,
        )
    for reason, count in why_refused(done)[:SHOWN]:
        out.print(f"  {count} refused: {reason}", soft_wrap=True)
