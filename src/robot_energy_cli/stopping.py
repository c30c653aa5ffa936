"""SIGTERM and SIGHUP end a command as Ctrl-C does: with its clean-up."""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType

from robot_energy.foundation.stopping import DEFAULTS, End


class Stopped(KeyboardInterrupt):
    """A signal to stop was received."""

    def __init__(self, number: int) -> None:
        self.number = signal.Signals(number)
        super().__init__(self.number.name)


@contextmanager
def stoppable() -> Generator[None]:
    """Raise `Stopped` in the block on SIGTERM and SIGHUP, KeyboardInterrupt on SIGINT.

    Those that are ignored, as under nohup, or have a handler of others are left alone.
    """
    main = threading.current_thread() is threading.main_thread()
    found = {number: signal.getsignal(number) for number in DEFAULTS if main}
    changed = {
        number: handler
        for number, handler in found.items()
        if isinstance(handler, End) or handler is signal.SIG_DFL
    }
    try:
        for number in changed:
            asked = signal.default_int_handler if number == signal.SIGINT else _stop
            signal.signal(number, asked)
        yield
    finally:
        for number, handler in changed.items():
            signal.signal(number, handler)


def _stop(number: int, frame: FrameType | None) -> None:
    del frame
    raise Stopped(number)
