# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What ``~/predict_trajectory`` and ``~/compare_trajectories`` answer, before anything moves."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from robot_energy.accounting.record import Calibrated
from robot_energy.accounting.registers import Registers
from robot_energy.foundation.errors import MotionError, UnknownJointError
from robot_energy.foundation.shown_text import MAX_LINE, shown
from robot_energy.messages.fields import JOINT_FIELDS, SHAFT_FIELDS
from robot_energy.model import RobotModel
from robot_energy.model.payload import Payload, payload, several_carried
from robot_energy.timeline.blocks import NANOSECOND, Float, known_part

MAX_SAMPLES = 1_000_000  # of all repetitions; the srv file says so
MAX_CANDIDATES = 100  # the srv file says so
NAME = "the trajectory"
Answer = dict[str, Any]


def predicted(
    model: RobotModel,
    request: Any,
    carried: Sequence[Payload],
    newest_degc: Float,
    calibration: Calibrated,
) -> Answer:
    """Return the fields of the response, each joint as fields of a ``JointEnergy``.

    Args:
        request: Fields of a ``PredictTrajectory.Request``, its trajectory as `PointColumns`.
        carried: Bodies that the robot carries; links of the model file that are not among
            them carry nothing.
        newest_degc: Motor temperatures where the request has none; NaN where unknown,
            shape (n,). [degC]
        calibration: What a meter has shown of the bands of this model.
    """
    # Heavy: imported by the process that predicts, not by the monitor.
    from robot_energy_plan.motion.joint_trajectory import through_points
    from robot_energy_plan.prediction import predict

    motion = through_points(request.trajectory, NAME)
    model, degc = at_temperatures(
        model, motion.joint_names, request.motor_temperature_degc, newest_degc
    )
    links = {body.link for body in carried}
    changes = [body for body in carried if body not in model.payload]
    changes += [payload(body.link, 0.0) for body in model.payload if body.link not in links]
    result = predict(
        model,
        motion.planned(),
        degc,
        NAME,
        repeat=max(1, request.repeat),
        payload=changes,
        max_samples=MAX_SAMPLES,
    )
    account, energy = result.account, result.account.registers
    observed = energy.time.observed_ns * NANOSECOND
    account.calibration.restore(calibration)
    band = account.energy_band
    imported, returned = energy.cabinet("grid_import"), energy.cabinet("grid_return")
    where = ", ".join(result.extrapolated)
    outside = f"; friction of {where} was not identified at that temperature" if where else ""
    said = f"{imported:.6g} J +- {band.half:.3g} J from the grid in {result.duration:.6g} s"
    return {
        "message": "; ".join([*result.limits.sentences(), f"{said}{outside}", *result.notes]),
        "duration": result.duration,
        "predicted_import_energy": imported,
        "predicted_energy_std": band.std,
        "predicted_energy_band": band.half,
        "band": int(band.kind),
        "predicted_return_energy": returned,
        "brake_energy": energy.cabinet("brake"),
        "predicted_peak_power": account.counts.peak_power,
        "predicted_mean_power": (imported - returned) / observed if observed else math.nan,
        "joints": _joints(energy, model),
        "motor_temperature_degc": degc.tolist(),
        "extrapolated": bool(result.extrapolated),
    }


def _joints(registers: Registers, model: RobotModel) -> list[dict[str, Any]]:
    """Energies of every joint; nothing is measured."""
    columns = {
        field: known_part(name, registers.joints(name), model.unmodelled)
        for name, field in JOINT_FIELDS.items()
    }
    unmeasured = dict.fromkeys(SHAFT_FIELDS.values(), math.nan)
    return [
        {
            "name": name,
            **{field: float(values[index]) for field, values in columns.items()},
            **unmeasured,
        }
        for index, name in enumerate(model.joint_names)
    ]


def at_temperatures(
    model: RobotModel, joint_names: Sequence[str], given: Sequence[float], newest_degc: Float
) -> tuple[RobotModel, Float]:
    """Return temperatures as asked, else the newest, else the fallback, shape (n,). [degC]

    The newest are readings, by which friction was found; a prediction takes what it is given for
    those of the motors. So the limits of a fan move by what the errors of the thermometers do to
    the warmest motor, in the model that is returned.

    Args:
        joint_names: In the order of ``given``.
        given: As asked; NaN, or empty, where nothing is. [degC]
        newest_degc: NaN where unknown, shape (n,). [degC]
    """
    if len(given) not in (0, len(joint_names)):
        raise MotionError(
            f"{len(given)} motor temperatures were given",
            f"none, or one for each of the {len(joint_names)} joints of the trajectory",
        )
    by_name = dict(zip(joint_names, given, strict=False))
    asked = np.array([by_name.get(name, math.nan) for name in model.joint_names])
    known = np.where(np.isnan(asked), newest_degc, asked)
    degc = np.where(np.isnan(known), model.temperature.fallback_degc, known)
    fan = model.cabinet.fan
    if fan is None or fan.thermometers is None:
        return model, degc
    read = np.isnan(asked) & ~np.isnan(newest_degc)
    above = float(degc.max() - (degc - np.where(read, fan.thermometers, 0.0)).max())
    limits = {
        name: limit.model_copy(update={"value": limit.value + above})
        for name in ("on_above_degc", "begins_off_to_degc")
        if (limit := getattr(fan, name)) is not None
    }
    moved = model.cabinet.model_copy(update={"fan": fan.model_copy(update=limits)})
    return model.changed(cabinet=moved), degc


def compared(
    model: RobotModel,
    request: Any,
    carried: Sequence[Payload],
    newest_degc: Float,
    calibration: Calibrated,
) -> Answer:
    """Return the fields of the response, each candidate as fields of a ``CandidateEnergy``.

    Args:
        request: Fields of a ``CompareTrajectories.Request``, its trajectories as `PointColumns`.
        newest_degc: Motor temperatures where the request has none; NaN where unknown,
            shape (n,). [degC]
        calibration: What a meter has shown of the bands of this model.
    """
    # Heavy: imported by the process that predicts, not by the monitor.
    from robot_energy_plan.motion.joint_trajectory import JointTrajectory, through_points
    from robot_energy_plan.optimization.comparison import compare_motions

    def candidate(number: int) -> Callable[[], JointTrajectory]:
        return lambda: through_points(request.trajectories[number], f"trajectory {number}")

    if foreign := sorted(set(request.joint_names) - set(model.joint_names)):
        raise UnknownJointError(
            f"a temperature was given for {foreign[0]}",
            f"joints of the model, {', '.join(model.joint_names)}",
        )
    if len(request.motor_temperature_degc) != len(request.joint_names):
        raise MotionError(
            f"{len(request.motor_temperature_degc)} motor temperatures were given",
            f"one for each of the {len(request.joint_names)} joint names",
        )
    model, degc = at_temperatures(
        model, request.joint_names, request.motor_temperature_degc, newest_degc
    )
    result = compare_motions(
        model.changed(payload=list(carried)),
        [candidate(number) for number in range(len(request.trajectories))],
        degc,
        cycle_time=request.cycle_time,
        peak_limit=request.peak_limit or math.inf,
        calibration=calibration,
        max_samples=MAX_SAMPLES,
    )
    best = result.cheapest
    advantage, half = result.advantage
    candidates: list[Answer] = []
    for one in result.candidates:
        more = (math.nan, math.nan) if best is None else one.more_than(result.candidates[best])
        candidates.append(
            {
                "feasible": one.feasible,
                "message": shown(one.message, MAX_LINE),
                "duration": one.duration,
                "predicted_energy": one.energy,
                "predicted_energy_band": one.half,
                "predicted_peak_power": one.peak,
                "more_energy": more[0],
                "more_energy_band": more[1],
            }
        )
    if best is None:
        message = "no trajectory is feasible; expected one at least; see the message of each"
    else:
        message = f"trajectory {best} is the cheapest of {len(result.order)} that are feasible"
        if advantage > half:
            message += f", by {advantage:.4g} J +- {half:.2g} J"
        elif len(result.order) > 1:
            message += (
                f"; the next needs {advantage:.4g} J more, less than its band of {half:.2g} J"
            )
    if several := several_carried(carried):
        message += f"; the robot carries {several}"
    return {
        "success": best is not None,
        "message": message,
        "candidates": candidates,
        "cheapest": -1 if best is None else best,
        "advantage": advantage,
        "advantage_band": half,
        "advantage_certain": bool(advantage > half),
    }
