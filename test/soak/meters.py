"""Meters and brokers that never end their answer: how long they hold a call, and what they cost.

Each server of `hostile_meters.ENDLESS` gets a link, whose longest call is measured, and the real
node: its greatest memory, and how soon it ends after an interrupt.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from figure import Figure

from robot_energy.foundation.errors import MeterAnswerError, MeterLinkError

NETWORK = Path(__file__).resolve().parents[2] / "ros2_energy_monitor" / "test" / "network"
sys.path.append(str(NETWORK))
from hostile_meters import ENDLESS, PROTOCOLS, HostileServer, make_link, one_round  # noqa: E402

MINUTES = (20.0, 6.0)
TIMEOUT = 2.0  # of the links; that of the node by default [s]
HANGS = 60.0  # after which a call counts as one that never returns [s]
MEMORY = 300.0  # MB
INTERRUPT = 5.0  # s from an interrupt to the end of the node


def run(folder: str, quick: bool) -> list[Figure]:
    """Meet every server with a link and with a node; then answers at random for a while."""
    longest, memory, ended = {}, {}, {}
    for (name, what), answer in ENDLESS.items():
        key = f"{name}: {what}"
        with served(answer) as server:
            longest[key] = longest_call(name, server.port)
            memory[key], ended[key] = node(name, server.port, folder, 3.0 if quick else 20.0)
    hanging = sum(seconds > 2 * TIMEOUT for seconds in longest.values())
    what = f"{len(ENDLESS)} servers that never end"
    figures = [
        Figure(f"{what}: calls of more than twice the timeout", hanging, "0", not hanging),
        *worst(f"{what}: longest call [s]", longest, 2 * TIMEOUT),
        *worst(f"{what}: memory of the node [MB]", memory, MEMORY),
        *worst(f"{what}: end after an interrupt [s]", ended, INTERRUPT),
    ]
    rounds = errors = 0
    until = time.monotonic() + (20.0 if quick else 300.0)
    while time.monotonic() < until:
        for name in PROTOCOLS:
            said = set(one_round(name, rounds))
            errors += not said <= {"read", "MeterLinkError", "MeterAnswerError"}
            rounds += 1
    figures.append(Figure(f"{rounds} rounds of damaged answers: others", errors, "0", not errors))
    return figures


def worst(what: str, found: dict[str, float], limit: float) -> list[Figure]:
    """The greatest of several figures, and whose it is."""
    whose = max(found, key=lambda name: found[name])
    value = round(found[whose], 2)
    return [Figure(f"{what}, {whose}", value, f"<= {limit:g}", value <= limit)]


@contextmanager
def served(answer: object) -> Iterator[HostileServer]:
    """A server, as long as it is needed."""
    server = HostileServer(answer)  # type: ignore[arg-type]
    yield server
    server.close()


def longest_call(name: str, port: int) -> float:
    """Longest call of a link in some attempts. [s]"""
    link = make_link(name, port, TIMEOUT)
    durations: list[float] = []
    begun = [time.monotonic()]

    def timed(call: object) -> None:
        begun[0] = time.monotonic()
        try:
            call()  # type: ignore[operator]
        finally:
            durations.append(time.monotonic() - begun[0])

    def attempt() -> None:
        for _ in range(2):
            try:
                timed(link.connect)
                timed(link.read)
                timed(link.read)
            except (MeterLinkError, MeterAnswerError):
                pass
            timed(link.close)

    thread = threading.Thread(target=attempt, daemon=True)
    thread.start()
    thread.join(HANGS)
    return HANGS if thread.is_alive() else max(durations)


def node(name: str, port: int, folder: str, seconds: float) -> tuple[float, float]:
    """Greatest memory of the driver [MB], and time from an interrupt to its end [s]."""
    secret = Path(folder) / "secret.yaml"
    secret.write_text("username: admin\npassword: secret\n")
    secret.chmod(0o600)
    given = {"profile": PROTOCOLS[name].profile, "host": "127.0.0.1", "port": port}
    given |= {"device": "meter"} | ({"credentials_file": secret} if name == "http" else {})
    command = [sys.executable, "-m", "ros2_energy_monitor", "meter_driver", "--ros-args"]
    for key, value in given.items():
        command += ["-p", f"{key}:={value}"]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    driver = subprocess.Popen(command, stderr=subprocess.PIPE, env=environment, text=True)
    assert driver.stderr is not None
    for line in driver.stderr:
        if "reading" in line:
            break
    rest = threading.Thread(target=driver.stderr.read, daemon=True)
    rest.start()
    try:
        driver.wait(seconds)
        return float("inf"), 0.0  # it ended by itself
    except subprocess.TimeoutExpired:
        pass
    status = Path(f"/proc/{driver.pid}/status").read_text().splitlines()
    peak = next(int(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1000
    begin = time.monotonic()
    driver.send_signal(signal.SIGINT)
    try:
        driver.wait(HANGS)
    except subprocess.TimeoutExpired:
        driver.kill()
    return peak, time.monotonic() - begin
