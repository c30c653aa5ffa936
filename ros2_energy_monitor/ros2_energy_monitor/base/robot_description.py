# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The robot's own description: awaited where the model leaves its URDF out, else compared."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from std_msgs.msg import String

from robot_energy.foundation.errors import RobotEnergyError
from robot_energy.foundation.shown_text import shown
from robot_energy.model import RobotModel
from robot_energy.physics.rigid_body import Robot
from robot_energy.physics.urdf.checks import disagreements
from ros2_energy_monitor.base.publishers import latched

MAX_FOUND = 20  # disagreements that are named


class AwaitedDescription:
    """Waits for the first description that can be used; later ones change nothing.

    Args:
        load: Makes a model of a description; raises what is wrong with it.
        adopt: Takes the model of the first good description; raises if it cannot.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        load: Callable[[str], RobotModel],
        adopt: Callable[[RobotModel], None],
        then: Callable[[], None],
    ) -> None:
        self._topic = node.resolve_topic_name(topic)
        self._load, self._adopt, self._then = load, adopt, then
        self._logger = node.get_logger()
        self._adopted: str | None = None
        self._complaint = ""
        node.create_subscription(String, topic, self._take, latched(1))

    @property
    def waits(self) -> bool:
        """Whether there was no good description yet."""
        return self._adopted is None

    def sentences(self) -> list[str]:
        """What is wrong, or what is awaited."""
        if not self.waits:
            return [self._complaint] if self._complaint else []
        reason = f" ({self._complaint})" if self._complaint else ""
        return [f"waiting for a robot description on {self._topic}{reason}"]

    def _take(self, message: String) -> None:
        if message.data == self._adopted:
            self._complaint = ""
            return
        try:
            model = self._load(message.data)
            Robot.from_model(model)
            if self.waits:
                self._adopt(model)
                self._adopted, self._complaint = message.data, ""
                self._then()
                return
            self._complaint = (
                f"another robot description on {self._topic} is ignored until cleanup and configure"
            )
        except RobotEnergyError as error:
            self._complaint = f"the robot description on {self._topic} is refused: {error}"
        self._logger.warning(self._complaint)


class ComparedDescription:
    """Compares what the robot publishes with the URDF of the model."""

    waits = False

    def __init__(self, node: Node, topic: str, model: RobotModel) -> None:
        self._topic = node.resolve_topic_name(topic)
        self._model, self._logger = model, node.get_logger()
        self._complaint = ""
        node.create_subscription(String, topic, self._take, latched(1))

    def sentences(self) -> list[str]:
        """How the two disagree."""
        return [self._complaint] if self._complaint else []

    def _take(self, message: String) -> None:
        try:
            found = [shown(one) for one in disagreements(self._model, message.data)[:MAX_FOUND]]
        except RobotEnergyError as error:
            found = [f"it cannot be read: {str(error).rstrip('.')}"]
        self._complaint = ""
        if found:
            self._complaint = (
                f"the robot description on {self._topic} is not of the modelled robot: "
                f"{'; '.join(found)}"
            )
            self._logger.warning(self._complaint)
