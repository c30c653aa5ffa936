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

from ros2_energy_msgs.msg import EnergyRegisters, PowerState

from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.averaging import MeanBlock
from robot_energy.messages.power import PowerStateWriter
from robot_energy.messages.registers import RegistersWriter
from robot_energy.model import RobotModel
from robot_energy.pipeline import PowerStage
from ros2_energy_monitor.base.auxiliary_loads import AuxiliaryLoads
from ros2_energy_monitor.base.checkpoints import Checkpoints
from ros2_energy_monitor.base.condition_publisher import ConditionPublisher
from ros2_energy_monitor.base.inputs import meter_input
from ros2_energy_monitor.base.monitor_node import MonitorNode
from ros2_energy_monitor.base.node_parameters import AccountParameters
from ros2_energy_monitor.base.parameters import folder_of
from ros2_energy_monitor.base.publishers import (
    POWER_TOPIC,
    REGISTERS_TOPIC,
    PacedPublisher,
    RowPublisher,
    reliable,
)
from ros2_energy_monitor.services.registers import RegisterServices


class AccountPublisher:
    """Publishes ``energy/power`` and ``energy/registers``; `open` creates, `close` ends."""

    def __init__(
        self,
        node: MonitorNode[Any],
        model: RobotModel,
        account: EnergyAccount,
        parameters: AccountParameters,
    ) -> None:
        self._node, self._account, self._model = node, account, model
        account.on_reading = self._add_reading
        identity = (model.joint_names, model.model_id, model.auxiliary or (), model.unmodelled)
        self._power_writer = PowerStateWriter(*identity)
        self._registers_writer = RegistersWriter(*identity)
        self._power: PacedPublisher | None = None
        self._ticks = round(parameters.tick_rate / parameters.power_rate)
        self._registers: RowPublisher | None = None
        self.checkpoints = Checkpoints(
            node,
            model,
            account,
            folder_of(parameters.state_folder),
            parameters.checkpoint_period,
            self._encode,
            lambda rows: self._registers and self._registers.publish(rows),
        )

    def open(self) -> None:
        """Create publishers and services, and read the registers from disk."""
        power = RowPublisher(self._node, PowerState, POWER_TOPIC, reliable(100))
        burst = -(-self._node.taken_ticks // self._ticks)  # messages that end together
        self._power = PacedPublisher(power, self._ticks, max_waiting=burst + 1)
        self._registers = RowPublisher(self._node, EnergyRegisters, REGISTERS_TOPIC, reliable(10))
        self.checkpoints.open()
        take = self._node.take_now
        RegisterServices(self._node, self._account, self.checkpoints, self._model, take).open()

    def close(self) -> None:
        """End the work on the disk; safe also after an `open` that failed."""
        self.checkpoints.close()
        self._account.on_reading = None
        self._power = self._registers = None

    def _encode(self, persisted: bool, minute_ns: int = 0) -> Any:
        """Return the message of the registers; what counts a recording is kept nowhere."""
        recording = self.checkpoints.store.is_aside
        kept = persisted and not recording
        return self._registers_writer.encode(self._account, kept, minute_ns, recording)

    def _add_reading(self, minute_ns: int) -> None:
        encode = partial(self._encode, minute_ns=minute_ns)
        if self.checkpoints.running:
            self.checkpoints.add_reading(encode)

    def activate(self) -> None:
        """Keep and publish the registers from now on."""
        self.checkpoints.running = True

    def deactivate(self) -> None:
        """Publish what waits, keep the registers once more, and then no longer."""
        if self._power is not None:
            self._power.flush()
        self.checkpoints.now()
        self.checkpoints.running = False

    def power(self, means: MeanBlock | None) -> None:
        """Take the periods that ended; `tick` publishes them.

        Args:
            means: One row per period; None if none ended.
        """
        if means is not None and self._power is not None:
            self._power.add(self._power_writer.encode(means, self._account.comparison.location))

    def tick(self) -> None:
        """Publish the next power state if it is its turn; call every tick."""
        if self._power is not None:
            self._power.tick()


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
        """Publish the next power state."""
        self.guard.run("publish.power", self._account_publisher.tick)

    def report(self) -> None:
        """Publish and keep what was learned."""
        self.guard.run("condition", self._condition.report)

    def begin_recording(self, players: str) -> None:
        """Count and learn apart from the robot's figures from now on."""
        self._account_publisher.checkpoints.begin_recording(players)
        self._condition.begin_recording()

    def end_recording(self) -> None:
        """Go on with the robot's figures."""
        self._account_publisher.checkpoints.end_recording()
        self._condition.end_recording()
