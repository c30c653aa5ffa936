"""SIGTERM and SIGHUP end a command as Ctrl-C does: with its clean-up."""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType

_SIGNALS = (signal.SIGTERM, signal.SIGHUP)


class Stopped(KeyboardInterrupt):
    """A signal to stop was received.

    Args:
        number: Of the signal.
    """

    def __init__(self, number: int) -> None:
        self.number = signal.Signals(number)
        super().__init__(self.number.name)


@contextmanager
def stoppable() -> Generator[None]:
    """Raise `Stopped` in the block on SIGTERM and SIGHUP.

    Those that are ignored, as under nohup, or have a handler already are left alone.
    """
    main = threading.current_thread() is threading.main_thread()
    changed = [number for number in _SIGNALS if main and signal.getsignal(number) is signal.SIG_DFL]
    try:
        for number in changed:
            signal.signal(number, _stop)
        yield
    finally:
        for number in changed:
            signal.signal(number, signal.SIG_DFL)


def _stop(number: int, frame: FrameType | None) -> None:
    del frame
    raise Stopped(number)
