# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Services of the registers, reset them, open, close and list intervals; and of the payload."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, cast
from weakref import proxy

from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.service import Service
from ros2_energy_msgs.msg import EnergyInterval, JointEnergy, LoadEnergy, Payload
from ros2_energy_msgs.srv import (
    CloseInterval,
    ListIntervals,
    OpenInterval,
    ResetRegisters,
    SetPayload,
)

from robot_energy.accounting import record
from robot_energy.accounting.account import EnergyAccount
from robot_energy.foundation.errors import RegisterError
from robot_energy.foundation.shown_text import MAX_LINE, shown
from robot_energy.foundation.units import SECOND_NS
from robot_energy.messages.payload import PayloadWriter, answer_set_payload
from robot_energy.messages.registers import interval_fields
from robot_energy.model import RobotModel
from robot_energy.pipeline import TorqueStage
from ros2_energy_monitor.base.checkpoints import Checkpoints
from ros2_energy_monitor.base.guard import refuse
from ros2_energy_monitor.base.lifecycle import ManagedNode
from ros2_energy_monitor.base.publishers import RowPublisher, latched


class RegisterServices:
    """Answers the services of one energy account; what they change is on disk before they answer.

    The thread of the ticks changes the account and goes on; it never waits for the disk.
    """

    def __init__(
        self,
        node: ManagedNode,
        account: EnergyAccount,
        checkpoints: Checkpoints,
        model: RobotModel,
        take: Callable[[], None],
    ) -> None:
        self._node, self._account, self._checkpoints = node, account, checkpoints
        self._model, self._take = model, take

    def open(self) -> None:
        self._node.create_service(ListIntervals, "~/list_intervals", self._list)
        for kind, name, change in (
            (ResetRegisters, "reset_registers", self._reset),
            (OpenInterval, "open_interval", self._open),
            (CloseInterval, "close_interval", self._close),
        ):
            answer = partial(self._change, change)
            service = self._node.create_service(kind, f"~/{name}", answer)
            # The executor sends what a callback returns through this method. A proxy, as a service
            # that refers to itself would outlive its node until garbage is collected.
            itself: Any = proxy(service)
            send = partial(Service.send_response, itself)
            service.send_response = partial(self._send, send, name)

    def _reset(self, request: Any, _: Any) -> str:
        before = self._account.registers.cabinet("grid_import")
        self._account.reset(request.reason)
        return f"the registers begin at zero; they had counted {before:.1f} J from the grid"

    def _open(self, request: Any, response: Any) -> str:
        return self._done(response, self._account.open_interval(request.name), "open")

    def _close(self, request: Any, response: Any) -> str:
        interval = self._account.close_interval(request.name, request.id)
        return self._done(response, interval, "closed")

    def _done(self, response: Any, interval: record.EnergyInterval, what: str) -> str:
        response.interval = self._message(interval)
        return f"interval {interval.interval_id} '{interval.name}' is {what}"

    def _list(self, request: Any, response: Any) -> Any:
        response.energy_start = _time(self._account.start_ns or 0)
        response.intervals = [self._message(one) for one in self._account.list_intervals()]
        return response

    def _change(self, change: Callable[[Any, Any], str], request: Any, response: Any) -> Any:
        """Change the account; `_send` waits for the disk."""
        try:
            self._checkpoints.store.require()
            self._take()
            response.message = change(request, response)
        except RegisterError as error:
            self._node.get_logger().warning(f"refused: {error}")
            return refuse(response, str(error))
        response.success = True
        return response

    def _send(
        self, send: Callable[[Any, Any], None], name: str, response: Any, header: Any
    ) -> None:
        """Send a refusal at once, and the answer to a change when it is on disk."""
        if not response.success:
            send(response, header)
            return

        def finish(kept: bool) -> None:
            response.persisted = kept
            if not kept:
                late = self._checkpoints.store.busy
                why = "in memory only" + (
                    " so far: the disk has not finished writing" if late else ""
                )
                response.message += f"; it is {why}"
            response.message = shown(response.message, MAX_LINE)
            self._node.get_logger().info(response.message)
            send(response, header)

        self._checkpoints.when_kept(self._node.guard.callback(f"service.{name}", finish))

    def _message(self, interval: record.EnergyInterval) -> EnergyInterval:
        model = self._model
        fields = interval_fields(
            interval, model.joint_names, self._account.calibration, model.unmodelled
        )
        joints = [JointEnergy(**joint) for joint in fields.pop("joints")]
        loads = [LoadEnergy(**load) for load in fields.pop("auxiliary")]
        start, end = _time(fields.pop("start_ns")), _time(fields.pop("end_ns"))
        return EnergyInterval(start=start, end=end, joints=joints, auxiliary=loads, **fields)


def _time(stamp_ns: int) -> Time:
    return Time(sec=stamp_ns // SECOND_NS, nanosec=stamp_ns % SECOND_NS)


DEPTH = 100  # changes that a late subscriber gets at most


class PayloadService:
    """Serves ``~/set_payload`` and publishes what is accepted on ``energy/payload``."""

    def __init__(self, node: Node, stage: TorqueStage, model_id: str) -> None:
        self._node, self._stage = node, stage
        self._writer = PayloadWriter(model_id)
        self._publisher: RowPublisher | None = None

    def open(self) -> None:
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
