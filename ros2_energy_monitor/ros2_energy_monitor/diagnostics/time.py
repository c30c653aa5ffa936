# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Checks, from report to report, that all the time that passed was observed or is a gap."""

from __future__ import annotations

from robot_energy.timeline.coverage import Coverage


class TimeWatch:
    """Compares the time between two newest stamps with what was booked between them.

    The end of the account moves with the stamps, observed time and gaps are added up by
    other lines of code: they can only agree if both are right. Where stamps jumped back,
    or the account began again, there is nothing to compare.
    """

    def __init__(self) -> None:
        self._before: tuple[object, int | None, int] | None = None

    def check(self, time: Coverage) -> str:
        """Return what does not add up since the last call; there must never be anything."""
        begun, end = (time.start_ns, time.jumps), time.end_ns
        counted = time.observed_ns + time.gap_ns
        before, self._before = self._before, (begun, end, counted)
        if before is None or before[0] != begun or before[1] is None or end is None:
            return ""
        passed, booked = end - before[1], counted - before[2]
        if passed == booked:
            return ""
        return (
            f"accounting of time does not add up: {passed} ns passed, {booked} ns were booked as "
            f"observed or gap"
        )
