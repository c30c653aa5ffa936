# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Node: reads a power meter on the network and publishes what the monitors compare with.

`power_meter` is the imported energy as the meter counts it (`MEANING_CUMULATIVE`); only where it
counts none, its power. `power_meter/power` is the power. Stamps are the middle between request
and answer, less the lag that the profile states.
"""

from __future__ import annotations

import math
import time
from functools import partial
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from ros2_energy_msgs.msg import PowerReading

from robot_energy.foundation.errors import ParameterError
from robot_energy.foundation.units import SECOND_NS
from robot_energy.inputs.meter.source import LOAD_NEGATIVE
from robot_energy.timeline.blocks import NANOSECOND, MeterLocation, MeterMeaning
from robot_energy.timeline.stamps import bounded
from ros2_energy_monitor.base.credentials import LOOPBACK, read_credentials
from ros2_energy_monitor.base.guard import Guard
from ros2_energy_monitor.base.parameters import declare
from ros2_energy_monitor.base.publishers import reliable
from ros2_energy_monitor.base.run_node import run
from ros2_energy_monitor.diagnostics.reporter import (
    ERROR,
    REPORT_PERIOD,
    WARN,
    Reporter,
    StatusBuilder,
)
from ros2_energy_monitor.meters.kinds import MeterDriverParameters, MeterLinkKind, load_profile
from ros2_energy_monitor.meters.link import Endpoint
from ros2_energy_monitor.meters.poller import Poller
from ros2_energy_monitor.meters.profile import MeterProfile
from ros2_energy_monitor.meters.reading import NetworkReading, Quantity, ReadingFilter

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


TICK_PERIOD = 0.05  # [s]


class MeterDriver(Node):
    """Publishes ``power_meter`` and ``power_meter/power``."""

    NAME = "meter_driver"

    def __init__(self, **options: Any) -> None:
        super().__init__(self.NAME, **options)
        self.guard = Guard(self.NAME, options.get("context"))
        try:
            self.parameters = declare(self, MeterDriverParameters)
            kind, self.profile = load_profile(self.parameters.profile)
            self.poller = self._poller(kind, self.profile)
        except Exception:
            self.destroy_node()
            raise
        self._outputs = {
            quantity: self.create_publisher(PowerReading, topic, reliable(100))
            for quantity, topic in topics(self.profile).items()
        }
        self._reporter = Reporter(self)
        self._source = MeterDriverSource(self.poller, self.profile, self._period)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        tick = self.guard.callback("timer.tick", self.tick)
        self.create_timer(TICK_PERIOD, tick, clock=steady)
        self.create_timer(
            REPORT_PERIOD, self.guard.callback("timer.report", self.report), clock=steady
        )
        self.get_logger().info(
            f"reading {self.profile.label} at {self.parameters.host}, {kind.label}"
        )
        self.poller.start()

    @property
    def _period(self) -> float:
        return self.parameters.period or self.profile.period

    def _poller(self, kind: MeterLinkKind, profile: MeterProfile[Any]) -> Poller:
        given = self.parameters
        if given.max_round_trip > given.timeout:
            raise ParameterError(
                f"max_round_trip is {given.max_round_trip:g} s and timeout {given.timeout:g} s",
                "a max_round_trip up to timeout",
            )
        credentials = read_credentials(given.credentials_file)
        hidden = given.tls or profile.hides_password or given.host in LOOPBACK
        if credentials is not None and not (hidden or given.allow_plain_password):
            raise ParameterError(
                f"the password for {given.host} would be sent over the network unencrypted",
                "tls, or allow_plain_password: true",
            )
        endpoint = Endpoint(
            host=given.host,
            port=given.port or profile.port,
            timeout=given.timeout,
            unit=None if given.unit < 0 else given.unit,
            device=given.device,
            credentials=credentials,
            tls=given.tls,
            ca_file=given.ca_file,
        )
        readings = ReadingFilter(given.max_power, given.max_round_trip)
        link = kind.make(profile, endpoint)
        return Poller(link, readings, self._period, given.max_backoff, self.guard.run)

    def tick(self) -> None:
        """Publish what the meter has answered since the last tick."""
        readings = self.poller.take()
        now_ns, now = self.get_clock().now().nanoseconds, time.monotonic()
        for reading in readings:
            age = now - reading.at + self.profile.lag
            self._outputs[reading.quantity].publish(
                self._message(reading, bounded(now_ns - round(age / NANOSECOND)))
            )

    def report(self) -> None:
        node = StatusBuilder("node")
        self.guard.check(node)
        self._reporter.publish([node, self._source()], self.profile.label)

    def destroy_node(self) -> None:
        if hasattr(self, "poller"):
            self.poller.stop()
        super().destroy_node()

    def _message(self, reading: NetworkReading, stamp_ns: int) -> PowerReading:
        message = PowerReading(power=math.nan, energy=math.nan, interval=math.nan)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, SECOND_NS)
        message.location = int(MeterLocation[self.parameters.location.upper()])
        value = reading.value * self.parameters.scale
        if reading.quantity is Quantity.ENERGY:
            message.meaning = int(MeterMeaning.CUMULATIVE)
            message.energy = value
            return message
        message.power = -value if self.parameters.sign == LOAD_NEGATIVE else value
        if self.profile.window > 0:
            message.meaning = int(MeterMeaning.MEAN_OVER_INTERVAL)
            message.interval = self.profile.window
        else:
            message.meaning = int(MeterMeaning.INSTANTANEOUS)
        return message


def topics(profile: MeterProfile[Any]) -> dict[Quantity, str]:
    """Return the topic of each quantity: energy is what monitors read by default."""
    if profile.counts_energy:
        return {Quantity.ENERGY: "power_meter", Quantity.POWER: "power_meter/power"}
    return {Quantity.POWER: "power_meter"}


main = partial(run, MeterDriver)
