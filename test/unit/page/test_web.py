"""Who may read the page and act on it, and what clients cannot do to it."""

import json
import shlex
import subprocess
import threading
import time
from concurrent.futures import Future
from contextlib import suppress
from select import select

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from page_client import PATIENCE, answer_to, connected, request, state_of, wait_until
from page_messages import power_states, registers
from robot_energy.foundation.errors import CredentialsError, PageError, RobotEnergyError
from robot_energy_report.page import web_server
from robot_energy_report.page.access import page_access
from robot_energy_report.page.hub import PageHub
from robot_energy_report.page.robot_state import RobotState
from robot_energy_report.page.saved_page import FILES
from robot_energy_report.page.settings import PageSettings
from robot_energy_report.page.web_app import MAX_STREAMS
from robot_energy_report.page.web_server import PageServer

TOKEN = "0123456789abcdef0123"
READS = ["/api/state", "/api/events", "/metrics", "/saved.html"]


@pytest.fixture
def token_file(tmp_path):
    path = tmp_path / "token"
    path.write_text(f"{TOKEN}\n")
    path.chmod(0o600)
    return str(path)


@pytest.fixture
def serve():
    """Start pages with one robot; all end with the test."""
    servers = []

    def start(hub=None, **access):
        hub = hub or PageHub("test", PageSettings(), live=False)  # figures that never grow stale
        robot = hub.robot("robot1")
        robot.take_power(power_states([1.0], [100.0], measured=99.0), time.monotonic())
        robot.take_registers(registers(7200.0))
        hub.tick(time.monotonic())
        servers.append(PageServer(hub, page_access(**access)))
        return servers[-1].url

    yield start
    for server in servers:
        server.close()


def bearer(token=TOKEN):
    return {"Authorization": f"Bearer {token}"}


def test_every_file_of_the_page_is_served_with_a_strict_policy(serve):
    url = serve()
    for path in FILES:
        status, headers, body = request(url, path, Accept_Encoding="gzip")
        assert status == 200, path
        assert headers["content-encoding"] == "gzip"
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert "access-control-allow-origin" not in headers
        assert "set-cookie" not in headers
        assert request(url, path, If_None_Match=headers["etag"])[0] == 304
        assert body


def test_figures_are_served(serve):
    url = serve()
    robot = state_of(url)["robots"][0]
    assert robot["power"]["predicted_grid_power"] == 100.0
    assert b"robot_energy_joules_total" in request(url, "/metrics")[2]


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "", "127.0.0.1.evil.example"])
def test_another_host_name_is_refused(serve, host):
    status, _, body = request(serve(), "/api/state", Host=host)
    assert status in (400, 403)
    assert b"100" not in body


def test_requests_of_other_pages_are_refused(serve):
    url = serve()
    assert request(url, "/api/state", Origin="http://evil.example")[0] == 403
    assert request(url, "/api/state", Origin="null")[0] == 403
    assert request(url, "/api/state", Sec_Fetch_Site="cross-site")[0] == 403
    assert request(url, "/api/state", Origin=url.rstrip("/"))[0] == 200


@pytest.mark.parametrize(
    "path",
    [
        "/../etc/passwd", "/..%2f..%2fetc/passwd", "/static/../access.py", "//etc/passwd",
        "/page.css/", "/%2e%2e/x", "/hub.py", "/.git/config", "/index.html%00.css", "/api",
        "/api/control",
    ],
)  # fmt: skip
def test_nothing_outside_the_page_is_served(serve, path):
    assert request(serve(), path)[0] == 404


@pytest.mark.parametrize("method", ["PUT", "DELETE", "PATCH", "TRACE", "OPTIONS", "CONNECT", "X"])
def test_other_methods_are_refused(serve, method):
    assert request(serve(), "/api/state", method)[0] in (400, 405)


def test_writing_is_absent_without_control(serve):
    wish = json.dumps({"robot": "robot1", "action": "open_interval", "text": "a"})
    assert request(serve(), "/api/control", "POST", wish, **bearer())[0] == 404


def test_another_address_needs_the_token_for_all_figures(serve, token_file):
    url = serve(address="0.0.0.0", token_file=token_file).replace("0.0.0.0", "127.0.0.1")
    for path in READS:
        assert request(url, path)[0] == 401, path
        assert request(url, path, **bearer("wrong" * 5))[0] == 401
        assert request(url, path, Authorization=f"Basic {TOKEN}")[0] == 401
    assert request(url, "/")[0] == 200  # the page itself holds no figure
    assert b"100.0" in request(url, "/api/state", **bearer())[2]


def test_actions_need_the_token_on_loopback_too(serve, token_file):
    seen = []

    def control(robot, action, text):
        seen.append((robot, action, text))
        answer = Future()
        threading.Timer(0.0, answer.set_result, [(True, "done")]).start()
        return answer

    hub = PageHub("test", PageSettings(), control=control)
    hub.robot("1")
    url = serve(hub, token_file=token_file, allow_control=True)
    wish = json.dumps({"robot": "robot1", "action": "open_interval", "text": "part 1"})
    assert request(url, "/api/control", "POST", wish)[0] == 401
    assert request(url, "/api/control", "POST", wish, Origin="http://e.e", **bearer())[0] == 403
    assert not seen
    status, _, body = request(url, "/api/control", "POST", wish, **bearer())
    assert (status, json.loads(body)) == (200, {"done": True, "message": "done"})
    assert seen == [("robot1", "open_interval", "part 1")]
    for bad in (b"", b"{", b"[]", b"null", wish.replace("robot1", "other"), b'{"robot":1}',
                wish.replace('"robot1"', "1"), wish.replace('"part 1"', "1"),
                wish.replace("open_interval", "shutdown"), wish.replace("part 1", "x" * 201),
                b"\xff" * 100, b"[" * 2000, b" " * 5000):  # fmt: skip
        assert request(url, "/api/control", "POST", bad, **bearer())[0] == 400, bad
    for text in ("part \udce9", "part \u202e", "  "):  # ROS cannot send the first
        bad = wish.replace('"part 1"', json.dumps(text))
        status, _, body = request(url, "/api/control", "POST", bad, **bearer())
        assert status == 400
        assert b"; expected " in body
    assert len(seen) == 1
    assert request(url, "/api/state")[0] == 200


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        ({"address": "0.0.0.0"}, "it has no token"),
        ({"address": "192.168.1.4"}, "it has no token"),
        ({"allow_control": True}, "it has no token"),
        ({"address": "localhost"}, "IP address"),
        ({"token_file": "/nowhere/token"}, "cannot be read .*umask 077"),
    ],
)
def test_access_that_is_not_safe_is_refused(wanted, words):
    with pytest.raises(RobotEnergyError, match=words):
        page_access(**wanted)


def test_a_weak_token_is_refused(tmp_path):
    path = tmp_path / "token"
    path.touch(0o600)
    for text in ("", "short", "x" * 600, "two\nlines of token text", "ü" * 20):
        path.write_text(text)
        with pytest.raises(PageError, match="cannot be used"):
            page_access(token_file=str(path))


def test_the_start_says_what_becomes_readable(token_file):
    said = " ".join(page_access("0.0.0.0", 0, token_file).sentences("http://x/"))
    assert "temperatures" in said
    assert "unencrypted" in said
    assert TOKEN not in said


def test_a_token_that_others_can_read_or_write_is_refused_with_a_remedy_that_helps(tmp_path):
    path = tmp_path / "a token"  # as a shell has it in quotation marks
    path.write_text(f"{TOKEN}\n")
    for mode in (0o644, 0o640, 0o602, 0o620):
        path.chmod(mode)
        with pytest.raises(CredentialsError) as caught:
            page_access(token_file=str(path))
        error = caught.value
        assert f"token file {path} has the permissions {mode:04o}" in error.found
        assert "0600" in error.expected
        subprocess.run(shlex.split(error.remedy), check=True)
        assert page_access(token_file=str(path)).token == TOKEN


def test_a_port_in_use_is_refused_in_one_sentence(serve):
    port = int(serve().rstrip("/").rpartition(":")[2])
    with pytest.raises(PageError, match="another port"):
        PageServer(PageHub("", PageSettings()), page_access(port=port))


def read_until(client, *words):
    """Read a stream until all words have come, each after the one before."""
    data, limit = b"", time.monotonic() + PATIENCE
    for word in words:
        while word not in data:
            part = client.recv(65536)
            assert part, f"closed before {word}"
            assert time.monotonic() < limit, f"waited {PATIENCE} s in vain for {word}"
            data += part
        data = data.partition(word)[2]


def test_events_bring_the_newest_and_late_pages_get_the_state(serve):
    hub = PageHub("test", PageSettings(), live=False)
    url = serve(hub)
    with connected(url) as client:
        client.sendall(b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        read_until(client, b"event: state", b"event: power", b"100.0")
        hub.robot("robot1").take_power(power_states([1.1], [321.0]), time.monotonic())
        hub.tick(time.monotonic())
        read_until(client, b"event: power", b"321.0")


def test_of_many_robots_a_page_gets_one_whole_and_an_overview_of_all(serve):
    hub = PageHub("", PageSettings(), live=False)
    url = serve(hub)
    for number in range(2, 101):
        robot = hub.robot(f"robot{number}")
        robot.take_power(power_states([1.0], [100.0 + number]), 0.0)
        robot.take_registers(registers(3600.0 * number))
    state = json.loads(request(url, "/api/state?robot=robot42")[2])
    assert [one["name"] for one in state["robots"]] == ["robot42"]
    assert len(state["history"]) == 1
    assert state["count"] == len(state["fleet"]) == 100
    row = state["fleet"][41]
    whole = state["robots"][0]
    assert row["name"] == "robot42"
    assert row["predicted_grid_power"] == whole["power"]["predicted_grid_power"] == 142.0
    assert row["energy"] == whole["headline"]["energy"] == 3600.0 * 42
    assert row["alarms"] == len(whole["alarms"])
    assert len(json.dumps(state)) < 120_000
    assert state_of(url)["robots"][0]["name"] == "robot1"
    for unknown in ("robot999", "%00", "..%2F", "x" * 2000):
        assert json.loads(request(url, f"/api/state?robot={unknown}")[2])["robots"]
    saved = request(url, "/saved.html?robot=robot42")[2]
    assert b"robot100" in saved
    assert len(saved) < 400_000
    with connected(url) as client:
        client.sendall(b"GET /api/events?robot=robot42 HTTP/1.1\r\nHost: localhost\r\n\r\n")
        wait_until(lambda: hub.watched["robot42"] == 1, "the page")
        hub.tick(time.monotonic() + 10.0)
        read_until(client, b"event: state", b"event: fleet", b"event: power", b"142.0")
        sent = hub.events_of("robot42")
        assert len(sent["power"][1]) < 2000
        assert len(sent["fleet"][1]) < 30_000
    wait_until(lambda: "robot42" not in hub.watched, "its end")
    hub.tick(time.monotonic() + 20.0)
    assert set(hub.events) == {""}


def test_a_page_gets_whole_ticks(monkeypatch):
    """Inside of a tick one that reads without the lock gets the events of the tick before."""
    hub = PageHub("test", PageSettings())
    hub.robot("r")
    hub.tick(0.0)
    before, whole = hub.events_of(""), dict(hub.events_of(""))
    seen = []
    power = RobotState.power
    monkeypatch.setattr(
        RobotState, "power", lambda *given: (seen.append(hub.events_of("")), power(*given))[1]
    )
    hub.tick(100.0)
    assert seen[0] is before
    assert before == whole
    assert {number for number, _ in hub.events_of("").values()} == {2}


def test_slow_pages_do_not_hold_up_others_and_are_dropped(serve, monkeypatch):
    hub = PageHub("test", PageSettings())
    url = serve(hub)
    slow = [connected(url) for _ in range(20)]
    for client in slow:
        client.sendall(b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n")

    def pressed():
        hub.tick(time.monotonic())
        hub._due.clear()
        return not hub.events or len(streams(hub)) == 0

    def streams(hub):
        return hub.on_tick.__self__._app._stream._news

    wait_until(lambda: len(streams(hub)) == 20, "all slow clients")
    with monkeypatch.context() as patch:
        patch.setattr(web_server, "REQUEST_TIMEOUT", 0.5)
        hub.title = "x" * 20_000  # in every state: fills the buffers soon
        wait_until(pressed, "slow clients to be dropped")
    assert state_of(url)["title"] == hub.title
    for client in slow:
        client.close()


def test_hanging_clients_are_dropped(serve, monkeypatch):
    url = serve()
    with monkeypatch.context() as patch:
        patch.setattr(web_server, "REQUEST_TIMEOUT", 0.3)
        for begin in (b"", b"GET /api/state HT", b"GET / HTTP/1.1\r\nHost: localhost\r\nX: "):
            # Closed by the server; with a reset if that was before all had arrived.
            with connected(url) as client, suppress(ConnectionError):
                client.sendall(begin)
                assert client.recv(100) == b""
    assert state_of(url)


def test_streams_and_connections_are_bounded(serve, monkeypatch):
    monkeypatch.setattr(web_server, "MAX_CONNECTIONS", MAX_STREAMS + 10)
    monkeypatch.setattr(web_server, "REQUEST_TIMEOUT", 10 * PATIENCE)  # ends no connection here
    url = serve()
    clients = []
    for _ in range(MAX_STREAMS):
        clients.append(connected(url))
        clients[-1].sendall(b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        read_until(clients[-1], b"event: ")
    assert request(url, "/api/events")[0] == 429
    assert state_of(url)
    more = [connected(url) for _ in range(20)]
    ended, _, _ = select(more, [], [], PATIENCE)
    assert ended
    assert not any(map(answered, ended))
    for client in clients + more:
        client.close()
    wait_until(lambda: _works(url), "connections to be free again")


def answered(client):
    try:
        return client.recv(1) != b""
    except ConnectionError:
        return False


def _works(url):
    try:
        return request(url, "/api/events", "HEAD")[0] == 200
    except OSError:
        return False


LINES = st.lists(st.binary(max_size=60), max_size=6).map(b"\r\n".join)
REQUESTS = st.one_of(
    st.binary(max_size=300),
    LINES,
    st.builds(
        lambda method, path, headers: (
            b"%s %s HTTP/1.1\r\nHost: localhost\r\n%s\r\n\r\n" % (method, path, headers)
        ),
        st.sampled_from([b"GET", b"HEAD", b"POST", b"PUT", b"X"]),
        st.one_of(
            st.sampled_from(
                [b"/", b"/metrics", b"/api/state", b"*", b"http://localhost/", b"/%ff%00"]
            ),
            st.text(st.characters(min_codepoint=33, max_codepoint=126), max_size=40).map(
                lambda text: b"/" + text.encode()
            ),
        ),
        LINES,
    ),
)


@pytest.fixture(scope="module")
def one_page():
    hub = PageHub("test", PageSettings())
    hub.robot("robot1").take_power(power_states([1.0], [100.0]), time.monotonic())
    hub.tick(time.monotonic())
    server = PageServer(hub, page_access())
    yield server.url
    server.close()


@settings(max_examples=150)
@given(data=REQUESTS)
@example(data=b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil\r\n\r\n")
@example(data=b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"a" * 20_000 + b"\r\n\r\n")
@example(
    data=b"GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\r\n"
)
@example(data=b"POST /api/control HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99\r\n\r\nx")
@example(data=b"GET / HTTP/1.1\r\nHost: [::1\r\n\r\n")
@example(data=b"GET http://[/ HTTP/1.1\r\nHost: localhost\r\n\r\n")
@example(
    data=b"GET /api/state HTTP/1.1\r\nHost: localhost:port\r\nAuthorization: Bearer \xff\r\n\r\n"
)
def test_no_request_makes_the_server_fail(one_page, data):
    found = answer_to(one_page, data)
    assert not found.startswith(b"HTTP/1.1 5"), found
    assert request(one_page, "/icon.svg")[0] == 200
