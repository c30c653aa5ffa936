# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Whether what arrives comes from a recording that is played, by the names of its publishers.

A recording must never be added to the registers of a robot: its energy was counted when it was
recorded, and would be counted again each time it is played.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from enum import Enum, auto

from ros2_energy_monitor.base.inbox import Inbox
from ros2_energy_monitor.diagnostics.topic_publishers import NOT_YET_KNOWN

PLAYERS = ("player", "rosbag2_player")  # nodes: ours, and that of `ros2 bag play`
PATIENCE = 2.0  # until publishers that cannot be named count as those of a robot [s]


class Change(Enum):
    """What a look at the publishers has shown."""

    NONE = auto()
    UNKNOWN = auto()
    """A publisher is new and not named yet: what has arrived must wait."""
    RECORDING = auto()
    """A recording begins."""
    ROBOT = auto()
    """A robot publishes after a recording had ended; all that waits is its own."""
    MIXED = auto()
    """A robot publishes and no player any more; of what waits, some may be of the recording."""


class PlayedRecording:
    """Looks who publishes to some inboxes, whenever a publisher was met or has left.

    After a recording has ended nothing changes until a robot publishes or a recording begins, so
    that its energies can still be read.

    Attributes:
        players: Full names of the nodes that play, or have played last; empty for a robot.
        met: Publishers of each inbox as of the last `look`: ever matched, and now.
    """

    def __init__(self, inboxes: Sequence[Inbox]) -> None:
        self.players: tuple[str, ...] = ()
        self.inboxes, self._ended = inboxes, True
        self.met = [(0, 0)] * len(inboxes)
        self._most = self.met  # the greatest of each; a subscription that is renewed falls
        self._unknown_since: float | None = None

    def look(self, met: list[tuple[int, int]]) -> Change:
        """Return what has changed, before anything is taken.

        Args:
            met: As the attribute, now; where it is the same, nothing has changed.
        """
        names = self._names([now for _, now in met])
        if names is None:
            return Change.UNKNOWN
        rises = any(ever > most for (ever, _), (most, _) in zip(met, self._most, strict=True))
        self.met = met
        self._most = [max(pair) for pair in zip(met, self._most, strict=True)]
        players = sorted(name for name in names if name.rsplit("/", 1)[-1] in PLAYERS)
        ended, self._ended = self._ended, not players
        if players:
            if self.players and not rises:
                return Change.NONE
            self.players = tuple(players)
            return Change.RECORDING
        if self.players and names:
            self.players = ()
            return Change.ROBOT if ended else Change.MIXED
        return Change.NONE

    def _names(self, numbers: list[int]) -> set[str] | None:
        """Publishers by name; None while the graph does not name all that are matched."""
        names = set[str]()
        known = True
        for inbox, number in zip(self.inboxes, numbers, strict=True):
            found = inbox.topic_publishers
            found.look(now=True)
            known &= found.names.total() == number and NOT_YET_KNOWN not in found.names
            names |= found.names.keys() if number else set()
        now = time.monotonic()
        if known:
            self._unknown_since = None
            return names
        if self._unknown_since is None:
            self._unknown_since = now
        if now - self._unknown_since < PATIENCE:
            return None
        self._unknown_since = None
        return names
