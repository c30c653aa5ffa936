"""The energy page with three browsers, and an MQTT exporter: processor time, weight, latency.

Slow clients are compared with none in the same run, alternating: what arrives of the monitor.
"""

from __future__ import annotations

import gzip
import os
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from bench_live import cpu_seconds
from rich.table import Table

from robot_energy_report.page.saved_page import FILES

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
ROUNDS = 4  # without slow clients and with them, in turn
SLOW = 200  # clients that never read or never end their request


def run(folder: Path, quick: bool) -> tuple[Table, dict[str, object], dict[str, bool]]:
    """Measure a page of one robot."""
    from ros2_energy_monitor.demo.demo import free_port
    from ros2_energy_monitor.demo.node_processes import NodeProcesses

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
    os.environ |= environment  # of the listener, too
    with ExitStack() as open_, NodeProcesses(folder, environment) as nodes:
        nodes.start("virtual_robot")
        nodes.start("energy_monitor", model="kr16")
        nodes.start("energy_dashboard", port=port)
        page = nodes._running["energy_dashboard"].pid
        monitor = nodes._running["energy_monitor"].pid
        exporter = open_.enter_context(_exporter(nodes))
        _until_served(url)
        if CHROMIUM and DRIVER:
            windows = [open_.enter_context(browser()) for _ in range(3)]
            for window in windows:
                window.open(url)
                window.wait(READY, "live figures", 120.0)
            windows[0].run(WATCH)
            figures["page"] = _share(page, seconds)
            figures["monitor"] = _share(monitor, seconds)
            if exporter is not None:
                figures["exporter"] = _share(exporter, seconds)
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
        "exporter": "energy_exporter to an MQTT broker, share of a core",
        "slow_page": f"dashboard with {SLOW} slow clients, share of a core",
        "monitor_without": "energy_monitor without them, share of a core",
        "monitor_with": "energy_monitor with them, share of a core",
        "powers_without": "power states that arrive without them [1/s]",
        "powers_with": "power states that arrive with them [1/s]",
        "registers_without": "register messages that arrive without them [1/s]",
        "registers_with": "register messages that arrive with them [1/s]",
        "delay_without": "stamp of a power state to its arrival without them, median [s]",
        "delay_with": "the same with them [s]",
        "counted_without": "time counted of the time that passed, without them",
        "counted_with": "the same with them",
        "gaps": "gaps in the registers",
        "answer_with_slow": "answer to a state with them, median [s]",
    }.items():
        if name in figures:
            table.add_row(text, f"{figures[name]:.4g}")
    goals = {
        "page at most 1.6 MB once": figures["weight"] + figures["state"] <= 1.6e6,
        "events at most 20 kB/s": figures["rate"] <= 20e3,
    }
    for name, what in (("powers", "power states"), ("registers", "registers")):
        goals[f"{what} with slow clients as without, within 5 %"] = (
            figures[f"{name}_with"] >= 0.95 * figures[f"{name}_without"]
        )
    goals["no gap in the registers"] = figures["gaps"] == 0
    if "exporter" in figures:
        goals["exporter at most 5 % of a core"] = figures["exporter"] <= 0.05
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


@contextmanager
def _exporter(nodes: Any) -> Iterator[int | None]:
    """An exporter with a broker of its own: its process; None without mosquitto."""
    broker = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin")
    if broker is None:
        yield None
        return
    from ros2_energy_monitor.demo.demo import free_port

    port = free_port()
    process = subprocess.Popen([broker, "-p", str(port)], stderr=subprocess.DEVNULL)
    try:
        nodes.start("energy_exporter", exporters=["mqtt"], **{"mqtt.port": port})
        yield nodes._running["energy_exporter"].pid
    finally:
        process.terminate()
        process.wait()


class Listener:
    """Counts what arrives of the monitor."""

    def __init__(self) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from ros2_energy_msgs.msg import EnergyRegisters, PowerState

        from ros2_energy_monitor.base.publishers import reliable

        rclpy.init()
        self.node = rclpy.create_node("bench_listener")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.delays: list[float] = []
        self.registers: list[EnergyRegisters] = []
        self.node.create_subscription(PowerState, "energy/power", self._take, reliable(1000))
        self.node.create_subscription(
            EnergyRegisters, "energy/registers", self.registers.append, reliable(1000)
        )

    def _take(self, message: Any) -> None:
        stamp = message.header.stamp
        self.delays.append(time.time() - stamp.sec - stamp.nanosec * 1e-9)

    def spin(self, seconds: float) -> None:
        """Take what arrives in this time."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=left)

    def close(self) -> None:
        """End the node."""
        import rclpy

        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown()


def _with_slow_clients(url: str, page: int, monitor: int, seconds: float) -> dict[str, float]:
    """What arrives of the monitor, alternating without and with clients that do not read or end."""
    port = int(url.rstrip("/").rpartition(":")[2])
    ask = b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n"
    listener = Listener()
    sums: dict[str, list[float]] = {}
    listener.spin(3.0)  # until it is found
    try:
        for number in range(2 * ROUNDS):
            clients = []
            if number % 2:
                clients = [_asked(port, b"GET /api/state HT") for _ in range(SLOW // 2)]
                clients += [_asked(port, ask) for _ in range(SLOW // 2)]
                sums.setdefault("answer_with_slow", []).append(_answer_time(url))
            listener.spin(0.2)
            listener.delays.clear()
            del listener.registers[:-1]
            first, begin = listener.registers[-1], time.monotonic()
            busy = {pid: cpu_seconds(pid) for pid in (page, monitor)}
            listener.spin(seconds / ROUNDS)
            passed = time.monotonic() - begin
            last, kind = listener.registers[-1], "with" if clients else "without"
            stamps = [
                one.header.stamp.sec + one.header.stamp.nanosec * 1e-9 for one in (first, last)
            ]
            found = {
                "powers": len(listener.delays) / passed,
                "registers": (len(listener.registers) - 1) / passed,
                "delay": statistics.median(listener.delays),
                "counted": (last.observed_time - first.observed_time) / (stamps[1] - stamps[0]),
                "monitor": (cpu_seconds(monitor) - busy[monitor]) / passed,
            }
            for name, value in found.items():
                sums.setdefault(f"{name}_{kind}", []).append(value)
            if clients:
                share = (cpu_seconds(page) - busy[page]) / passed
                sums.setdefault("slow_page", []).append(share)
            for client in clients:
                client.close()
        gaps = float(listener.registers[-1].gap_count)
    finally:
        listener.close()
    return {name: statistics.median(values) for name, values in sums.items()} | {"gaps": gaps}
