# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Servers of real protocols on the loopback: Modbus TCP, HTTP, an MQTT broker."""

from __future__ import annotations

import asyncio
import contextlib
import datetime
import http.server
import ipaddress
import os
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

PATIENCE = 120.0  # s, on a machine that does much else


def wait_for(condition: Callable[[], Any], what: str) -> Any:
    limit = time.monotonic() + PATIENCE
    while not (result := condition()):
        assert time.monotonic() < limit, f"waited {PATIENCE} s in vain for {what}"
        threading.Event().wait(0.01)
    return result


class ModbusServer:
    """The TCP server of pymodbus with registers that a test changes while it runs.

    It answers with an exception for registers that were not there at the start.
    """

    def __init__(self, port: int, registers: dict[int, int], unit: int = 1) -> None:
        self.registers = dict(registers)
        self.unit, self.port = unit, port
        self.refusal: int | None = None  # number of a Modbus exception
        self.delay = 0.0  # of every answer [s]
        self.requests: list[tuple[int, int, int]] = []  # function, address, count
        self._loop: asyncio.AbstractEventLoop | None = None

    def write(self, address: int, registers: list[int]) -> None:
        self.registers |= {address + i: value for i, value in enumerate(registers)}

    def start(self) -> None:
        loop = self._loop = asyncio.new_event_loop()
        ready = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(loop, ready), daemon=True)
        self._thread.start()
        assert ready.wait(PATIENCE)

    def stop(self) -> None:
        if self._loop is not None:
            asyncio.run_coroutine_threadsafe(self._server.shutdown(), self._loop).result(PATIENCE)
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(PATIENCE)
            self._loop = None

    def _run(self, loop: asyncio.AbstractEventLoop, ready: threading.Event) -> None:
        from pymodbus.server import ModbusTcpServer
        from pymodbus.simulator import DataType, SimData, SimDevice

        asyncio.set_event_loop(loop)
        blocks = [
            SimData(address, values=[0], datatype=DataType.REGISTERS)
            for address in sorted(self.registers)
        ]
        device = SimDevice(self.unit, simdata=blocks, action=self._act)

        async def begin() -> None:
            self._server = ModbusTcpServer(device, address=("127.0.0.1", self.port))
            await self._server.serve_forever(background=True)
            ready.set()

        loop.run_until_complete(begin())
        loop.run_forever()
        pending = asyncio.all_tasks(loop)
        for task in pending:
            task.cancel()
        loop.run_until_complete(asyncio.gather(*pending, return_exceptions=True))
        for _ in range(5):  # transports close in callbacks of the loop
            loop.run_until_complete(asyncio.sleep(0))
        loop.close()

    async def _act(
        self, function: int, start: int, address: int, count: int, current: list[int], _new: Any
    ) -> Any:
        from pymodbus.constants import ExcCodes

        self.requests.append((function, address, count))
        if self.delay:
            await asyncio.sleep(self.delay)
        if self.refusal is not None:
            return ExcCodes(self.refusal)
        for at in range(address, address + count):
            current[at - start] = self.registers.get(at, 0)
        return None


@pytest.fixture
def modbus(free_port: Callable[[], int]) -> Iterator[Callable[..., ModbusServer]]:
    pytest.importorskip("pymodbus", reason="pymodbus is not installed")
    servers: list[ModbusServer] = []

    def make(registers: dict[int, int], unit: int = 1) -> ModbusServer:
        servers.append(ModbusServer(free_port(), registers, unit))
        servers[-1].start()
        return servers[-1]

    yield make
    for server in servers:
        server.stop()


class HttpMeter:
    """A web server; a test says by `answer` what a request gets."""

    def __init__(self) -> None:
        self.answer: Callable[[http.server.BaseHTTPRequestHandler], None] = lambda _: None
        self.paths: list[str] = []
        meter = self

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self) -> None:
                meter.paths.append(self.path)
                meter.answer(self)

            def log_message(self, *_: Any) -> None:
                pass

        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self._server.handle_error = lambda *_: None  # type: ignore[method-assign]
        self.port = self._server.server_address[1]
        serve = threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True)
        serve.start()

    def says(self, body: str, status: int = 200, **headers: str) -> None:
        def answer(request: http.server.BaseHTTPRequestHandler) -> None:
            request.send_response(status)
            for name, value in headers.items():
                request.send_header(name.replace("_", "-"), value)
            request.send_header("Content-Length", str(len(body)))
            request.end_headers()
            request.wfile.write(body.encode())

        self.answer = answer

    def stop(self) -> None:
        self._server.shutdown()
        self._server.server_close()


@pytest.fixture
def http_meter() -> Iterator[HttpMeter]:
    pytest.importorskip("requests", reason="requests is not installed")
    meter = HttpMeter()
    yield meter
    meter.stop()


class Broker:
    """A mosquitto process that can be stopped and started again."""

    def __init__(self, port: int, program: str, folder: Path, *lines: str) -> None:
        self.port = port
        self._program, self._folder = program, folder
        self._process: subprocess.Popen[bytes] | None = None
        self._file = folder / "mosquitto.conf"
        text = [f"listener {self.port} 127.0.0.1", "persistence false", f"user {_user()}"]
        self._file.write_text("\n".join([*text, *(lines or ["allow_anonymous true"])]) + "\n")

    def start(self) -> None:
        log = (self._folder / "mosquitto.log").open("ab")
        self._process = subprocess.Popen(
            [self._program, "-c", str(self._file)], stdout=log, stderr=subprocess.STDOUT
        )
        log.close()
        wait_for(self._accepts, "the broker")

    def _accepts(self) -> bool:
        assert self._process is not None
        assert self._process.poll() is None, (self._folder / "mosquitto.log").read_text()
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self.port), 1):
            return True
        return False

    def stop(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait(PATIENCE)
            self._process = None


def _user() -> str:
    import pwd

    return pwd.getpwuid(os.getuid()).pw_name


@pytest.fixture
def broker(tmp_path: Path, free_port: Callable[[], int]) -> Iterator[Callable[..., Broker]]:
    pytest.importorskip("paho.mqtt", reason="paho-mqtt is not installed")
    program = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin:/usr/local/sbin")
    if program is None:
        pytest.skip("the broker mosquitto is not installed: apt-get install mosquitto")
    brokers: list[Broker] = []

    def make(*lines: str) -> Broker:
        brokers.append(Broker(free_port(), program, tmp_path, *lines))
        brokers[-1].start()
        return brokers[-1]

    yield make
    for one in brokers:
        one.stop()


class Certificates:
    """An authority and a certificate of 127.0.0.1 that it signed, as PEM files."""

    def __init__(self, folder: Path, uri: str) -> None:
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes, serialization
        from cryptography.hazmat.primitives.asymmetric import rsa

        self.ca, self.certificate, self.key = (
            folder / name for name in ("ca.pem", "cert.pem", "key.pem")
        )
        keys = [rsa.generate_private_key(public_exponent=65537, key_size=2048) for _ in range(2)]
        names = [
            x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, text)])
            for text in ("test authority", "localhost")
        ]
        now = datetime.datetime.now(datetime.UTC)

        def made(subject: int, extension: Any) -> Any:
            builder = (
                x509.CertificateBuilder()
                .subject_name(names[subject])
                .issuer_name(names[0])
                .public_key(keys[subject].public_key())
                .serial_number(x509.random_serial_number())
                .not_valid_before(now - datetime.timedelta(days=1))
                .not_valid_after(now + datetime.timedelta(days=1))
                .add_extension(extension, critical=False)
            )
            return builder.sign(keys[0], hashes.SHA256())

        pem = serialization.Encoding.PEM
        authority = made(0, x509.BasicConstraints(ca=True, path_length=None))
        address = x509.IPAddress(ipaddress.ip_address("127.0.0.1"))
        both = x509.SubjectAlternativeName([address, x509.UniformResourceIdentifier(uri)])
        self.ca.write_bytes(authority.public_bytes(pem))
        self.certificate.write_bytes(made(1, both).public_bytes(pem))
        private = serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        self.key.write_bytes(keys[1].private_bytes(pem, *private))
        self.key.chmod(0o600)


@pytest.fixture
def certificates(tmp_path: Path) -> Callable[[str], Certificates]:
    pytest.importorskip("cryptography", reason="cryptography is not installed")
    return lambda uri: Certificates(tmp_path, uri)


@pytest.fixture(scope="session")
def eventually() -> Callable[[Callable[[], Any], str], Any]:
    return wait_for
