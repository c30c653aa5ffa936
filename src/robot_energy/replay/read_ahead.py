"""An iterator in a process of its own, which works ahead of the process that takes its items."""

from __future__ import annotations

import os
import pickle
import signal
import warnings
from collections.abc import Generator, Iterator
from contextlib import suppress
from fcntl import fcntl
from multiprocessing import get_all_start_methods, get_context
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from robot_energy.foundation.errors import BagError

T = TypeVar("T")

PIPE_BYTES = 2**20  # items that wait; a process that is further ahead waits itself
SET_PIPE_SIZE = 1031  # F_SETPIPE_SZ of Linux


def can_read_ahead() -> bool:
    return "fork" in get_all_start_methods()


def read_ahead(items: Iterator[T]) -> Generator[T]:
    """Yield the items of an iterator that runs in a process of its own.

    The items are those of the iterator, in their order. What it changes, it changes in its own
    process only: what must come back is part of an item.

    Raises:
        Exception: What the iterator raises.
    """
    context = get_context("fork")
    receive, send = context.Pipe(duplex=False)
    with suppress(OSError):  # a pipe that holds more, where the system allows it
        fcntl(send.fileno(), SET_PIPE_SIZE, PIPE_BYTES)
    process = context.Process(target=_serve, args=(items, send, receive))
    with warnings.catch_warnings():  # of threads, which hold nothing that the process needs
        warnings.simplefilter("ignore", DeprecationWarning)
        process.start()
    send.close()
    try:
        while True:
            try:
                item, error, more = _received(receive)
            except EOFError:
                process.join()
                raise BagError(
                    f"the process that reads ahead ended with code {process.exitcode}",
                    "one that reads to the end",
                    "try again with --processes 1",
                ) from None
            if error is not None:
                raise error
            if not more:
                return
            yield item
    finally:
        receive.close()
        process.kill()
        process.join()


def _send(pipe: Connection, message: Any) -> None:
    """Send an object: arrays go from their own memory into the pipe."""
    arrays: list[pickle.PickleBuffer] = []
    text = pickle.dumps(message, 5, buffer_callback=arrays.append)
    views = [array.raw() for array in arrays]
    pipe.send((text, [view.nbytes for view in views]))
    for view in views:
        done = 0
        while done < view.nbytes:
            done += os.write(pipe.fileno(), view[done:])


def _received(pipe: Connection) -> Any:
    """Take an object that was sent; its arrays go into their own memory. EOFError at the end."""
    text, sizes = pipe.recv()
    arrays = [bytearray(size) for size in sizes]
    for array in arrays:
        view, done = memoryview(array), 0
        while done < len(view):
            more = os.readv(pipe.fileno(), [view[done:]])
            if not more:
                raise EOFError
            done += more
    return pickle.loads(text, buffers=arrays)


def _serve(items: Iterator[T], send: Connection, receive: Connection) -> None:
    """Send items, then what was raised or that there are no more; stop where nobody takes them."""
    receive.close()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the other process ends this one
    try:
        error: Exception | None = None
        try:
            for item in items:
                _send(send, (item, None, True))
        except BrokenPipeError:
            raise
        except Exception as raised:
            error = raised
        _send(send, (None, error, False))
    except BrokenPipeError:
        return
