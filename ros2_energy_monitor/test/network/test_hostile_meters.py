# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Meters whose answers are damaged, endless, late or of wrong types: typed errors, then readings.

Long runs: ``python hostile_meters.py SECONDS``, in this folder.
"""

import contextlib
import itertools
import socket
import ssl
import sys
import threading
from pathlib import Path

import pytest

from robot_energy.foundation.errors import MeterAnswerError, MeterLinkError
from ros2_energy_monitor.base.guard import Guard
from ros2_energy_monitor.meters.link import MAX_ANSWER
from ros2_energy_monitor.meters.poller import Poller
from ros2_energy_monitor.meters.reading import ReadingFilter

sys.path.append(str(Path(__file__).resolve().parent))
from hostile_meters import (
    ENDLESS,
    PROTOCOLS,
    READS,
    TIMEOUT,
    HostileServer,
    answers,
    make_link,
    modbus_answer,
    mqtt_answer,
    one_round,
    sound_answers,
)


@pytest.fixture
def thread_errors(monkeypatch):
    found = []
    monkeypatch.setattr(threading, "excepthook", lambda one: found.append(one.exc_value))
    return found


@pytest.mark.parametrize("name", PROTOCOLS)
def test_no_answer_gives_an_untyped_error(name, thread_errors, eventually):
    said, seeds = [], itertools.count()
    for seed in itertools.islice(seeds, 8):
        said += one_round(name, seed)
    # On a busy machine all of these may have come too late.
    eventually(lambda: len(set(said)) > 1 or said.extend(one_round(name, next(seeds))), "two kinds")
    assert set(said) <= {"read", "MeterLinkError", "MeterAnswerError"}
    assert not thread_errors


def test_a_topic_that_is_no_text_is_left_out(thread_errors):
    def answer(request):
        right = mqtt_answer(request)
        return [
            right.replace(b"tele/meter", b"tele/me\xf6er") + right
            if request[0] >> 4 == 8
            else right
        ]

    server = HostileServer(answer)
    link = make_link("mqtt", server.port, timeout=60.0)
    link.connect()
    found = link.read()  # of the first message that counts
    link.close()
    server.close()
    assert len(found) == 2  # energy and power of the good message
    assert not thread_errors


def test_an_answer_of_another_function_ends_the_connection():
    def other(request):
        right = modbus_answer(request)
        return [right[:7] + bytes([7 - right[7]]) + right[8:]]  # 3 for 4 and 4 for 3

    server = HostileServer(other)
    link = make_link("modbus", server.port, timeout=60.0)
    link.connect()
    with pytest.raises(MeterLinkError, match="answers function 4 with function 3"):
        link.read()
    with pytest.raises(MeterLinkError, match="not connected"):
        link.read()
    server.close()


def test_a_refused_subscription_is_named_at_once():
    def refuse(request):
        right = mqtt_answer(request)
        return [right[:4] + b"\x80"] if request[0] >> 4 == 8 else [right]

    server = HostileServer(refuse)
    link = make_link("mqtt", server.port, timeout=60.0)
    with pytest.raises(MeterLinkError, match="refuses the subscription of tele/meter/SENSOR"):
        link.connect()
    server.close()


def test_a_broker_that_does_not_let_us_in_says_why():
    server = HostileServer(lambda _: [b"\x20\x02\x00\x05"])
    link = make_link("mqtt", server.port, timeout=60.0)
    with pytest.raises(MeterLinkError, match=r"does not accept us .Not authorized"):
        link.connect()
    server.close()


# paho-mqtt leaves the socket of a failed handshake to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("name", ["http", "mqtt"])
def test_a_certificate_that_is_refused_is_named(name, certificates):
    files = certificates("urn:meter")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(files.certificate, files.key)
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve():
            with contextlib.suppress(OSError):
                context.wrap_socket(listener.accept()[0], server_side=True).close()

        threading.Thread(target=serve, daemon=True).start()
        link = make_link(name, listener.getsockname()[1], 60.0, tls=True)
        words = r"certificate is refused: .*(unable|self.signed)"
        with pytest.raises(MeterLinkError, match=words):  # noqa: PT012  one of the two connects
            link.connect()
            link.read()
        link.close()


@pytest.mark.parametrize("name", ["http", "mqtt"])
def test_a_ca_file_that_cannot_be_used_is_named(name, tmp_path):
    path = tmp_path / "ca.pem"
    link = make_link(name, 1, 60.0, tls=True, ca_file=str(path))
    with pytest.raises(MeterLinkError, match=r"ca_file .*ca\.pem cannot be used .*No such file"):
        link.connect()
    path.write_text("none")
    with pytest.raises(MeterLinkError, match=r"cannot be used .*; expected certificates"):
        link.connect()


SLOW = ("dripping", "slowly", "silence", "subscription", "chain")
ALLOWED = {"large messages", "requests without end"}  # by MQTT; what waits of them is bounded


@pytest.mark.parametrize(("name", "what"), ENDLESS, ids=lambda word: word.replace(" ", "_"))
def test_what_never_ends_is_given_up(name, what, thread_errors):
    server = HostileServer(ENDLESS[name, what])
    slow = what in ALLOWED or any(word in what for word in SLOW)
    link = make_link(name, server.port, timeout=0.5 if slow else 60.0)  # a flood ends by its size
    said = []

    def read():
        try:
            link.connect()
            for _ in range(READS):
                link.read()
        except (MeterLinkError, MeterAnswerError) as error:
            said.append(error)
        link.close()
        said.append("closed")

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    reader.join(120.0)
    assert said[-1:] == ["closed"], "it hangs"
    server.close()
    if what not in ALLOWED:
        assert isinstance(said[0], MeterLinkError), said
    assert server.sent < 20 * MAX_ANSWER  # what it took, and buffers of the sockets
    assert not thread_errors


@pytest.mark.parametrize("name", ["modbus", "http", "mqtt"])
def test_a_poller_outlives_a_hostile_meter_and_reads_the_sound_one(
    name, thread_errors, monkeypatch, eventually
):
    monkeypatch.setattr("ros2_energy_monitor.meters.poller.MIN_BACKOFF", 0.01)
    guard, tried = Guard("poller"), threading.Semaphore(0)
    wrong = answers(name, 7)

    def hostile(request):
        tried.release()
        return wrong(request)

    server = HostileServer(hostile)
    readings = ReadingFilter(1e9, 100 * TIMEOUT)
    poller = Poller(make_link(name, server.port), readings, 0.01, 0.05, guard.run)
    poller.start()
    try:
        for _ in range(12):
            assert tried.acquire(timeout=120.0)
        eventually(lambda: poller.state.errors, "errors")
        server.become(sound_answers(name))
        poller.take()
        eventually(lambda: poller.take() and poller.state.connected, "a reading of the sound meter")
    finally:
        poller.stop()
        server.close()
    assert not guard.errors
    assert not thread_errors
