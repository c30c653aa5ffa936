# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The node: what it publishes is what the monitors read, with the time of the exchange."""

from __future__ import annotations

import json
import math
import struct
import sys
import time
from pathlib import Path

import pytest
from ros2_energy_msgs.msg import PowerReading

from robot_energy.foundation.errors import MeterProfileError, ParameterError
from ros2_energy_monitor.nodes import meter_driver
from ros2_energy_monitor.nodes.meter_driver import MeterDriver
from ros2_energy_monitor.nodes.power_monitor import PowerMonitor

sys.path.append(str(Path(__file__).resolve().parent))
from documented_devices import shelly_em, shelly_emdata, tasmota_sensor


def registers(address, form, number):
    data = struct.pack(f">{form}", number)
    return {
        address + i: int.from_bytes(data[2 * i : 2 * i + 2], "big") for i in range(len(data) // 2)
    }


def pac(energy, power):
    return registers(801, "d", energy) | registers(805, "d", 0.0) | registers(65, "f", power)


@pytest.fixture(autouse=True)
def often(monkeypatch):
    monkeypatch.setattr(meter_driver, "REPORT_PERIOD", 0.2)


def test_energy_and_power_of_a_pac2200(bench, modbus):
    server = modbus(pac(1000.0, 750.5))
    energy = bench.latest(PowerReading, "power_meter")
    power = bench.latest(PowerReading, "power_meter/power")
    diagnosed = bench.diagnosed()
    begin = time.time()
    bench.add(
        MeterDriver, profile="siemens_pac2200", host="127.0.0.1", port=server.port, period=0.05
    )
    bench.spin_until(lambda: energy() and power(), "readings")
    assert energy().meaning == PowerReading.MEANING_CUMULATIVE
    assert energy().location == PowerReading.LOCATION_GRID
    assert energy().energy == 3.6e6
    assert math.isnan(energy().power)
    assert power().meaning == PowerReading.MEANING_MEAN_OVER_INTERVAL
    assert power().power == 750.5
    assert power().interval == 0.2
    assert math.isnan(power().energy)
    stamp = power().header.stamp.sec + 1e-9 * power().header.stamp.nanosec
    assert begin - 0.2 < stamp < time.time() - 0.1  # the lag of the profile is 0.1 s
    status = diagnosed.wait("meter_driver: meter", "all is well")
    assert diagnosed.values(status)["connected"] == 1
    server.stop()
    diagnosed.wait("meter_driver: meter", "no connection, the next attempt follows")
    server.start()
    diagnosed.wait("meter_driver: meter", "all is well")


def test_a_monitor_reads_the_energy_without_settings(bench, modbus):
    server = modbus(pac(1000.0, 0.0))
    monitor = bench.add(PowerMonitor, model="kr16")
    bench.add(
        MeterDriver, profile="siemens_pac2200", host="127.0.0.1", port=server.port, period=0.05
    )
    curve = monitor.account.comparison.curve
    bench.spin_until(lambda: curve.rejections.accepted >= 3, "accepted readings")
    assert curve.rejections.accepted == curve.rejections.received


def test_a_meter_without_energy_gives_power_where_monitors_look(bench, http_meter, tmp_path):
    path = tmp_path / "plug.yaml"
    path.write_text(
        "schema_version: 1\nlabel: plug\nsources: [none]\ntried: nothing\nlink: http_json\n"
        "request: /status\nauth: basic\nperiod: 0.05\npower:\n  - {path: [apower], unit: kW}\n"
    )
    http_meter.says(json.dumps({"apower": 0.25}))
    reading = bench.latest(PowerReading, "power_meter")
    bench.add(
        MeterDriver,
        profile=str(path), host="127.0.0.1", port=http_meter.port,
        location="dc_bus", sign="load_negative", scale=40.0,
    )  # fmt: skip
    found = bench.spin_until(reading, "a reading")
    assert found.meaning == PowerReading.MEANING_INSTANTANEOUS
    assert found.location == PowerReading.LOCATION_DC_BUS
    assert found.power == -10_000.0


def test_refusals_are_in_the_diagnostics(bench, modbus):
    server = modbus(registers(65, "f", 1.0))  # a meter without the energies
    diagnosed = bench.diagnosed()
    bench.add(
        MeterDriver, profile="siemens_pac2200", host="127.0.0.1", port=server.port, period=0.05
    )
    diagnosed.wait("meter_driver: meter", "refuses input register 801 with Modbus exception 2")


def test_a_password_goes_readable_only_where_that_was_said(bench, tmp_path):
    secret = tmp_path / "meter.yaml"
    secret.write_text("username: admin\npassword: secret\n")
    secret.chmod(0o600)
    given = {"profile": "tasmota_http", "host": "192.0.2.1", "credentials_file": str(secret)}
    with pytest.raises(ParameterError, match="would be sent over the network unencrypted"):
        bench.add(MeterDriver, **given)
    bench.remove(bench.add(MeterDriver, **given, allow_plain_password=True))
    bench.remove(bench.add(MeterDriver, **{**given, "profile": "shelly_pro_3em_http"}))


@pytest.mark.parametrize(
    ("given", "error", "words"),
    [
        ({}, ParameterError, "without its parameter 'profile'"),
        ({"profile": "pac", "host": "x"}, MeterProfileError, "no meter profile 'pac'"),
        (
            {"profile": "siemens_pac2200", "host": "x", "timeout": 0.1},
            ParameterError, "max_round_trip is 0.5 s and timeout 0.1 s",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_used_stops_the_node(bench, given, error, words):
    with pytest.raises(error, match=words):
        bench.add(MeterDriver, **given)


def test_tasmota_over_mqtt(bench, broker, eventually):
    import paho.mqtt.client as mqtt

    server = broker()
    sender = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
    sender.connect("127.0.0.1", server.port)
    sender.loop_start()
    stale = json.dumps(tasmota_sensor(power=1.0, total=1.0))
    sender.publish("tele/plug/SENSOR", stale, qos=1, retain=True).wait_for_publish(120)
    energy = bench.latest(PowerReading, "power_meter")
    power = bench.latest(PowerReading, "power_meter/power")
    node = bench.add(
        MeterDriver,
        profile="tasmota_mqtt", host="127.0.0.1", port=server.port, device="plug",
        max_backoff=0.5, timeout=0.5, max_round_trip=0.5,
    )  # fmt: skip
    state = node.poller.state
    bench.spin_until(lambda: state.connected, "a connection")
    assert not node.poller.readings.accepted  # what is retained is of unknown age

    def send():
        sender.publish("tele/plug/SENSOR", json.dumps(tasmota_sensor(power=60.0, total=2.5)))
        return energy() and power()

    bench.spin_until(send, "readings")
    assert energy().energy == 9.0e6
    assert power().power == 60.0
    server.stop()
    bench.spin_until(lambda: state.failures, "the loss of the broker")
    server.start()
    bench.spin_until(lambda: state.connections > 1 and state.connected, "another connection")
    before = node.poller.readings.accepted
    bench.spin_until(lambda: send() and node.poller.readings.accepted > before, "readings again")
    sender.loop_stop()
    sender.disconnect()


def test_shelly_over_mqtt(bench, broker):
    import paho.mqtt.client as mqtt

    server = broker()
    sender = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
    sender.connect("127.0.0.1", server.port)
    sender.loop_start()
    energy = bench.latest(PowerReading, "power_meter")
    power = bench.latest(PowerReading, "power_meter/power")
    bench.add(
        MeterDriver,
        profile="shelly_pro_3em_mqtt", host="127.0.0.1", port=server.port, device="shelly",
        max_backoff=0.5,
    )  # fmt: skip

    def send():
        sender.publish("shelly/status/em:0", json.dumps(shelly_em(power=720.0)))
        sender.publish("shelly/status/emdata:0", json.dumps(shelly_emdata(energy=2.5)))
        return energy() and power()

    bench.spin_until(send, "readings")
    assert energy().energy == 9000.0
    assert power().power == 720.0
    sender.loop_stop()
    sender.disconnect()
