# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""From exchanges to readings, and what the poller does when a meter fails."""

from __future__ import annotations

import math
import struct

import pytest

from robot_energy.foundation.errors import CredentialsError
from ros2_energy_monitor.base.credentials import read_credentials
from ros2_energy_monitor.meters.kinds import load_profile
from ros2_energy_monitor.meters.link import Endpoint
from ros2_energy_monitor.meters.poller import Poller
from ros2_energy_monitor.meters.reading import (
    CounterWrap,
    Exchange,
    MeterTerm,
    Quantity,
    ReadingFilter,
)


def test_a_wrap_continues_and_a_reset_falls():
    def step(counter, value, wraps_at, at):
        return counter.step(MeterTerm(value, wraps_at), at)

    counter = CounterWrap(max_power=1000.0)
    assert step(counter, 990.0, 1000.0, 0.0) == 990.0
    assert step(counter, 5.0, 1000.0, 1.0) == 1005.0  # 15 W for a second
    assert step(counter, 8.0, 1000.0, 2.0) == 1008.0
    assert step(counter, 0.0, 1000.0, 2.5) == 1000.0  # 992 J in 0.5 s: more than 1 kW, a reset
    assert counter.wraps == 1
    plain = CounterWrap(max_power=1000.0)
    assert [step(plain, count, None, at) for at, count in enumerate((9.0, 3.0))] == [9.0, 3.0]


def scaled(*counts, reconnected_at=None):
    """What becomes of counts that a meter states with a scale, one a second; None for refused."""
    readings = ReadingFilter(1e6, 0.5)
    found = []
    for at, (count, exponent) in enumerate(counts):
        if at == reconnected_at:
            readings.reconnected()
        scale = 3600.0 * 10.0**exponent
        term = MeterTerm(count * scale, scale=scale)
        reading = readings.step(Exchange(Quantity.ENERGY, (term,), at, at))
        found.append(reading and round(reading.value / 3600, 6))
    return found, readings.rejected


def test_a_scale_that_jumps_is_refused_and_one_that_goes_with_its_count_is_not():
    found, rejected = scaled((4000, 0), (4001, 3), (4002, 3), (4003, 0), (4004, 0))
    assert found == [4000, None, None, 4003, 4004]
    assert rejected == {"scale_changed": 2}
    found, rejected = scaled((40_000_008, 0), (4_000_001, 1), (4_000_002, 1), (40_000_021, 0))
    assert found == [40_000_008, 40_000_010, 40_000_020, 40_000_021]
    assert not rejected


def test_a_new_connection_may_bring_another_scale():
    found, rejected = scaled((4000, 0), (17, -1), (17, -1), (20, -1), reconnected_at=2)
    assert found == [4000, None, 1.7, 2.0]
    assert rejected == {"scale_changed": 1}


def exchange(value, quantity=Quantity.ENERGY, took=0.1, wraps_at=None, at=10.0):
    return Exchange(quantity, (MeterTerm(value, wraps_at),), at, at + took)


def test_the_stamp_is_the_middle_of_the_exchange():
    reading = ReadingFilter(1e6, 0.5).step(exchange(5.0, took=0.3))
    assert reading.at == pytest.approx(10.15)
    assert reading.value == 5.0


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (exchange(math.nan), "not_finite"),
        (exchange(math.inf, Quantity.POWER), "not_finite"),
        (exchange(-2e6, Quantity.POWER), "too_high"),
        (exchange(5.0, took=0.6), "slow"),
    ],
)
def test_what_is_no_reading_is_counted(given, reason):
    readings = ReadingFilter(1e6, 0.5)
    assert readings.step(given) is None
    assert readings.rejected == {reason: 1}
    assert readings.accepted == 0


def test_each_term_of_a_sum_wraps_on_its_own():
    readings = ReadingFilter(1e6, 0.5)
    for at, (day, night), total in ((0, (98.0, 40.0), 138.0), (1, (3.0, 41.0), 144.0)):
        terms = (MeterTerm(day, 100.0), MeterTerm(night, 100.0))
        reading = readings.step(Exchange(Quantity.ENERGY, terms, at, at))
        assert reading.value == total
    assert readings.wraps == 1


def floats(power, energy):
    def pair(address, number):
        data = struct.pack(">f", number)
        return {
            address: int.from_bytes(data[:2], "big"),
            address + 1: int.from_bytes(data[2:], "big"),
        }

    return pair(19026, power) | pair(19068, energy)


@pytest.fixture
def polled(modbus):
    """A Janitza and what polls it, fast."""
    pollers = []

    def make(**options):
        server = modbus(floats(100.0, 5.0))
        kind, profile = load_profile("janitza_umg604")
        given = {"period": 0.02, "max_backoff": 0.5, **options}
        endpoint = Endpoint(host="127.0.0.1", port=server.port, timeout=5.0)
        readings = ReadingFilter(1e6, 0.3)

        def guarded(path, work):
            work()

        pollers.append(Poller(kind.make(profile, endpoint), readings, guarded=guarded, **given))
        pollers[-1].start()
        return server, pollers[-1]

    yield make
    for poller in pollers:
        poller.stop()


def test_a_server_dies_and_returns(polled, eventually):
    server, poller = polled()
    eventually(lambda: poller.readings.accepted > 4, "readings")
    server.stop()
    eventually(lambda: poller.state.failures >= 2, "failures")
    assert not poller.state.connected
    assert poller.state.backoff <= 0.5
    assert "accept" in poller.state.last_error or "no answer" in poller.state.last_error
    poller.take()
    server.registers = floats(200.0, 6.0)
    server.start()
    taken = []
    eventually(lambda: taken.extend(poller.take()) or len(taken) > 3, "readings again")
    assert poller.state.connections == 2
    assert {one.value for one in taken} == {200.0, 6.0 * 3600}
    times = [one.at for one in taken]
    assert times == sorted(times)


def test_refusals_and_late_answers_are_counted_and_pass(polled, eventually):
    server, poller = polled()
    server.refusal = 6  # busy
    eventually(lambda: poller.state.errors["MeterAnswerError"] > 12, "refusals, more than ten")
    assert "exception 6" in poller.state.last_error
    server.refusal = None
    before = poller.readings.accepted
    eventually(lambda: poller.readings.accepted > before, "readings")
    assert poller.state.refusals == 0
    assert poller.state.connections > 1  # after ten in a row a new connection is tried
    server.delay = 0.4  # within the timeout, too late for a stamp
    eventually(lambda: poller.readings.rejected["slow"] > 1, "slow answers")
    server.delay = 0.0
    before = poller.readings.accepted
    eventually(lambda: poller.readings.accepted > before, "readings")


def test_a_meter_that_says_nan(polled, eventually):
    server, poller = polled()
    eventually(lambda: poller.readings.accepted > 4, "readings")
    server.registers = floats(math.nan, math.inf)
    eventually(lambda: poller.readings.rejected["not_finite"] > 4, "refused readings")
    assert poller.state.connected


def test_stop_ends_the_thread_while_nobody_answers(polled, eventually):
    server, poller = polled(max_backoff=3600.0)
    server.stop()
    eventually(lambda: poller.state.failures > 1, "failures")
    poller.stop()
    assert not poller._thread.is_alive()


def test_credentials_are_private(tmp_path):
    path = tmp_path / "meter.yaml"
    path.write_text("username: admin\npassword: secret\n")
    path.chmod(0o640)
    with pytest.raises(CredentialsError, match=r"permissions 0640; expected 0600.*[Cc]hmod 600"):
        read_credentials(str(path))
    path.chmod(0o600)
    found = read_credentials(str(path))
    assert (found.username, found.password) == ("admin", "secret")
    assert "secret" not in repr(found)
    path.write_text("username: admin\npasswort: secret\n")
    with pytest.raises(CredentialsError, match="password") as caught:
        read_credentials(str(path))
    assert "secret" not in str(caught.value)
    assert read_credentials("") is None
    with pytest.raises(CredentialsError, match="No such file"):
        read_credentials(str(tmp_path / "none.yaml"))
