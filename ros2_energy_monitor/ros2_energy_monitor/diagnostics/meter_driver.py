# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What the meter driver says about its meter."""

from __future__ import annotations

import time
from typing import Any

from ros2_energy_monitor.diagnostics.reporter import ERROR, WARN, StatusBuilder
from ros2_energy_monitor.meters.poller import Poller
from ros2_energy_monitor.meters.profile import MeterProfile

MAX_SILENCE = 3.0  # periods without an accepted reading


class MeterDriverSource:
    """Makes the status of the meter.

    Args:
        period: Usual time from one reading to the next. [s]
    """

    def __init__(self, poller: Poller, profile: MeterProfile[Any], period: float) -> None:
        self._poller, self._profile = poller, profile
        self._patience = max(MAX_SILENCE * period, 2.0)
        self._accepted, self._since = 0, time.monotonic()
        self._refused = 0

    def __call__(self) -> StatusBuilder:
        """Return the status of now."""
        state, readings = self._poller.state, self._poller.readings
        found = StatusBuilder("meter")
        now = time.monotonic()
        if readings.accepted != self._accepted:
            self._accepted, self._since = readings.accepted, now
        silent = now - self._since
        refused = readings.rejected.total()
        found.values |= {
            "connected": int(state.connected),
            "connections": state.connections,
            "accepted": readings.accepted,
            "round_trip": readings.round_trip,
            "wraps": readings.wraps,
            "silent": silent,
            "dropped": state.dropped,
            "window": self._profile.window,
            "lag": self._profile.lag,
            **{f"rejected.{reason}": n for reason, n in sorted(readings.rejected.items())},
            **{f"errors.{name}": n for name, n in sorted(state.errors.items())},
        }
        if not state.connected and (state.failures or state.refusals):
            found.add(ERROR, f"no connection, the next attempt follows: {state.last_error}")
        elif state.refusals:
            found.add(ERROR, state.last_error)
        elif silent > self._patience:
            found.add(
                WARN, f"no reading for {silent:.0f} s: the meter is silent, or all are refused"
            )
        if refused != self._refused:
            found.add(WARN, f"{refused - self._refused} readings refused since the last report")
        self._refused = refused
        return found
