"""What every monitor shares: a model, a tick, a report once a second, a clean end."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Generic, TypeVar

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from robot_energy.model_file import RobotModel, load
from ros2_energy_monitor.diagnostics import Reporter, Source
from ros2_energy_monitor.node_parameters import Common, declare

P = TypeVar("P", bound=Common)
REPORT_PERIOD = 1.0  # [s]


class MonitorNode(Node, Generic[P], ABC):
    """Base of the monitors.

    Subclasses fill their inboxes and stages in the constructor and end it with `begin`.
    Ticks follow the steady clock, so that queues are drained also while simulated time
    stands still.

    Args:
        name: Name of the node.
        parameters_type: Dataclass of its parameters.
        options: Options of `rclpy.node.Node`.

    Raises:
        RobotEnergyError: If a parameter or the model cannot be used.
    """

    parameters: P
    model: RobotModel

    def __init__(self, name: str, parameters_type: type[P], **options: Any) -> None:
        super().__init__(name, **options)
        self.parameters = declare(self, parameters_type)
        self.model = load(self.parameters.model)

    def begin(self, sources: list[Source]) -> None:
        """Start ticking and reporting.

        Args:
            sources: What the node says about itself.
        """
        self._reporter = Reporter(self, self.model, sources)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0 / self.parameters.tick_rate, self.tick, clock=steady)
        self.create_timer(REPORT_PERIOD, self.report, clock=steady)
        robot = self.model.robot
        self.get_logger().info(f"{robot.type}, model {self.model.model_id}, is monitored")

    @abstractmethod
    def tick(self) -> None:
        """Take what has arrived, run the stage once and publish."""

    def report(self) -> None:
        """Publish diagnostics."""
        self._reporter.publish()

    def close(self) -> None:
        """Take and publish what still waits, before the node is destroyed."""
        self.tick()
