"""Drafts next to their targets, moved into place together or not at all.

Only a kill that cannot be caught leaves a draft (`.robot-energy-...new`) or what it replaces
(`...old`); the next run for the same target removes them once their process is gone.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import re
import secrets
import shutil
import signal
import stat
import threading
import weakref
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from types import FrameType

PREFIX = ".robot-energy-"
_NAME = re.compile(r"\.robot-energy-([0-9a-f]{12})-(\d+)-[0-9a-f]{8}\.(new|old)")
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_NO_LINKS = {errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK}

Check = Callable[[Path], None]


class OutputPlacement:
    """One file or folder on its way into place; an error of the disk is raised as `failure` has it.

    Args:
        check: Raises if what stands at a path (it may be nothing) must not be replaced.
        failure: Makes the exception to raise of an error of the disk.
    """

    def __init__(self, target: Path, check: Check, failure: Callable[[OSError], Exception]) -> None:
        self.target = target
        stem = f"{_beginning(target)}{os.getpid()}-{secrets.token_hex(4)}"
        self.draft = target.parent / f"{stem}.new"
        self._aside = target.parent / f"{stem}.old"
        self._check = check
        self._failure = failure
        self._lock: int | None = None
        self._made: list[Path] = []  # parents that were not there
        self._identity: tuple[int, int] | None = None  # device and inode of the draft
        self.closed = False
        self._undone = weakref.finalize(self, _leave, self.draft, os.getpid())

    def write_draft(self, data: bytes) -> None:
        """Write the draft of a file, on the disk when this returns."""
        with self._disk():
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
            number = os.open(self.draft, flags, 0o666)
            self._hold(number)
            with suppress(OSError):  # the mode of what it replaces
                old = os.lstat(self.target)
                if stat.S_ISREG(old.st_mode):
                    os.fchmod(number, stat.S_IMODE(old.st_mode))
            left = memoryview(data)
            while left:
                left = left[os.write(number, left) :]
            os.fsync(number)

    def make_folder(self) -> None:
        with self._disk():
            parent = self.target.parent
            missing = [one for one in (parent, *parent.parents) if not one.exists()]
            for folder in reversed(missing):
                self._made.append(folder)
                os.mkdir(folder)
            os.mkdir(self.draft)
            self._hold(os.open(self.draft, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC))

    def move(self) -> None:
        """Put the draft in place, and what was there next to it, unless the check refuses."""
        with self._disk():
            self._check(self.target)
            folder = self.draft.is_dir()
            if folder:
                for path in (*self.draft.rglob("*"), self.draft):
                    sync(path)
            if os.path.lexists(self.target):
                self._set_aside(folder)
            os.replace(self.draft, self.target)

    def sync(self) -> None:
        """Write its new place to the disk."""
        with self._disk():
            sync(self.target.parent)

    @contextmanager
    def _disk(self) -> Generator[None]:
        try:
            yield
        except OSError as error:
            raise self._failure(error) from error

    def undo(self) -> None:
        """Put everything back as it was; of no effect once it stands or was undone."""
        if self.closed:
            return
        self.closed = True
        with suppress(OSError):
            if self._identity is not None and _identity(self.target) == self._identity:
                if self.target.is_dir():
                    os.rename(self.target, self.draft)
                elif not os.path.lexists(self._aside):
                    os.unlink(self.target)
        with suppress(OSError):
            if os.path.lexists(self._aside):
                if _identity(self._aside) == _identity(self.target):  # two names of one file
                    os.unlink(self._aside)
                else:
                    os.replace(self._aside, self.target)
        _remove(self.draft)
        for folder in reversed(self._made):
            with suppress(OSError):
                os.rmdir(folder)
        self._release()

    def finish(self) -> None:
        _remove(self._aside)
        self._release()

    def _set_aside(self, folder: bool) -> None:
        if folder:
            os.rename(self.target, self._aside)
            self._check(self._aside)  # nothing was added to it at the last moment
            return
        try:
            os.link(self.target, self._aside, follow_symlinks=False)
        except OSError as error:  # not every file system has links
            if error.errno not in _NO_LINKS:
                raise
            os.rename(self.target, self._aside)

    def _hold(self, lock: int) -> None:
        self._lock, self._identity = lock, _identity(self.draft)
        with suppress(OSError):  # not every file system has locks
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def _release(self) -> None:
        self._undone.detach()
        lock, self._lock = self._lock, None
        if lock is not None:
            with suppress(OSError):
                os.close(lock)


_waiting: ContextVar[list[OutputPlacement] | None] = ContextVar("waiting placements", default=None)


@contextmanager
def all_or_none() -> Generator[list[OutputPlacement]]:
    """Put all that is written in the block into place at its end, or nothing of it.

    A block inside another one leaves that to the outer one.
    """
    waiting = _waiting.get()
    if waiting is not None:
        yield waiting
        return
    mine: list[OutputPlacement] = []
    token = _waiting.set(mine)
    try:
        yield mine
        place_all()
    except BaseException:
        with deferred_signals():
            for placement in reversed(mine):
                placement.undo()
        raise
    finally:
        _waiting.reset(token)


def place_all() -> None:
    """Put what was written in a block `all_or_none` so far into place before its end.

    Raises:
        Exception: If one cannot be; the block, which it ends, undoes the others.
    """
    waiting = _waiting.get() or []
    with deferred_signals():
        for placement in waiting:
            placement.move()
        for placement in {one.target.parent: one for one in waiting}.values():
            placement.sync()
        for placement in waiting:
            placement.closed = True  # it stays where it stands, whatever comes
        with ExitStack() as stack:  # each is finished, even if one is not
            for placement in waiting:
                stack.callback(placement.finish)
            waiting.clear()


@contextmanager
def deferred_signals() -> Generator[None]:
    """Let the block end before a signal to stop is acted upon."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals are handled in the main thread only
        return
    met: list[int] = []

    def remember(number: int, frame: FrameType | None) -> None:
        del frame
        met.append(number)

    handlers = {number: signal.getsignal(number) for number in _SIGNALS}
    changed = [number for number, handler in handlers.items() if callable(handler)]
    try:
        for number in changed:
            signal.signal(number, remember)
        yield
    finally:
        for number in changed:
            signal.signal(number, handlers[number])
        for number in met:
            signal.raise_signal(number)


def remove_remains(target: Path) -> None:
    """Remove what a killed run left for a target, and put back what it had set aside."""
    folder, beginning = target.parent, _beginning(target)
    with suppress(OSError), os.scandir(folder) as entries:
        names = [entry.name for entry in entries if entry.name.startswith(beginning)]
        for name in names:
            match, path = _NAME.fullmatch(name), folder / name
            if match is None or is_running(int(match[2])) or is_locked(path):
                continue
            if match[3] == "old" and not os.path.lexists(target):
                os.rename(path, target)
            else:
                _remove(path)


def _beginning(target: Path) -> str:
    """First part of the names of drafts; short, whatever the length of the target's name."""
    digest = hashlib.blake2b(os.fsencode(target.name), digest_size=6).hexdigest()
    return f"{PREFIX}{digest}-"


def is_locked(path: Path) -> bool:
    try:
        number = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return False
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(number)
    return False


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        found = os.lstat(path)
    except OSError:
        return None
    return found.st_dev, found.st_ino


def sync(path: Path) -> None:
    """Bring a file, or the names in a folder, to the disk, where its file system can.

    Raises:
        OSError: If it cannot be opened, or the disk fails.
    """
    number = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(number)
    except OSError as error:
        if error.errno != errno.EINVAL:  # not every file system can
            raise
    finally:
        os.close(number)


def _leave(draft: Path, pid: int) -> None:
    """Remove a draft that nobody placed or gave up; a forked child leaves it alone."""
    if os.getpid() == pid:
        _remove(draft)


def _remove(path: Path) -> None:
    """Remove a draft or what was replaced; a later run removes what cannot be removed now."""
    try:
        _remove_once(path)
    except BaseException as error:
        with suppress(OSError):
            _remove_once(path)
        if not isinstance(error, OSError):
            raise


def _remove_once(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    elif os.path.lexists(path):
        os.unlink(path)
