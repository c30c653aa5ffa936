"""The web application: fixed routes, checked headers, one stream of events for each page.

Answers of the history are made by threads, never by the one of the live page.
"""

from __future__ import annotations

import asyncio
import gzip
import json
import time
from collections import Counter
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, cast

from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import Message, Receive, Scope, Send

from robot_energy.accounting.plain_text import MAX_REASON, require_plain_text
from robot_energy.foundation.errors import HistoryError, RegisterError, RobotEnergyError
from robot_energy.foundation.schema_errors import refusal
from robot_energy_history.tariffs import Tariff
from robot_energy_report.page.access import PageAccess
from robot_energy_report.page.history_view import (
    HistoryView,
    Wish,
    friction_answer,
    savings_answer,
)
from robot_energy_report.page.hub import ACTIONS, EVENTS, PageHub
from robot_energy_report.page.json_numbers import json_text
from robot_energy_report.page.metrics import OPENMETRICS, metrics_text
from robot_energy_report.page.saved_page import FILES, saved_page, static_file

MAX_BODY = 2048  # of a request [bytes]
MAX_STREAMS = 64  # pages that are open at the same time
BEAT = 1.0  # a stream without news sends a comment this often [s]
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
    "cache-control": "no-store",
}
OPEN_PATHS = frozenset(FILES)  # hold no figures; everything else needs the token where there is one
WORKERS = 2  # answers that are worked on at the same time; the live page has a thread of its own
MAX_WAITING = 32  # requests beyond it are refused
MAX_TARIFF = 16 * 1024  # of a request with one [bytes]
Asked = dict[str, list[str]]
Answer = Callable[[Wish, Asked, int], dict[str, Any]]
PATIENCE = 5.0  # for a body to arrive, and for an action [s]


class HistoryRoutes:
    """Answers requests for a history."""

    def __init__(self, folder: Path, allow_control: bool) -> None:
        self._view, self._control = HistoryView(folder), allow_control
        answers: dict[str, Answer] = {
            "": self._answer,
            "/shifts": lambda wish, asked, now_ns: self._view.shifts(wish),
            "/savings": lambda wish, asked, now_ns: savings_answer(folder, wish, asked, now_ns),
            "/friction": lambda wish, asked, now_ns: friction_answer(
                folder, wish.robots, wish.period
            ),
        }
        self._workers = ThreadPoolExecutor(WORKERS, "history")
        self._waiting = 0
        self.routes = [
            *(
                Route(f"/api/history{path}", self._json(answer), methods=["GET"])
                for path, answer in answers.items()
            ),
            Route("/history.csv", self._csv, methods=["GET"]),
        ]
        if allow_control:
            self.routes.append(Route("/api/history/tariff", self._tariff, methods=["POST"]))

    def close(self) -> None:
        """Take no more requests."""
        self._workers.shutdown(wait=False, cancel_futures=True)

    def _answer(self, wish: Wish, asked: Asked, now_ns: int) -> dict[str, Any]:
        return {**self._view.answer(wish, now_ns), "control": self._control}

    def _json(self, answer: Answer) -> Callable[[Request], Awaitable[Response]]:
        async def route(request: Request) -> Response:
            def work(now_ns: int) -> str:
                asked = _asked(request)
                return json_text(answer(self._view.wish(asked, now_ns), asked, now_ns))

            return await self._worked(request, work, "application/json")

        return route

    async def _csv(self, request: Request) -> Response:
        def work(now_ns: int) -> str:
            return self._view.csv(self._view.wish(_asked(request), now_ns))

        answer = await self._worked(request, work, "text/csv")
        answer.headers["content-disposition"] = 'attachment; filename="robot_energy_history.csv"'
        return answer

    async def _tariff(self, request: Request) -> Response:
        given = await _json_of(request, MAX_TARIFF)
        if given is None:
            return PlainTextResponse("expected JSON with a tariff\n", 400)

        def work(now_ns: int) -> str:
            try:
                tariff = Tariff.model_validate_json(json.dumps(given))
            except ValidationError as error:
                raise refusal(error, Tariff, given, "the tariff", HistoryError) from error
            return json_text({"done": True, "message": self._view.add_tariff(tariff, now_ns)})

        return await self._worked(request, work, "application/json")

    async def _worked(self, request: Request, work: Callable[[int], str], kind: str) -> Response:
        if self._waiting >= MAX_WAITING:
            return PlainTextResponse("too many requests for the history wait already\n", 503)
        self._waiting += 1

        def answer() -> Response:
            return _packed(request, work(time.time_ns()).encode(), kind)

        try:
            return await asyncio.get_running_loop().run_in_executor(self._workers, answer)
        except HistoryError as error:
            return PlainTextResponse(f"{error}\n", 400)
        except RobotEnergyError as error:
            return PlainTextResponse(f"{error}\n", 500)
        finally:
            self._waiting -= 1


def _asked(request: Request) -> Asked:
    found: Asked = {}
    for name, value in request.query_params.multi_items():
        found.setdefault(name, []).append(value)
    return found


class PageApp:
    """ASGI application of one page."""

    def __init__(self, hub: PageHub, access: PageAccess) -> None:
        self._hub, self._access = hub, access
        self._stream = EventStream(hub)
        routes = [
            *(Route(path, self._file, methods=["GET"]) for path in FILES),
            Route("/api/state", self._state, methods=["GET"]),
            Route("/api/events", self._stream, methods=["GET"]),
            Route("/metrics", self._metrics, methods=["GET"]),
            Route("/saved.html", self._saved, methods=["GET"]),
        ]
        if access.allow_control:
            routes.append(Route("/api/control", self._control, methods=["POST"]))
        self._history: HistoryRoutes | None = None
        if hub.history_folder is not None:
            self._history = HistoryRoutes(hub.history_folder, access.allow_control)
            routes += self._history.routes
        self._app = Starlette(routes=routes)
        self._app.router.redirect_slashes = False

    def notify(self) -> None:
        """Say that the hub has news; called in the loop of the server."""
        self._stream.notify()

    def close(self) -> None:
        """Take no more requests for the history."""
        if self._history is not None:
            self._history.close()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            return

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                given = dict(message.get("headers", []))  # those of a file may be kept
                own = {key.encode(): value.encode() for key, value in HEADERS.items()}
                message = {**message, "headers": list((own | given).items())}
            await send(message)

        refusal = self._refusal(Request(scope))
        await (refusal or self._app)(scope, receive, guarded)

    def _refusal(self, request: Request) -> Response | None:
        """What is wrong with a request before anything is looked up; None if nothing is."""
        headers = request.headers
        hosts, host = headers.getlist("host"), headers.get("host")
        if len(hosts) != 1 or not self._access.knows_host(host):
            return PlainTextResponse(
                "this page is not served under that name; use the address that was printed at its "
                "start, or add the name to its hosts (allowed_hosts)\n",
                403,
            )
        if not self._access.same_origin(headers.get("origin"), host):
            return PlainTextResponse("requests of other pages are refused\n", 403)
        if headers.get("sec-fetch-site", "none") in ("cross-site", "same-site"):
            if headers.get("sec-fetch-mode") != "navigate":
                return PlainTextResponse("requests of other pages are refused\n", 403)
        if request.method not in ("GET", "HEAD", "POST"):
            return PlainTextResponse("expected GET\n", 405, {"allow": "GET, HEAD"})
        writes = request.method == "POST"
        private = not self._access.loopback and request.url.path not in OPEN_PATHS
        if (writes and self._access.allow_control) or private:
            if not self._access.permits(headers.get("authorization")):
                return PlainTextResponse(
                    "expected the header 'Authorization: Bearer ...' with the token of this page\n",
                    401,
                    {"www-authenticate": "Bearer"},
                )
        return None

    async def _file(self, request: Request) -> Response:
        found = static_file(request.url.path)
        headers = {"etag": found.tag, "cache-control": "no-cache"}
        if request.headers.get("if-none-match") == found.tag:
            return Response(status_code=304, headers=headers)
        if _takes_gzip(request):
            headers |= {"content-encoding": "gzip", "vary": "accept-encoding"}
            return Response(found.packed, media_type=found.kind, headers=headers)
        return Response(found.content, media_type=found.kind, headers=headers)

    async def _state(self, request: Request) -> Response:
        text = json_text(self._hub.state(time.monotonic(), _shown(request)))
        return _packed(request, text.encode(), "application/json")

    async def _metrics(self, request: Request) -> Response:
        return _packed(request, metrics_text(self._hub, time.monotonic()), OPENMETRICS)

    async def _saved(self, request: Request) -> Response:
        text = saved_page(self._hub.state(time.monotonic(), _shown(request)))
        answer = _packed(request, text.encode(), "text/html")
        answer.headers["content-disposition"] = 'attachment; filename="robot_energy.html"'
        return answer

    async def _control(self, request: Request) -> Response:
        control, found = self._hub.control, await _json_of(request, MAX_BODY)
        given = cast("dict[str, Any]", found) if isinstance(found, dict) else {}
        robot, action, text = (given.get(key) for key in ("robot", "action", "text"))
        if (
            control is None
            or not (isinstance(robot, str) and isinstance(action, str) and isinstance(text, str))
            or robot not in self._hub.robots
            or action not in ACTIONS
            or len(text) > MAX_REASON
        ):
            return PlainTextResponse(
                f"expected JSON with robot (one of the page), action ({', '.join(ACTIONS)}) and "
                f"text (up to {MAX_REASON} characters)\n",
                400,
            )
        try:
            require_plain_text("a text", text.strip(), MAX_REASON, RegisterError)
        except RegisterError as error:  # before ROS, which cannot send a lone surrogate
            return PlainTextResponse(f"{error}\n", 400)
        try:
            async with asyncio.timeout(PATIENCE):
                done, sentence = await asyncio.wrap_future(control(robot, action, text))
        except (TimeoutError, asyncio.CancelledError):
            done = False
            sentence = "the monitor did not answer; see in the list of intervals what was done"
        return Response(
            json_text({"done": done, "message": sentence}), media_type="application/json"
        )


def _shown(request: Request) -> str:
    return request.query_params.get("robot", "")


class EventStream:
    """ASGI application of the route of server-sent events; nothing waits for a page.

    A client that reads slowly misses events between, never the newest; the memory for it is
    that of one event and the buffer of its connection. Of many robots a client gets one whole.
    """

    def __init__(self, hub: PageHub) -> None:
        self._hub = hub
        self._news: set[asyncio.Event] = set()

    def notify(self) -> None:
        """Say that the hub has news; called in the loop of the server."""
        for event in self._news:
            event.set()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send events until the client goes."""
        if len(self._news) >= MAX_STREAMS:
            answer = PlainTextResponse(f"{MAX_STREAMS} pages are open already\n", 429)
            return await answer(scope, receive, send)
        news, name = asyncio.Event(), _shown(Request(scope))
        self._news.add(news)
        with self._hub.lock:
            self._hub.watched[name] += 1
        gone = asyncio.ensure_future(_disconnected(receive))
        gone.add_done_callback(lambda _: news.set())
        try:
            kind = (b"content-type", b"text/event-stream")
            await send({"type": "http.response.start", "status": 200, "headers": [kind]})
            if scope["method"] != "HEAD":
                await self._follow(send, news, gone, name)
            await send({"type": "http.response.body", "body": b"", "more_body": False})
        finally:
            self._news.discard(news)
            with self._hub.lock:
                self._hub.watched[name] -= 1
                self._hub.watched += Counter()  # those that nobody shows go
            gone.cancel()

    async def _follow(
        self, send: Send, news: asyncio.Event, gone: asyncio.Future[None], name: str
    ) -> None:
        sent: dict[str, int] = {}
        while not gone.done():
            events = self._hub.events_of(name)
            new = [kind for kind in EVENTS if events.get(kind, (0, b""))[0] > sent.get(kind, 0)]
            chunk = b"".join(events[kind][1] for kind in new) or b": beat\n\n"
            sent |= {kind: events[kind][0] for kind in new}
            await send({"type": "http.response.body", "body": chunk, "more_body": True})
            try:
                async with asyncio.timeout(BEAT):
                    await news.wait()
            except TimeoutError:
                pass
            news.clear()


async def _disconnected(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass


async def _json_of(request: Request, most: int) -> Any:
    """Return what the body of a request says; None if it is too long, late or no JSON."""
    body = b""
    try:
        async with asyncio.timeout(PATIENCE):
            async for chunk in request.stream():
                body += chunk
                if len(body) > most:
                    return None
        return json.loads(body)
    except (TimeoutError, ClientDisconnect, ValueError, RecursionError):
        return None


def _takes_gzip(request: Request) -> bool:
    return "gzip" in request.headers.get("accept-encoding", "")


def _packed(request: Request, content: bytes, kind: str) -> Response:
    if not _takes_gzip(request):
        return Response(content, media_type=kind)
    headers = {"content-encoding": "gzip", "vary": "accept-encoding"}
    return Response(gzip.compress(content, 5, mtime=0), media_type=kind, headers=headers)
