"""Server-sent events: every page gets the newest when it is ready for it, and nothing waits."""

from __future__ import annotations

import asyncio

from starlette.responses import PlainTextResponse
from starlette.types import Receive, Scope, Send

from robot_energy.page.hub import PageHub

MAX_STREAMS = 64  # pages that are open at the same time
BEAT = 1.0  # a stream without news sends a comment this often [s]


class EventStream:
    """ASGI application of the route of the events.

    A client that reads slowly misses events between, never the newest; the memory for it is
    that of one event and the buffer of its connection.

    Args:
        hub: Whose events.
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
        news = asyncio.Event()
        self._news.add(news)
        gone = asyncio.ensure_future(_disconnected(receive))
        gone.add_done_callback(lambda _: news.set())
        try:
            kind = (b"content-type", b"text/event-stream")
            await send({"type": "http.response.start", "status": 200, "headers": [kind]})
            if scope["method"] != "HEAD":
                await self._follow(send, news, gone)
            await send({"type": "http.response.body", "body": b"", "more_body": False})
        finally:
            self._news.discard(news)
            gone.cancel()

    async def _follow(self, send: Send, news: asyncio.Event, gone: asyncio.Future[None]) -> None:
        number = state_number = 0
        while not gone.done():
            events = self._hub.events
            chunk = b": beat\n\n"
            if events.number > number:
                chunk = events.power
                if events.state_number > state_number:
                    chunk = events.state + chunk
                number, state_number = events.number, events.state_number
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
