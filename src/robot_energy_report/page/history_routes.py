"""Routes of the history: answers are made by threads, never by the one of the live page."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from robot_energy.foundation.errors import HistoryError, RobotEnergyError
from robot_energy.foundation.schema_errors import refusal
from robot_energy_history.tariffs import Tariff
from robot_energy_report.page.answers import json_of, packed
from robot_energy_report.page.history_view import (
    HistoryView,
    Wish,
    friction_answer,
    savings_answer,
    savings_wish,
)
from robot_energy_report.page.json_numbers import json_text

WORKERS = 2  # answers that are worked on at the same time; the live page has a thread of its own
MAX_WAITING = 32  # requests beyond it are refused
MAX_TARIFF = 16 * 1024  # of a request with one [bytes]
Asked = dict[str, list[str]]
Answer = Callable[[Wish, Asked, int], dict[str, Any]]


class HistoryRoutes:
    """Answers requests for a history."""

    def __init__(self, folder: Path, allow_control: bool) -> None:
        self._view, self._control = HistoryView(folder), allow_control
        answers: dict[str, Answer] = {
            "": self._answer,
            "/shifts": lambda wish, asked, now_ns: self._view.shifts(wish),
            "/savings": self._savings,
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

    def _savings(self, wish: Wish, asked: Asked, now_ns: int) -> dict[str, Any]:
        days = savings_wish(asked, wish.period, now_ns)
        return savings_answer(self._view.folder, wish.robots, wish.period, days)

    def _json(self, answer: Answer) -> Callable[[Request], Awaitable[Response]]:
        """Return the route that gives the answer to a wish."""

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
        given = await json_of(request, MAX_TARIFF)
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
            return packed(request, work(time.time_ns()).encode(), kind)

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
