"""How a process that replays bags keeps its memory."""

from __future__ import annotations

import ctypes

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # malloc.h of glibc
KEPT = 256 * 1024 * 1024  # bytes


def keep_freed_memory() -> None:
    """Keep freed arrays in the process instead of giving them back at every step.

    Each step of a replay allocates and frees the same arrays of some hundred kilobytes.
    By default glibc returns them to the kernel, whose fresh pages then cost a fifth of
    the run. Where there is no glibc, nothing happens.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError):
        return
    mallopt(M_TRIM_THRESHOLD, KEPT)
    mallopt(M_MMAP_THRESHOLD, KEPT)
