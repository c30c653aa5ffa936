# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What the monitors share that count power: account, loads, learned figures, recordings."""

from __future__ import annotations

from functools import partial
from typing import Any, TypeVar

from robot_energy.accounting.account import EnergyAccount
from robot_energy.condition.learner import ConditionLearner
from robot_energy.messages.power import PowerStateWriter
from robot_energy.messages.registers import RegistersWriter
from ros2_energy_monitor.base.auxiliary_loads import AuxiliaryLoads
from ros2_energy_monitor.base.checkpoints import Checkpoints
from ros2_energy_monitor.base.condition_publisher import ConditionPublisher
from ros2_energy_monitor.base.inputs import meter_input
from ros2_energy_monitor.base.monitor_node import MonitorNode
from ros2_energy_monitor.base.node_parameters import AccountParameters
from ros2_energy_monitor.base.parameters import folder_of
from ros2_energy_monitor.base.publishers import (
    REGISTERS_TOPIC,
    power_publisher,
    registers_publisher,
)
from ros2_energy_monitor.services.registers import RegisterServices

A = TypeVar("A", bound=AccountParameters)


class AccountNode(MonitorNode[A]):
    """Base of the monitors that keep an account; `set_up` calls `keep_account`."""

    UNIQUE_TOPIC = REGISTERS_TOPIC
    account: EnergyAccount

    def keep_account(self, account: EnergyAccount, condition: ConditionLearner) -> None:
        """Make what counts, learns, publishes and keeps; subscribe the meter."""
        self.account, given, model = account, self.parameters, self.model
        self._loads = AuxiliaryLoads(self, given, account)
        identity = (model.joint_names, model.model_id, model.auxiliary or (), model.unmodelled)
        self._power_writer = PowerStateWriter(*identity)
        self._registers_writer = RegistersWriter(*identity)
        ticks = round(given.tick_rate / given.power_rate)
        burst = -(-self.taken_ticks // ticks)  # messages that end together
        self._power = self.paced = power_publisher(self, ticks, burst + 1)
        registers = registers_publisher(self)
        folder = folder_of(given.state_folder)
        self.checkpoints = Checkpoints(
            self, model, account, folder, given.checkpoint_period, self._encode, registers.publish
        )
        account.on_reading = self._add_reading
        self.exit_stack.callback(self.checkpoints.close)  # safe also where it is not open
        self.checkpoints.open()
        RegisterServices(self, account, self.checkpoints, model, self.take_now).open()
        self._condition = ConditionPublisher(self, model, condition, given.state_folder)
        self.exit_stack.callback(self._condition.close)
        self._condition.open()
        self._meter, self.readings = meter_input(self, given, given.resubscribe_after)

    def _encode(self, persisted: bool, minute_ns: int = 0) -> Any:
        """Return the message of the registers; what counts a recording is kept nowhere."""
        recording = self.checkpoints.store.is_aside
        kept = persisted and not recording
        return self._registers_writer.encode(self.account, kept, minute_ns, recording)

    def _add_reading(self, minute_ns: int) -> None:
        if self.checkpoints.running:
            self.checkpoints.add_reading(partial(self._encode, minute_ns=minute_ns))

    def activate(self) -> None:
        """Keep and publish the registers from now on."""
        super().activate()
        self.checkpoints.running = True

    def keep_last(self) -> None:
        """Publish what waits, keep the registers once more, and then no longer."""
        self._power.flush()
        self.checkpoints.now()
        self.checkpoints.running = False

    def parameters_changed(self) -> None:
        """Use the parameters that can change while active."""
        super().parameters_changed()
        self.checkpoints.change_period(self.parameters.checkpoint_period)

    def report(self) -> None:
        """Publish and keep what was learned."""
        self.guard.run("condition", self._condition.report)

    def begin_recording(self, players: str) -> None:
        """Count and learn apart from the robot's figures from now on."""
        self.checkpoints.begin_recording(players)
        self._condition.begin_recording()

    def end_recording(self) -> None:
        """Go on with the robot's figures."""
        self.checkpoints.end_recording()
        self._condition.end_recording()
