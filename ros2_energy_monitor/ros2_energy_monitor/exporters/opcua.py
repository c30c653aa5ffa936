# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""OPC UA: a server with active power and imported energy, predicted and measured apart.

Browse names, data types, units and measurement numbers are those of OPC 34100 (Energy Consumption
Management) 1.00: profile E1, tables 20 and 21 of section 7.1.3.2, and the energies of profiles E2
and E3. The types are our own, in our own name space, as the standard's NodeSet is not part of this
project: no conformance is claimed.

Status codes say what is known: BadWaitingForInitialData before the first message,
BadNoCommunication once messages are missing, BadNotConnected where no meter at the mains measures,
UncertainSubNormal where a prediction has remarks (`quality`).
"""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import logging
import math
import socket
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Annotated, Any

from robot_energy import __version__
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import ExporterError
from robot_energy.foundation.files.regular_file import require_private
from robot_energy.foundation.units import ENERGY_UNITS
from robot_energy.inputs.parameters import parameter
from robot_energy.model.auxiliary import MAX_LOADS
from robot_energy.timeline.blocks import MeterLocation
from ros2_energy_monitor.base.credentials import read_credentials
from ros2_energy_monitor.base.optional_packages import require
from ros2_energy_monitor.diagnostics.reporter import ERROR, StatusBuilder
from ros2_energy_monitor.exporters.values import Exporter, Newest, Topic, stamp_of

MEASURED_IN = {
    Topic.POWER: (1.0, (5723220, "W", "watt")),
    Topic.REGISTERS: (ENERGY_UNITS["Wh"], (5720146, "W·h", "watt hour")),
}
"""One of the unit of a variable in that of the field, and that unit."""


class Measurement(Described):
    """One variable."""

    origin: str
    name: str
    topic: Topic
    field: str
    double: Annotated[bool, "Whether it is a Double; a Float otherwise."]
    number: Annotated[int | None, "MeasurementID; None where no public text states one."] = None
    load: Annotated[
        str, "Name of the load outside of the cabinet that it is of; empty for the robot."
    ] = ""

    def value(self, message: Any) -> float:
        """Return the value in a message; NaN where the load is not in it."""
        owner = message
        if self.load:
            owner = next((one for one in message.auxiliary if one.name == self.load), None)
        size, _ = MEASURED_IN[self.topic]
        return math.nan if owner is None else getattr(owner, self.field) / size


def _of(origin: str, power: str, energy: str, load: str = "") -> tuple[Measurement, ...]:
    low, high = "AcActiveEnergyTotalImportLp", "AcActiveEnergyTotalImportHp"
    return (
        Measurement(origin, "AcActivePowerTotal", Topic.POWER, power, False, 1412, load),
        Measurement(origin, low, Topic.REGISTERS, energy, False, 1001, load),
        Measurement(origin, high, Topic.REGISTERS, energy, True, None, load),
    )


PREDICTED, MEASURED, LOAD = "predicted", "measured", "load"
OBJECTS = {
    PREDICTED: ("PredictedEnergy", "computed by a model from joint states and temperatures"),
    MEASURED: ("MeasuredEnergy", "read from a meter at the mains supply of the cabinet"),
}
MEASUREMENTS = (
    *_of(PREDICTED, "predicted_grid_power", "predicted_import_energy"),
    *(
        Measurement(PREDICTED, name, topic, field, True)  # of the 90 % band; the standard has none
        for name, topic, field in (
            ("ActivePowerBandLower", Topic.POWER, "predicted_power_lower"),
            ("ActivePowerBandUpper", Topic.POWER, "predicted_power_upper"),
            ("ActiveEnergyBandHalfWidth", Topic.REGISTERS, "predicted_energy_band"),
        )
    ),
    *_of(MEASURED, "measured_power", "measured_energy"),
)


def data_value(one: Measurement, newest: Newest, now: float) -> tuple[float, str, float]:
    """Return value, status and source time [s] of a measurement.

    Args:
        now: Steady time. [s]
    """
    message = newest.message(one.topic)
    if message is None:
        return math.nan, "BadWaitingForInitialData", 0.0
    stamp = stamp_of(message.header.stamp)
    if not newest.is_current(one.topic, now):
        return math.nan, "BadNoCommunication", stamp
    value = one.value(message)
    power = newest.message(Topic.POWER)
    if one.origin is MEASURED and (power is None or power.meter_location != MeterLocation.GRID):
        return math.nan, "BadNotConnected", stamp
    if not math.isfinite(value):
        return math.nan, "BadNotConnected" if one.origin is MEASURED else "BadNoData", stamp
    doubtful = one.origin is PREDICTED and power is not None and power.quality != 0
    return value, "UncertainSubNormal" if doubtful else "Good", stamp


NAMESPACE = "urn:robot-energy:opcua"
UNITS = "http://www.opcfoundation.org/UA/units/un/cefact"
NONE, SIGN, ENCRYPT = "none", "sign", "sign_and_encrypt"
ENDED = 10.0  # longest wait for the end of the server [s]


@dataclass(frozen=True, kw_only=True)
class OpcUaParameters:
    """Parameters of the OPC UA exporter."""

    address: str = parameter(
        "IP address to listen on; any other than 127.0.0.1 needs security.", "127.0.0.1"
    )
    port: int = parameter("Port to listen on.", 4840, (1, 65535))
    security: str = parameter(
        "Security that connections must have, by the policy Basic256Sha256.",
        NONE,
        choices=(NONE, SIGN, ENCRYPT),
    )
    certificate_file: str = parameter("Certificate of the server; empty for none.", "")
    key_file: str = parameter(
        "Key of that certificate, in a file that only its owner can read; empty for none.", ""
    )
    credentials_file: str = parameter(
        "YAML file, readable by its owner only, with the username and password of clients; if "
        "empty, anybody who can connect may read.",
        "",
    )
    period: float = parameter("Time from one update to the next [s].", 1.0, (0.1, 3600.0))


class OpcUaExporter(Exporter):
    """Serves the measurements, read-only, from a thread of its own."""

    def __init__(self, parameters: OpcUaParameters, robot: str) -> None:
        self._asyncua = require("asyncua", "asyncua", "this exporter", ExporterError)
        require("asyncua.server.user_managers", "asyncua", "this exporter", ExporterError)
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)  # diagnostics say it
        self._given, self._robot = parameters, robot
        _check(parameters)
        self._secret = read_credentials(parameters.credentials_file)
        self._nodes: dict[Measurement, Any] = {}
        self._loads: dict[str, tuple[Measurement, ...]] = {}  # as power states name them
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ready, self._ended = threading.Event(), threading.Event()
        self._stop: asyncio.Event | None = None
        self._failure, self._updates, self._last = "", 0, -math.inf
        self._thread = threading.Thread(target=self._run, name="opcua", daemon=True)

    def start(self) -> None:
        _require_free(self._given)
        self._thread.start()

    def publish(self, newest: Newest, now: float) -> None:
        """Hand the present values to the server.

        Args:
            now: Steady time. [s]
        """
        loop = self._loop
        if loop is None or not self._ready.is_set() or now - self._last < self._given.period:
            return
        self._last = now
        power = newest.message(Topic.POWER)
        for name in [] if power is None else [load.name for load in power.auxiliary]:
            if name not in self._loads and len(self._loads) < MAX_LOADS:
                self._loads[name] = _of(LOAD, "power", "energy", name)[::2]  # one energy
        wanted = [*MEASUREMENTS, *(one for each in self._loads.values() for one in each)]
        values = {one: data_value(one, newest, now) for one in wanted}
        asyncio.run_coroutine_threadsafe(self._write(values), loop)

    def stop(self) -> None:
        loop, stop = self._loop, self._stop
        if loop is not None and stop is not None and not self._ended.is_set():
            loop.call_soon_threadsafe(stop.set)
        if self._thread.is_alive():
            self._thread.join(ENDED)

    def check(self, found: StatusBuilder) -> None:
        found.values |= {"serving": int(self._ready.is_set()), "updates": self._updates}
        if self._failure:
            found.add(ERROR, f"the OPC UA server does not run: {self._failure}")

    # In the thread of the server

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception as error:  # of the library, the sockets, the certificates
            self._failure = f"{type(error).__name__}: {error}"
        finally:
            self._ready.clear()
            self._ended.set()

    async def _serve(self) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        self._writing = asyncio.Lock()
        server = self._asyncua.Server(user_manager=_ReadOnlyUsers(self._secret, self._user))
        await server.init()
        await self._configure(server)
        await self._build(server)
        self._server = server
        async with server:
            self._ready.set()
            await self._stop.wait()

    def _user(self) -> Any:
        rules = require(
            "asyncua.crypto.permission_rules", "asyncua", "this exporter", ExporterError
        )
        return rules.User(role=rules.UserRole.User)  # reads; writing is for nobody

    async def _configure(self, server: Any) -> None:
        ua, given = self._asyncua.ua, self._given
        host = f"[{given.address}]" if ":" in given.address else given.address
        server.set_endpoint(f"opc.tcp://{host}:{given.port}/robot_energy")
        server.set_server_name(f"robot-energy {self._robot}")
        await server.set_application_uri(f"{NAMESPACE}:{self._robot}")
        policy = {
            NONE: ua.SecurityPolicyType.NoSecurity,
            SIGN: ua.SecurityPolicyType.Basic256Sha256_Sign,
            ENCRYPT: ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
        }[given.security]
        server.set_security_policy([policy])
        token = ua.AnonymousIdentityToken if self._secret is None else ua.UserNameIdentityToken
        server.set_identity_tokens([token])
        if given.certificate_file:
            await server.load_certificate(given.certificate_file)
            await server.load_private_key(given.key_file)

    async def _build(self, server: Any) -> None:
        space = self._space = await server.register_namespace(NAMESPACE)
        types = server.nodes.base_object_type
        self._kind = await types.add_object_type(space, "EnergyMeasurement")
        self._place = await server.nodes.objects.add_object(space, self._robot)
        await self._place.add_property(space, "SoftwareVersion", __version__)
        for origin, (title, text) in OBJECTS.items():
            held = [one for one in MEASUREMENTS if one.origin == origin]
            await self._add_object(title, self._robot, text, held)

    async def _add_object(
        self, title: str, tag: str, origin: str, held: Sequence[Measurement]
    ) -> None:
        ua, space = self._asyncua.ua, self._space
        place = await self._place.add_object(
            ua.NodeId(f"{self._robot}.{title}", space),
            ua.QualifiedName(title, space),
            objecttype=self._kind.nodeid,
        )
        await place.add_property(space, "ApplicationTag", tag)
        await place.add_property(space, "Origin", origin)
        for one in held:
            self._nodes[one] = await self._variable(place, title, one)

    async def _variable(self, place: Any, title: str, one: Measurement) -> Any:
        ua, space = self._asyncua.ua, self._space
        kind = ua.VariantType.Double if one.double else ua.VariantType.Float
        node = await place.add_variable(
            ua.NodeId(f"{self._robot}.{title}.{one.name}", space),
            ua.QualifiedName(one.name, space),
            0.0,
            kind,
        )
        await node.write_value(self._value(one, (math.nan, "BadWaitingForInitialData", 0.0)))
        _, (number, symbol, words) = MEASURED_IN[one.topic]
        unit = ua.EUInformation(UNITS, number, ua.LocalizedText(symbol), ua.LocalizedText(words))
        await node.add_property(ua.NodeId(), ua.QualifiedName("EngineeringUnits", 0), unit)
        if one.number is not None:
            await node.add_property(space, "MeasurementID", one.number, ua.VariantType.UInt16)
        return node

    async def _write(self, values: dict[Measurement, tuple[float, str, float]]) -> None:
        async with self._writing:
            for one, value in values.items():
                if one not in self._nodes:  # of a load that a message has named since
                    title, tag = f"AuxiliaryEnergy.{one.load}", f"{self._robot} {one.load}"
                    held = self._loads[one.load]
                    await self._add_object(title, tag, "load outside of the cabinet", held)
                await self._server.write_attribute_value(
                    self._nodes[one].nodeid, self._value(one, value)
                )
        self._updates += 1

    def _value(self, one: Measurement, value: tuple[float, str, float]) -> Any:
        ua = self._asyncua.ua
        number, status, stamp = value
        kind = ua.VariantType.Double if one.double else ua.VariantType.Float
        bad = status.startswith("Bad")
        return ua.DataValue(
            ua.Variant(None if bad else number, ua.VariantType.Null if bad else kind),
            ua.StatusCode(getattr(ua.StatusCodes, status)),
            SourceTimestamp=datetime.fromtimestamp(stamp, UTC) if stamp else None,
            ServerTimestamp=datetime.now(UTC),
        )


class _ReadOnlyUsers:
    """Lets in clients with the right name and password, or all if there is none, to read.

    Args:
        secret: Name and password; None lets in anybody.
    """

    def __init__(self, secret: Any, user: Callable[[], Any]) -> None:
        self._secret, self._user = secret, user

    def get_user(
        self, iserver: Any, username: Any = None, password: Any = None, certificate: Any = None
    ) -> Any:
        if self._secret is None:
            return self._user()
        pairs = ((username, self._secret.username), (password, self._secret.password))
        good = [
            hmac.compare_digest(str(given or "").encode(), expected.encode())
            for given, expected in pairs
        ]
        return self._user() if all(good) else None


def _check(given: OpcUaParameters) -> None:
    try:
        loopback = ipaddress.ip_address(given.address).is_loopback
    except ValueError as error:
        raise ExporterError(f"opcua.address is '{given.address}'", "an IP address") from error
    if not loopback and given.security == NONE:
        raise ExporterError(
            f"opcua.address is {given.address} and opcua.security is none",
            "address 127.0.0.1, or security sign or sign_and_encrypt",
            "set one of them: otherwise everybody in the network can read power and energy of the "
            "robot",
        )
    if bool(given.certificate_file) != bool(given.key_file) or (
        given.security != NONE and not given.certificate_file
    ):
        raise ExporterError(
            f"opcua.security is {given.security}, with certificate_file "
            f"'{given.certificate_file}' and key_file '{given.key_file}'",
            "both files, which security needs, or none of them",
        )
    if given.key_file:
        require_private(given.key_file, "key of the OPC UA server")


def _require_free(given: OpcUaParameters) -> None:
    """Refuse a place where nobody can listen: the server would fail seconds later."""
    family = socket.AF_INET6 if ":" in given.address else socket.AF_INET
    with socket.socket(family) as tried:
        tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server does
        try:
            tried.bind((given.address, given.port))
        except OSError as error:
            raise ExporterError(
                f"OPC UA cannot be served on {given.address} port {given.port} "
                f"({error.strerror or error})",
                "an address of this computer and a free port",
                "set opcua.port to another one, or end the program that uses it",
            ) from error
