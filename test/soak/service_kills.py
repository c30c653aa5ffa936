"""A monitor that is killed at random while services are called and the clock is stepped.

The wheel of `kills.py`. Meanwhile registers are reset, intervals opened and closed, and
payloads set, with the longest texts, with texts and numbers that are refused, at random; and
the stamps step: by an hour either way, to 1970 as after a start without a clock battery, and
back. So:

- what a service acknowledged as persisted is in the files after the next kill;
- no registers are below what was published with the same start, and no start comes back
  that a reset had ended;
- energy = 68 W x observed time, or something was counted twice or not at all.

Usage: ``python test/soak/service_kills.py [--kills N]``; also a run of ``make soak``.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from figure import Figure
from kills import PERIOD, POWER, SECOND_NS, Harness, Row, kill
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from ros2_energy_msgs.srv import CloseInterval, OpenInterval, ResetRegisters, SetPayload

from robot_energy.accounting.record import FORMAT_VERSION, AccountRecord
from robot_energy.foundation.errors import StateFileError
from robot_energy.store.slots import is_newer, unwrap

MINUTES = (45.0, 1.5)
HOSTILE = ("x" * 300_000, "a\n[ERROR] forged", "\x1b[2J", "", " ", "\U0001f916" * 201)
ANSWER = 0.25  # how long an answer is waited for [s]
HOUR_NS = 3600 * SECOND_NS


def run(folder: str, quick: bool) -> list[Figure]:
    """Kill a thousand times, or thirty."""
    return kill(folder, 30 if quick else 1000, ServiceHarness)


class ServiceHarness(Harness):
    """Calls services and steps the clock as well.

    Args:
        folder: For the model, the state files and the log of the monitors.
    """

    young = 0.2

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._caller = Node("caller")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._caller)
        self._clients = {
            kind: self._caller.create_client(kind, f"energy_monitor/{name}")
            for kind, name in (
                (ResetRegisters, "reset_registers"),
                (OpenInterval, "open_interval"),
                (CloseInterval, "close_interval"),
                (SetPayload, "set_payload"),
            )
        }
        self._call: tuple[Any, str, Any] | None = None  # kind, text, future
        self._patience = 0.0
        self._calls = 0
        self._acknowledged = self._refused = self._forgotten = self._wrong = 0
        self._open: dict[str, int] = {}  # acknowledged, and not asked to be closed
        self._reset = ""  # latest acknowledged reason
        self._starts: set[int] = set()  # those that a reset has ended
        self._start: int | None = None
        self._steps = 0

    def close(self) -> None:
        """End all processes."""
        self._executor.shutdown()
        self._caller.destroy_node()
        super().close()

    def _kill(self, pid: int) -> None:
        super()._kill(pid)
        if self._call is not None:
            self._clients[self._call[0]].remove_pending_request(self._call[2])
            self._call = None
        if self._random.random() < 0.5:
            self._step_clock()

    def _step_clock(self) -> None:
        self._steps += 1
        boot = 30 * SECOND_NS - self._now_ns()
        self._offset_ns = self._random.choice(
            [0, boot, self._offset_ns - HOUR_NS, self._offset_ns + HOUR_NS]
        )
        self._offset_ns = max(boot, min(self._offset_ns, 1000 * HOUR_NS))

    def _move(self) -> None:
        super()._move()
        self._executor.spin_once(timeout_sec=0)
        if self._call is not None:
            if self._call[2].done():
                self._take_answer()
            elif time.monotonic() > self._patience:  # sent to a monitor that was dead
                self._clients[self._call[0]].remove_pending_request(self._call[2])
                self._call = None
            return
        if self._moving and self._random.random() < 0.02:
            self._step_clock()
        kind = self._random.choice(list(self._clients))
        if not self._clients[kind].service_is_ready():
            return
        self._calls += 1
        hostile = self._random.random() < 0.3
        text = f"{self._calls:06}" + "\U0001f916" * self._random.choice([0, 94])
        text = self._random.choice(HOSTILE) if hostile else text
        if kind is CloseInterval and self._open and not hostile:
            text = self._random.choice(list(self._open))
            self._open.pop(text)  # from now on either is right
        request = kind.Request()
        if kind is ResetRegisters:
            request.reason = text
        elif kind is SetPayload:
            request.payload.header.frame_id = text if hostile else "disc"
            request.payload.inertia.m = self._random.choice([1e308, float("nan"), -1.0])
        else:
            request.name = text
        self._call = (kind, text, self._clients[kind].call_async(request))
        self._patience = time.monotonic() + ANSWER

    def _take_answer(self) -> None:
        assert self._call is not None
        kind, text, future = self._call
        self._call, answer = None, future.result()
        self._wrong += not answer.message.isprintable() or len(answer.message) > 5000
        if not answer.success:
            self._refused += 1
            return
        self._wrong += text in HOSTILE or kind is SetPayload
        if not answer.persisted:
            return
        self._acknowledged += 1
        if kind is ResetRegisters:
            self._reset = text
        elif kind is OpenInterval:
            self._open[text] = answer.interval.id

    def _check_row(self, row: Row) -> None:
        found, before = self.found, self._last_kept()
        found.energy_error = max(found.energy_error, abs(row.energy - POWER * row.observed))
        if not row.persisted:
            found.in_memory += 1
            return
        self._moving |= row.end_ns != self._restored_ns
        found.regressions += row.start_ns in self._starts
        if before is None:
            return
        if row.start_ns == before.start_ns:
            found.regressions += row.energy < before.energy
        else:
            self._starts.add(before.start_ns)

    def _check_files(self, died_ns: int) -> None:
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
        (sequence, newest), *others = records
        for other in others:
            if is_newer(other[0], sequence):
                sequence, newest = other
        energy = newest.totals.cabinet_energy_microjoule["grid_import"] * 1e-6
        if kept is not None and kept.start_ns == newest.energy_start_ns:
            self.found.regressions += energy < kept.energy - 1e-9 * kept.energy
        names = {one.name for one in newest.open_intervals}
        self._forgotten += not set(self._open) <= names
        reasons = [one.text for one in newest.trace if one.kind == "reset"]
        self._forgotten += bool(self._reset) and self._reset not in reasons
        self._wrong += newest.totals.gap_ns > (len(self._deaths) + self._steps) * 1100 * HOUR_NS
        if newest.end_ns is not None:
            self._moving, self._restored_ns = False, newest.end_ns

    def _figures(self, lasted: float) -> list[Figure]:
        found, kills = self.found, len(self._deaths)
        record = self._final_record()
        observed = POWER * (self._sent_ns - self._begun_ns) * 1e-9
        tolerance = 1e-9 * observed + 2e-6
        persisted = sum(row.persisted for row in self._rows)
        aside = len(list(self._state.glob("*.bad-*")))
        figures = [
            Figure("kills", kills),
            Figure("kills per minute", round(60 * kills / lasted, 1)),
            Figure("steps of the clock", self._steps),
            Figure("services called", self._calls),
            Figure("acknowledged", self._acknowledged, "some", self._acknowledged > 0),
            Figure("refused", self._refused, "some", self._refused > 0),
            Figure("registers seen, on disk", persisted, "some", persisted > 0),
            Figure("slots torn by a kill, set aside", f"{found.torn}, {aside}"),
            Figure(
                "energy less 68 W x observed time [J]",
                f"{found.energy_error:.1e}",
                f"below {tolerance:.1e}",
                found.energy_error <= tolerance,
            ),
            Figure("restarts on record", record.restarts),
            Figure("jumps on record", record.totals.jumps),
        ]
        for what, count in (
            ("states that could not be read", found.unreadable),
            ("values below what had been published", found.regressions),
            ("acknowledged and not in the files", self._forgotten),
            ("wrong answers, repairs, gap times", self._wrong),
        ):
            figures.append(Figure(what, count, "0", not count))
        return figures


def main() -> int:
    """Print the figures; the exit code is 1 if a goal was missed."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kills", type=int, default=1000)
    kills = parser.parse_args().kills
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="kills_") as folder:
        figures = kill(folder, kills, ServiceHarness)
    for figure in figures:
        verdict = "" if not figure.goal else "yes" if figure.reached else "NO"
        print(f"{figure.what:46} {figure.value!s:>14}  {figure.goal:18} {verdict}")
    print(f"{time.monotonic() - begin:.0f} s, checkpoints every {PERIOD} s")
    return 0 if all(figure.reached for figure in figures) else 1


if __name__ == "__main__":
    sys.exit(main())
