"""Services of the registers and of the payload: any strings and numbers, with restarts between.

Bytes become a sequence of calls, power samples, steps of the clock, kills and restarts. After
each restart the state holds what was acknowledged, and no energy that was not counted.
"""

import shutil
import struct
from dataclasses import dataclass
from types import SimpleNamespace

from target import scratch

import robots
from accounts import SECOND, power_block, steady
from robot_energy.accounting.account import EnergyAccount
from robot_energy.foundation.errors import RegisterError
from robot_energy.messages.payload import answer_set_payload
from robot_energy.messages.registers import RegistersWriter, interval_fields
from robot_energy.pipeline import TorqueStage
from robot_energy.store.account_store import AccountStore, load_account
from robot_energy.timeline.stamps import MAX_STAMP_NS

SINGLE = 9  # bytes of a call without its text
OPERATIONS = ("count", "step", "reset", "open", "close", "payload", "kill", "restart")


@dataclass
class Stamp:
    """As ``builtin_interfaces/Time``."""

    sec: int
    nanosec: int


def set_payload_call(
    stamp: Stamp, link: str, mass: float, x: float, moment: float
) -> SimpleNamespace:
    """As a request of ``set_payload``."""
    entries = dict.fromkeys(("ixx", "iyy", "izz"), moment) | dict.fromkeys(("ixy", "ixz", "iyz"), 0)
    inertia = SimpleNamespace(m=mass, com=SimpleNamespace(x=x, y=0.0, z=0.0), **entries)
    header = SimpleNamespace(stamp=stamp, frame_id=link)
    return SimpleNamespace(payload=SimpleNamespace(header=header, inertia=inertia))


class Monitor:
    """A monitor without ROS: its books, its services, and what it has acknowledged."""

    def __init__(self) -> None:
        self.folder = scratch() / "services"
        shutil.rmtree(self.folder, ignore_errors=True)
        self.model = robots.two_link()
        self.names = self.model.joint_names
        self.stage = TorqueStage(self.model)
        self.now_ns = 1000 * SECOND
        self.measured = 0  # all energy of all lives [uJ]
        self.kept = 0  # energy since the last reset that is on disk [uJ]
        self.reason = ""
        self.open: dict[int, str] = {}
        self.books: AccountStore = self.born()

    def born(self) -> AccountStore:
        """Begin a life."""
        books = load_account(EnergyAccount(2), self.model, self.folder, node="/cell/em")
        books.open()
        assert not books.notices, books.notices
        assert not books.trouble, books.trouble
        return books

    def energy(self) -> int:
        """What the registers hold. [uJ]"""
        return self.books.account.totals().cabinet_energy_microjoule["grid_import"]

    def count(self, value: int) -> None:
        """A few samples at 100 W, at the present time of the clock."""
        before = self.energy()
        block = steady(0, 0.05)
        stamp = block.stamp_ns + self.now_ns
        self.books.account.step(power_block(stamp, block.grid_power, value))
        self.now_ns = min(int(stamp[-1]) + SECOND, MAX_STAMP_NS - SECOND)
        self.measured += self.energy() - before
        self.keep()

    def keep(self) -> None:
        """A checkpoint; from now on it is acknowledged."""
        assert self.books.checkpoint(), self.books.trouble
        self.kept = self.energy()

    def step(self, value: int) -> None:
        """Set the clock to anything a stamp can be."""
        self.now_ns = value % (MAX_STAMP_NS - SECOND)

    def again(self, *, clean: bool) -> None:
        """End and begin again: the files hold what was acknowledged, and no more."""
        if clean:
            assert self.books.close()
        else:
            assert self.books._slots is not None
            self.books._slots.release()  # the kernel gives the lock back
        self.books = self.born()
        assert self.kept <= self.energy() <= self.measured
        intervals = {one.interval_id: one for one in self.books.account.list_intervals()}
        for number, name in self.open.items():
            assert intervals[number].is_open
            assert intervals[number].name == name
        reasons = [one.text for one in self.books.account.trace.entries if one.kind == "reset"]
        assert not self.reason or self.reason == reasons[-1]

    def call(self, kind: str, value: int, text: str) -> bool:
        """Call a service; what it refuses changes nothing."""
        account, before, refusal = self.books.account, self.energy(), ""
        try:
            if kind == "reset":
                account.reset(text)
                self.reason = text.strip()
            elif kind == "open":
                self.open[account.open_interval(text).interval_id] = text
            else:
                self.open.pop(account.close_interval(text, value % 2**64).interval_id)
        except RegisterError as error:
            refusal = str(error)
        if refusal:
            assert refusal.isprintable()
            assert len(refusal) < 5000
            assert self.energy() == before
            return False
        self.keep()
        for interval in account.list_intervals():
            interval_fields(interval, self.names, self.books.account.calibration)
        assert RegistersWriter(self.names, "id").encode(account) is not None
        return True

    def payload(self, number: float, text: str, value: int) -> bool:
        """Call set_payload."""
        stamp = Stamp(value % 2**32 - 2**31, value >> 32)
        link = "fore" if value % 3 else text
        request = set_payload_call(stamp, link, number, number, abs(number))
        answer = answer_set_payload(self.stage.set_payload, request)
        assert answer.message.isprintable()
        assert len(answer.message) < 1000
        return answer.success


def services(data: bytes) -> bool:
    """Call what the bytes say; True if a call was accepted."""
    monitor, taken = Monitor(), False
    monitor.count(0)
    at = 0
    while at + SINGLE <= len(data):
        kind = OPERATIONS[data[at] % len(OPERATIONS)]
        (value,) = struct.unpack_from("<Q", data, at + 1)
        at += SINGLE
        text = ""
        if kind in ("reset", "open", "close", "payload"):
            size = value % 300
            text = data[at : at + size].decode("utf-8", "surrogateescape")
            at += size
            text *= 1 + 100_000 * (value % 7 == 6)
        if kind == "count":
            monitor.count(value % 1000)
        elif kind == "step":
            monitor.step(value)
        elif kind in ("kill", "restart"):
            monitor.again(clean=kind == "restart")
        elif kind == "payload":
            (number,) = struct.unpack("<d", value.to_bytes(8, "little"))
            taken |= monitor.payload(number, text, value)
        else:
            taken |= monitor.call(kind, value, text)
    monitor.again(clean=True)
    return taken


def call(kind: str, value: int = 0, text: str = "") -> bytes:
    """One operation as bytes; the size of a text is in its number."""
    data = text.encode()
    value = value - value % 300 + len(data) if text else value
    return bytes([OPERATIONS.index(kind)]) + struct.pack("<Q", value) + data


def service_seeds() -> list[bytes]:
    """Jobs with a reset, restarts, and a clock that begins in 1970."""
    jobs = [
        call("open", text="job"),
        call("count"),
        call("reset", text="new shift"),
        call("kill"),
        call("count"),
        call("close", text="job"),
        call("restart"),
    ]
    boots = [call("step", 30 * SECOND), call("count"), call("step", MAX_STAMP_NS - 5 * SECOND)]
    return [b"".join(jobs), b"".join([*boots, *jobs, *boots, *jobs])]
