# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Meters that answer HTTP requests with JSON, whose whole answers are bounded.

The adapter of `requests` bounds the wait for a single byte, and authentication reads the body of a
refused request whole. Here the socket itself counts bytes and time.
"""

from __future__ import annotations

import http.client
import io
import select
import socket
import time
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import Field

from robot_energy.foundation.errors import MeterAnswerError, MeterLinkError, MeterProfileError
from ros2_energy_monitor.base.connection_failure import reason_of
from ros2_energy_monitor.base.optional_packages import require
from ros2_energy_monitor.meters.link import (
    AnswerBound,
    Endpoint,
    JsonFlag,
    JsonNumber,
    MeterLink,
    is_good,
    parse,
    terms_at,
)
from ros2_energy_monitor.meters.profile import MeterProfile
from ros2_energy_monitor.meters.reading import Exchange

PIECE = 4096  # bytes taken at once


class _BoundedSocket(io.RawIOBase):
    """What `http.client` uses of a socket, within a bound."""

    def __init__(self, connection: socket.socket, bound: AnswerBound) -> None:
        self._connection, self._bound = connection, bound

    def sendall(self, data: bytes) -> None:
        self._connection.settimeout(self._bound.left)
        self._connection.sendall(data)

    def makefile(self, *_: Any) -> io.BufferedReader:
        return io.BufferedReader(self, PIECE)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        self._connection.settimeout(self._bound.left)
        try:
            count = self._connection.recv_into(buffer)
        except TimeoutError:
            raise self._bound.over() from None
        self._bound.take(count)
        return count

    def close(self) -> None:
        """Do nothing: `http.client` closes before it has read the answer."""

    def end(self) -> None:
        self._connection.close()

    @property
    def is_idle(self) -> bool:
        """Whether nothing was received that nobody has asked for."""
        return not select.select([self._connection], [], [], 0)[0]


class BoundedTransport:
    """Transport adapter of `requests`: one connection, kept between requests to one endpoint."""

    def __init__(self, requests: Any, endpoint: Endpoint, bound: AnswerBound) -> None:
        self._requests, self._endpoint, self._bound = requests, endpoint, bound
        self._context = endpoint.tls_context()
        self._kept: _BoundedSocket | None = None

    def send(self, request: Any, **options: Any) -> Any:
        """Return the whole answer to a prepared request.

        Args:
            options: Of the session, not used: all of them follow from the endpoint.

        Raises:
            OSError: If no answer comes within the bound.
            HTTPException: If it is no HTTP.
        """
        if self._kept is None or not self._kept.is_idle:
            self._connect()
        connection = http.client.HTTPConnection(self._endpoint.host, self._endpoint.port)
        connection.auto_open, connection.sock = 0, self._kept
        try:
            connection.request(request.method, request.path_url, headers=dict(request.headers))
            found = connection.getresponse()
            body = bytearray()
            while piece := found.read1(PIECE):
                body += piece
            found.close()  # without a body it does not end by itself
        except BaseException:
            self.close()
            raise
        if found.will_close:
            self.close()
        answer = self._requests.Response()
        answer.status_code, answer.url = found.status, request.url
        answer.headers.update(found.headers.items())
        answer.raw, answer.request, answer.connection = io.BytesIO(body), request, self
        return answer

    def close(self) -> None:
        if self._kept is not None:
            self._kept.end()
            self._kept = None

    def _connect(self) -> None:
        self.close()
        host, port = self._endpoint.host, self._endpoint.port
        plain = socket.create_connection((host, port), timeout=self._bound.left)
        try:
            if self._context is not None:
                plain.settimeout(self._bound.left)
                plain = self._context.wrap_socket(plain, server_hostname=host)
        except BaseException:
            plain.close()
            raise
        self._kept = _BoundedSocket(plain, self._bound)


OK = 200


class HttpProfile(MeterProfile[JsonNumber]):
    """Profile of a meter that is asked by HTTP; one answer holds all numbers.

    Attributes:
        auth: How a name and a password are sent, where the user gives them.
    """

    port: Annotated[int, Field(ge=1, le=65535)] = 80
    request: Annotated[str, Field(pattern=r"^/\S*$", max_length=500)]
    auth: Literal["digest", "basic"]
    flags: tuple[JsonFlag, ...] = ()

    @property
    def hides_password(self) -> bool:
        """Digest authentication sends a hash."""
        return self.auth == "digest"


class HttpLink(MeterLink):
    """Asks over one kept connection; redirections and proxies are not followed."""

    def __init__(self, profile: HttpProfile, endpoint: Endpoint) -> None:
        self._requests = require("requests", "requests", "this meter", MeterProfileError)
        self._profile, self._endpoint = profile, endpoint
        self._bound = AnswerBound(self._where, endpoint.timeout)
        self._scheme = "https" if endpoint.tls else "http"
        self._url = f"{self._scheme}://{endpoint.host}:{endpoint.port}{profile.request}"
        self._session: Any = None

    @property
    def _where(self) -> str:
        return f"the HTTP meter at {self._endpoint.host}:{self._endpoint.port}"

    def connect(self) -> None:
        """Make a session; the connection comes with the first request."""
        self.close()
        session = self._requests.Session()
        session.trust_env = False
        session.headers["Accept-Encoding"] = "identity"  # no answer grows when it is unpacked
        transport = BoundedTransport(self._requests, self._endpoint, self._bound)
        session.mount(f"{self._scheme}://", transport)
        given = self._endpoint.credentials
        if given is not None:
            auth = self._requests.auth
            kind = {"digest": auth.HTTPDigestAuth, "basic": auth.HTTPBasicAuth}[self._profile.auth]
            session.auth = kind(given.username, given.password)
        self._session = session

    def close(self) -> None:
        if self._session is not None:
            self._session.close()
            self._session = None

    def read(self) -> Sequence[Exchange]:
        requested = time.monotonic()
        self._bound.begin()
        text = self._text()
        answered = time.monotonic()
        document = parse(text, self._where)
        good = is_good(document, self._profile.flags)
        return [
            Exchange(what, terms_at(document, numbers, self._where, good=good), requested, answered)
            for what, numbers in self._profile.quantities.items()
        ]

    def _text(self) -> str:
        """Body of the answer, of bounded size and in bounded time."""
        if self._session is None:
            raise MeterLinkError(f"{self._where} is not connected", "connect first")
        try:
            answer = self._session.get(self._url, allow_redirects=False)
        except MeterLinkError:
            raise
        except (self._requests.RequestException, http.client.HTTPException, OSError) as error:
            raise MeterLinkError(
                f"{self._where} gives no answer ({reason_of(error)})",
                f"one within {self._endpoint.timeout:g} s",
            ) from error
        if answer.status_code != OK:
            raise MeterAnswerError(
                f"{self._where} answers {self._profile.request} with status {answer.status_code}",
                f"{OK}; 401 asks for credentials_file",
            )
        return answer.content.decode("utf-8", errors="replace")
