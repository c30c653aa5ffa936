"""SIGTERM and SIGHUP end a command as Ctrl-C does: with its clean-up, and from its first moment.

Little is imported here: it is what an entry point imports first.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

_DEFAULTS = {
    signal.SIGINT: signal.default_int_handler,
    signal.SIGTERM: signal.SIG_DFL,
    signal.SIGHUP: signal.SIG_DFL,
}  # as Python begins; what is ignored or has a handler is left alone


class Stopped(KeyboardInterrupt):
    """A signal to stop was received."""

    def __init__(self, number: int) -> None:
        self.number = signal.Signals(number)
        super().__init__(self.number.name)


class _End:
    """Handler that ends the process with one sentence and 128 + the number of the signal."""

    def __init__(self, program: str) -> None:
        self._program = program

    def __call__(self, number: int, frame: FrameType | None) -> NoReturn:
        sentence = f"{self._program}: interrupted ({signal.Signals(number).name})\n"
        try:
            os.write(2, sentence.encode())  # not by print, which may be what is interrupted
        finally:
            os._exit(128 + number)


def end_at_once(program: str) -> None:
    """Have signals to stop end the process while there is nothing to clean up.

    An exception could be raised, and lost, inside of any import.
    """
    for number, default in _DEFAULTS.items():
        if signal.getsignal(number) is default:
            signal.signal(number, _End(program))


@contextmanager
def stoppable() -> Generator[None]:
    """Raise `Stopped` in the block on SIGTERM and SIGHUP, KeyboardInterrupt on SIGINT.

    Those that are ignored, as under nohup, or have a handler of others are left alone.
    """
    import threading  # not while nothing handles signals yet

    main = threading.current_thread() is threading.main_thread()
    found = {number: signal.getsignal(number) for number in _DEFAULTS if main}
    changed = {
        number: handler
        for number, handler in found.items()
        if isinstance(handler, _End) or handler is signal.SIG_DFL
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
