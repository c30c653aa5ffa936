"""The energy page with three browsers: processor time, weight, latency, and slow clients."""

from __future__ import annotations

import gzip
import os
import socket
import statistics
import sys
import tempfile
import time
import urllib.request
from contextlib import ExitStack
from pathlib import Path

from bench_live import cpu_seconds
from rich.table import Table

from robot_energy.page.saved_page import FILES

sys.path.append(str(Path(__file__).resolve().parents[1]))
from chromium import CHROMIUM, DRIVER, browser

WATCH = """
window.delays = [];
const power = document.getElementById('power');
new MutationObserver(() => requestAnimationFrame(() => {
  const time = Number(power.dataset.time);
  if (time) window.delays.push(Date.now() / 1000 - time);
})).observe(power, {attributes: true, attributeFilter: ['data-time']});
"""
READY = "document.getElementById('status').textContent === 'live'"
SLOW = 200  # clients that never read or never end their request


def run(folder: Path, quick: bool) -> tuple[Table, dict[str, object], dict[str, bool]]:
    """Measure a page of one robot."""
    from ros2_energy_monitor.demo.demo_page import free_port
    from ros2_energy_monitor.demo.processes import NodeProcesses

    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": str(60 + os.getpid() % 40),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_HOME": tempfile.mkdtemp(prefix="robot_energy_"),
    }
    port = free_port()
    url = f"http://127.0.0.1:{port}/"
    seconds = 10.0 if quick else 60.0
    figures: dict[str, float] = {}
    with ExitStack() as open_, NodeProcesses(folder, environment) as nodes:
        nodes.start("virtual_robot")
        nodes.start("energy_monitor", model="kr16")
        nodes.start("energy_dashboard", port=port)
        page = nodes._running["energy_dashboard"].pid
        monitor = nodes._running["energy_monitor"].pid
        _until_served(url)
        if CHROMIUM and DRIVER:
            windows = [open_.enter_context(browser()) for _ in range(3)]
            for window in windows:
                window.open(url)
                window.wait(READY, "live figures", 120.0)
            windows[0].run(WATCH)
            figures["page"] = _share(page, seconds)
            figures["monitor"] = _share(monitor, seconds)
            delays = windows[0].run("return window.delays")
            figures["latency"] = statistics.median(delays)
        figures["weight"] = sum(len(_packed(f"{url}{path[1:]}")) for path in FILES)
        figures["state"] = len(_packed(f"{url}api/state"))
        figures["rate"] = _stream_rate(port, seconds)
        figures |= _with_slow_clients(url, page, monitor, seconds)
    table = Table(title="energy page, 10 Hz, one robot of 6 joints")
    table.add_column("figure")
    table.add_column("value", justify="right")
    for name, text in {
        "page": "dashboard with three browsers, share of a core",
        "monitor": "energy_monitor in the same time, share of a core",
        "latency": "joint state to pixel, median [s]",
        "weight": "page over the wire, once [bytes]",
        "state": "state with history, once, unpacked [bytes]",
        "rate": "events, one browser [bytes/s]",
        "slow_page": f"dashboard with {SLOW} slow clients, share of a core",
        "monitor_with_slow": "energy_monitor with them, share of a core",
        "answer_with_slow": "answer to a state with them, median [s]",
    }.items():
        if name in figures:
            table.add_row(text, f"{figures[name]:.4g}")
    goals = {
        "page at most 1.6 MB once": figures["weight"] + figures["state"] <= 1.6e6,
        "events at most 20 kB/s": figures["rate"] <= 20e3,
    }
    if "page" in figures:
        goals |= {
            "dashboard with three browsers at most 5 % of a core": figures["page"] <= 0.05,
            "joint state to pixel at most 0.6 s": figures["latency"] <= 0.6,
        }
    return table, dict(figures), goals


def _until_served(url: str) -> None:
    for _ in range(600):
        try:
            if b'"persisted":true' in _packed(f"{url}api/state"):
                return
        except OSError:
            pass
        time.sleep(0.1)
    raise RuntimeError(f"no registers at {url}")


def _packed(url: str) -> bytes:
    """The bytes on the wire; those of the state unpacked."""
    request = urllib.request.Request(url, headers={"Accept-Encoding": "gzip"})
    with urllib.request.urlopen(request, timeout=20) as answer:
        content = answer.read()
    return gzip.decompress(content) if url.endswith("state") else content


def _share(pid: int, seconds: float) -> float:
    """Share of one core that a process uses. [-]"""
    before, begin = cpu_seconds(pid), time.monotonic()
    time.sleep(seconds)
    return (cpu_seconds(pid) - before) / (time.monotonic() - begin)


def _answer_time(url: str) -> float:
    """Median time of an answer. [s]"""
    times = []
    for _ in range(20):
        begin = time.monotonic()
        _packed(f"{url}api/state")
        times.append(time.monotonic() - begin)
    return statistics.median(times)


def _asked(port: int, text: bytes) -> socket.socket:
    client = socket.create_connection(("127.0.0.1", port), timeout=20)
    client.sendall(text)
    return client


def _stream_rate(port: int, seconds: float) -> float:
    """Bytes of events that one page gets. [bytes/s]"""
    with _asked(port, b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n") as client:
        client.recv(65536)
        begin, size = time.monotonic(), 0
        while time.monotonic() - begin < seconds:
            size += len(client.recv(65536))
        return size / (time.monotonic() - begin)


def _with_slow_clients(url: str, page: int, monitor: int, seconds: float) -> dict[str, float]:
    """Shares of a core and time of an answer while clients do not read or do not finish."""
    port = int(url.rstrip("/").rpartition(":")[2])
    clients = [_asked(port, b"GET /api/state HT") for _ in range(SLOW // 2)]
    ask = b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n"
    clients += [_asked(port, ask) for _ in range(SLOW // 2)]
    try:
        return {
            "answer_with_slow": _answer_time(url),
            "slow_page": _share(page, seconds / 2),
            "monitor_with_slow": _share(monitor, seconds / 2),
        }
    finally:
        for client in clients:
            client.close()
