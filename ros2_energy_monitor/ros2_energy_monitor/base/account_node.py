# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What the monitors share that count power: account, loads, learned figures, recordings."""

from __future__ import annotations

from typing import TypeVar

from robot_energy.accounting.account import EnergyAccount
from robot_energy.pipeline import PowerStage
from ros2_energy_monitor.base.account_publisher import AccountPublisher
from ros2_energy_monitor.base.auxiliary_loads import AuxiliaryLoads
from ros2_energy_monitor.base.condition_publisher import ConditionPublisher
from ros2_energy_monitor.base.inputs import meter_input
from ros2_energy_monitor.base.monitor_node import MonitorNode
from ros2_energy_monitor.base.node_parameters import AccountParameters
from ros2_energy_monitor.base.publishers import REGISTERS_TOPIC

A = TypeVar("A", bound=AccountParameters)


class AccountNode(MonitorNode[A]):
    """Base of the monitors that keep an account; `set_up` calls `keep_account`."""

    UNIQUE_TOPIC = REGISTERS_TOPIC
    account: EnergyAccount

    def keep_account(self, account: EnergyAccount, stage: PowerStage) -> None:
        """Make what counts, learns, publishes and keeps; subscribe the meter."""
        self.account, given = account, self.parameters
        self._loads = AuxiliaryLoads(self, given, account)
        self._account_publisher = AccountPublisher(self, self.model, account, given)
        self.exit_stack.callback(self._account_publisher.close)
        self._account_publisher.open()
        self._condition = ConditionPublisher(
            self, self.model, stage.condition, stage.thermal, given.state_folder
        )
        self.exit_stack.callback(self._condition.close)
        self._condition.open()
        self._meter, self.readings = meter_input(self, given, given.resubscribe_after)

    def activate(self) -> None:
        """Keep and publish the registers from now on."""
        super().activate()
        self._account_publisher.activate()

    def parameters_changed(self) -> None:
        """Use the parameters that can change while active."""
        super().parameters_changed()
        self._account_publisher.checkpoints.change_period(self.parameters.checkpoint_period)

    def tick(self) -> None:
        """Publish the next power state, and keep learned figures."""
        self.guard.run("publish.power", self._account_publisher.tick)
        self.guard.run("condition", self._condition.tick)

    def begin_recording(self, players: str) -> None:
        """Count and learn apart from the robot's figures from now on."""
        self._account_publisher.checkpoints.begin_recording(players)
        self._condition.begin_recording()

    def end_recording(self) -> None:
        """Go on with the robot's figures."""
        self._account_publisher.checkpoints.end_recording()
        self._condition.end_recording()
