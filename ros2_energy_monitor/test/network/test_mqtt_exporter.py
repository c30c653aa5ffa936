# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""MQTT with a real broker: what a subscriber gets, before, during and after."""

from __future__ import annotations

import contextlib
import json
import math
import shutil
import socket
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import jinja2
import pytest
from ros2_energy_msgs.msg import EnergyRegisters, JointPower, LoadEnergy, LoadPower, PowerState

from robot_energy.foundation.errors import CredentialsError, ExporterError
from ros2_energy_monitor.diagnostics.reporter import StatusBuilder
from ros2_energy_monitor.exporters.mqtt import MqttExporter, MqttParameters
from ros2_energy_monitor.exporters.values import VALUES, Newest, Topic, exported
from ros2_energy_monitor.nodes.energy_exporter import EnergyExporter

BASE = "robot_energy/kr16"


def power(watt=500.0, measured=math.nan, quality=0):
    message = PowerState(predicted_grid_power=watt, measured_power=measured, quality=quality)
    message.header.stamp.sec = 1_700_000_000
    message.joints = [JointPower(name="joint_a1", motor_temperature_degc=41.5)]
    return message


def registers(joule=7.2e6):
    message = EnergyRegisters(predicted_import_energy=joule, measured_energy=math.nan)
    message.energy_start.sec = 1_600_000_000
    return message


class Subscriber:
    """Every message by topic, with its retain flag and QoS, as a client of its own gets them."""

    def __init__(self, port, **tls):
        import paho.mqtt.client as mqtt

        self.messages = {}
        self.client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
        self.client.on_message = self._take
        self.client.on_connect = lambda *_: self.client.subscribe("#", 1)
        ready = threading.Event()
        self.client.on_subscribe = lambda *_: ready.set()
        self.client.connect("127.0.0.1", port)
        self.client.loop_start()
        assert ready.wait(120)

    def _take(self, _client, _data, message):
        self.messages.setdefault(message.topic, []).append(message)

    def json(self, topic):
        found = self.messages.get(topic)
        return json.loads(found[-1].payload) if found else None

    def text(self, topic):
        found = self.messages.get(topic)
        return found[-1].payload.decode() if found else ""

    def close(self):
        self.client.disconnect()
        self.client.loop_stop()


@pytest.fixture
def subscriber():
    made = []

    def make(port):
        made.append(Subscriber(port))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.fixture
def exporter():
    made = []

    def make(port, **options):
        given = {"period": 0.1, **options}
        made.append(MqttExporter(MqttParameters(port=port, **given), "kr16"))
        made[-1].start()
        return made[-1]

    yield make
    for one in made:
        one.stop()


def feeding(exporter, newest, condition):
    """A condition that lets the exporter go on."""

    def go_on():
        exporter.publish(newest, time.monotonic())
        return condition()

    return go_on


def test_values_are_those_of_the_messages_with_null_for_unknown():
    found = exported(power(measured=math.nan), Topic.POWER)
    assert found["predicted_grid_power"] == 500.0
    assert found["measured_power"] is None
    assert found["stamp"] == 1_700_000_000.0
    assert found["joints"][0]["motor_temperature_degc"] == 41.5
    found = exported(registers(), Topic.REGISTERS)
    assert found["predicted_import_energy_kwh"] == 2.0
    assert found["measured_energy_kwh"] is None
    assert found["energy_start"] == 1_600_000_000.0
    json.dumps(found, allow_nan=False)


def test_whole_kilowatt_hours_and_nanoseconds_are_shown_without_a_tail():
    for whole in range(1, 2000):
        message = registers(whole * 3.6e6)
        message.energy_start.sec, message.energy_start.nanosec = whole, 100_000_000
        found = exported(message, Topic.REGISTERS)
        assert found["predicted_import_energy_kwh"] == whole
        assert found["energy_start"] == float(f"{whole}.1")


def test_messages_retention_and_discovery(broker, subscriber, exporter, eventually):
    server = broker()
    early = subscriber(server.port)
    newest = Newest(1000.0)
    now = time.monotonic()
    newest.take(Topic.POWER, power(), now)
    newest.take(Topic.REGISTERS, registers(), now)
    out = exporter(server.port)
    eventually(feeding(out, newest, lambda: early.text(f"{BASE}/status") == "online"), "the status")
    eventually(lambda: early.json(f"{BASE}/registers"), "the registers")
    eventually(lambda: early.json(f"{BASE}/power"), "the power")
    assert early.json(f"{BASE}/power")["predicted_grid_power"] == 500.0
    assert early.messages[f"{BASE}/power"][0].qos == 1
    # One who comes late gets counters and status, and no old power.
    late = subscriber(server.port)
    late.client.publish("the_last", qos=1)  # the broker hands it out after all that it has kept
    eventually(lambda: "the_last" in late.messages, "all that is retained")
    assert late.text(f"{BASE}/status") == "online"
    assert late.messages[f"{BASE}/registers"][0].retain
    topics = [topic for topic in late.messages if topic.startswith("homeassistant/sensor/")]
    assert len(topics) == len(VALUES) + 1  # and the temperature of the joint
    assert f"{BASE}/power" not in late.messages
    config = late.json("homeassistant/sensor/robot_energy_kr16/predicted_import_energy_kwh/config")
    assert config["device_class"] == "energy"
    assert config["state_class"] == "total_increasing"
    assert config["unit_of_measurement"] == "kWh"
    key = config["value_template"].removeprefix("{{ value_json.").removesuffix(" }}")
    assert early.json(config["state_topic"])[key] == pytest.approx(2.0)
    assert config["availability_topic"] == f"{BASE}/status"
    assert late.json("homeassistant/sensor/robot_energy_kr16/measured_power/config")["expire_after"]
    assert "expire_after" not in config


def test_stale_data_are_offline_and_nothing_is_said_again(broker, subscriber, exporter, eventually):
    server = broker()
    seen = subscriber(server.port)
    newest = Newest(0.2)
    newest.take(Topic.POWER, power(), time.monotonic())
    out = exporter(server.port)
    status = f"{BASE}/status"
    eventually(feeding(out, newest, lambda: seen.text(status) == "offline"), "offline")
    assert len(seen.messages.get(f"{BASE}/power", [])) <= 1
    newest.take(Topic.POWER, power(600.0), time.monotonic())
    new = '"predicted_grid_power": 600.0'
    eventually(feeding(out, newest, lambda: new in seen.text(f"{BASE}/power")), "new power")


def test_a_broker_dies_and_returns(broker, subscriber, exporter, eventually):
    server = broker()
    newest = Newest(60.0)
    newest.take(Topic.REGISTERS, registers(), time.monotonic())
    out = exporter(server.port)
    eventually(feeding(out, newest, lambda: out._published > 2), "messages")
    server.stop()
    found = StatusBuilder("mqtt")
    eventually(lambda: not out._connected.is_set(), "the loss")
    out.check(found)
    assert "no connection to the MQTT broker" in found.message
    server.start()
    seen = subscriber(server.port)  # this broker has kept nothing
    eventually(feeding(out, newest, lambda: seen.json(f"{BASE}/registers")), "registers again")
    eventually(lambda: any(one.endswith("/config") for one in list(seen.messages)), "discovery")


class Mute:
    """A broker that takes connections and messages, and acknowledges nothing else."""

    def __init__(self):
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self.taken: list[socket.socket] = []
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self):
        with contextlib.suppress(OSError):
            while True:
                one, _ = self._listening.accept()
                self.taken.append(one)
                one.recv(4096)
                one.sendall(bytes([0x20, 2, 0, 0]))
                threading.Thread(target=self._read, args=(one,), daemon=True).start()

    def _read(self, one):
        with contextlib.suppress(OSError):
            while one.recv(65536):
                pass

    def close(self):
        self._listening.close()
        for one in self.taken:
            one.close()


def test_a_broker_that_acknowledges_nothing_is_said(exporter, eventually):
    pytest.importorskip("paho.mqtt", reason="paho-mqtt is not installed")
    server, newest = Mute(), Newest(1000.0)
    out = exporter(server.port, period=0.0)

    def said():
        newest.take(Topic.POWER, power(), time.monotonic())
        out.publish(newest, time.monotonic())
        found = StatusBuilder("mqtt")
        out.check(found)
        return found.message if " lost " in found.message else ""

    words = eventually(said, "the finding")
    assert words.startswith("look at its log and its limits: the broker has not acknowledged ")
    server.close()


def test_a_loss_is_not_explained_by_an_earlier_one():
    made = pytest.importorskip("paho.mqtt.reasoncodes", reason="paho-mqtt is not installed")
    end = pytest.importorskip("paho.mqtt.packettypes").PacketTypes.DISCONNECT
    out = MqttExporter(MqttParameters(), "kr16")
    for reason, words in (
        ("Keep alive timeout", "Keep alive timeout"),
        ("Unspecified error", "the connection broke off"),
    ):
        out._take_connection(None, None, None, SimpleNamespace(is_failure=False), None)
        assert not out._failure
        out._take_loss(None, None, None, made.ReasonCode(end, reason), None)
        found = StatusBuilder("mqtt")
        out.check(found)
        assert found.message.endswith(words)


def test_what_found_no_room_goes_out_later(broker, subscriber, exporter, eventually, monkeypatch):
    monkeypatch.setattr("ros2_energy_monitor.exporters.mqtt.MAX_WAITING", 1)
    port = broker().port
    seen, newest, message = subscriber(port), Newest(1000.0), power()
    message.joints = [JointPower(name=f"joint_{number}") for number in range(32)]
    newest.take(Topic.POWER, message, time.monotonic())
    newest.take(Topic.REGISTERS, registers(), time.monotonic())
    out = exporter(port, period=1000.0)
    wanted = {f"{BASE}/status", f"{BASE}/registers"} | {
        f"homeassistant/sensor/robot_energy_kr16/{name}/config"
        for name in [value.name for value in VALUES]
        + [f"motor_temperature_joint_{number}" for number in range(32)]
    }
    eventually(feeding(out, newest, lambda: wanted <= set(seen.messages)), "all that is retained")
    assert not out._refused
    assert seen.text(f"{BASE}/status") == "online"


WILL = """
import sys, time
from ros2_energy_msgs.msg import PowerState
from ros2_energy_monitor.exporters.values import Newest
from ros2_energy_monitor.exporters.mqtt import MqttExporter, MqttParameters
from ros2_energy_monitor.exporters.values import Topic
out = MqttExporter(MqttParameters(port=int(sys.argv[1])), "kr16")
out.start()
newest = Newest(1000.0)
newest.take(Topic.POWER, PowerState(), time.monotonic())
while True:
    out.publish(newest, time.monotonic())
    time.sleep(0.05)
"""


def test_the_last_will_says_offline_after_kill(broker, subscriber, eventually):
    server = broker()
    seen = subscriber(server.port)
    child = subprocess.Popen([sys.executable, "-c", WILL, str(server.port)])
    try:
        eventually(lambda: seen.text(f"{BASE}/status") == "online", "online")
    finally:
        child.kill()
        child.wait()
    eventually(lambda: seen.text(f"{BASE}/status") == "offline", "the last will")


# paho-mqtt leaves the socket of a failed handshake to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_tls_and_password(broker, certificates, exporter, eventually, tmp_path):
    made = certificates("urn:test")
    passwords = tmp_path / "passwords"
    program = shutil.which("mosquitto_passwd")
    if program is None:
        pytest.skip("mosquitto_passwd is not installed: apt-get install mosquitto")
    subprocess.run([program, "-c", "-b", str(passwords), "robot", "secret"], check=True)
    server = broker(
        "allow_anonymous false", f"password_file {passwords}", f"cafile {made.ca}",
        f"certfile {made.certificate}", f"keyfile {made.key}",
    )  # fmt: skip
    secret = tmp_path / "mqtt.yaml"
    secret.write_text("username: robot\npassword: secret\n")
    secret.chmod(0o600)
    newest = Newest(60.0)
    newest.take(Topic.POWER, power(), time.monotonic())
    good = {"tls": True, "ca_file": str(made.ca), "credentials_file": str(secret)}
    out = exporter(server.port, **good)
    eventually(feeding(out, newest, lambda: out._published), "messages over TLS")
    stranger = exporter(server.port, **{**good, "credentials_file": ""})

    def refused():
        found = StatusBuilder("mqtt")
        stranger.check(found)
        return "Not authorized" in found.message

    eventually(refused, "a refusal")
    stranger = exporter(server.port, **{**good, "ca_file": ""})

    def unknown_certificate():
        found = StatusBuilder("mqtt")
        stranger.check(found)
        return "its certificate is refused" in found.message

    eventually(unknown_certificate, "the reason of the refusal")
    with pytest.raises(ExporterError, match="cannot be used"):
        exporter(server.port, **{**good, "ca_file": str(passwords)})


def test_secrets_do_not_go_in_plain_text(tmp_path, broker):
    secret = tmp_path / "mqtt.yaml"
    secret.write_text("username: robot\npassword: secret\n")
    secret.chmod(0o644)
    with pytest.raises(CredentialsError, match="permissions"):
        MqttExporter(MqttParameters(credentials_file=str(secret)), "kr16")
    secret.chmod(0o600)
    given = {"host": "broker.example", "credentials_file": str(secret)}
    with pytest.raises(ExporterError, match="in plain text"):
        MqttExporter(MqttParameters(**given), "kr16")
    MqttExporter(MqttParameters(**given, tls=True), "kr16")
    MqttExporter(MqttParameters(**given, allow_plain_password=True), "kr16")


@pytest.mark.parametrize(
    ("given", "robot", "words"),
    [
        ({}, "a/b", "robot_name"),
        ({"topic": "a/#"}, "kr16", r"mqtt\.topic"),
        ({"cert_file": "x"}, "kr16", "both, or none"),
    ],
)
def test_wrong_parameters(given, robot, words):
    pytest.importorskip("paho.mqtt")
    with pytest.raises(ExporterError, match=words):
        MqttExporter(MqttParameters(**given), robot)


def test_the_node_exports_what_the_monitors_publish(bench, broker, subscriber):
    server = broker()
    seen = subscriber(server.port)
    publisher = bench.tester.create_publisher(PowerState, "energy/power", 10)
    node = bench.add(
        EnergyExporter, robot_name="kr16", **{"mqtt.port": server.port, "mqtt.period": 0.1}
    )

    def send():
        publisher.publish(power(750.0))
        return seen.json(f"{BASE}/power")

    assert bench.spin_until(send, "power")["predicted_grid_power"] == 750.0
    diagnosed = bench.diagnosed()
    bench.spin_until(lambda: publisher.publish(power()) or send(), "power")
    diagnosed.wait("energy_exporter: mqtt", "all is well")
    bench.remove(node)
    bench.spin_until(lambda: seen.text(f"{BASE}/status") == "offline", "a clean end")


def test_the_node_names_the_exporters_there_are(bench):
    with pytest.raises(Exception, match="one of 'mqtt', 'opcua'"):
        bench.add(EnergyExporter, exporters=["sparkplug"])


def test_loads_outside_of_the_cabinet_are_in_values_and_discovery(
    broker, subscriber, exporter, eventually
):
    port = broker().port
    got, newest = subscriber(port), Newest(stale_after=60.0)
    message, counted = power(), registers()
    states = ["off", "on"]
    message.outlet_power = math.nan
    message.auxiliary = [
        LoadPower(name="pump", states=states, state=1, power=800.0),
        LoadPower(name="lamp", states=states, state=-1, power=math.nan, remarks=2),
    ]
    counted.auxiliary = [LoadEnergy(name="pump", energy=3.6e6, known_time=10.0)]
    newest.take(Topic.POWER, message, time.monotonic())
    newest.take(Topic.REGISTERS, counted, time.monotonic())
    one = exporter(port)
    eventually(
        feeding(one, newest, lambda: got.json(f"{BASE}/power") and got.json(f"{BASE}/registers")),
        "values",
    )
    pump, lamp = got.json(f"{BASE}/power")["auxiliary"]
    assert pump == {"name": "pump", "state": "on", "power": 800.0, "remarks": 0}
    assert (lamp["state"], lamp["power"], lamp["remarks"]) == (None, None, 2)
    assert got.json(f"{BASE}/registers")["auxiliary"][0]["energy_kwh"] == pytest.approx(1.0)
    sensor = "homeassistant/sensor/robot_energy_kr16/auxiliary_pump_power/config"
    eventually(lambda: got.json(sensor), "discovery of the pump")
    power_of_pump = jinja2.Template(got.json(sensor)["value_template"])
    assert power_of_pump.render(value_json=got.json(f"{BASE}/power")) == "800.0"
    # A monitor with fewer loads may follow, and Home Assistant keeps the sensor: it is unknown.
    energy = got.json("homeassistant/sensor/robot_energy_kr16/auxiliary_lamp_energy_kwh/config")
    energy_of_lamp = jinja2.Template(energy["value_template"], undefined=jinja2.StrictUndefined)
    assert energy_of_lamp.render(value_json=got.json(f"{BASE}/registers")) == "None"
