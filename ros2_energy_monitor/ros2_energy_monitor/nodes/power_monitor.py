"""Node: torque, friction and meter in, power and energy out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

from ros2_energy_msgs.msg import JointFriction, JointTorque

from robot_energy.blocks import PowerBlock
from robot_energy.messages import FrictionReader, TorqueReader
from robot_energy.pipeline import Ledger, PowerStage
from ros2_energy_monitor.diagnostics import energy_source, stuck_temperatures
from ros2_energy_monitor.drain import Inbox
from ros2_energy_monitor.input_watch import InputWatch
from ros2_energy_monitor.inputs import drain_all, meter_input
from ros2_energy_monitor.monitor_node import MonitorNode
from ros2_energy_monitor.node_parameters import PowerParameters
from ros2_energy_monitor.publishers import FRICTION_DEPTH, BooksPublisher, latched, reliable
from ros2_energy_monitor.settings import settings_of
from ros2_energy_monitor.shell import run


class PowerMonitor(MonitorNode[PowerParameters]):
    """Publishes ``energy/power`` and ``energy/registers``.

    Args:
        options: Options of `rclpy.node.Node`.

    Raises:
        RobotEnergyError: If a parameter or the model cannot be used.
    """

    NAME = "power_monitor"
    UNIQUE_TOPIC = "energy/registers"

    def __init__(self, **options: Any) -> None:
        super().__init__(self.NAME, PowerParameters, **options)

    def set_up(self) -> None:
        """Make the stage, the publishers and the inboxes."""
        settings = settings_of(self.parameters)
        self._torque = TorqueReader(self.model.joint_names, self.model.model_id)
        self._friction = FrictionReader(self.model)
        self._stage = PowerStage(self.model, settings)
        self.ledger = Ledger(len(self.model.joints), settings)
        self._books = BooksPublisher(self, self.model, self.ledger, self.parameters)
        self.holds.callback(self._books.checkpoints.close)
        depth = self.parameters.joint_torque_depth
        renew = self.parameters.resubscribe_after
        self.torques = Inbox(
            self, JointTorque, "energy/joint_torque", reliable(depth), renew_after=renew
        )
        self.frictions = Inbox(
            self, JointFriction, "energy/joint_friction", latched(FRICTION_DEPTH)
        )
        self._meter, self.readings = meter_input(
            self, self.parameters, self.parameters.resubscribe_after
        )
        self.inputs = [
            (self.torques, self._torque.account),
            (self.frictions, self._friction.account),
            *((inbox, self._meter.account) for inbox in self.readings),
        ]
        self.orders = [self._torque.order]
        timeout = self.parameters.input_timeout
        torque = InputWatch("joint torque", self.torques, self._torque.account, timeout)
        # Friction comes with temperatures only, and latched: silence is no fault, absence is.
        friction = InputWatch("joint friction", self.frictions, self._friction.account, math.inf)
        self.sources = [
            energy_source(
                self.ledger,
                self.readings,
                self._meter,
                self.parameters.meter_max_gap,
                torque.judge,
                partial(friction.judge, prefix="friction_"),
                stuck_temperatures(self._stage.watch, self.model),
            ),
            self._books.checkpoints.findings,
        ]

    def begin(self) -> None:
        """Keep and publish the registers from now on."""
        super().begin()
        self._books.begin()

    def tick(self) -> None:
        """Drain all inputs and publish the periods that ended.

        Torque comes first, though it is used last: what it belongs to is then not newer.
        """
        torques = self.torques.drain()
        frictions, readings = self.frictions.drain(), drain_all(self.readings)
        friction = self._friction.decode(frictions) if frictions is not None else None
        if friction is not None:
            self._stage.friction(friction)
        meter = self._meter.step(readings)
        if meter is not None:
            self.ledger.measure(meter)
        torque = self._torque.decode(torques) if torques is not None else None
        if torque is not None:
            self._book(self._stage.step(torque))
        self._books.checkpoints.poll()

    def finish(self) -> None:
        """Book and publish what still waits."""
        self.tick()
        self._book(self._stage.flush())
        self._books.power(self.ledger.flush())
        self._books.finish()

    def _book(self, power: PowerBlock | None) -> None:
        if power is not None:
            self._books.power(self.ledger.step(power))


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is interrupted."""
    return run(PowerMonitor, args)


if __name__ == "__main__":
    raise SystemExit(main())
