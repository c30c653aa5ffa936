# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Meters that answer what no meter should: damaged, cut, endless, slow, of wrong types.

``python hostile_meters.py SECONDS [SEED]`` tries links and poller for that long, each
round with answers of its own, and ends with exit code 1 at the first error without a type of
ours. The tests try some rounds.
"""

from __future__ import annotations

import itertools
import json
import random
import socket
import struct
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

from documented_devices import shelly_status, tasmota_sensor

from robot_energy.foundation.errors import MeterAnswerError, MeterLinkError
from ros2_energy_monitor.base.credentials import Credentials
from ros2_energy_monitor.meters.kinds import load_profile
from ros2_energy_monitor.meters.link import Endpoint, MeterLink

TIMEOUT = 0.15  # of the links [s]
SLACK = 30.0  # that an answer may take beyond the timeout, on a machine that does much else [s]
READS = 3  # of one connection
ODD = (None, True, "512", "", [], {}, [1, 2], 10**400, -1e308, 1e309, float("nan"), "\ud800", -0.0)

Answer = Iterable[bytes | float]  # pieces to send, and pauses between them [s]; maybe endless


def modbus_answer(request: bytes) -> bytes:
    """What a sound meter answers to a request: zeros."""
    number, unit, function, _, count = struct.unpack(">H4xBBHH", request[:12])
    data = bytes(2 * count)
    return struct.pack(">HHHBBB", number, 0, 3 + len(data), unit, function, len(data)) + data


def http_answer(request: bytes, document: object = None) -> bytes:
    """What a sound meter answers."""
    body = json.dumps(document or shelly_status()).encode("utf-8", "surrogatepass")
    return b"HTTP/1.1 200 OK\r\nContent-Length: %d\r\n\r\n%s" % (len(body), body)


def mqtt_answer(request: bytes, payload: bytes = b"") -> bytes:
    """What a sound broker answers to a packet; after the subscription comes a message."""
    kind = request[0] >> 4
    if kind == 1:
        return b"\x20\x02\x00\x00"
    if kind != 8:
        return b""
    at = 2 + sum(byte > 127 for byte in request[1:5])  # behind the length of the packet
    topic = b"tele/meter/SENSOR"
    content = (
        struct.pack(">H", len(topic)) + topic + (payload or json.dumps(tasmota_sensor()).encode())
    )
    return b"\x90\x03" + request[at : at + 2] + b"\x00" + b"\x30" + _length(content) + content


def _length(content: bytes) -> bytes:
    """Length of an MQTT packet, seven bits a byte."""
    left, found = len(content), bytearray()
    while True:
        left, byte = left >> 7, left & 127
        found.append(byte | (128 if left else 0))
        if not left:
            return bytes(found)


def odd_document(rng: random.Random, document: object) -> object:
    """The document with one of its values replaced or gone."""
    if not isinstance(document, dict) or rng.random() < 0.2:
        return rng.choice(ODD)
    key = rng.choice(list(document))
    if rng.random() < 0.15:
        return {name: value for name, value in document.items() if name != key}
    return document | {key: odd_document(rng, document[key])}


def hostile(rng: random.Random, sound: bytes, odd: Callable[[], bytes]) -> Answer:
    """One wrong answer.

    Args:
        rng: Decides which.
        sound: The right one.
        odd: Makes an answer of the right form with wrong content.
    """
    flipped = bytearray(sound)
    for _ in range(rng.randint(1, 4)):
        if flipped:
            flipped[rng.randrange(len(flipped))] ^= 1 << rng.randrange(8)
    cut = sound[: rng.randrange(len(sound) + 1)]
    return rng.choice(
        (
            lambda: [rng.randbytes(rng.randint(1, 400))],
            lambda: [bytes(flipped)],
            lambda: [cut],
            lambda: [cut, 3 * TIMEOUT],
            lambda: [sound[:1], 0.02, sound[1:2], 0.02, sound[2:]],
            lambda: [piece for byte in sound[:12] for piece in (bytes([byte]), 0.5 * TIMEOUT)],
            lambda: [sound * rng.randint(2, 50)],
            lambda: [sound[:8] + bytes(200_000) + sound],
            lambda: [sound + rng.randbytes(3_000_000)],
            lambda: [rng.randbytes(3) + sound],
            lambda: [3 * TIMEOUT, sound],
            lambda: [],
            lambda: [odd()],
            lambda: [odd()],
        )
    )()


class HostileServer:
    """Answers every request with what a function of the request gives.

    Args:
        answer: Gives the pieces of the answer, and pauses.
    """

    def __init__(self, answer: Callable[[bytes], Answer]) -> None:
        self.answer = answer
        self.sent = 0  # bytes
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._server.getsockname()[1])
        self._stopped = threading.Event()
        self._round = 0
        self._thread = threading.Thread(target=self._accept, daemon=True)
        self._thread.start()

    def become(self, answer: Callable[[bytes], Answer]) -> None:
        """Answer otherwise from now on; the connections end.

        Args:
            answer: As of the class.
        """
        self.answer = answer
        self._round += 1

    def close(self) -> None:
        """End the server and its connections."""
        self._stopped.set()
        self._server.close()
        self._thread.join()

    def _accept(self) -> None:
        self._server.settimeout(0.05)
        talks: list[threading.Thread] = []
        while not self._stopped.is_set():
            try:
                client, _ = self._server.accept()
            except OSError:
                continue
            talks.append(threading.Thread(target=self._talk, args=(client,), daemon=True))
            talks[-1].start()
        for talk in talks:
            talk.join()

    def _talk(self, client: socket.socket) -> None:
        client.settimeout(0.05)
        begun = self._round
        with client:
            while not self._stopped.is_set() and begun == self._round:
                try:
                    request = client.recv(65536)
                except TimeoutError:
                    continue
                except OSError:
                    return
                if not request:
                    return
                try:
                    if not self._send(client, self.answer(request)):
                        return
                except OSError:
                    return

    def _send(self, client: socket.socket, pieces: Answer) -> bool:
        """Send an answer; no piece at all ends the connection."""
        for piece in pieces:
            if isinstance(piece, float):
                if self._stopped.wait(piece):
                    return False
                continue
            client.settimeout(2.0)  # for a reader that has stopped reading
            client.sendall(piece)
            self.sent += len(piece)
            client.settimeout(0.05)
            if self._stopped.is_set():
                return False
        return pieces != []


BLOCK = bytes(65536)
DRIP = 0.02  # from one byte to the next [s]


def without_end(head: bytes, piece: bytes = BLOCK, pause: float = 0.0) -> Answer:
    """A beginning, then a piece for ever."""
    yield head
    while True:
        yield piece
        if pause:
            yield pause


def dripping(data: bytes, then: bytes = b" ") -> Answer:
    """Byte after byte, for ever."""
    for byte in data:
        yield bytes([byte])
        yield DRIP
    yield from without_end(b"", then, DRIP)


def _status(line: str, *headers: str) -> bytes:
    return "\r\n".join([f"HTTP/1.1 {line}", *headers, "", ""]).encode()


CHALLENGE = 'WWW-Authenticate: Digest qop="auth", realm="r", nonce="n", algorithm=SHA-256'
LONG = f"Content-Length: {10**12}"


def _modbus_other(request: bytes) -> bytes:
    """Answer to a transaction that nobody began."""
    return bytes([request[0] ^ 0xFF]) + modbus_answer(request)[1:]


def _sunspec_chain(request: bytes) -> Answer:
    """A chain of models without length, each answered just in time."""
    address, count = struct.unpack(">HH", request[8:12])
    words = [0x5375, 0x6E53] if address in (40000, 50000, 0) else [1, 0]
    yield 0.5 * TIMEOUT
    yield modbus_answer(request)[:9] + struct.pack(f">{count}H", *words[:count])


def _message(content: bytes, first: int = 0x30) -> bytes:
    return bytes([first]) + _length(content) + content


def _topic(body: bytes, identifier: bytes = b"") -> bytes:
    return b"\x00\x11tele/meter/SENSOR" + identifier + body


def _after_subscription(endless: Callable[[], Answer]) -> Callable[[bytes], Answer]:
    def answer(request: bytes) -> Answer:
        if request[0] >> 4 == 8:
            yield mqtt_answer(request)
            yield from endless()
        else:
            yield mqtt_answer(request)

    return answer


def _qos_2() -> Answer:
    for number in itertools.cycle(range(1, 65536)):
        yield _message(_topic(bytes(900_000), struct.pack(">H", number)), 0x34)


# What a server does for ever, by protocol: each is met with an error, in bounded time and memory.
ENDLESS: dict[tuple[str, str], Callable[[bytes], Answer]] = {
    ("http", "refused without end"): lambda _: without_end(
        _status("401 Unauthorized", CHALLENGE, LONG)
    ),
    ("http", "refused in chunks"): lambda _: without_end(
        _status("401 Unauthorized", CHALLENGE, "Transfer-Encoding: chunked"),
        b"10000\r\n" + BLOCK + b"\r\n",
    ),
    ("http", "failed without end"): lambda _: without_end(_status("500 No", LONG)),
    ("http", "moved without end"): lambda _: without_end(_status("302 Found", "Location: /", LONG)),
    ("http", "answer without end"): lambda _: without_end(_status("200 OK")),
    ("http", "headers without end"): lambda _: without_end(b"HTTP/1.1 200 OK\r\n", b"a: b\r\n"),
    ("http", "line without end"): lambda _: without_end(b"HTTP/1.1 200 OK\r\na: ", b"b" * 65536),
    ("http", "continue for ever"): lambda _: without_end(b"", _status("100 Continue")),
    ("http", "continue slowly"): lambda _: without_end(b"", _status("100 Continue"), DRIP),
    ("http", "dripping headers"): lambda _: dripping(_status("200 OK", LONG)),
    ("http", "dripping body"): lambda _: without_end(_status("200 OK", LONG), b" ", DRIP),
    ("http", "dripping refusal"): lambda _: without_end(
        _status("401 Unauthorized", CHALLENGE, LONG), b" ", DRIP
    ),
    ("http", "silence"): lambda _: without_end(b"", b"", DRIP),
    ("modbus", "zeros without end"): lambda _: without_end(b""),
    ("modbus", "answers to others"): lambda request: without_end(b"", _modbus_other(request)),
    ("modbus", "dripping zeros"): lambda _: dripping(b"", b"\x00"),
    ("modbus", "dripping answer"): lambda request: dripping(modbus_answer(request)[:-1], b""),
    ("modbus", "silence"): lambda _: without_end(b"", b"", DRIP),
    ("sunspec", "chain without end"): _sunspec_chain,
    ("sunspec", "zeros without end"): lambda _: without_end(b""),
    ("mqtt", "packet of 250 MB"): _after_subscription(
        lambda: without_end(b"\x30\xff\xff\xff\x7f" + _topic(b""))
    ),
    ("mqtt", "dripping packet"): _after_subscription(
        lambda: without_end(b"\x30\xff\xff\x03" + _topic(b""), b" ", DRIP)
    ),
    ("mqtt", "messages to hold"): _after_subscription(_qos_2),
    ("mqtt", "large messages"): _after_subscription(
        lambda: without_end(b"", _message(_topic(bytes(900_000))))
    ),
    ("mqtt", "requests without end"): _after_subscription(
        lambda: without_end(b"", b"\xc0\x00" * 1000)
    ),
    ("mqtt", "no subscription"): lambda request: [
        mqtt_answer(request) if request[0] == 16 else b""
    ],
    ("mqtt", "silence"): lambda _: without_end(b"", b"", DRIP),
}


class Protocol(NamedTuple):
    """One way to ask a meter: a profile, its right answers, and wrong ones of the right form."""

    profile: str
    sound: Callable[[bytes], bytes]
    odd: Callable[[random.Random, bytes], bytes]


def _odd_modbus(rng: random.Random, request: bytes) -> bytes:
    """An answer to another request, of another length, or an exception."""
    answer = bytearray(modbus_answer(request))
    at = rng.choice((0, 4, 7))
    answer[at : at + 2] = rng.randbytes(2)
    return bytes(answer)


def _odd_mqtt(rng: random.Random, request: bytes) -> bytes:
    document = json.dumps(odd_document(rng, tasmota_sensor()))
    return mqtt_answer(request, document.encode("utf-8", "surrogatepass"))


PROTOCOLS = {
    "modbus": Protocol("siemens_pac2200", modbus_answer, _odd_modbus),
    "sunspec": Protocol("sunspec_meter", modbus_answer, _odd_modbus),
    "http": Protocol(
        "shelly_pro_3em_http",
        http_answer,
        lambda rng, request: http_answer(request, odd_document(rng, shelly_status())),
    ),
    "mqtt": Protocol("tasmota_mqtt", mqtt_answer, _odd_mqtt),
}


def make_link(name: str, port: int, timeout: float = TIMEOUT, **options: Any) -> MeterLink:
    """A link of a protocol, not connected."""
    kind, profile = load_profile(PROTOCOLS[name].profile)
    given = Credentials("admin", "secret") if name == "http" else None
    endpoint = Endpoint(
        host="127.0.0.1",
        port=port,
        timeout=timeout,
        device="meter",
        credentials=given,
        **options,
    )
    return kind.make(profile, endpoint)


def answers(name: str, seed: int) -> Callable[[bytes], Answer]:
    """Function that answers sometimes well, mostly not."""
    rng = random.Random(seed)
    _, sound, odd = PROTOCOLS[name]

    def answer(request: bytes) -> Answer:
        try:
            right = sound(request)
        except (struct.error, IndexError):
            right = b"\x00"  # the client was led to ask something odd
        if rng.random() < 0.3:
            return [right]
        try:
            return hostile(rng, right, lambda: odd(rng, request))
        except (struct.error, IndexError):
            return [rng.randbytes(20)]

    return answer


def sound_answers(name: str) -> Callable[[bytes], Answer]:
    """Function that answers as a sound meter."""
    return lambda request: [PROTOCOLS[name].sound(request)]


def one_round(name: str, seed: int) -> Iterator[str]:
    """Connect and read a few times; only errors of a link are caught.

    Yields:
        What each call gave: the class of its error, or ``read``.
    """
    server = HostileServer(answers(name, seed))
    link = make_link(name, server.port)
    try:
        begin = time.monotonic()
        try:
            link.connect()
        except (MeterLinkError, MeterAnswerError) as error:
            yield type(error).__name__
            return
        for _ in range(READS):
            try:
                for exchange in link.read():
                    assert all(isinstance(term.value, int | float) for term in exchange.terms)
                yield "read"
            except MeterLinkError as error:
                yield type(error).__name__
                break
            except MeterAnswerError as error:
                yield type(error).__name__
        assert time.monotonic() - begin < (READS + 2) * 10 * TIMEOUT + SLACK
    finally:
        link.close()
        server.close()


def main() -> int:
    """Try until the time is over."""
    warnings.simplefilter("error", ResourceWarning)
    until, seed = time.monotonic() + float(sys.argv[1]), int([*sys.argv, "1"][2])
    errors: list[object] = []
    threading.excepthook = lambda found: errors.append(found.exc_value)
    counts: dict[str, dict[str, int]] = {name: {} for name in PROTOCOLS}
    while time.monotonic() < until:
        for name in PROTOCOLS:
            for said in one_round(name, seed):
                counts[name][said] = counts[name].get(said, 0) + 1
            if errors:
                print(f"{name}, seed {seed}: in a thread: {errors[0]!r}")
                return 1
        seed += 1
    print(json.dumps(counts))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
