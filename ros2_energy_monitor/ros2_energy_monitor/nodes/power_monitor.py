# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Node: torque, friction and meter in, power and energy out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from itertools import pairwise

import numpy as np
from ros2_energy_msgs.msg import JointFriction, JointTorque

from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.averaging import MeanBlock
from robot_energy.accounting.meter_response import MeterResponse
from robot_energy.bag.cdr.decode import RawBatch
from robot_energy.condition.learner import ConditionLearner
from robot_energy.messages.friction import FrictionReader
from robot_energy.messages.torque import TorqueReader
from robot_energy.physics.drivetrain import motor_rest
from robot_energy.pipeline import PowerStage
from robot_energy.timeline.blocks import (
    NANOSECOND,
    FrictionBlock,
    MeterBlock,
    PowerBlock,
    TorqueBlock,
)
from ros2_energy_monitor.base.account_node import AccountNode
from ros2_energy_monitor.base.inbox import Inbox
from ros2_energy_monitor.base.node_parameters import PowerParameters
from ros2_energy_monitor.base.played_recording import Change, PlayedRecording
from ros2_energy_monitor.base.publishers import (
    FRICTION_DEPTH,
    FRICTION_TOPIC,
    TORQUE_TOPIC,
    latched,
    reliable,
)
from ros2_energy_monitor.base.run_node import run
from ros2_energy_monitor.base.settings import settings_of
from ros2_energy_monitor.diagnostics.auxiliary import auxiliary_sources
from ros2_energy_monitor.diagnostics.energy import (
    energy_source,
    fallback_temperatures,
    stray_stamps,
    stuck_temperatures,
)
from ros2_energy_monitor.diagnostics.inputs import InputWatch
from ros2_energy_monitor.diagnostics.reporter import StatusBuilder


class PowerMonitor(AccountNode[PowerParameters]):
    """Publishes ``energy/power`` and ``energy/registers``."""

    NAME = "power_monitor"
    PARAMETERS = PowerParameters

    def set_up(self) -> None:
        """Make the stage, the publishers and the inboxes."""
        settings = settings_of(self.parameters)
        self._torque = TorqueReader(self.model.joint_names, self.model.model_id, settings.max_gap)
        self._friction = FrictionReader(self.model)
        self._learner = ConditionLearner(self.model, settings)
        self._stage = PowerStage(self.model, settings, self._learner)
        response, rest = MeterResponse.of(self.model), motor_rest(self.model)
        account = EnergyAccount(len(self.model.joints), settings, response, rest)
        self.keep_account(account, self._learner)
        depth = self.parameters.joint_torque_depth
        renew = self.parameters.resubscribe_after
        self.torques = Inbox(self, JointTorque, TORQUE_TOPIC, reliable(depth), renew_after=renew)
        self._played = PlayedRecording([self.torques])
        self._recording = False
        self.frictions = Inbox(self, JointFriction, FRICTION_TOPIC, latched(FRICTION_DEPTH))
        self.inputs = [
            (self.torques, self._torque.rejections),
            (self.frictions, self._friction.rejections),
            *((inbox, self._meter.rejections) for inbox in self.readings),
            *self._loads.inputs,
        ]
        self.orders = [self._torque.order]
        torque = InputWatch(
            "joint torque",
            self.torques,
            self._torque.rejections,
            lambda: self.parameters.input_timeout,
            remedy="start torque_monitor",
        )
        # Friction comes with temperatures only, and latched: silence is not a fault, absence is.
        friction = InputWatch(
            "joint friction",
            self.frictions,
            self._friction.rejections,
            lambda: math.inf,
            remedy="start friction_monitor",
        )
        self.sources = [
            energy_source(
                self.account,
                self.readings,
                self._meter,
                self.parameters.meter_max_gap,
                torque.check,
                partial(friction.check, prefix="friction_"),
                stuck_temperatures(self._stage.watch, self.model),
                fallback_temperatures(self._stage.fallback_use, self._friction_ahead_ns),
                self._clocks,
            ),
            *auxiliary_sources(self.account, self._loads),
            self.checkpoints.findings,
            self._condition.findings,
        ]

    def take(self) -> None:
        """Drain all inputs and publish the periods that ended.

        Torque comes first, though it is used last: what it belongs to is then not newer.
        """
        met = [self.torques.met()]
        if met != self._played.met and self._played.look(met) is Change.UNKNOWN:
            return
        torques = self.drain([self.torques])
        frictions, readings = self.drain([self.frictions]), self.drain(self.readings)
        if self._loads.loads:
            self._loads.take()
        if frictions:
            self.guard.feed(
                "joint_friction",
                [(self._friction.rejections, sum(map(len, frictions)))],
                lambda: [self._use_friction(self._friction.decode(batch)) for batch in frictions],
                self._friction.restart,
            )
        if readings:
            self.guard.feed(
                "meter",
                [(self._meter.rejections, sum(map(len, readings)))],
                lambda: self._use_meter(self._meter.step(readings)),
                self._meter.restart,
            )
        if not torques:
            return
        means = self.guard.feed(
            "joint_torque",
            [(self._torque.rejections, sum(map(len, torques)))],
            lambda: [
                mean for batch in torques for part in _alike(batch) for mean in self._decoded(part)
            ],
            self._restart,
        )
        for mean in means or ():
            self._publish(mean)

    def deactivate(self) -> None:
        """Count and publish what still waits."""
        self.take()
        self.guard.run("joint_friction", lambda: self._use_friction(self._friction.flush()))
        self.guard.run("meter", lambda: self._use_meter(self._meter.flush()))
        self._loads.flush()
        for mean in self.guard.run("joint_torque", self._flushed) or ():
            self._publish(mean)
        self.guard.run("registers", self.keep_last)

    def _decoded(self, batch: RawBatch) -> list[MeanBlock | None]:
        """Count a batch of torques, apart from the robot's where a recording is played."""
        means: list[MeanBlock | None] = []
        block = self._torque.decode(batch)
        recording = self._torque.recording or bool(self._played.players)
        if recording != self._recording:
            means += self._flushed()
            self._recording = recording
            if recording:
                self.begin_recording(", ".join(self._played.players) or "a player")
            else:
                self.end_recording()
        return [*means, self._use_torque(block)]

    def _flushed(self) -> list[MeanBlock | None]:
        """Count what waits in the stages, as at the end; return the periods that ended."""
        return [
            self._use_torque(self._torque.flush()),
            self._count(self._stage.flush()),
            self.account.flush(),
        ]

    def _clocks(self, found: StatusBuilder) -> None:
        """Check the stamps of torque and friction."""
        stray_stamps(self._torque.epochs, f"messages on {self.torques.topic}", found)
        stray_stamps(self._friction.epochs, f"messages on {self.frictions.topic}", found)

    def _friction_ahead_ns(self) -> int | None:
        """How far the stamps of friction are ahead of those of torque, as they arrived. [ns]"""
        apart_ns, age = self._stage.fallback_use.apart_ns, self.frictions.age
        if apart_ns is None or math.isnan(age):
            return None
        return apart_ns + round(age / NANOSECOND)

    def _use_friction(self, friction: FrictionBlock | None) -> None:
        if friction is not None:
            self._stage.timeline.add(friction)

    def _use_meter(self, meter: MeterBlock | None) -> None:
        if meter is not None:
            self.account.measure(meter)
            self._learner.measure(meter)

    def _use_torque(self, torque: TorqueBlock | None) -> MeanBlock | None:
        return None if torque is None else self._count(self._stage.step(torque))

    def _count(self, power: PowerBlock | None) -> MeanBlock | None:
        return None if power is None else self.account.step(power)

    def _restart(self) -> None:
        self._torque.restart()
        self._stage.restart()

    def _publish(self, means: MeanBlock | None) -> None:
        if means is not None:
            add, message = self._power.add, self._power_writer.encode
            location = self.account.comparison.location
            self.guard.run("publish.power", lambda: add(message(means, location)))


def _alike(batch: RawBatch) -> Iterator[RawBatch]:
    """Cut where messages get longer or shorter, as they do where a recording begins and ends."""
    cuts = (np.flatnonzero(np.diff(batch.length)) + 1).tolist()
    for start, stop in pairwise([0, *cuts, len(batch)]):
        yield batch[slice(start, stop)]


main = partial(run, PowerMonitor)
