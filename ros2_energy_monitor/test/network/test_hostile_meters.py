"""Meters whose answers are damaged, endless, late or of wrong types: typed errors, then readings.

Long runs: ``python hostile_meters.py SECONDS``, in this folder.
"""

import itertools
import sys
import threading
from pathlib import Path

import pytest

from ros2_energy_monitor.base.guard import Guard
from ros2_energy_monitor.meters.poller import Poller
from ros2_energy_monitor.meters.reading import ReadingFilter

sys.path.append(str(Path(__file__).resolve().parent))
from hostile_meters import (
    PROTOCOLS,
    TIMEOUT,
    HostileServer,
    answers,
    make_link,
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
