"""Two alternating files in a folder, one of which is always whole.

A write goes to the older slot and is synced before it counts, so that whatever ends the
process or the power, the other slot still holds the state before. One process writes: it
holds a lock (flock) on a third file, which the kernel gives back when the process ends.

A line with format, sequence number, length and CRC-32 guards the JSON behind it; the CRC covers
the line as well. ``head -1`` shows it, ``tail -n +2`` gives plain JSON.

Each is a regular file, no link and nothing that blocks: whoever can put a link there would
decide what is overwritten. The folder itself may be a link, which its user has set.
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import stat
import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import Future, wait
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar, cast

from robot_energy.foundation.errors import StateFileError
from robot_energy.foundation.files.placement import sync

SAFE = os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY


def open_unlinked(path: Path, flags: int, mode: int = 0o644) -> int:
    """Return the descriptor of a regular file.

    Raises:
        OSError: If it cannot be opened, or is a link, pipe, device or folder.
    """
    try:
        file = os.open(path, flags | SAFE, mode)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENXIO, errno.EISDIR):
            raise OSError(error.errno, "is not a regular file", str(path)) from error
        raise
    if stat.S_ISREG(os.fstat(file).st_mode):
        return file
    os.close(file)
    raise OSError(errno.EINVAL, "is not a regular file", str(path))


def read_regular(path: Path, limit: int) -> bytes | None:
    """Return the content of a regular file; None where there is nothing.

    Raises:
        OSError: If it cannot be read, is not a regular file or is larger.
    """
    try:
        file = open_unlinked(path, os.O_RDONLY)
    except FileNotFoundError:
        return None
    with os.fdopen(file, "rb") as opened:
        if os.fstat(file).st_size > limit:
            raise OSError(errno.EFBIG, f"has over {limit} bytes", str(path))
        return opened.read(limit)


MAGIC = "robot-energy-registers"
MAX_BYTES = 16 * 1024 * 1024  # of a payload; 49 totals of a thousand joints
MAX_SEQUENCE = 10**18 - 1  # the number after it is 1
MAX_LINE = 200
_LINE = re.compile(
    rb"robot-energy-registers version=(\d{1,9}) sequence=(\d{1,18}) bytes=(\d{1,9}) "
    rb"crc32=([0-9a-f]{8})\n"
)


def wrap(version: int, sequence: int, payload: bytes) -> bytes:
    if len(payload) > MAX_BYTES:
        raise StateFileError(f"a state of {len(payload)} bytes", f"at most {MAX_BYTES}")
    line = f"{MAGIC} version={version} sequence={sequence} bytes={len(payload)}".encode()
    check = zlib.crc32(payload, zlib.crc32(line))
    return line + f" crc32={check:08x}\n".encode() + payload


def follows(sequence: int) -> int:
    """Return the sequence number after one; after the largest comes 1."""
    return sequence % MAX_SEQUENCE + 1


def is_newer(sequence: int, other: int) -> bool:
    """Whether a sequence number comes after another, also where the numbers began again at 1."""
    return sequence != other and (sequence - other) % MAX_SEQUENCE < MAX_SEQUENCE // 2


def unwrap(version: int, content: bytes) -> tuple[int, bytes]:
    """Return sequence number and payload of a state file.

    What stands behind the payload is ignored: a shorter state may lie over a longer one.
    """
    if not content:
        raise StateFileError("an empty file", "a state file")
    found = _LINE.match(content[:MAX_LINE])
    if found is None:
        raise StateFileError("a file without the first line of a state file", "a state file")
    number, sequence, size = (int(found[group]) for group in (1, 2, 3))
    payload = content[found.end() : found.end() + size]
    if len(payload) < size:
        raise StateFileError(f"a file cut after {len(payload)} bytes", f"{size}")
    if wrap(number, sequence, payload) != content[: found.end() + size]:
        raise StateFileError("a damaged file, whose CRC does not fit", "the CRC in its first line")
    if number != version:
        raise StateFileError(
            f"a state file of format {number}", f"format {version}", "use the release that wrote it"
        )
    return sequence, payload


T = TypeVar("T")
MAX_ASIDE = 20  # damaged files kept next to the slots


@dataclass(frozen=True)
class Stored(Generic[T]):
    """What was found in a folder."""

    value: Annotated[T | None, "The newest state, or None where there is none."]
    sequence: Annotated[int, "Its number; 0 where there is none."]
    notices: tuple[str, ...]


class SlotPair(Generic[T]):
    """The state files of one robot; ``read`` may raise `StateFileError` for a payload."""

    def __init__(self, folder: Path, name: str, version: int, read: Callable[[bytes], T]) -> None:
        self.folder = folder
        self.sequence = 0
        self._paths = tuple(folder / f"{name}.{slot}.state" for slot in "ab")
        self._lock_path = folder / f"{name}.lock"
        self._version = version
        self._read = read
        self._lock: int | None = None
        self._newest = 1  # slot of the newest state; the first write goes to slot 0

    def acquire(self) -> Stored[T]:
        """Return the newest state that can be used, as the only writer from now on.

        A slot that is damaged, or of another format, is moved aside and the other one
        used. Nothing is ever deleted.
        """
        self.release()
        try:
            if not self.folder.is_dir():
                self.folder.mkdir(parents=True, exist_ok=True)
                sync(self.folder.parent)
            self._take_lock()
            found = self._read_slots()
        except OSError as error:
            self.release()
            raise _wrapped(error, self.folder) from error
        self.sequence = found.sequence
        return found

    def write(self, payload: bytes) -> None:
        """Write a state over the older slot; when this returns, it is on disk."""
        slot = 1 - self._newest
        path = self._paths[slot]
        try:
            self._check_lock()
            content = wrap(self._version, follows(self.sequence), payload)
            existed = path.exists()
            file = self._open_slot(path)
            try:
                done = 0
                while done < len(content):
                    done += os.pwrite(file, content[done:], done)
                os.ftruncate(file, len(content))
                os.fsync(file)
            finally:
                os.close(file)
            if not existed:
                sync(self.folder)
        except OSError as error:
            raise _wrapped(error, path) from error
        self.sequence = follows(self.sequence)
        self._newest = slot

    def set_aside(self) -> list[str]:
        """Move both slots aside, as they are of something else; return where to."""
        try:
            there = [path for path in self._paths if os.path.lexists(path)]
            notes = [f"moved aside as {_move_aside(path)}" for path in there]
            sync(self.folder)
        except OSError as error:
            raise _wrapped(error, self.folder) from error
        self.sequence = 0
        self._newest = 1
        return notes

    @property
    def held(self) -> bool:
        return self._lock is not None

    def release(self) -> None:
        """Let another process write."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _open_slot(self, path: Path) -> int:
        try:
            return open_unlinked(path, os.O_WRONLY | os.O_CREAT)
        except OSError:
            if path.is_symlink() or (path.exists() and not path.is_file()):
                self.release()  # the next checkpoint moves it aside
            raise

    def _take_lock(self) -> None:
        try:
            lock = open_unlinked(self._lock_path, os.O_RDWR | os.O_CREAT)
        except OSError:
            if not self._lock_path.is_file() or self._lock_path.is_symlink():
                raise
            # Nothing can be written now, but what was kept can still be read and guarded.
            lock = open_unlinked(self._lock_path, os.O_RDONLY)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.pread(lock, 20, 0).decode(errors="replace").strip()
            os.close(lock)
            raise StateFileError(
                f"another monitor (process {owner or 'unknown'}) keeps the registers in "
                f"{self.folder}",
                "",
                "stop it, or give this one another name, namespace or state_folder",
            ) from None
        except OSError:
            os.close(lock)
            raise
        self._lock = lock
        with suppress(OSError):  # only a hint for people
            os.ftruncate(lock, 0)
            os.pwrite(lock, f"{os.getpid()}\n".encode(), 0)

    def _check_lock(self) -> None:
        """Make sure that the lock file held is still the one in the folder."""
        if self._lock is None:
            raise StateFileError("the state files are not locked", remedy="acquire them first")
        held = os.fstat(self._lock)
        try:
            there = os.stat(self._lock_path, follow_symlinks=False)
        except OSError:
            self.release()
            raise
        if (held.st_dev, held.st_ino) != (there.st_dev, there.st_ino):
            self.release()
            raise StateFileError(f"{self._lock_path} was replaced", "the file that was locked")

    def _read_slots(self) -> Stored[T]:
        found: list[tuple[int, int, T]] = []
        notices: list[str] = []
        for slot, path in enumerate(self._paths):
            try:
                content = _content(path)
                if content is None:
                    continue
                sequence, payload = unwrap(self._version, content)
                found.append((sequence, slot, self._read(payload)))
            except StateFileError as error:
                try:
                    became = f"moved aside as {_move_aside(path).name}"
                except OSError as trouble:
                    became = f"left in place ({trouble.strerror or trouble})"
                notices.append(f"{path}: {error} It was {became}.")
        if notices:
            with suppress(OSError):  # a read-only folder, where nothing was moved either
                sync(self.folder)
        if not found:
            self._newest = 1
            return Stored(None, 0, tuple(notices))
        newest = found[-1]
        if is_newer(found[0][0], newest[0]):
            newest = found[0]
        sequence, self._newest, value = newest
        return Stored(value, sequence, tuple(notices))


def _content(path: Path) -> bytes | None:
    try:
        return read_regular(path, MAX_LINE + MAX_BYTES)
    except OSError as error:
        if error.errno in (errno.EINVAL, errno.ELOOP, errno.ENXIO, errno.EFBIG):
            raise StateFileError(error.strerror or "cannot be read", "a state file") from error
        raise


def _move_aside(path: Path) -> Path:
    """Rename a file to the first free name; OSError if there is none."""
    for number in range(1, MAX_ASIDE + 1):
        target = path.with_name(f"{path.name}.bad-{number}")
        if not os.path.lexists(target):
            path.rename(target)
            return target
    raise OSError(f"{MAX_ASIDE} files lie aside already")


def _wrapped(error: OSError, path: Path) -> StateFileError:
    if isinstance(error, StateFileError):
        return error
    where = error.filename or path
    return StateFileError(
        f"the registers cannot be kept in {where}: {error.strerror or error}",
        "a folder that can be written, on a disk with space",
        "counting goes on in memory and the next checkpoint tries again",
    )


Submit = Callable[[Callable[[], Any]], "Future[Any]"]


def at_once(job: Callable[[], Any]) -> Future[Any]:
    """Return the finished future of a job done now; it holds a `StateFileError` that it raised."""
    future: Future[Any] = Future()
    try:
        future.set_result(job())
    except StateFileError as error:
        future.set_exception(error)
    return future


class SlotStore(ABC, Generic[T]):
    """Keeps something in state files.

    Args:
        slots: The state files; None keeps nothing.
        submit: Does work on the disk; jobs must run one after the other.

    Attributes:
        trouble: Why nothing can be kept at present, and what to do; empty while all is well.
        remedy: What to do about it, where that is known.
        notices: What the user should know, oldest first; take them out.
    """

    def __init__(self, slots: SlotPair[T] | None, submit: Submit) -> None:
        self.trouble = self.cause = self.remedy = ""
        self.failures = self.checkpoints = 0
        self.notices: list[str] = []
        self._slots, self._submit = slots, submit
        self._pending: Future[Any] | None = None

    @abstractmethod
    def _payload(self) -> bytes | None:
        """Return what to write; None for nothing yet."""

    @abstractmethod
    def _adopt(self, stored: Stored[T]) -> None:
        """Continue from what is on disk."""

    def begin(self) -> bool:
        """Whether a write of what there is to keep was begun; an absent folder is tried again."""
        slots = self._slots
        if slots is None or self._pending is not None:
            return False
        if not slots.held:
            self._pending = self._submit(slots.acquire)
            return False
        payload = self._payload()
        if payload is not None:
            self._pending = self._submit(lambda: slots.write(payload))
        return payload is not None

    def poll(self) -> bool | None:
        """Return whether the disk's work succeeded; None if there is nothing to report."""
        if self._pending is None or not self._pending.done():
            return None
        job, self._pending = self._pending, None
        try:
            result = job.result()
            if isinstance(result, Stored):
                stored = cast("Stored[T]", result)
                self.notices += stored.notices
                self._adopt(stored)
                return None
        except StateFileError as error:
            self.failures += 1
            self.trouble, self.remedy = str(error), error.remedy
            self.cause = str(StateFileError(error.found, error.expected))
            return False
        self.checkpoints += 1
        self.trouble = self.cause = self.remedy = ""
        return True

    def open(self, patience: float | None = None) -> None:
        """Open the folder and continue from what is there, as far as that is possible.

        Args:
            patience: How long to wait for the disk; None waits for ever. [s]
        """
        self._finish(patience)
        if self._slots is not None and not self._slots.held:
            self.begin()
            self._finish(patience)

    def _finish(self, patience: float | None) -> bool | None:
        if self._pending is not None:
            wait([self._pending], patience)
        return self.poll()

    def _release(self) -> None:
        """Let another monitor write, unless the disk is still at work."""
        if self._slots is not None and self._pending is None:
            self._slots.release()
