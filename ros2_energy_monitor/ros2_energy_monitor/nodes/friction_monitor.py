"""Node: motor temperatures in, friction coefficients of every joint out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_energy.messages import FrictionWriter
from robot_energy.pipeline import FrictionStage
from ros2_energy_monitor.diagnostics import temperature_source
from ros2_energy_monitor.drain import Inbox
from ros2_energy_monitor.inputs import (
    drain_all,
    temperature_inboxes,
    temperature_ingest,
    temperature_inputs,
)
from ros2_energy_monitor.monitor_node import MonitorNode
from ros2_energy_monitor.node_parameters import FrictionParameters
from ros2_energy_monitor.publishers import friction_publisher
from ros2_energy_monitor.shell import run


class FrictionMonitor(MonitorNode[FrictionParameters]):
    """Publishes ``energy/joint_friction`` at the start and at every new temperature.

    Args:
        options: Options of `rclpy.node.Node`.

    Raises:
        RobotEnergyError: If a parameter or the model cannot be used.
    """

    NAME = "friction_monitor"

    def __init__(self, **options: Any) -> None:
        super().__init__(self.NAME, FrictionParameters, **options)

    def set_up(self) -> None:
        """Make the stage, the publishers and the inboxes."""
        self.ingest = temperature_ingest(self, self.parameters, self.model)
        self._stage = FrictionStage(self.model)
        self._writer = FrictionWriter(self.model)
        self._publisher = friction_publisher(self)
        self.temperatures: list[Inbox] = temperature_inboxes(
            self, self.ingest, self.parameters.resubscribe_after
        )
        self.inputs = temperature_inputs(self.ingest, self.temperatures)
        self.sources = [temperature_source(self.temperatures, self.ingest, self._stage, self.model)]

    def begin(self) -> None:
        """Publish the friction as it stands, also before the first temperature."""
        super().begin()
        self._publisher.publish(self._writer.encode(self._stage.latest()))

    def tick(self) -> None:
        """Drain the temperatures and publish the friction from each of them onward."""
        temperatures = self.ingest.step(drain_all(self.temperatures))
        friction = self._stage.step(temperatures) if temperatures is not None else None
        if friction is not None:
            self._publisher.publish(self._writer.encode(friction))


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is interrupted."""
    return run(FrictionMonitor, args)


if __name__ == "__main__":
    raise SystemExit(main())
