# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""OPC UA with a real client: values, units, status codes, and that nobody can write."""

from __future__ import annotations

import asyncio
import contextlib
import math
import time

import pytest
from ros2_energy_msgs.msg import EnergyRegisters, LoadEnergy, LoadPower, PowerState

from robot_energy.foundation.errors import CredentialsError, ExporterError
from ros2_energy_monitor.diagnostics.reporter import StatusBuilder
from ros2_energy_monitor.exporters.opcua import NAMESPACE, OpcUaExporter, OpcUaParameters
from ros2_energy_monitor.exporters.values import Newest, Topic

asyncua = pytest.importorskip("asyncua", reason="asyncua is not installed")
ua = asyncua.ua

POWER, ENERGY = "AcActivePowerTotal", "AcActiveEnergyTotalImportHp"
PATIENCE = 120.0  # s, on a machine that does much else


def power(watt=500.25, measured=480.5, location=PowerState.LOCATION_GRID, quality=0):
    message = PowerState(
        predicted_grid_power=watt, measured_power=measured, meter_location=location, quality=quality
    )
    message.header.stamp.sec = 1_700_000_000
    return message


def registers():
    message = EnergyRegisters(predicted_import_energy=3.6e9, measured_energy=1.8e9)
    message.header.stamp.sec = 1_700_000_001
    return message


@contextlib.contextmanager
def served(port, eventually, **options):
    """A server that runs, and its address."""
    out = OpcUaExporter(OpcUaParameters(port=port, period=0.1, **options), "kr16")
    out.start()
    try:
        eventually(lambda: out._ready.is_set() or out._failure, "the server")
        assert not out._failure, out._failure
        yield out, f"opc.tcp://127.0.0.1:{port}/robot_energy"
    finally:
        out.stop()
    eventually(out._ended.is_set, "the end of the server")


@pytest.fixture(scope="module")
def server(eventually, free_port):
    """One for all tests that need nothing special: to begin takes longer than such a test."""
    with served(free_port(), eventually) as started:
        yield started


@pytest.fixture
def serve(eventually, free_port):
    """A server with settings of its own."""
    with contextlib.ExitStack() as stack:
        yield lambda **options: stack.enter_context(served(free_port(), eventually, **options))


def updated(out, newest, eventually):
    """Hand out values and wait until they are written; one write comes after the other."""
    before = out._last
    eventually(lambda: out.publish(newest, time.monotonic()) or out._last > before, "an update")
    asyncio.run_coroutine_threadsafe(out._write({}), out._loop).result(PATIENCE)


def patient(url):
    return asyncua.Client(url, timeout=PATIENCE, watchdog_intervall=PATIENCE)


async def read(url, *names, **login):
    """Data values of variables, by object and browse name."""
    client = patient(url)
    if login:
        client.set_user(login["username"])
        client.set_password(login["password"])
    async with client:
        space = await client.get_namespace_index(NAMESPACE)
        found = []
        for place, name in names:
            path = [f"{space}:kr16", f"{space}:{place}", f"{space}:{name}"]
            node = await client.nodes.objects.get_child(path)
            found.append(await node.read_data_value(raise_on_bad_status=False))
        return found


def test_power_and_energy_with_units_and_numbers(server, eventually):
    out, url = server
    newest = Newest(1000.0)
    newest.take(Topic.POWER, power(), time.monotonic())
    newest.take(Topic.REGISTERS, registers(), time.monotonic())
    updated(out, newest, eventually)
    places = ("PredictedEnergy", "MeasuredEnergy")
    names = [(place, name) for place in places for name in (POWER, ENERGY)]
    values = asyncio.run(read(url, *names))
    assert [one.Value.Value for one in values] == [500.25, 1e6, 480.5, 5e5]
    assert all(one.StatusCode.is_good() for one in values)
    assert [one.Value.VariantType for one in values[:2]] == [
        ua.VariantType.Float, ua.VariantType.Double,
    ]  # fmt: skip
    assert values[0].SourceTimestamp.timestamp() == 1_700_000_000

    async def properties():
        async with patient(url) as client:
            space = await client.get_namespace_index(NAMESPACE)
            place = await client.nodes.objects.get_child(
                [f"{space}:kr16", f"{space}:PredictedEnergy"]
            )
            node = await place.get_child([f"{space}:{POWER}"])
            unit = await (await node.get_child(["0:EngineeringUnits"])).read_value()
            number = await (await node.get_child([f"{space}:MeasurementID"])).read_value()
            origin = await (await place.get_child([f"{space}:Origin"])).read_value()
            return unit, number, origin

    unit, number, origin = asyncio.run(properties())
    assert (unit.UnitId, unit.DisplayName.Text) == (5723220, "W")
    assert number == 1412
    assert "model" in origin


def test_the_band_stands_with_the_prediction(server, eventually):
    out, url = server
    newest = Newest(1000.0)
    state, energy = power(), registers()
    state.predicted_power_lower, state.predicted_power_upper = 400.0, 600.5
    energy.predicted_energy_band = 7.2e6
    newest.take(Topic.POWER, state, time.monotonic())
    newest.take(Topic.REGISTERS, energy, time.monotonic())
    updated(out, newest, eventually)
    names = ("ActivePowerBandLower", "ActivePowerBandUpper", "ActiveEnergyBandHalfWidth")
    values = asyncio.run(read(url, *(("PredictedEnergy", name) for name in names)))
    assert [one.Value.Value for one in values] == [400.0, 600.5, 2000.0]


@pytest.mark.parametrize(
    ("message", "predicted", "measured"),
    [
        (None, "BadWaitingForInitialData", "BadWaitingForInitialData"),
        (power(measured=math.nan), "Good", "BadNotConnected"),
        (power(location=PowerState.LOCATION_DC_BUS), "Good", "BadNotConnected"),
        (power(watt=math.nan), "BadNoData", "Good"),
        (power(quality=2), "UncertainSubNormal", "Good"),
    ],
)
def test_status_codes_say_what_is_unknown(server, eventually, message, predicted, measured):
    out, url = server
    newest = Newest(1000.0)
    if message is not None:
        newest.take(Topic.POWER, message, time.monotonic())
    updated(out, newest, eventually)
    values = asyncio.run(read(url, ("PredictedEnergy", POWER), ("MeasuredEnergy", POWER)))
    assert [one.StatusCode.name for one in values] == [predicted, measured]
    for one in values:
        assert (one.Value.Value is None) == one.StatusCode.is_bad()


def test_silence_is_no_communication(server, eventually):
    out, url = server
    newest = Newest(0.5)
    newest.take(Topic.POWER, power(), time.monotonic() - 1.0)
    updated(out, newest, eventually)
    (value,) = asyncio.run(read(url, ("PredictedEnergy", POWER)))
    assert value.StatusCode.name == "BadNoCommunication"
    assert value.Value.Value is None


def test_nobody_writes_or_adds(server):
    _, url = server

    async def try_it():
        async with patient(url) as client:
            space = await client.get_namespace_index(NAMESPACE)
            robot = await client.nodes.objects.get_child([f"{space}:kr16"])
            node = await robot.get_child([f"{space}:PredictedEnergy", f"{space}:{POWER}"])
            with pytest.raises((ua.uaerrors.BadUserAccessDenied, ua.uaerrors.BadNotWritable)):
                await node.write_value(ua.Variant(1.0, ua.VariantType.Float))
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                await robot.add_variable(space, "mine", 1.0)

    asyncio.run(try_it())


def secret_file(folder, mode=0o600):
    path = folder / "opcua.yaml"
    path.write_text("username: plant\npassword: secret\n")
    path.chmod(mode)
    return str(path)


def test_users_need_their_password(serve, eventually, tmp_path):
    out, url = serve(credentials_file=secret_file(tmp_path))
    newest = Newest(1000.0)
    newest.take(Topic.POWER, power(), time.monotonic())
    updated(out, newest, eventually)
    wanted = ("PredictedEnergy", POWER)
    (value,) = asyncio.run(read(url, wanted, username="plant", password="secret"))
    assert value.Value.Value == 500.25
    for login in (
        {"username": "plant", "password": "wrong"},
        {"username": "admin", "password": ""},
    ):
        with pytest.raises(ua.UaError):
            asyncio.run(read(url, wanted, **login))
    with pytest.raises(ua.UaError):
        asyncio.run(read(url, wanted))


def test_signed_and_encrypted(serve, eventually, certificates):
    made = certificates("urn:robot-energy:opcua:kr16")
    out, url = serve(
        security="sign_and_encrypt",
        certificate_file=str(made.certificate),
        key_file=str(made.key),
    )
    newest = Newest(1000.0)
    newest.take(Topic.POWER, power(), time.monotonic())
    updated(out, newest, eventually)
    with pytest.raises((ua.UaError, ConnectionError, asyncio.TimeoutError)):
        asyncio.run(read(url, ("PredictedEnergy", POWER)))  # without security

    async def secure():
        client = patient(url)
        client.application_uri = "urn:robot-energy:opcua:kr16"
        await client.set_security_string(
            f"Basic256Sha256,SignAndEncrypt,{made.certificate},{made.key}"
        )
        async with client:
            space = await client.get_namespace_index(NAMESPACE)
            path = [f"{space}:kr16", f"{space}:PredictedEnergy", f"{space}:{POWER}"]
            return await (await client.nodes.objects.get_child(path)).read_value()

    assert asyncio.run(secure()) == 500.25


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"address": "0.0.0.0"}, "security is none"),
        ({"address": "plant"}, "an IP address"),
        ({"security": "sign"}, "both files"),
        ({"certificate_file": "x"}, "both files"),
    ],
)
def test_unsafe_settings_are_refused(given, words):
    with pytest.raises(ExporterError, match=words):
        OpcUaExporter(OpcUaParameters(**given), "kr16")


def test_an_open_file_of_credentials_is_refused(tmp_path):
    with pytest.raises(CredentialsError, match="0644"):
        OpcUaExporter(OpcUaParameters(credentials_file=secret_file(tmp_path, 0o644)), "kr16")


def test_a_port_in_use_is_refused(server):
    out, _ = server
    words = "OPC UA cannot be served on 127.0.0.1 port .*Address already in use.*Set opcua.port to"
    with pytest.raises(ExporterError, match=words):
        OpcUaExporter(out._given, "kr16").start()


def test_a_server_that_fails_is_in_the_diagnostics(eventually, free_port, tmp_path):
    broken = secret_file(tmp_path, 0o600)
    given = OpcUaParameters(port=free_port(), certificate_file=str(broken), key_file=str(broken))
    out = OpcUaExporter(given, "kr16")
    out.start()
    eventually(lambda: out._failure, "the failure")
    found = StatusBuilder("opcua")
    out.check(found)
    assert "the OPC UA server does not run" in found.message
    out.stop()


def test_loads_outside_of_the_cabinet_get_objects_of_their_own(serve, eventually):
    out, url = serve()
    newest = Newest(stale_after=60.0)
    message, counted = power(), registers()
    message.auxiliary = [
        LoadPower(name="pump", power=800.0),
        LoadPower(name="lamp", power=math.nan, remarks=2),
    ]
    counted.auxiliary = [LoadEnergy(name="pump", energy=7200.0), LoadEnergy(name="lamp")]
    newest.take(Topic.POWER, message, time.monotonic())
    newest.take(Topic.REGISTERS, counted, time.monotonic())
    updated(out, newest, eventually)
    pump, energy, lamp = asyncio.run(
        read(
            url,
            ("AuxiliaryEnergy.pump", POWER),
            ("AuxiliaryEnergy.pump", ENERGY),
            ("AuxiliaryEnergy.lamp", POWER),
        )
    )
    assert pump.Value.Value == 800.0
    assert pump.StatusCode.is_good()
    assert energy.Value.Value == pytest.approx(2.0)
    assert lamp.StatusCode.name == "BadNoData"
