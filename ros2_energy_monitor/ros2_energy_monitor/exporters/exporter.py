# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What every exporter does, and the newest messages that it exports."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any

from ros2_energy_monitor.diagnostics.reporter import StatusBuilder
from ros2_energy_monitor.exporters.values import Topic


@dataclass
class Newest:
    """The newest message of each topic.

    Attributes:
        stale_after: Age from which a message is no longer current. [s]
    """

    stale_after: float
    _held: dict[Topic, tuple[Any, float]] = field(default_factory=lambda: {})

    def take(self, topic: Topic, message: Any, now: float) -> None:
        """Keep a message.

        Args:
            now: Steady time. [s]
        """
        self._held[topic] = (message, now)

    def message(self, topic: Topic) -> Any:
        """Return the newest message of a topic; None before the first."""
        return self._held[topic][0] if topic in self._held else None

    def is_current(self, topic: Topic, now: float) -> bool:
        """Return whether a message of a topic came lately.

        Args:
            now: Steady time. [s]
        """
        return topic in self._held and now - self._held[topic][1] <= self.stale_after


class Exporter(ABC):
    """Hands the newest values to one system. Its methods never wait for the network."""

    @abstractmethod
    def start(self) -> None:
        """Begin to connect or to serve."""

    @abstractmethod
    def publish(self, newest: Newest, now: float) -> None:
        """Hand out what is new, or that nothing is current.

        Args:
            now: Steady time. [s]
        """

    @abstractmethod
    def stop(self) -> None:
        """Say goodbye and disconnect."""

    @abstractmethod
    def check(self, found: StatusBuilder) -> None:
        """Add how it goes to the diagnostics."""
