# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The services that predict trajectories, outside the ticks and within a bound known before.

A thread takes the requests, and refuses what is too long before anything is converted. A process
makes the predictions: it is started when a client of the service appears, so that it is ready for
the first request, and ended when the last one is gone or when it holds much memory.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from threading import Event, Thread
from time import monotonic
from typing import Any, ClassVar

from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from ros2_energy_msgs.msg import CandidateEnergy, JointEnergy
from ros2_energy_msgs.srv import CompareTrajectories, PredictTrajectory
from trajectory_msgs.msg import JointTrajectory

from robot_energy.accounting.record import Calibrated
from robot_energy.foundation.errors import MotionError, RobotEnergyError
from robot_energy.foundation.process_memory import give_back_freed_memory
from robot_energy.foundation.shown_text import MAX_LINE, shown
from robot_energy.model import RobotModel
from robot_energy.model.payload import Payload
from robot_energy.timeline.blocks import Float
from ros2_energy_monitor.base.guard import Guard, unknown_figures
from ros2_energy_monitor.services.prediction_process import PredictionProcess
from ros2_energy_monitor.services.raw_service import (
    RawService,
    TakenRequest,
    elements,
    points_of,
    time_of,
)
from ros2_energy_monitor.services.trajectory_answers import MAX_CANDIDATES, MAX_SAMPLES

LOOK = 0.2  # s between two looks for a request
CLIENTS = 1.0  # s between two questions whether there is a client
KEPT = 10.0  # s that the process is kept without a client
LARGE = 50_000  # samples; memory of such a request is given back at once
BUSY = "a prediction is under way; expected one at a time; ask again when it is done"
STOPPED = "the node was stopped meanwhile"
FAILED = "internal error: see the log of the node"


class PredictionService:
    """Serves ``~/predict_trajectory``: one prediction at a time, outside the ticks.

    Attributes:
        parts: Fields of its response that are lists of messages, with their classes.

    Args:
        motor_temperature_degc: Gives the newest motor temperatures, NaN where unknown,
            shape (n,). [degC]
        calibration: Gives what the meter has shown of the bands so far.
    """

    interface: Any = PredictTrajectory
    name = "predict_trajectory"
    parts: ClassVar[dict[str, Any]] = {"joints": JointEnergy}

    def __init__(
        self,
        node: Node,
        guard: Guard,
        model: RobotModel,
        payload: Callable[[], Sequence[Payload]],
        motor_temperature_degc: Callable[[], Float],
        calibration: Callable[[], Calibrated],
    ) -> None:
        self._node, self._guard, self._model = node, guard, model
        self._payload, self._newest = payload, motor_temperature_degc
        self._calibration = calibration
        self._process = PredictionProcess()
        self._stop, self._known = Event(), Event()
        self._now: dict[str, Any] = {}  # what is known of the robot
        self._waiting: TakenRequest | None = None
        self._large = False  # whether the process holds a long trajectory
        self._renew = False  # whether the middleware does
        self._wanted = self._due = 0.0  # when there was a client last; when to ask next
        self._thread = Thread(target=self._serve, name=f"prediction {self.name}", daemon=True)

    def open(self) -> None:
        try:
            self._service = RawService(self._node, self.interface, f"~/{self.name}")
        except (OSError, AttributeError) as error:
            self._node.get_logger().error(
                f"~/{self.name} is not offered: this rclpy does not let requests be taken outside "
                f"the ticks ({error}); expected rclpy 7; use robot-energy predict instead"
            )
            return
        self._ask = self._node.create_guard_condition(self._look)
        self._thread.start()

    def close(self) -> None:
        """Give up the prediction under way, and answer that."""
        self._stop.set()
        self._process.end()
        if self._thread.is_alive():
            self._thread.join()

    def _serve(self) -> None:
        """Take requests and send answers, until the node is stopped."""
        while not self._stop.is_set():
            try:
                self._step()
            except Exception as error:
                self._process.end()
                if self._stop.is_set():
                    break
                self._finish(FAILED)
                try:
                    self._guard.note(f"service.{self.name}", error)
                except Exception:  # the same: ROS is shut down
                    break
        self._process.end()
        self._finish(STOPPED)

    def _step(self) -> None:
        if self._waiting is None:
            self._keep_process()
            self._stop.wait(LOOK)
        elif (answer := self._process.answer(LOOK)) is not None:
            if self._large:
                self._process.end()
            self._finish(**answer)
        while not self._stop.is_set() and (taken := self._service.take()) is not None:
            self._begin(taken)

    def _begin(self, taken: TakenRequest) -> None:
        """Refuse a request, or give it to the process."""
        refusal = FAILED
        try:
            trajectories = self.trajectories(taken.message.fields)
            self._renew |= sum(len(points_of(each)) for each in trajectories) > LARGE
            samples = self._checked_size(taken.message.fields)
            refusal = BUSY if self._waiting is not None else ""
            if not refusal:
                self._waiting, self._large = taken, samples > LARGE
                if self._looked():
                    with taken.message.serialised() as data:
                        taken.message.free()
                        self._process.ask({"answer": self.name, **self._now}, data)
        except RobotEnergyError as error:
            refusal = str(error)
        finally:
            taken.message.free()
            give_back_freed_memory()
            if refusal:
                self._send(taken, refusal)

    def _checked_size(self, fields: Any) -> int:
        """Samples of a request, at most; it is refused if they are too many."""
        from robot_energy_plan.motion.planned import grid_steps  # once a client asks

        samples, duration = 0, 0.0
        for trajectory in self.trajectories(fields):
            points = points_of(trajectory)
            begin, end = time_of(points[[0, -1]]) if len(points) else (0.0, 0.0)
            samples += grid_steps(max(end - begin, 0.0)) + 1 + len(points)
            duration += end - begin
        repeat = max(1, getattr(fields, "repeat", 1))
        if samples * repeat > MAX_SAMPLES:
            raise MotionError(
                f"{samples * repeat} samples over {duration * repeat:.4g} s were asked for",
                f"at most {MAX_SAMPLES} samples: one for each point, and one every 5 ms",
                "ask for fewer repetitions, points or trajectories, or use robot-energy predict",
            )
        return samples * repeat

    def trajectories(self, fields: Any) -> list[Any]:
        """Return the trajectories of a request, as they lie in memory."""
        return [fields.trajectory]

    def _looked(self) -> bool:
        """Let the thread of the ticks say what is known of the robot; False at the end."""
        self._known.clear()
        with suppress(InvalidHandle):
            self._ask.trigger()
        while not self._known.wait(LOOK):
            if self._stop.is_set():
                return False
        return True

    def _look(self) -> None:
        self._now = {
            "model": self._model,
            "carried": tuple(self._payload()),
            "newest_degc": self._newest().copy(),
            "calibration": self._calibration(),
        }
        self._known.set()

    def _keep_process(self) -> None:
        """Start the process before it is needed, and end it when it no longer is."""
        now = monotonic()
        if now < self._due:
            return
        self._due = now + CLIENTS
        with suppress(InvalidHandle):
            if self._node.count_clients(self._service.name):
                self._wanted = now
                self._process.start()
            elif self._renew:  # now no client can lose a request
                self._service.renew()
                self._renew = False
        if now - self._wanted > KEPT:
            self._process.end()

    def _finish(self, message: str = "", error: str = "", **fields: Any) -> None:
        """Answer the request that waits, if one does."""
        taken, self._waiting = self._waiting, None
        if error:
            self._guard.note(f"service.{self.name}", Exception(error))
        if taken is not None:
            self._send(taken, FAILED if error else message, **fields)

    def _send(self, taken: TakenRequest, message: str, **fields: Any) -> None:
        for name in self.parts.keys() & fields:
            fields[name] = [self.parts[name](**one) for one in fields[name]]
        known = {**self._unknown(), **fields, "message": shown(message, MAX_LINE)}
        answer = self.interface.Response(**known)
        log = self._node.get_logger()
        if answer.success:
            log.info(f"{self.name}: {answer.message}")
        else:  # rclpy ties one severity to each place of a call
            log.warning(f"{self.name}: {answer.message}")
        self._service.answer(taken, answer)

    def _unknown(self) -> dict[str, Any]:
        return unknown_figures(self.interface.Response)


class ComparisonService(PredictionService):
    """Serves ``~/compare_trajectories``, with a thread and a process of its own; see its base."""

    interface = CompareTrajectories
    name = "compare_trajectories"
    parts: ClassVar[dict[str, Any]] = {"candidates": CandidateEnergy}

    def trajectories(self, fields: Any) -> list[Any]:
        """Return the trajectories of a request, as they lie in memory."""
        if fields.trajectories.size > MAX_CANDIDATES:
            raise MotionError(
                f"{fields.trajectories.size} trajectories were given", f"at most {MAX_CANDIDATES}"
            )
        return elements(fields.trajectories, JointTrajectory)

    def _unknown(self) -> dict[str, Any]:
        return {**super()._unknown(), "cheapest": -1}
