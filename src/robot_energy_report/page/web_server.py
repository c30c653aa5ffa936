"""The HTTP server of the page, in a thread of its own."""

from __future__ import annotations

import asyncio
import logging
import socket
import threading
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from robot_energy.foundation.errors import PageError
from robot_energy_report.page.access import PageAccess
from robot_energy_report.page.hub import PageHub
from robot_energy_report.page.web_app import PageApp

MAX_CONNECTIONS = 512
REQUEST_TIMEOUT = 10.0  # for a request to arrive whole, and for a client to read [s]
SEND_BUFFER = 64 * 1024  # of a connection in the kernel [bytes]
MAX_HEADERS = 16 * 1024  # of a request [bytes]
START_TIMEOUT = 10.0  # [s]


class BoundedProtocol(H11Protocol):
    """HTTP/1.1 that drops connections beyond a number, and clients that send or read too slowly."""

    _deadline: asyncio.TimerHandle | None = None
    _reading: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        """Take a connection, unless there are too many."""
        super().connection_made(transport)
        if len(self.connections) > MAX_CONNECTIONS:
            transport.abort()
            return
        self._expect_request()

    def data_received(self, data: bytes) -> None:
        """Take bytes; a request has a limited time from its first byte to its last."""
        super().data_received(data)
        cycle: Any = self.cycle  # None before the first request
        if cycle is not None and not cycle.response_complete:
            self._deadline = _cancelled(self._deadline)
        else:
            self._expect_request()

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        self._deadline = _cancelled(self._deadline)
        super().on_response_complete()

    def pause_writing(self) -> None:
        """The client reads too slowly; it has a limited time to go on."""
        super().pause_writing()
        self._reading = self._reading or self.loop.call_later(REQUEST_TIMEOUT, self._drop)

    def resume_writing(self) -> None:
        """The client reads again."""
        self._reading = _cancelled(self._reading)
        super().resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the timers."""
        self._deadline, self._reading = _cancelled(self._deadline), _cancelled(self._reading)
        super().connection_lost(exc)

    def _expect_request(self) -> None:
        if self._deadline is None and not self.transport.is_closing():
            self._deadline = self.loop.call_later(REQUEST_TIMEOUT, self._drop)

    def _drop(self) -> None:
        self._deadline = self._reading = None
        self.transport.abort()


class PageServer:
    """Serves a page until it is closed."""

    def __init__(self, hub: PageHub, access: PageAccess) -> None:
        self._socket = _listening(access)
        port = int(self._socket.getsockname()[1])
        shown = f"[{access.address}]" if ":" in access.address else access.address
        self.url = f"http://{shown}:{port}/"
        self._hub = hub
        self._app = PageApp(hub, access)
        self._loop = asyncio.new_event_loop()
        self._server = uvicorn.Server(
            uvicorn.Config(
                self._app,
                http=BoundedProtocol,
                ws="none",
                lifespan="off",
                loop="none",
                log_config=None,
                log_level=logging.CRITICAL,
                access_log=False,
                server_header=False,
                proxy_headers=False,
                h11_max_incomplete_event_size=MAX_HEADERS,
                timeout_keep_alive=round(REQUEST_TIMEOUT),
                timeout_graceful_shutdown=1,
            )
        )
        self._started = threading.Event()
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)
        self._thread.start()
        self._started.wait(START_TIMEOUT)
        hub.on_tick = self._notify

    def close(self) -> None:
        """Close all connections and end the thread."""
        self._hub.on_tick = None
        self._server.should_exit = True
        self._server.force_exit = True
        self._thread.join(START_TIMEOUT)
        self._app.close()
        self._socket.close()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.call_soon(self._started.set)
        try:
            self._loop.run_until_complete(self._server.serve(sockets=[self._socket]))
            for task in asyncio.all_tasks(self._loop):
                task.cancel()
            self._loop.run_until_complete(asyncio.sleep(0))
        finally:
            self._loop.close()

    def _notify(self) -> None:
        try:
            self._loop.call_soon_threadsafe(self._app.notify)
        except RuntimeError:  # the loop has just been closed
            pass


def _listening(access: PageAccess) -> socket.socket:
    family = socket.AF_INET6 if ":" in access.address else socket.AF_INET
    found = socket.socket(family, socket.SOCK_STREAM)
    try:
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        found.bind((access.address, access.port))
        found.listen(128)
    except OSError as error:
        found.close()
        raise PageError(
            f"the page cannot listen on {access.address} port {access.port} "
            f"({error.strerror or error})",
            "a free port of this computer",
            "choose another port, or 0 for any",
        ) from error
    return found


def _cancelled(timer: asyncio.TimerHandle | None) -> None:
    if timer is not None:
        timer.cancel()
