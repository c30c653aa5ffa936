"""Real databases of Debian, each in a folder of its own, on loopback or a socket, never as root."""

from __future__ import annotations

import os
import pwd
import shutil
import socket
import subprocess
import tempfile
import time
import urllib.parse
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PATIENCE = 60.0  # s, on a busy machine
INFLUXD, VICTORIA = shutil.which("influxd"), shutil.which("victoria-metrics")
NOBODY = "nobody"


def _postgres() -> Path | None:
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    on_path = shutil.which("initdb")
    return found[-1].parent if found else Path(on_path).parent if on_path else None


POSTGRES = _postgres()


@contextmanager
def _folder() -> Iterator[Path]:
    """A folder that belongs to who runs the server; a server refuses to run as root."""
    path = Path(tempfile.mkdtemp(prefix="robot_energy_"))
    try:
        if os.geteuid() == 0:
            user = pwd.getpwnam(NOBODY)
            os.chown(path, user.pw_uid, user.pw_gid)
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)


def _as_user(command: list[str]) -> list[str]:
    if os.geteuid():
        return command
    user = pwd.getpwnam(NOBODY)
    return [
        "setpriv",
        f"--reuid={user.pw_uid}",
        f"--regid={user.pw_gid}",
        "--clear-groups",
        *command,
    ]


class Postgres:
    """A cluster that listens on a socket in its folder alone."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def run(self, sql: bytes) -> str:
        """Run statements; what is wrong with them fails."""
        words = ["psql", "-h", str(self._folder), "-U", "plant", "-d", "postgres", "-qAtX",
                 "-v", "ON_ERROR_STOP=1"]  # fmt: skip
        done = subprocess.run(_as_user(words), input=sql, capture_output=True, check=False, cwd="/")
        assert done.returncode == 0, done.stderr.decode()
        assert done.stderr == b"", done.stderr.decode()
        return done.stdout.decode().strip()


@contextmanager
def postgres() -> Iterator[Postgres]:
    assert POSTGRES is not None
    with _folder() as folder:
        made = subprocess.run(
            _as_user([str(POSTGRES / "initdb"), "-D", str(folder / "data"), "-U", "plant",
                      "--auth=trust",
                      "--no-sync", "-E", "UTF8", "--no-locale"]),
            capture_output=True, check=False, cwd="/",
        )  # fmt: skip
        assert made.returncode == 0, made.stderr
        words = [str(POSTGRES / "postgres"), "-D", str(folder / "data"), "-k", str(folder),
                 "-c", "listen_addresses=", "-c", "fsync=off"]  # fmt: skip
        with _running(words):
            server = Postgres(folder)
            _until(lambda: (folder / ".s.PGSQL.5432").exists() and _answers(server), "PostgreSQL")
            yield server


def _answers(server: Postgres) -> bool:
    try:
        return server.run(b"SELECT 1;") == "1"
    except AssertionError:  # it starts
        return False


class Http:
    """A server that speaks HTTP on loopback."""

    def __init__(self, port: int) -> None:
        self._url = f"http://127.0.0.1:{port}/"

    def __call__(self, path: str, body: bytes | None = None, **query: str) -> bytes:
        address = f"{self._url}{path}?{urllib.parse.urlencode(query)}"
        with urllib.request.urlopen(address, body, timeout=PATIENCE) as answer:
            return answer.read()

    def ready(self, path: str) -> bool:
        try:
            self(path)
        except OSError:
            return False
        return True


@contextmanager
def influxdb() -> Iterator[Http]:
    with _folder() as folder:
        port, other = _free_port(), _free_port()
        place = {f"INFLUXDB_{one}_DIR": str(folder / one.lower()) for one in ("META", "DATA")}
        settings = {
            **place, "INFLUXDB_DATA_WAL_DIR": str(folder / "wal"),
            "INFLUXDB_HTTP_BIND_ADDRESS": f"127.0.0.1:{port}",
            "INFLUXDB_BIND_ADDRESS": f"127.0.0.1:{other}", "INFLUXDB_REPORTING_DISABLED": "true",
            "HOME": str(folder),
        }  # fmt: skip
        with _running([INFLUXD or "", "run", "-config", "/dev/null"], settings):
            server = Http(port)
            _until(lambda: server.ready("ping"), "InfluxDB")
            yield server


@contextmanager
def victoria_metrics(*settings: str) -> Iterator[Http]:
    with _folder() as folder:
        port = _free_port()
        words = [VICTORIA or "", f"-storageDataPath={folder / 'data'}", "-retentionPeriod=100y",
                 f"-httpListenAddr=127.0.0.1:{port}", *settings]  # fmt: skip
        with _running(words):
            server = Http(port)
            _until(lambda: server.ready("health"), "VictoriaMetrics")
            yield server


@contextmanager
def _running(words: list[str], settings: dict[str, str] | None = None) -> Iterator[None]:
    process = subprocess.Popen(
        _as_user(words), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd="/",
        env={**os.environ, **(settings or {})},
    )  # fmt: skip
    try:
        yield
    finally:
        process.terminate()
        process.wait(PATIENCE)


def _free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def _until(condition, what: str) -> None:
    limit = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < limit, f"waited {PATIENCE} s in vain for {what}"
        time.sleep(0.05)
