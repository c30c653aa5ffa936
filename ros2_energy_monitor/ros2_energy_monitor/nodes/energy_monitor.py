"""Node: the three monitors in one process, wired directly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_energy.blocks import EffortMeaning
from robot_energy.ingest import JointStateIngest
from robot_energy.messages import FrictionWriter, TorqueWriter
from robot_energy.pipeline import EnergyPipeline, Ledger, Output
from ros2_energy_monitor.diagnostics import (
    energy_source,
    joint_state_source,
    stuck_temperatures,
    temperature_source,
)
from ros2_energy_monitor.inputs import (
    drain_all,
    joint_state_inboxes,
    meter_input,
    temperature_inboxes,
    temperature_ingest,
    temperature_inputs,
)
from ros2_energy_monitor.monitor_node import MonitorNode
from ros2_energy_monitor.node_parameters import EnergyParameters
from ros2_energy_monitor.payload_service import PayloadService
from ros2_energy_monitor.publishers import (
    BooksPublisher,
    friction_publisher,
    torque_publisher,
)
from ros2_energy_monitor.settings import settings_of
from ros2_energy_monitor.shell import run


class EnergyMonitor(MonitorNode[EnergyParameters]):
    """Publishes what the three monitors publish; ``energy/joint_torque`` only if asked.

    Args:
        options: Options of `rclpy.node.Node`.

    Raises:
        RobotEnergyError: If a parameter or the model cannot be used.
    """

    NAME = "energy_monitor"
    UNIQUE_TOPIC = "energy/registers"

    def __init__(self, **options: Any) -> None:
        super().__init__(self.NAME, EnergyParameters, **options)

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
        )
        self._torque_writer = TorqueWriter(names, self.model.model_id)
        self._friction_writer = FrictionWriter(self.model)
        self._torque = torque_publisher(self, depth) if self.parameters.publish_torque else None
        self._friction = friction_publisher(self)
        self._books = BooksPublisher(self, self.model, self.ledger, self.parameters)
        self.holds.callback(self._books.checkpoints.close)
        renew = self.parameters.resubscribe_after
        states = joint_state_inboxes(self, self.parameters)
        self.joint_states, *self._further = states
        self.temperatures = temperature_inboxes(self, self._temperature, renew)
        self._meter, self.readings = meter_input(self, self.parameters, renew)
        PayloadService(self, self._pipeline.torque, self.model.model_id)
        self.tell(self._pipeline.torque.robot)
        self.inputs = [
            *((inbox, self.ingest.account) for inbox in states),
            *temperature_inputs(self._temperature, self.temperatures),
            *((inbox, self._meter.account) for inbox in self.readings),
        ]
        self.orders = [self.ingest.order]
        self.sources = [
            joint_state_source(states, self.ingest, self.parameters.input_timeout),
            temperature_source(
                self.temperatures, self._temperature, self._pipeline.friction, self.model
            ),
            energy_source(
                self.ledger,
                self.readings,
                self._meter,
                self.parameters.meter_max_gap,
                stuck_temperatures(self._pipeline.power.watch, self.model),
            ),
            self._books.checkpoints.findings,
        ]

    def begin(self) -> None:
        """Publish the friction as it stands, also before the first temperature."""
        super().begin()
        self._books.begin()
        self._friction.publish(self._friction_writer.encode(self._pipeline.friction.latest()))

    @property
    def ledger(self) -> Ledger:
        """The books."""
        return self._pipeline.ledger

    def tick(self) -> None:
        """Drain all inputs, run the pipeline once and publish.

        Joint states come first: the temperatures and readings drained after them are then
        never older than what they belong to.
        """
        states = drain_all([self.joint_states, *self._further])
        temperatures = self._temperature.step(drain_all(self.temperatures))
        readings = drain_all(self.readings)
        joints = self.ingest.step(states)
        meter = self._meter.step(readings)
        self._publish(self._pipeline.step(joints, temperatures, meter))

    def finish(self) -> None:
        """Book and publish what still waits."""
        self.tick()
        self._publish(self._pipeline.step(self.ingest.flush()))
        self._publish(self._pipeline.flush())
        self._books.finish()

    def _publish(self, output: Output) -> None:
        if output.torque is not None and self._torque is not None:
            self._torque.publish(self._torque_writer.encode(output.torque))
        if output.friction is not None:
            self._friction.publish(self._friction_writer.encode(output.friction))
        self._books.power(output.means)
        self._books.checkpoints.poll()


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is interrupted."""
    return run(EnergyMonitor, args)


if __name__ == "__main__":
    raise SystemExit(main())
