"""A fleet on Dask: same bits with any number of workers and with kills, overhead, gain, memory.

Run it with ``python test/bench/fleet.py`` (``--bags 2000`` for the long form). Bags are links to
a bundled one. Repeat workers, as in ``--workers 1 2 1 2``, to compare with the last run of one
worker: what else the machine does changes from minute to minute. Times are without the start of
the workers, whose imports are done before.
"""

from __future__ import annotations

import os
import random
import signal
import sys
import tempfile
import threading
import time
from argparse import ArgumentParser
from contextlib import suppress
from pathlib import Path
from statistics import median
from typing import Any

import psutil

from robot_energy_fleet.bag_list import FleetBag, FleetModels, list_bags
from robot_energy_fleet.dataset import Dataset
from robot_energy_fleet.fleet_run import FleetRun, Replays, in_turn, on_dask, run_fleet

BAG = Path(__file__).resolve().parents[2] / "bags" / "kr16_warm"
ROBOTS = 20
WARM_UP = 8  # bags
GROUP = 100  # bags between two looks at the clock
LONGEST_LIFE = 8.0  # of a worker until the next one is killed [s]


def content(folder: Path) -> dict[str, bytes]:
    """All files of a dataset."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*.parquet")}


def linked(folder: Path, count: int) -> None:
    """So many bags of `ROBOTS` robots."""
    for number in range(count):
        target = folder / f"r{number % ROBOTS:02d}" / f"bag{number:06d}"
        target.mkdir(parents=True)
        for file in BAG.iterdir():
            os.link(file, target / file.name)


def processor_time() -> float:
    """Of this process and its children that live. [s]"""
    own = psutil.Process()
    total = 0.0
    for one in (own, *own.children(recursive=True)):
        with suppress(psutil.NoSuchProcess):  # a worker may have ended since
            times = one.cpu_times()
            total += times.user + times.system
    return total


class Bench:
    """The bags and where datasets go."""

    def __init__(self, folder: Path, count: int) -> None:
        self.folder, self.models = folder, FleetModels()
        linked(folder / "hall", count)
        options = {"effort": "motor_torque"}
        self.bags: list[FleetBag] = list_bags(str(folder / "hall"), self.models, "kr16", options)

    def run(
        self, name: str, replays: Replays, bags: list[FleetBag] | None = None
    ) -> tuple[float, float, FleetRun]:
        """Replay bags into a dataset; time and processor time in s, and what was done."""
        dataset, models = Dataset(self.folder / name), self.models.models
        begun, worked = time.perf_counter(), processor_time()
        done = run_fleet(bags or self.bags, models, dataset, replays)
        elapsed, worked = time.perf_counter() - begun, processor_time() - worked
        dataset.pack()
        return elapsed, worked, done

    def overhead(self, replays: Replays) -> tuple[float, float]:
        """Time and processor time of one worker over those in turn; medians over groups of bags.

        Groups alternate, so that what else the machine does meets both.
        """
        ratios: list[tuple[float, float]] = []
        size = min(GROUP, len(self.bags))
        for first in range(0, len(self.bags) - size + 1, size):
            bags = self.bags[first : first + size]
            there = self.run(f"group{first}", replays, bags)
            turn = self.run(f"group{first}turn", in_turn(), bags)
            ratios.append((there[0] / turn[0], there[1] / turn[1]))
        return median(one for one, _ in ratios), median(one for _, one in ratios)

    def warm(self, replays: Replays) -> None:
        """Let the workers import and compile what they need."""
        for _ in replays(iter(self.bags[:WARM_UP]), self.models.models):
            pass


def killer(stop: threading.Event, kills: list[int], most: int, seed: int) -> None:
    """Kill a worker at random moments."""
    dice = random.Random(seed)
    while len(kills) < most and not stop.wait(dice.uniform(0.0, LONGEST_LIFE)):
        own = psutil.Process().children(recursive=True)
        victims = [one.pid for one in own if "spawn_main" in " ".join(_words(one))]
        if victims:
            victim = dice.choice(victims)
            with suppress(ProcessLookupError):
                os.kill(victim, signal.SIGKILL)
                kills.append(victim)


def _words(process: Any) -> list[str]:
    try:
        return process.cmdline()
    except psutil.Error:
        return []


def main() -> int:
    """Print all figures; the exit code is 1 if a dataset differs by a bit."""
    parser = ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--bags", type=int, default=200, help="default 200")
    parser.add_argument(
        "--workers",
        type=int,
        nargs="+",
        default=[1, 2, 4],
        help="default 1 2 4; one by one, in this order",
    )
    parser.add_argument("--kills", type=int, default=20, help="default 20; 0: none")
    args = parser.parse_args()
    sound = True
    with tempfile.TemporaryDirectory() as place:
        bench = Bench(Path(place), args.bags)
        bench.warm(in_turn())
        base, worked, done = bench.run("sequential", in_turn())
        wanted = content(bench.folder / "sequential")
        hours = done.observed_time / 3600.0
        size = sum(map(len, wanted.values()))
        load = os.getloadavg()[0]
        print(f"{args.bags} bags, {hours:.2f} recorded hours, load of the machine {load:.1f}")
        print(f"in turn: {base:.1f} s, {worked:.1f} s of processor, "
              f"{done.observed_time / worked:.0f} recorded s per s of processor, "
              f"{done.peak_memory / 1e6:.0f} MB")  # fmt: skip
        print(f"dataset: {size / 1e3:.0f} kB, {size / 1e3 / hours:.0f} kB per recorded hour, "
              f"{size / 1e3 / args.bags:.1f} kB per bag, {len(wanted)} files")  # fmt: skip
        alone, over = None, None
        gains: dict[int, list[float]] = {}
        for place, workers in enumerate(args.workers):
            name = f"run{place}"
            with on_dask(workers=workers) as replays:
                bench.warm(replays)
                elapsed, _, done = bench.run(name, replays)
                first = workers == 1 and over is None
                over = bench.overhead(replays) if first else over
            equal = content(bench.folder / name) == wanted
            alone = elapsed if workers == 1 else alone or elapsed
            gains.setdefault(workers, []).append(alone / elapsed)
            sound &= equal
            print(f"{workers} workers: {elapsed:.1f} s, {alone / elapsed:.2f} x one, "
                  f"{done.peak_memory / 1e6:.0f} MB each at most, "
                  f"{'equal to the bit' if equal else 'DIFFERS'}")  # fmt: skip
            if first and over:
                print(f"scheduling, with one worker: {over[0] - 1.0:+.1%} on the clock, "
                      f"{over[1] - 1.0:+.1%} of processor time")  # fmt: skip
        for workers, found in gains.items():
            if len(found) > 1 and workers > 1:
                print(f"{workers} workers, median of {len(found)}: {median(found):.2f} x one")
        kills: list[int] = []
        rounds = 0
        while len(kills) < args.kills:
            stop, rounds = threading.Event(), rounds + 1
            with on_dask(workers=2) as replays:
                words = (stop, kills, args.kills, rounds)
                thread = threading.Thread(target=killer, args=words)
                thread.start()
                try:
                    bench.run(f"killed{rounds}", replays)
                finally:
                    stop.set()
                    thread.join()
            equal = content(bench.folder / f"killed{rounds}") == wanted
            sound &= equal
            print(f"{len(kills)} workers killed in {rounds} runs: "
                  f"{'equal to the bit' if equal else 'DIFFERS'}", flush=True)  # fmt: skip
        _, _, done = bench.run("sequential", in_turn())
        same = content(bench.folder / "sequential") == wanted
        sound &= same and not done.read
        print(f"second run: {done.read} replayed, {'nothing' if same else 'SOMETHING'} changed")
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
