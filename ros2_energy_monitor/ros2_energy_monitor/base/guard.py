# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The border of every path of a node: an exception inside one ends neither tick nor node.

A path is an input, a publisher, a timer, a service or a subscription. What an exception in
it costs is the block it was working on, and that is counted. It is a fault of the program
in any case: it is logged with its traceback, and an error in the diagnostics from then on.
"""

from __future__ import annotations

import math
import traceback
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import wraps
from typing import Any, TypeVar

from rclpy.context import Context
from rclpy.logging import get_logger
from rclpy.utilities import get_default_context

from robot_energy.foundation.shown_text import shown
from robot_energy.inputs.rejection_log import RejectionLog
from ros2_energy_monitor.diagnostics.reporter import ERROR, StatusBuilder

T = TypeVar("T")
INTERNAL_ERROR = "internal_error"  # the reason under which messages of a failed path are counted
MAX_KINDS = 100  # of errors that are logged whole
MAX_LINE = 500  # characters of one line of a traceback


class Guard:
    """Catches what the paths of one node raise.

    An error that comes while ROS is shut down is passed on.

    Args:
        context: Of the node; None for the default.
    """

    def __init__(self, name: str, context: Context | None = None) -> None:
        self.errors: Counter[str] = Counter()
        self._name, self._context = name, context
        self._kinds: set[tuple[str, str]] = set()  # logged: path, and class with its place
        self._last = ""

    def run(
        self, path: str, work: Callable[[], T], restart: Callable[[], None] | None = None
    ) -> T | None:
        """Return what some work of a path gives; None after an exception."""
        try:
            return work()
        except Exception as error:
            self.note(path, error)
        if restart is not None:
            self.run(f"{path}.restart", restart)
        return None

    def feed(
        self,
        path: str,
        accounts: Iterable[tuple[RejectionLog, int]],
        work: Callable[[], T],
        restart: Callable[[], None],
    ) -> T | None:
        """Return what an input makes of messages; None after an exception: none of them was used.

        Args:
            accounts: Each account of the input, with how many messages have arrived for it.
        """
        kept: list[tuple[RejectionLog, RejectionLog, int]] = []
        for log, arrived in accounts:
            kept.append((log, replace(log, rejected=log.rejected.copy()), arrived))

        def lose() -> None:
            for log, before, arrived in kept:
                log.lose(before, arrived, INTERNAL_ERROR)
            restart()

        return self.run(path, work, lose)

    def callback(self, path: str, work: Callable[..., Any]) -> Callable[..., Any]:
        """Return a callback that no exception leaves; that of a service still answers."""

        @wraps(work)
        def guarded(*arguments: Any) -> Any:
            try:
                return work(*arguments)
            except Exception as error:
                self.note(path, error)
            return _refusal(arguments[1]) if len(arguments) == 2 else None  # request, response

        return guarded

    def note(self, path: str, error: Exception) -> None:
        """Count an exception, and log it if it is of a new kind.

        Args:
            path: Where it was caught, such as ``timer.tick``.

        Raises:
            Exception: The same, if ROS is shut down.
        """
        if not (self._context or get_default_context()).ok():
            raise error
        self.errors[path] += 1
        frames = traceback.extract_tb(error.__traceback__)
        place = f"{frames[-1].filename}:{frames[-1].lineno}" if frames else ""
        self._last = f"{path}: {type(error).__name__}: {shown(str(error))}"
        kind = (path, f"{type(error).__name__} {place}")
        if kind in self._kinds or len(self._kinds) >= MAX_KINDS:
            return
        self._kinds.add(kind)
        lines = "".join(traceback.format_exception(error)).splitlines()
        text = "\n".join(shown(line, MAX_LINE) for line in lines)
        get_logger(self._name).error(
            f"internal error in {path}; what it was working on is lost, the rest goes on:\n{text}"
        )

    def check(self, found: StatusBuilder) -> None:
        """Add how many exceptions were caught, which must be none."""
        total = self.errors.total()
        found.values["internal_errors"] = total
        found.values |= {f"internal_errors.{path}": count for path, count in self.errors.items()}
        if total:
            found.add(
                ERROR,
                f"report this fault of the program, with the log: {total} internal errors, the "
                f"last in {self._last}",
            )


def _refusal(response: Any) -> Any:
    """Return the response of a service that failed."""
    if hasattr(response, "success") and hasattr(response, "message"):
        return refuse(response, "internal error: see the log of the node")
    return response


def refuse(response: Any, message: str) -> Any:
    """Return the response of a service that refuses, for a reason, without an interval."""
    response.success, response.message = False, message
    if hasattr(response, "interval"):
        response.interval = type(response.interval)(**unknown_figures(type(response.interval)))
    return response


def unknown_figures(kind: Any) -> dict[str, Any]:
    """Return the figures of an answer to what was refused; ROS makes them 0, which is an energy."""
    types = kind.get_fields_and_field_types()
    return {name: math.nan for name, text in types.items() if text == "double"}
