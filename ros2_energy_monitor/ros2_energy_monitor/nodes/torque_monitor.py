# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Node: joint states in, rigid-body torque of every joint out."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.messages.torque import TorqueWriter
from robot_energy.pipeline import TorqueStage
from robot_energy.timeline.blocks import EffortMeaning, JointBlock, TorqueBlock
from ros2_energy_monitor.base.inbox import Inbox
from ros2_energy_monitor.base.inputs import joint_state_inboxes
from ros2_energy_monitor.base.monitor_node import MonitorNode
from ros2_energy_monitor.base.node_parameters import TorqueParameters
from ros2_energy_monitor.base.played_recording import Change, PlayedRecording
from ros2_energy_monitor.base.publishers import TORQUE_TOPIC, torque_publisher
from ros2_energy_monitor.base.run_node import run
from ros2_energy_monitor.base.settings import settings_of
from ros2_energy_monitor.diagnostics.energy import joint_state_source
from ros2_energy_monitor.services.registers import PayloadService


class TorqueMonitor(MonitorNode[TorqueParameters]):
    """Publishes ``energy/joint_torque`` for every accepted message of ``joint_states``."""

    NAME = "torque_monitor"
    PARAMETERS = TorqueParameters
    UNIQUE_TOPIC = TORQUE_TOPIC
    # One message for each joint state: bursts of 80 ms lost some on the way to a subscriber where
    # recordings are played fast; its receive buffer is small by default.
    TAKEN_EVERY = 0.0

    def set_up(self) -> None:
        """Make the stage, the publishers and the inboxes."""
        depth = self.parameters.joint_state_depth
        settings, source = settings_of(self.parameters), self.parameters.joint_states
        self.stage = TorqueStage(self.model, settings)
        self._recording = False  # whether joint states come from a recording that is played
        self.ingest = JointStateIngest(
            self.model.joint_names,
            limits=self.stage.robot.limits,
            effort=settings.effort is not EffortMeaning.NONE,
            source=source,
            max_gap=settings.max_gap,
        )
        self._writer = TorqueWriter(self.model.joint_names, self.model.model_id)
        self._publisher = torque_publisher(self, depth)
        PayloadService(self, self.stage, self.model.model_id).open()
        self.log_inventory(self.stage.robot)
        inboxes = joint_state_inboxes(self, self.parameters)
        self.joint_states, *self._further = inboxes
        self._played = PlayedRecording(inboxes)
        self.inputs = [(inbox, self.ingest.rejections) for inbox in inboxes]
        self.orders = [self.ingest.order]
        self.sources = [
            joint_state_source(
                inboxes, self.ingest, lambda: self.parameters.input_timeout, self.stage
            )
        ]

    def take(self) -> None:
        """Drain the joint states and publish the torques that became complete."""
        met = [*map(Inbox.met, self._played.inboxes)]
        change = Change.NONE if met == self._played.met else self._played.look(met)
        if change is Change.UNKNOWN:
            return
        if change in (Change.RECORDING, Change.ROBOT):
            self._flush()
            self._recording = change is Change.RECORDING
        if states := self.drain([self.joint_states, *self._further]):
            self._joints(sum(map(len, states)), partial(self.ingest.step, states))
        if change is Change.MIXED:
            self._flush()
            self._recording = False

    def deactivate(self) -> None:
        """Publish the last torques, whose window will not fill any more."""
        self.take()
        self._flush()
        self.guard.run("publish.joint_torque", self._publisher.finish)

    def _flush(self) -> None:
        self._joints(0, self.ingest.flush)
        self._publish(self.guard.run("joint_states", self.stage.flush, self._restart))

    def _joints(self, arrived: int, take: Callable[[], JointBlock | None]) -> None:
        """Let joint states go their way from messages to torques."""

        def torque() -> TorqueBlock | None:
            joints = take()
            return None if joints is None else self.stage.step(joints)

        accounts = [(self.ingest.rejections, arrived)]
        self._publish(self.guard.feed("joint_states", accounts, torque, self._restart))

    def _restart(self) -> None:
        self.ingest.restart()
        self.stage.restart()

    def _publish(self, torque: TorqueBlock | None) -> None:
        if torque is not None:
            publish, encode = self._publisher.publish, self._writer.encode
            self.guard.run("publish.joint_torque", lambda: publish(encode(torque, self._recording)))


main = partial(run, TorqueMonitor)
