"""Requests to the page as any client can send them, well formed or not."""

import json
import socket
import time
from contextlib import closing
from http.client import HTTPConnection
from urllib.parse import urlsplit

PATIENCE = 120.0  # s, on a busy machine


def request(url, path="/", method="GET", body=None, **headers):
    """Status, headers and body of one answer; header names with _ for -."""
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    with closing(HTTPConnection(urlsplit(url).netloc, timeout=PATIENCE)) as connection:
        connection.request(method, path, body, named)
        answer = connection.getresponse()
        return answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read()


def state_of(url, **headers):
    status, _, body = request(url, "/api/state", **headers)
    assert status == 200, body
    return json.loads(body)


def connected(url):
    place = urlsplit(url)
    return socket.create_connection((place.hostname, place.port), timeout=PATIENCE)


def answer_to(url, data):
    """All bytes that come back for raw bytes; the client then says that it has no more."""
    with connected(url) as client:
        try:
            client.sendall(data)
            client.shutdown(socket.SHUT_WR)
        except OSError:  # refused before all was sent
            pass
        found = b""
        try:
            while part := client.recv(65536):
                found += part
        except ConnectionError:
            pass
        return found


def wait_until(condition, what):
    limit = time.monotonic() + PATIENCE
    while not (found := condition()):
        assert time.monotonic() < limit, f"waited {PATIENCE} s in vain for {what}"
        time.sleep(0.02)
    return found
