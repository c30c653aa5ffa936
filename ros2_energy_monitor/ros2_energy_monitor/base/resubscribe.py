# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""When to subscribe again although nothing looks wrong: publishers are there, data are not.

After a network failure the middleware may never hand on data again. A topic may also
be silent by nature. So the time to wait doubles with every trial, and a silence that ends
without one teaches how long to wait at least.
"""

from __future__ import annotations

MAX_WAIT = 120.0  # [s]
AT_ONCE = 2.0  # data so soon after a trial are its success [s]


class ResubscribePolicy:
    """Decides for one subscription.

    Args:
        after: Shortest silence after which to try. [s]
    """

    def __init__(self, after: float) -> None:
        self._after = after
        self._wait = after
        self._tried: float | None = None
        self._since: float | None = None  # start of the silence

    def heard(self, now: float) -> None:
        """Note data.

        Args:
            now: Time on any steady clock. [s]
        """
        if self._since is not None and self._tried is not None and now - self._tried > AT_ONCE:
            self._after = min(2.0 * (now - self._since), MAX_WAIT)
        self._wait, self._tried, self._since = self._after, None, now

    def due(self, now: float, publishers: int) -> bool:
        """Whether to subscribe again now.

        Args:
            now: Time on the same clock. [s]
            publishers: How many there are; without one there is nothing to wait for.
        """
        if not publishers or self._since is None:
            self._since = now
            self._wait, self._tried = self._after, None
            return False
        if now - (self._since if self._tried is None else self._tried) < self._wait:
            return False
        self._tried = now
        self._wait = min(2.0 * self._wait, MAX_WAIT)
        return True
