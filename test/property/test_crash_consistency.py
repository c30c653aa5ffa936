"""A crash at any instant of a sequence of checkpoints: the state files stay usable.

The operations of the real code on the real file system are recorded. Then the folder is
made as a crash could have left it: after every operation, inside every write at every
byte, and, for a loss of power, with any part of what was not yet synced. From each, the
real code must read a state that is no older than the last one it had reported as kept.
"""

from __future__ import annotations

import os
import random
import shutil
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_energy.store.slots import SlotPair

SECTOR = 16  # bytes that reach the disk together; small, to have many in a small file
STATES = [b"a" * 40, b"b" * 70, b"c" * 10, b"d" * 55, b"e" * 90, b"f" * 20, b"g" * 60]


def pair(folder: Path) -> SlotPair[bytes]:
    return SlotPair(folder, "arm", 1, bytes)


@dataclass
class Disk:
    """Content of every file, what of it is safe, and what was reported as kept."""

    content: dict[str, bytes] = field(default_factory=dict)
    safe: dict[str, bytes] = field(default_factory=dict)
    kept: int = 0

    def do(self, operation: tuple, upto: int | None = None) -> None:
        kind, *rest = operation
        if kind == "create":
            self.content.setdefault(rest[0], b"")
        elif kind == "write":
            name, data, offset = rest
            data = data if upto is None else data[:upto]
            old = self.content[name].ljust(offset, b"\0")
            self.content[name] = old[:offset] + data + old[offset + len(data) :]
        elif kind == "cut":
            self.content[rest[0]] = self.content[rest[0]][: rest[1]].ljust(rest[1], b"\0")
        elif kind == "sync":
            self.safe[rest[0]] = self.content[rest[0]]
        elif kind == "kept":
            self.kept = rest[0]

    def after_power_loss(self, rng: random.Random) -> dict[str, bytes]:
        """Safe content, over which any sectors and any length of the rest may have come."""
        left: dict[str, bytes] = {}
        for name, new in self.content.items():
            old = self.safe.get(name)
            if old is None and rng.random() < 0.3:
                continue  # not even its name was on disk
            old = old or b""
            size = rng.choice([len(old), len(new), rng.randint(0, max(len(old), len(new)))])
            mixed = bytearray(old[:size].ljust(size, b"\0"))
            for start in range(0, size, SECTOR):
                if rng.random() < 0.5:
                    piece = new[start : min(start + SECTOR, size)]
                    mixed[start : start + len(piece)] = piece
            left[name] = new if old == new else bytes(mixed)
        return left


@pytest.fixture(scope="module")
def operations(tmp_path_factory) -> list[tuple]:
    """What seven checkpoints do to the disk, in order, recorded while they do it."""
    folder = tmp_path_factory.mktemp("recorded")
    found: list[tuple] = []
    names: dict[int, str] = {}
    real = {name: getattr(os, name) for name in ("open", "pwrite", "ftruncate", "fsync")}

    def opened(path, flags, *rest, **more):
        number = real["open"](path, flags, *rest, **more)
        names[number] = Path(path).name
        if str(path).endswith(".state"):
            found.append(("create", names[number]))
        return number

    def noted(kind, name):
        def call(number, *rest):
            if names.get(number, "").endswith(".state"):
                found.append((kind, names[number], *rest))
            return real[name](number, *rest)

        return call

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "open", opened)
        for kind, name in (("write", "pwrite"), ("cut", "ftruncate"), ("sync", "fsync")):
            patch.setattr(os, name, noted(kind, name))
        slots = pair(folder)
        slots.acquire()
        for number, state in enumerate(STATES, start=1):
            slots.write(state)
            found.append(("kept", number))
        slots.release()
    assert [entry[0] for entry in found[:4]] == ["create", "write", "cut", "sync"]
    assert sum(entry[0] == "sync" for entry in found) == len(STATES)
    return found


def check(folder: Path, content: dict[str, bytes], kept: int) -> None:
    """Read the folder with the real code and count on."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name, data in content.items():
        (folder / name).write_bytes(data)
    slots = pair(folder)
    stored = slots.acquire()
    assert stored.sequence >= kept, content
    assert stored.value == (STATES[stored.sequence - 1] if stored.sequence else None)
    assert stored.sequence <= kept + 1
    slots.release()


def test_killed_after_every_operation_and_inside_every_write(operations, tmp_path):
    disk, checked = Disk(), 0
    for operation in operations:
        for upto in range(len(operation[2])) if operation[0] == "write" else ():
            torn = Disk(dict(disk.content))
            torn.do(operation, upto)
            check(tmp_path / "left", torn.content, disk.kept)
            checked += 1
        disk.do(operation)
        check(tmp_path / "left", disk.content, disk.kept)
        checked += 1
    assert checked > 500
    assert disk.kept == len(STATES)


@settings(deadline=None, max_examples=150)
@given(seed=st.integers(0, 2**31))
def test_power_lost_at_any_instant(operations, tmp_path_factory, seed):
    rng = random.Random(seed)
    disk = Disk()
    for operation in operations[: rng.randint(0, len(operations))]:
        disk.do(operation)
    folder = tmp_path_factory.getbasetemp() / "power_loss"
    check(folder, disk.after_power_loss(rng), disk.kept)
