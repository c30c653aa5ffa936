"""Node: joint states in, rigid-body torque of every joint out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_energy.blocks import EffortMeaning, JointBlock, TorqueBlock
from robot_energy.ingest import JointStateIngest
from robot_energy.messages import TorqueWriter
from robot_energy.pipeline import TorqueStage
from ros2_energy_monitor.diagnostics import joint_state_source
from ros2_energy_monitor.inputs import drain_all, joint_state_inboxes
from ros2_energy_monitor.monitor_node import MonitorNode
from ros2_energy_monitor.node_parameters import TorqueParameters
from ros2_energy_monitor.payload_service import PayloadService
from ros2_energy_monitor.publishers import torque_publisher
from ros2_energy_monitor.settings import settings_of
from ros2_energy_monitor.shell import run


class TorqueMonitor(MonitorNode[TorqueParameters]):
    """Publishes ``energy/joint_torque`` for every accepted message of ``joint_states``.

    Args:
        options: Options of `rclpy.node.Node`.

    Raises:
        RobotEnergyError: If a parameter or the model cannot be used.
    """

    NAME = "torque_monitor"

    def __init__(self, **options: Any) -> None:
        super().__init__(self.NAME, TorqueParameters, **options)

    def set_up(self) -> None:
        """Make the stage, the publishers and the inboxes."""
        depth = self.parameters.joint_state_depth
        settings, source = settings_of(self.parameters), self.parameters.joint_states
        self.stage = TorqueStage(self.model, settings)
        self.ingest = JointStateIngest(
            self.model.joint_names,
            limits=self.stage.robot.limits,
            effort=settings.effort is not EffortMeaning.NONE,
            source=source,
        )
        self._writer = TorqueWriter(self.model.joint_names, self.model.model_id)
        self._publisher = torque_publisher(self, depth)
        PayloadService(self, self.stage, self.model.model_id)
        self.tell(self.stage.robot)
        inboxes = joint_state_inboxes(self, self.parameters)
        self.joint_states, *self._further = inboxes
        self.inputs = [(inbox, self.ingest.account) for inbox in inboxes]
        self.orders = [self.ingest.order]
        timeout = self.parameters.input_timeout
        self.sources = [joint_state_source(inboxes, self.ingest, timeout)]

    def tick(self) -> None:
        """Drain the joint states and publish the torques that became complete."""
        self._take(self.ingest.step(drain_all([self.joint_states, *self._further])))

    def finish(self) -> None:
        """Publish the last torques, whose window will not fill any more."""
        self.tick()
        self._take(self.ingest.flush())
        self._publish(self.stage.flush())

    def _take(self, joints: JointBlock | None) -> None:
        if joints is not None:
            self._publish(self.stage.step(joints))

    def _publish(self, torque: TorqueBlock | None) -> None:
        if torque is not None:
            self._publisher.publish(self._writer.encode(torque))


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is interrupted."""
    return run(TorqueMonitor, args)


if __name__ == "__main__":
    raise SystemExit(main())
