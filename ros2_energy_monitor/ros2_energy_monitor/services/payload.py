# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The service that says at run time what the robot carries, and the topic that keeps it."""

from __future__ import annotations

from typing import Any, cast

from rclpy.node import Node
from ros2_energy_msgs.msg import Payload
from ros2_energy_msgs.srv import SetPayload

from robot_energy.foundation.units import SECOND_NS
from robot_energy.messages.payload import PayloadWriter, answer_set_payload
from robot_energy.pipeline import TorqueStage
from ros2_energy_monitor.base.publishers import RowPublisher, latched

DEPTH = 100  # changes that a late subscriber gets at most


class PayloadService:
    """Serves ``~/set_payload`` and publishes what is accepted on ``energy/payload``."""

    def __init__(self, node: Node, stage: TorqueStage, model_id: str) -> None:
        self._node, self._stage = node, stage
        self._writer = PayloadWriter(model_id)
        self._publisher: RowPublisher | None = None

    def open(self) -> None:
        """Create the service and the publisher."""
        self._publisher = RowPublisher(self._node, Payload, "energy/payload", latched(DEPTH))
        self._node.create_service(SetPayload, "~/set_payload", self._answer)

    def _answer(
        self, request: SetPayload.Request, response: SetPayload.Response
    ) -> SetPayload.Response:
        answer = answer_set_payload(self._stage.set_payload, cast("Any", request))
        if answer.change is not None and self._publisher is not None:
            self._publisher.publish(self._writer.encode(answer.change))
        log = self._node.get_logger()
        if answer.success:
            log.info(f"set_payload: {answer.message}")
        else:  # rclpy ties one severity to each place of a call
            log.warning(f"set_payload: {answer.message}")
        response.success, response.message = answer.success, answer.message
        response.valid_from.sec, response.valid_from.nanosec = divmod(answer.from_ns, SECOND_NS)
        return response
