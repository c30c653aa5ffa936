# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""What ``~/compare_trajectories`` answers: which of several trajectories is the cheapest."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from robot_energy.accounting.record import Calibrated
from robot_energy.foundation.errors import MotionError, UnknownJointError
from robot_energy.foundation.shown_text import MAX_LINE, shown
from robot_energy.model import RobotModel
from robot_energy.model.payload import Payload, several_carried
from robot_energy.timeline.blocks import Float
from ros2_energy_monitor.services.predict_trajectory import (
    MAX_SAMPLES,
    Answer,
    temperatures_of,
)

MAX_CANDIDATES = 100  # the srv file says so


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
    degc = temperatures_of(model, request.joint_names, request.motor_temperature_degc, newest_degc)
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
