"""The service that predicts the energy of a trajectory before it runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from threading import Event
from typing import Any

import numpy as np
from rclpy.node import Node
from ros2_energy_msgs.msg import JointEnergy
from ros2_energy_msgs.srv import PredictTrajectory

from robot_energy.accounting.record import Calibrated
from robot_energy.accounting.registers import Registers
from robot_energy.blocks import NANOSECOND, Float
from robot_energy.errors import MotionError, RobotEnergyError
from robot_energy.messages.registers import JOINT_FIELDS, SHAFT_FIELDS
from robot_energy.model import RobotModel
from robot_energy.model.payload import Payload, payload
from robot_energy.shown_text import MAX_LINE, shown
from ros2_energy_monitor.base.guard import Guard
from ros2_energy_monitor.services.deferred import DeferredService

MAX_SAMPLES = 1_000_000  # of all repetitions; the srv file says so
NAME = "the trajectory"
Answer = dict[str, Any]


class GivenUp(Exception):
    """The node gives up the prediction."""


class PredictionService:
    """Serves ``~/predict_trajectory``: one prediction at a time, in a thread beside the ticks.

    Attributes:
        interface: Of the service.
        name: Of the service.
        answer: Makes the fields of the response.

    Args:
        node: The node that serves.
        guard: Counts exceptions of a prediction.
        model: The robot's model.
        payload: Gives the bodies that the robot carries now.
        motor_temperature_degc: Gives the newest motor temperatures, NaN where unknown,
            shape (n,). [degC]
        calibration: Gives what the meter has shown of the bands so far.
    """

    interface: Any = PredictTrajectory
    name = "predict_trajectory"
    answer: Callable[..., Answer]

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
        self._stop = Event()
        self._thread: ThreadPoolExecutor | None = None
        self._work: Future[Answer] | None = None
        self._service = DeferredService(
            node, self.interface, f"~/{self.name}", self._begin, self._end
        )

    def open(self) -> None:
        """Create the service."""
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="prediction")
        self._service.open()

    def close(self) -> None:
        """Give up the prediction under way, and answer that."""
        self._stop.set()
        self._service.close(self.interface.Response(message="the node was stopped meanwhile"))
        if self._thread is not None:
            self._thread.shutdown(wait=False, cancel_futures=True)

    def _begin(self, request: Any) -> Any:
        """Start a prediction; return the answer only if it is refused at once."""
        if self._service.pending or self._thread is None:
            message = "a prediction is under way; expected one at a time; ask again when it is done"
            return self.interface.Response(message=message)
        model, carried, newest = self._model, tuple(self._payload()), self._newest().copy()
        kept = self._calibration()
        self._work = self._thread.submit(
            lambda: self.answer(model, request, carried, newest, kept, self._stop.is_set)
        )
        self._work.add_done_callback(lambda _: self._service.wake())
        return None

    def _end(self) -> Any:
        """Return the answer of the prediction that is done."""
        if self._work is None or not self._work.done():
            return None
        error = self._work.exception()
        if error is None:
            answer = self.interface.Response(**{"success": True, **self._work.result()})
        elif isinstance(error, RobotEnergyError):
            answer = self.interface.Response(message=str(error))
        else:
            self._guard.note(f"service.{self.name}", Exception(repr(error)))
            answer = self.interface.Response(message="internal error: see the log of the node")
        answer.message = shown(answer.message, MAX_LINE)
        log = self._node.get_logger()
        if answer.success:
            log.info(f"{self.name}: {answer.message}")
        else:  # rclpy ties one severity to each place of a call
            log.warning(f"{self.name}: {answer.message}")
        return answer


def predicted(
    model: RobotModel,
    request: Any,
    carried: Sequence[Payload],
    newest_degc: Float,
    calibration: Calibrated,
    stopped: Callable[[], bool] = lambda: False,
) -> Answer:
    """Predict a trajectory.

    Args:
        model: The robot's model.
        request: ``PredictTrajectory.Request``.
        carried: Bodies that the robot carries; links of the model file that are not among
            them carry nothing.
        newest_degc: Motor temperatures where the request has none; NaN where unknown,
            shape (n,). [degC]
        calibration: What a meter has shown of the bands of this model.
        stopped: Asked for every block of samples whether to give up.

    Returns:
        Fields of the response.

    Raises:
        RobotEnergyError: If the trajectory cannot be made or is too long.
        GivenUp: If it was given up.
    """
    # Heavy and seldom used: imported by the first prediction, not by the monitor.
    from robot_energy.motion.joint_trajectory import read_points
    from robot_energy.prediction import predict

    def progress(_: float) -> None:
        if stopped():
            raise GivenUp

    motion = read_points(request.trajectory, NAME)
    degc = temperatures_of(model, motion.joint_names, request.motor_temperature_degc, newest_degc)
    links = {body.link for body in carried}
    changes = [body for body in carried if body not in model.payload]
    changes += [payload(body.link, 0.0) for body in model.payload if body.link not in links]
    result = predict(
        model,
        motion.planned(),
        degc,
        NAME,
        max(1, request.repeat),
        changes,
        progress=progress,
        max_samples=MAX_SAMPLES,
    )
    account, energy = result.account, result.account.registers
    observed = energy.time.observed_ns * NANOSECOND
    account.calibration.restore(calibration)
    band = account.energy_band
    imported, returned = energy.cabinet("grid_import"), energy.cabinet("grid_return")
    where = ", ".join(result.extrapolated)
    outside = f"; friction of {where} was not identified at that temperature" if where else ""
    return {
        "message": f"{imported:.6g} J +- {band.half:.3g} J from the grid in {result.duration:.6g} s"
        f"{outside}",
        "duration": result.duration,
        "predicted_import_energy": imported,
        "predicted_energy_std": band.std,
        "predicted_energy_band": band.half,
        "band": int(band.kind),
        "predicted_return_energy": returned,
        "brake_energy": energy.cabinet("brake"),
        "predicted_peak_power": account.counts.peak_power,
        "predicted_mean_power": (imported - returned) / observed if observed else math.nan,
        "joints": _joints(energy, model.joint_names),
        "motor_temperature_degc": degc.tolist(),
        "extrapolated": bool(result.extrapolated),
    }


PredictionService.answer = staticmethod(predicted)


def _joints(registers: Registers, joint_names: Sequence[str]) -> list[JointEnergy]:
    """Energies of every joint; nothing is measured."""
    columns = {field: registers.joints(name) for name, field in JOINT_FIELDS.items()}
    unmeasured = dict.fromkeys(SHAFT_FIELDS.values(), math.nan)
    return [
        JointEnergy(
            name=name,
            **{field: float(values[index]) for field, values in columns.items()},
            **unmeasured,
        )
        for index, name in enumerate(joint_names)
    ]


def temperatures_of(
    model: RobotModel, joint_names: Sequence[str], given: Sequence[float], newest_degc: Float
) -> Float:
    """Return temperatures in the order of the model: as asked, else the newest, else the fallback.

    Args:
        model: The robot's model.
        joint_names: In the order of ``given``.
        given: As asked; NaN, or empty, where nothing is. [degC]
        newest_degc: NaN where unknown, shape (n,). [degC]

    Returns:
        Shape (n,). [degC]

    Raises:
        MotionError: If there are not as many as joints.
    """
    if len(given) not in (0, len(joint_names)):
        raise MotionError(
            f"{len(given)} motor temperatures were given",
            f"none, or one for each of the {len(joint_names)} joints of the trajectory",
        )
    by_name = dict(zip(joint_names, given, strict=False))
    asked = np.array([by_name.get(name, math.nan) for name in model.joint_names])
    known = np.where(np.isnan(asked), newest_degc, asked)
    return np.where(np.isnan(known), model.temperature.fallback_degc, known)
