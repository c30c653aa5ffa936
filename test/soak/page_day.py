"""A day of power states through the page, faster than nature, with a browser's requests.

Every tick takes what a monitor publishes in a second, with its registers, and makes the events.
The stamps are those of the day; the server is the real one.
"""

from __future__ import annotations

import sys
import time
import urllib.request
from pathlib import Path

import numpy as np
from figure import Figure, resident_kib, slope

sys.path.append(str(Path(__file__).resolve().parents[1]))
from page_messages import power_states, registers
from robot_energy_report.page.access import page_access
from robot_energy_report.page.hub import PageHub
from robot_energy_report.page.settings import PageSettings
from robot_energy_report.page.web_server import PageServer

MINUTES = (4.0, 0.2)
PER_TICK = 50  # power states in a second
HOUR = 3600.0  # s
PATHS = ("api/state", "metrics", "saved.html", "")


def run(folder: str, quick: bool) -> list[Figure]:
    """Serve the day.

    Args:
        folder: Not used.
        quick: Half an hour instead of a day.
    """
    del folder
    hours = 0.5 if quick else 24.0
    hub = PageHub("day", PageSettings(price_per_kwh=0.3))
    robot = hub.robot("robot")
    if robot is None:
        raise RuntimeError("the first robot has no place")
    server = PageServer(hub, page_access())
    period = 1.0 / PER_TICK
    offsets = (1 + np.arange(PER_TICK)) * period
    times: list[float] = []
    memory: list[float] = []
    energy, now, answers, begin = 0.0, 0.0, 0, time.monotonic()
    try:
        for tick in range(round(hours * HOUR)):
            now = float(tick)
            power = 1000.0 + 900.0 * np.sin(now + offsets)
            robot.take_power(power_states(now + offsets, power, period=period), now)
            energy += float(power.sum()) * period
            robot.take_registers(registers(energy, stamp=now + 1.0))
            hub.tick(now)
            if tick % 300 == 299:
                for path in PATHS:
                    with urllib.request.urlopen(server.url + path, timeout=60) as answer:
                        answers += len(answer.read()) > 0
                times.append(now / HOUR)
                memory.append(resident_kib())
        found = hub.state(now)["robots"][0]
    finally:
        server.close()
    all_day = float(found["spans"]["all"]["energy"])
    taken = time.monotonic() - begin
    hour_ring = float(found["spans"]["hour"]["seconds"])
    warm = len(times) // 4  # buffers that fill once
    growth = slope(times[warm:], memory[warm:])
    return [
        Figure("time served [h]", hours, f"{hours / taken * HOUR:.0f} times nature"),
        Figure("memory growth [KiB/h]", round(growth, 1), "at most 100 over a day",
               growth <= 100.0 or quick),
        Figure("energy of all history, of the register [-]", all_day / energy, "1 to 1e-6",
               abs(all_day / energy - 1.0) <= 1e-6),
        Figure("time in the last hour [s]", hour_ring, "at most 3600", hour_ring <= HOUR + 1e-6),
        Figure("answers to requests", answers, "all", answers == 4 * len(times)),
    ]  # fmt: skip
