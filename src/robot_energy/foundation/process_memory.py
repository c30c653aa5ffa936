"""Memory of this process: kept while it replays bags, and the most that it held."""

from __future__ import annotations

import ctypes
import re
import resource
from contextlib import suppress
from pathlib import Path

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # malloc.h of glibc
KEPT = 256 * 1024 * 1024  # bytes


def keep_freed_memory() -> None:
    """Keep freed arrays in the process instead of giving them back at every step.

    Each step of a replay allocates and frees the same arrays of some hundred kilobytes.
    By default glibc returns them to the kernel, whose fresh pages then cost a fifth of
    the run. Where there is no glibc, nothing happens.
    """
    with suppress(AttributeError, OSError):
        for parameter in (M_TRIM_THRESHOLD, M_MMAP_THRESHOLD):
            ctypes.CDLL(None).mallopt(parameter, KEPT)


def give_back_freed_memory() -> None:
    """Give all freed memory back to the kernel, once; nothing happens without glibc."""
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)


def peak_memory() -> int:
    """Return the most memory that this process has held so far. [bytes]

    The figure of ``getrusage`` begins with that of the process that started this one, so it
    stands in only where there is no ``/proc``.
    """
    try:
        found = re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())
    except OSError:
        found = None
    return 1024 * (int(found[1]) if found else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
