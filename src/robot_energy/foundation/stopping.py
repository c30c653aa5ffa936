"""Signals to stop end a program from its first moment, with one sentence.

Little is imported here: it is what an entry point imports first.
"""

from __future__ import annotations

import os
import signal
from types import FrameType
from typing import NoReturn

DEFAULTS = {
    signal.SIGINT: signal.default_int_handler,
    signal.SIGTERM: signal.SIG_DFL,
    signal.SIGHUP: signal.SIG_DFL,
}  # as Python begins; what is ignored or has a handler is left alone


class End:
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
    for number, default in DEFAULTS.items():
        if signal.getsignal(number) is default:
            signal.signal(number, End(program))
