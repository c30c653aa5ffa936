# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Node: the three monitors in one process, wired directly."""

from __future__ import annotations

from functools import partial

from robot_energy.inputs.joint_states.joint_states import JointStateIngest
from robot_energy.messages.friction import FrictionWriter
from robot_energy.messages.torque import TorqueWriter
from robot_energy.pipeline import EnergyPipeline, Output
from robot_energy.timeline.blocks import EffortMeaning
from ros2_energy_monitor.base.account_node import AccountNode
from ros2_energy_monitor.base.inbox import Inbox
from ros2_energy_monitor.base.inputs import (
    joint_state_inboxes,
    temperature_inboxes,
    temperature_ingest,
    temperature_inputs,
)
from ros2_energy_monitor.base.node_parameters import EnergyParameters
from ros2_energy_monitor.base.played_recording import Change, PlayedRecording
from ros2_energy_monitor.base.publishers import friction_publisher, torque_publisher
from ros2_energy_monitor.base.run_node import run
from ros2_energy_monitor.base.settings import settings_of
from ros2_energy_monitor.diagnostics.auxiliary import auxiliary_sources
from ros2_energy_monitor.diagnostics.energy import (
    energy_source,
    fallback_temperatures,
    joint_state_source,
    stuck_temperatures,
    temperature_source,
)
from ros2_energy_monitor.diagnostics.model_check import ModelCheck
from ros2_energy_monitor.services.registers import PayloadService
from ros2_energy_monitor.services.trajectory_services import ComparisonService, PredictionService


class EnergyMonitor(AccountNode[EnergyParameters]):
    """Publishes what the three monitors publish; ``energy/joint_torque`` only if asked."""

    NAME = "energy_monitor"
    PARAMETERS = EnergyParameters

    def set_up(self) -> None:
        """Make the stage, the publishers and the inboxes."""
        names, depth = self.model.joint_names, self.parameters.joint_state_depth
        settings, source = settings_of(self.parameters), self.parameters.joint_states
        self._temperature = temperature_ingest(self, self.parameters, self.model)
        self._pipeline = EnergyPipeline(self.model, settings)
        self.ingest = JointStateIngest(
            names,
            limits=self._pipeline.torque.robot.limits,
            effort=settings.effort is not EffortMeaning.NONE,
            source=source,
            max_gap=settings.max_gap,
        )
        self._torque_writer = TorqueWriter(names, self.model.model_id)
        self._friction_writer = FrictionWriter(self.model)
        self._torque = torque_publisher(self, depth) if self.parameters.publish_torque else None
        self._friction = friction_publisher(self)
        self.keep_account(self._pipeline.account, self._pipeline.condition)
        states = joint_state_inboxes(self, self.parameters)
        self.joint_states, *self._further = states
        self._played = PlayedRecording(states)
        self.temperatures = temperature_inboxes(
            self, self._temperature, self.parameters.resubscribe_after
        )
        PayloadService(self, self._pipeline.torque, self.model.model_id).open()
        for kind in (PredictionService, ComparisonService):
            prediction = kind(
                self,
                self.guard,
                self.model,
                lambda: self._pipeline.torque.next_payload,
                lambda: self._pipeline.friction.latest().motor_temperature_degc[0],
                lambda: self.account.calibration.state(),
            )
            self.exit_stack.callback(prediction.close)
            prediction.open()
        self._model_check = ModelCheck(
            self.parameters.model_check,
            self.model,
            settings.effort,
            self.parameters,
            self._pipeline,
            self._temperature,
            self.guard,
        )
        self.exit_stack.callback(self._model_check.close)
        self.log_inventory(self._pipeline.torque.robot)
        self.inputs = [
            *((inbox, self.ingest.rejections) for inbox in states),
            *temperature_inputs(self._temperature, self.temperatures),
            *((inbox, self._meter.rejections) for inbox in self.readings),
            *self._loads.inputs,
        ]
        self.orders = [self.ingest.order]
        self.sources = [
            joint_state_source(
                states,
                self.ingest,
                lambda: self.parameters.input_timeout,
                self._pipeline.torque,
            ),
            temperature_source(
                self.temperatures,
                self._temperature,
                self._pipeline.friction,
                self.model,
                self.ingest,
                wanted=bool(self.parameters.temperature_sources),
            ),
            energy_source(
                self.account,
                self.readings,
                self._meter,
                self.parameters.meter_max_gap,
                stuck_temperatures(self._pipeline.power.watch, self.model),
                fallback_temperatures(
                    self._pipeline.power.fallback_use,
                    lambda: self._temperature.ahead_ns(self.ingest),
                ),
            ),
            *auxiliary_sources(self.account, self._loads),
            self.checkpoints.findings,
            self._condition.findings,
            self._model_check.findings,
        ]

    def activate(self) -> None:
        """Publish the friction as it stands, also before the first temperature."""
        super().activate()
        self._friction.publish(self._friction_writer.encode(self._pipeline.friction.latest()))

    def take(self) -> None:
        """Take what has arrived, unless it is still unknown whether a recording is played."""
        met = [*map(Inbox.met, self._played.inboxes)]
        change = Change.NONE if met == self._played.met else self._played.look(met)
        if change is Change.UNKNOWN:
            return
        if change is Change.RECORDING:
            self._flush()  # what a robot has sent before
            self.begin_recording(", ".join(self._played.players))
        if change is not Change.ROBOT:
            self._drain()
        if change in (Change.ROBOT, Change.MIXED):
            self._flush()  # the end of the recording
            self.end_recording()
        if change is Change.ROBOT:
            self._drain()

    def _drain(self) -> None:
        """Drain all inputs, run the pipeline once and publish.

        Joint states come first: the temperatures and readings drained after them are then
        never older than what they belong to.
        """
        states = self.drain([self.joint_states, *self._further])
        temperatures, readings = self.drain(self.temperatures), self.drain(self.readings)
        if self._loads.loads:
            self._loads.take()
        if temperatures:
            self._publish(
                self.guard.feed(
                    "motor_temperatures",
                    self._temperature.arrivals(temperatures),
                    lambda: self._pipeline.step(temperatures=self._temperature.step(temperatures)),
                    self._temperature.restart,
                )
            )
        if readings:
            self._publish(
                self.guard.feed(
                    "meter",
                    [(self._meter.rejections, sum(map(len, readings)))],
                    lambda: self._pipeline.step(meter=self._meter.step(readings)),
                    self._meter.restart,
                )
            )
        if states:
            self._publish(
                self.guard.feed(
                    "joint_states",
                    [(self.ingest.rejections, sum(map(len, states)))],
                    lambda: self._pipeline.step(self.ingest.step(states)),
                    self._restart,
                )
            )

    def deactivate(self) -> None:
        """Count and publish what still waits."""
        self.take()
        self._flush()
        self.guard.run("registers", self.keep_last)

    def _flush(self) -> None:
        """Count what waits in the stages, as at the end."""
        self._publish(
            self.guard.run(
                "motor_temperatures",
                lambda: self._pipeline.step(temperatures=self._temperature.flush()),
            )
        )
        self.guard.run("meter", lambda: self._pipeline.step(meter=self._meter.flush()))
        self._loads.flush()
        self._publish(
            self.guard.feed(
                "joint_states",
                [(self.ingest.rejections, 0)],
                lambda: self._pipeline.step(self.ingest.flush()),
                self._restart,
            )
        )
        self._publish(self.guard.run("joint_states", self._pipeline.flush, self._restart))

    def _restart(self) -> None:
        self.ingest.restart()
        self._pipeline.restart()

    def _publish(self, output: Output | None) -> None:
        if output is None:
            return
        self._model_check.outputs.append(output)
        torque, friction, means = output.torque, output.friction, output.means
        if torque is not None and self._torque is not None:
            publish, encode = self._torque.publish, self._torque_writer.encode
            self.guard.run("publish.joint_torque", lambda: publish(encode(torque)))
        if friction is not None:
            send, write = self._friction.publish, self._friction_writer.encode
            self.guard.run("publish.joint_friction", lambda: send(write(friction)))
        if means is not None:
            add, message = self._power.add, self._power_writer.encode
            location = self.account.comparison.location
            self.guard.run("publish.power", lambda: add(message(means, location)))


main = partial(run, EnergyMonitor)
