"""The history over HTTP: for whom, what is refused, and that the live page does not wait for it."""

import json
import threading
from concurrent.futures import ThreadPoolExecutor
from datetime import date

import pytest

from histories import START, Robot
from page_client import PATIENCE, request, state_of, wait_until
from robot_energy_history.store import HistoryStore
from robot_energy_history.tariffs import Tariff
from robot_energy_report.page import web_app
from robot_energy_report.page.access import page_access
from robot_energy_report.page.history_view import HistoryView
from robot_energy_report.page.hub import PageHub
from robot_energy_report.page.settings import PageSettings
from robot_energy_report.page.web_server import PageServer

TOKEN = "0123456789abcdef0123"
DAY = "?period=day&at=2026-01-01"
SAVINGS = f"{DAY}&baseline_start=2025-12-01&baseline_stop=2025-12-31"
TARIFF = {"begin": "2026-01-01", "price_per_kwh": 0.3, "co2_kg_per_kwh": 0.4, "timezone": "UTC"}
BEARER = {"Authorization": f"Bearer {TOKEN}"}


@pytest.fixture
def folder(tmp_path):
    store = HistoryStore(tmp_path / "history")
    store.open()
    robot = Robot()
    store.add("a", [robot.minute(1000) for _ in range(30)])
    assert store.write(robot.now), store.trouble
    store.close()
    return tmp_path / "history"


@pytest.fixture
def token_file(tmp_path):
    path = tmp_path / "token"
    path.write_text(TOKEN)
    path.chmod(0o600)
    return str(path)


@pytest.fixture
def serve(folder):
    """Start pages with the history; all end with the test."""
    servers = []

    def start(place=folder, **access):
        hub = PageHub("test", PageSettings(), history_folder=place)
        servers.append(PageServer(hub, page_access(**access)))
        return servers[-1].url.replace("0.0.0.0", "127.0.0.1")

    yield start
    for server in servers:
        server.close()


def test_the_history_is_served_to_this_computer(serve):
    url = serve()
    assert state_of(url)["recorded"] is True
    status, headers, body = request(url, f"/api/history{DAY}")
    assert status == 200
    assert "default-src 'none'" in headers["content-security-policy"]
    answer = json.loads(body)
    assert answer["total"]["energy"] == pytest.approx(1000 * 1800)
    assert answer["control"] is False
    status, headers, body = request(url, f"/history.csv{DAY}")
    assert status == 200
    assert "robot_energy_history.csv" in headers["content-disposition"]
    assert b"1800000000000" in body


def test_another_address_needs_the_token_for_the_history(serve, token_file):
    url = serve(address="0.0.0.0", token_file=token_file)
    paths = ("/api/history", "/api/history/shifts", "/api/history/friction", "/history.csv")
    for path in (*(f"{one}{DAY}" for one in paths), f"/api/history/savings{SAVINGS}"):
        assert request(url, path)[0] == 401
        assert request(url, path, **BEARER)[0] == 200
    assert request(url, "/history")[0] == 200  # the page itself holds no figure


def test_prices_are_set_with_the_token_alone(serve, token_file):
    url = serve(token_file=token_file, allow_control=True)
    body = json.dumps(TARIFF)
    assert request(url, "/api/history/tariff", "POST", body)[0] == 401
    assert (
        request(url, "/api/history/tariff", "POST", body, Origin="http://e.e", **BEARER)[0] == 403
    )
    assert json.loads(request(url, f"/api/history{DAY}")[2])["tariffs"] == []
    assert request(url, "/api/history/tariff", "POST", body, **BEARER)[0] == 200
    answer = json.loads(request(url, f"/api/history{DAY}")[2])
    assert answer["total"]["cost"] == pytest.approx(0.5 * 0.3)
    assert answer["total"]["co2"] == pytest.approx(0.5 * 0.4)
    assert answer["control"] is True


def test_prices_cannot_be_set_without_control(serve, token_file):
    url = serve(token_file=token_file)
    assert request(url, "/api/history/tariff", "POST", json.dumps(TARIFF), **BEARER)[0] == 404


@pytest.mark.parametrize(
    "body",
    [
        b"", b"{", b"[]", b"null", b"\xff", b"x" * 20_000,
        json.dumps({**TARIFF, "price_per_kwh": -1}), json.dumps({**TARIFF, "price_per_kwh": "NaN"}),
        json.dumps({**TARIFF, "timezone": "Mars/Base"}), json.dumps({**TARIFF, "other": 1}),
        json.dumps({**TARIFF, "currency": "<script>alert(1)</script>"}),
        json.dumps({**TARIFF, "begin": "2026-13-01"}),
    ],
)  # fmt: skip
def test_what_is_no_tariff_is_refused_and_changes_nothing(serve, token_file, body):
    url = serve(token_file=token_file, allow_control=True)
    status, _, said = request(url, "/api/history/tariff", "POST", body, **BEARER)
    assert status == 400
    assert b"expected" in said
    assert json.loads(request(url, f"/api/history{DAY}")[2])["tariffs"] == []


@pytest.mark.parametrize(
    "query",
    [
        "?robot=../../etc/passwd", "?robot=%00", "?period=%2e%2e%2f", "?at=%F0%9F%92%A9",
        "?timezone=../../etc/passwd", "?timezone=/etc/localtime", "?by=__class__", "?at=-1",
        "?period=span&start=0001-01-01&stop=9999-12-31", "?period=span&start=2026-01-01&stop=",
    ],
)  # fmt: skip
def test_no_request_reads_anything_else(serve, query):
    url = serve()
    for path in ("/api/history", "/api/history/friction", "/api/history/savings", "/history.csv"):
        status, _, body = request(url, path + query)
        assert status == 400, body
        assert b"expected" in body
        assert b"root:" not in body


def test_without_a_history_the_page_says_so(serve, tmp_path):
    status, _, body = request(serve(tmp_path / "none"), "/api/history")
    assert status == 400
    assert b"energy_recorder" in body
    assert not (tmp_path / "none").exists()


def test_a_page_without_history_has_no_route():
    server = PageServer(PageHub("test", PageSettings()), page_access())
    try:
        assert state_of(server.url)["recorded"] is False
        assert request(server.url, "/api/history")[0] == 404
    finally:
        server.close()


def test_a_slow_answer_holds_up_neither_the_live_page_nor_memory(serve, monkeypatch):
    free, begun = threading.Event(), threading.Semaphore(0)

    def slow(view, wish, now_ns):
        begun.release()
        assert free.wait(PATIENCE)
        return {}

    monkeypatch.setattr(HistoryView, "answer", slow)
    monkeypatch.setattr(web_app, "MAX_WAITING", 4)
    url = serve()
    with ThreadPoolExecutor(6) as clients:
        asked = [clients.submit(request, url, f"/api/history{DAY}") for _ in range(6)]
        for _ in range(web_app.WORKERS):
            assert begun.acquire(timeout=PATIENCE)
        assert state_of(url)["live"] is True  # answered while all threads are taken
        wait_until(lambda: sum(one.done() for one in asked) == 2, "two refusals")
        assert {one.result()[0] for one in asked if one.done()} == {503}
        free.set()
        assert sorted(one.result()[0] for one in asked) == [200] * 4 + [503] * 2


def test_the_page_reads_while_the_recorder_writes(serve, folder):
    url = serve()
    store = HistoryStore(folder)
    store.open()
    try:
        robot = Robot(now=START)
        for count in range(1, 4):
            store.add("b", [robot.minute(600)])
            assert store.write(robot.now), store.trouble
            rows = json.loads(request(url, f"/api/history{DAY}&robot=b")[2])["robots"]
            assert rows[0]["energy"] == pytest.approx(600 * 60 * count)
    finally:
        store.close()


def test_a_page_that_is_closed_ends_its_threads(serve, folder):
    server = PageServer(PageHub("t", PageSettings(), history_folder=folder), page_access())
    assert request(server.url, f"/api/history{DAY}")[0] == 200
    server.close()
    names = [thread.name for thread in threading.enumerate() if thread.name.startswith("history")]
    wait_until(
        lambda: not any(thread.name in names for thread in threading.enumerate()), "their end"
    )


def test_the_tariff_of_the_page_is_that_of_the_command(folder):
    view = HistoryView(folder)
    view.add_tariff(Tariff(**{**TARIFF, "begin": date(2026, 1, 1)}), START)  # the command's
    wish = view.wish({"period": ["day"], "at": ["2026-01-01"]}, START)
    assert view.answer(wish, START)["tariffs"][0]["price_per_kwh"] == 0.3
