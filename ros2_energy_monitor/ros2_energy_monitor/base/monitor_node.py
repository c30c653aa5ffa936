"""What every monitor shares: a model, a tick, a report once a second, a life cycle."""

from __future__ import annotations

from abc import abstractmethod
from contextlib import ExitStack
from typing import Any, ClassVar, Generic, TypeVar

from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from robot_energy.errors import RobotDescriptionError, RobotEnergyError, UrdfAwaitedError
from robot_energy.ingest import Accounting
from robot_energy.ingest.order import StampOrder
from robot_energy.model_file import RobotModel, load
from robot_energy.robot import Robot
from ros2_energy_monitor.drain import Inbox
from ros2_energy_monitor.entities import Entities
from ros2_energy_monitor.findings import Reporter, Source
from ros2_energy_monitor.life_cycle import ManagedNode
from ros2_energy_monitor.node_parameters import Common, declare, in_force
from ros2_energy_monitor.node_watch import NodeWatch
from ros2_energy_monitor.robot_description import AwaitedDescription, ComparedDescription
from ros2_energy_monitor.tempo import Tempo

P = TypeVar("P", bound=Common)
ROBOT_DESCRIPTION = "robot_description"
REPORT_PERIOD = 1.0  # [s]


class MonitorNode(ManagedNode, Generic[P]):
    """Base of the monitors.

    configure reads the model and calls `set_up`; while the node is active, `tick` runs at
    the tick rate and `report` once a second; while it is inactive, what arrives is
    discarded and counted. Diagnostics are published in every state. With the parameter
    ``autostart`` the constructor configures and activates.

    Ticks follow the steady clock, so that queues are drained also while simulated time
    stands still.

    Args:
        name: Name of the node.
        parameters_type: Dataclass of its parameters.
        options: Options of `rclpy.node.Node`.

    Attributes:
        parameters: Values of the parameters.
        model: The robot's model, once configured.
        inputs: Every inbox with the account of its messages, from `set_up`.
        orders: Orders of stamps in which becoming active leaves a gap, from `set_up`.
        sources: What the node says about itself, from `set_up`.
        holds: What cleanup closes, from `set_up`.

    Raises:
        RobotEnergyError: If a parameter, or with ``autostart`` the model, cannot be used.
    """

    NAME: ClassVar[str]
    UNIQUE_TOPIC: ClassVar[str] = ""  # that no other node may publish
    parameters: P
    model: RobotModel

    def __init__(self, name: str, parameters_type: type[P], **options: Any) -> None:
        super().__init__(name, **options)
        self.inputs: list[tuple[Inbox, Accounting]] = []
        self.orders: list[StampOrder] = []
        self.sources: list[Source] = []
        self._description: AwaitedDescription | ComparedDescription | None = None
        self.holds = ExitStack()
        try:
            self.parameters = declare(self, parameters_type)
            self._steady = Clock(clock_type=ClockType.STEADY_TIME)
            self._reporter = Reporter(self)
            self._tempo = Tempo(1.0 / self.parameters.tick_rate)
            self._watch = NodeWatch(self, self._tempo, self.UNIQUE_TOPIC)
            self.create_timer(REPORT_PERIOD, self._report, clock=self._steady)
            self.settle(start=self.parameters.autostart)
        except Exception:
            self.destroy_node()
            raise

    @abstractmethod
    def set_up(self) -> None:
        """Make stages, publishers and inboxes; fill `inputs`, `orders`, `sources`."""

    @abstractmethod
    def tick(self) -> None:
        """Take what has arrived, run the stage once and publish."""

    def report(self) -> None:
        """Publish, once a second while active, what has no rate of its own."""

    def equip(self) -> None:
        """Read the model, set up and start to drain, as soon as the robot is described."""
        name = self.parameters.model
        try:
            model = load(name)
        except UrdfAwaitedError as awaited:
            self._description = AwaitedDescription(
                self,
                awaited.topic,
                lambda urdf_xml: load(name, urdf_xml),
                self._adopt,
                self.start_late,
            )
            self.get_logger().info("; ".join(self._description.sentences()))
        else:
            self._description = ComparedDescription(self, ROBOT_DESCRIPTION, model)
            self._set_up(model)

    def begin(self) -> None:
        """Discard what came before; the time until now is a gap."""
        if not self.ready and self._description is not None:
            raise RobotDescriptionError("; ".join(self._description.sentences()))
        self._discard()
        for order in self.orders:
            order.interrupt()
        robot = self.model.robot
        self.get_logger().info(f"{robot.type}, model {self._model_id}, is monitored")

    def tell(self, robot: Robot) -> None:
        """Log what of the robot is modelled, and what is not."""
        self.get_logger().info("\n".join(["the joints:", *robot.inventory.sentences()]))

    def finish(self) -> None:
        """Take and publish what still waits."""
        self.tick()

    def release(self) -> None:
        """Close what is held; forget inputs and sources, whose entities cleanup destroys."""
        self.holds.close()
        self.inputs, self.orders, self.sources = [], [], []
        self._description = None

    @property
    def ready(self) -> bool:
        """Whether the robot is described."""
        return self._description is None or not self._description.waits

    def _adopt(self, model: RobotModel) -> None:
        """Set up with a model that came late; if that fails, wait on as before."""
        before = Entities(self)
        try:
            self._set_up(model)
        except RobotEnergyError:
            self.holds.close()
            before.restore()
            self.inputs, self.orders, self.sources = [], [], []
            raise

    def _set_up(self, model: RobotModel) -> None:
        self.model, self._model_id = model, model.model_id
        self.set_up()
        self.get_logger().info(f"configured with {in_force(self)}")
        self.create_timer(1.0 / self.parameters.tick_rate, self._tick, clock=self._steady)

    def _tick(self) -> None:
        with self._tempo.tick():
            if self.active:
                self.tick()
            else:
                self._discard()

    def _report(self) -> None:
        if self.active:
            self.report()
        for inbox, _ in self.inputs:
            inbox.revive()
        described = [] if self._description is None else self._description.sentences()
        statuses = [
            self._watch.judge(self.inputs, described),
            *(source() for source in self.sources),
        ]
        self._reporter.publish(statuses, self._model_id if self.sources else "")

    def _discard(self) -> None:
        for inbox, account in self.inputs:
            inbox.discard(account)
