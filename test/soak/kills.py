"""An energy monitor that is killed (SIGKILL) at random moments, in motion, many times.

A wheel turns at 2 rad/s. Its friction, 0.5 + 0.02 x 20 N m at a motor that turns at
20 rad/s, takes 18 W; with constant losses of 20 W and 30 W that is 68 W from the grid at
every instant. So whatever was counted, and however often the monitor died meanwhile:

- energy = 68 W x observed time, or something was counted twice or at a wrong power;
- observed + gap time = time from the first to the last sample, exact in ns, or some time
  was counted twice or not at all;
- no published value that was marked as persisted is ever above what the files hold after
  the next kill, nor above a later one;
- what a kill loses is at most one checkpoint period, and what was still being booked.

Usage: ``python test/soak/kills.py [--kills N]``; also a run of ``make soak``.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import numpy as np
import rclpy
from figure import Figure
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from ros2_energy_msgs.msg import EnergyRegisters
from sensor_msgs.msg import JointState

from robot_energy.accounting.record import FORMAT_VERSION, AccountRecord
from robot_energy.foundation.errors import StateFileError
from robot_energy.model import save
from robot_energy.store.slots import unwrap
from robots import one_wheel
from ros2_energy_monitor.base.inbox import Inbox
from ros2_energy_monitor.base.publishers import reliable

MINUTES = (30.0, 1.5)

SPEED = 2.0  # rad/s
POWER = 68.0  # W, worked out above
RATE = 250  # joint states per second
PERIOD = 0.2  # between checkpoints [s]
DELAY = 1.0  # derivative, settling, ticks, syncing, on a machine that does much else [s]
YOUNG = 0.7  # share of the monitors that are killed in their first second, whatever they do
PATIENCE = 60.0  # s
SECOND_NS = 10**9
ISOLATED = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(HERE.parent / "loopback.xml"),  # no shared memory
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",  # a process with threads should not fork
}


def run(folder: str, quick: bool) -> list[Figure]:
    """Kill a thousand times, or fifty."""
    return kill(folder, 50 if quick else 1000)


def kill(folder: str, kills: int, harness_type: type[Harness] | None = None) -> list[Figure]:
    """Kill some times and return what was found."""
    os.environ.update(ISOLATED)
    os.environ.setdefault("ROS_DOMAIN_ID", str(os.getpid() % 100 + 1))
    rclpy.init()
    harness = (harness_type or Harness)(Path(folder))
    try:
        return harness.run(kills)
    finally:
        harness.close()
        rclpy.try_shutdown()


@dataclass
class Row:
    """What one message of the registers said."""

    end_ns: int
    start_ns: int
    energy: float
    observed: float
    persisted: bool


@dataclass
class Findings:
    """What went wrong, and how large it was."""

    unreadable: int = 0
    torn: int = 0
    regressions: int = 0
    in_memory: int = 0
    energy_error: float = 0.0
    losses: list[float] = field(default_factory=list)
    births: list[float] = field(default_factory=list)


class Harness:
    """Drives the wheel, kills the monitor and checks what it published and kept.

    Args:
        folder: For the model, the state files and the log of the monitors.
    """

    young = YOUNG

    def __init__(self, folder: Path) -> None:
        self._state = folder / "state"
        save(one_wheel(), folder / "wheel.yaml")
        self._arguments = (
            f"--ros-args --log-level error -p model:={folder / 'wheel.yaml'} "
            f"-p state_folder:={self._state} -p checkpoint_period:={PERIOD}"
        )
        self._node = Node("wheel")
        self._states = self._node.create_publisher(JointState, "joint_states", reliable(1000))
        self._inbox = Inbox(self._node, EnergyRegisters, "energy/registers", reliable(1000))
        self._log = (folder / "monitors.log").open("wb")
        self._nursery = subprocess.Popen(
            [sys.executable, str(HERE / "nursery.py")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
        )
        assert self._nursery.stdout is not None
        assert self._nursery.stdout.readline() == "ready\n"
        self._clock_ns = time.time_ns() - time.monotonic_ns()
        self._begun_ns = self._sent_ns = self._now_ns()
        self._offset_ns = 0  # of the stamps from the time of this machine
        self._rows: list[Row] = []
        self._moving = False  # whether this monitor has counted a sample of its own
        self._restored_ns = 0  # newest sample that was on disk at its birth
        self._deaths: list[int] = []
        self._random = random.Random(20)
        self.found = Findings()

    def run(self, kills: int) -> list[Figure]:
        """Let it live and die, then live once more."""
        begin = time.monotonic()
        while len(self._deaths) < kills:
            born, pid = self._bear()
            if self._random.random() < self.young:
                self._until(born + self._random.uniform(0.0, 1.0))
            else:
                self._wait_for_row(born)
                self._until(time.monotonic() + self._random.uniform(0.0, 3 * PERIOD))
            self._kill(pid)
        born, pid = self._bear()
        self._wait_for_row(born)
        self._until(time.monotonic() + 2 * PERIOD)
        os.kill(pid, signal.SIGTERM)
        self._wait(lambda: not alive(pid), "a clean end")
        self._drain()
        return self._figures(time.monotonic() - begin)

    def close(self) -> None:
        """End all processes."""
        assert self._nursery.stdin is not None
        self._nursery.stdin.close()
        self._nursery.wait()
        self._log.close()
        self._node.destroy_node()

    def _bear(self) -> tuple[float, int]:
        assert self._nursery.stdin is not None
        assert self._nursery.stdout is not None
        born = time.monotonic()
        self._nursery.stdin.write(f"{self._arguments}\n")
        self._nursery.stdin.flush()
        return born, int(self._nursery.stdout.readline())

    def _kill(self, pid: int) -> None:
        self._drain()
        os.kill(pid, signal.SIGKILL)
        died_ns = self._now_ns()
        self._wait(lambda: not alive(pid), "its end")
        self._deaths.append(died_ns)
        self._check_files(died_ns)

    def _wait_for_row(self, born: float) -> None:
        self._wait(lambda: self._moving, "registers of new samples on disk")
        self.found.births.append(time.monotonic() - born)

    def _now_ns(self) -> int:
        return time.monotonic_ns() + self._clock_ns

    def _wait(self, condition: Callable[[], bool], what: str) -> None:
        limit = time.monotonic() + PATIENCE
        while not condition():
            if time.monotonic() > limit:
                raise TimeoutError(f"waited {PATIENCE:g} s in vain for {what}")
            self._move()

    def _until(self, moment: float) -> None:
        while time.monotonic() < moment:
            self._move()

    def _move(self) -> None:
        """Publish the joint states that are due, and take what came back."""
        now_ns = self._now_ns()
        while self._sent_ns + SECOND_NS // RATE <= now_ns:
            self._sent_ns += SECOND_NS // RATE
            message = JointState(
                name=["axle"],
                position=[SPEED * (self._sent_ns - self._begun_ns) * 1e-9],
                velocity=[SPEED],
            )
            stamp_ns = self._sent_ns + self._offset_ns
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, SECOND_NS)
            self._states.publish(message)
        self._drain()
        time.sleep(0.004)

    def _drain(self) -> None:
        batch = self._inbox.drain()
        for index in range(0 if batch is None else len(batch)):
            message: Any = deserialize_message(batch.row(index), EnergyRegisters)
            row = Row(
                nanoseconds(message.header.stamp),
                nanoseconds(message.energy_start),
                message.predicted_import_energy,
                message.observed_time,
                message.persisted,
            )
            self._check_row(row)
            self._rows.append(row)

    def _check_row(self, row: Row) -> None:
        found, before = self.found, self._last_kept()
        found.energy_error = max(found.energy_error, abs(row.energy - POWER * row.observed))
        if not row.persisted:
            found.in_memory += 1
            return
        self._moving |= row.end_ns > self._restored_ns
        if before is None:
            return
        fell = row.energy < before.energy or row.end_ns < before.end_ns
        found.regressions += fell or row.start_ns != before.start_ns

    def _last_kept(self) -> Row | None:
        return next((row for row in reversed(self._rows) if row.persisted), None)

    def _check_files(self, died_ns: int) -> None:
        """Read the slots as the next monitor will, and compare with what was published."""
        records = []
        for path in self._slots():
            try:
                sequence, payload = unwrap(FORMAT_VERSION, path.read_bytes())
                records.append((sequence, AccountRecord.from_json(payload)))
            except StateFileError:
                self.found.torn += 1
        kept = self._last_kept()
        if not records:
            self.found.unreadable += kept is not None
            return
        _, newest = max(records, key=lambda entry: entry[0])
        energy = newest.totals.cabinet_energy_microjoule["grid_import"] * 1e-6
        if kept is not None:
            self.found.regressions += energy < kept.energy - 1e-9 * kept.energy
        if newest.end_ns is not None:
            if self._moving:
                self.found.losses.append((died_ns - newest.end_ns) * 1e-9)
            self._moving, self._restored_ns = False, newest.end_ns

    def _figures(self, lasted: float) -> list[Figure]:
        found, kills = self.found, len(self._deaths)
        record = self._final_record()
        totals = record.totals
        assert record.end_ns is not None
        assert record.energy_start_ns is not None
        span_ns = record.end_ns - record.energy_start_ns
        unaccounted = span_ns - totals.observed_ns - totals.gap_ns
        energy = totals.cabinet_energy_microjoule["grid_import"] * 1e-6
        most = POWER * (self._sent_ns - self._begun_ns) * 1e-9
        aside = len(list(self._state.glob("*.bad-*")))
        tolerance = 1e-9 * energy + 2e-6
        losses = np.array(found.losses)
        births = np.array(found.births)
        persisted = sum(row.persisted for row in self._rows)
        bound = PERIOD + DELAY
        return [
            Figure("kills", kills),
            Figure("kills per minute", round(60 * kills / lasted, 1)),
            Figure("registers seen, on disk", persisted, "more than kills", persisted > kills / 2),
            Figure("registers seen, in memory only", found.in_memory),
            Figure("states that could not be read", found.unreadable, "0", not found.unreadable),
            Figure("slots torn by a kill, set aside", f"{found.torn}, {aside}"),
            Figure(
                "values below what had been published", found.regressions, "0",
                not found.regressions,
            ),
            Figure(
                "energy less 68 W x observed time [J]", f"{found.energy_error:.1e}",
                f"below {tolerance:.1e}", found.energy_error <= tolerance,
            ),
            Figure("energy [J]", round(energy, 3), f"below {most:.3f}", 0 < energy < most),
            Figure("span less observed and gap time [ns]", unaccounted, "0", unaccounted == 0),
            Figure(
                "restarts on record", record.restarts, "over a quarter", record.restarts > kills / 4
            ),
            Figure("observed share [%]", round(100 * totals.observed_ns / span_ns, 1)),
            Figure("lost by a kill, median [s]", round(float(np.median(losses)), 3)),
            Figure(
                "the same, worst [s]", round(float(losses.max()), 3),
                f"below {bound:g}", bool(losses.max() <= bound),
            ),
            Figure("birth to new registers, median [s]", round(float(np.median(births)), 2)),
            Figure("the same, worst [s]", round(float(births.max()), 2)),
        ]  # fmt: skip

    def _final_record(self) -> AccountRecord:
        states = [unwrap(FORMAT_VERSION, path.read_bytes()) for path in self._slots()]
        return AccountRecord.from_json(max(states)[1])

    def _slots(self) -> list[Path]:
        """The files of the registers; what is learned has files of another format."""
        return [path for path in self._state.glob("*.state") if "-learned-" not in path.name]


def nanoseconds(stamp: Any) -> int:
    """Return a ROS time as an integer."""
    return int(stamp.sec) * SECOND_NS + int(stamp.nanosec)


def alive(pid: int) -> bool:
    """Return whether a process runs; what is dead but not yet reaped does not."""
    with suppress(FileNotFoundError, ProcessLookupError):
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    return False


def main() -> int:
    """Print the figures; the exit code is 1 if a goal was missed."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kills", type=int, default=1000)
    kills = parser.parse_args().kills
    with tempfile.TemporaryDirectory(prefix="kills_") as folder:
        figures = kill(folder, kills)
    for figure in figures:
        verdict = "" if not figure.goal else "yes" if figure.reached else "NO"
        print(f"{figure.what:46} {figure.value!s:>14}  {figure.goal:18} {verdict}")
    return 0 if all(figure.reached for figure in figures) else 1


if __name__ == "__main__":
    sys.exit(main())
