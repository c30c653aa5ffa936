"""How good a model is on recordings, fitted or not."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, Unpack

import numpy as np

from robot_energy.foundation.errors import BagError
from robot_energy.foundation.options import takes
from robot_energy.model import RobotModel
from robot_energy.pipeline import Output, Settings
from robot_energy.replay.api import FALLBACK, fixed_friction
from robot_energy.replay.bag_replay import replay
from robot_energy.replay.options import ReplayOptions
from robot_energy.replay.setup import ModelName, ReplaySetup, model_of
from robot_energy.results.base import model_used
from robot_energy.results.replay import ReplayReport, replay_report
from robot_energy.timeline.blocks import EffortMeaning, Quality
from robot_energy.timeline.pieces import NO_INTERVALS, Compared
from robot_energy_identify.check.meter_step import by_second, step_of
from robot_energy_identify.provenance import sha256_of
from robot_energy_identify.results.evaluation import (
    FIXED,
    MODEL,
    EvaluationReport,
    ModelScore,
    RecordingScore,
    ScoreSums,
    TorqueErrorSums,
    seen_in_fit,
)

LONGER = 5.0 * Settings.derivative_window  # window of accelerations that is tried as well [s]
WINDOW = "longer window"
CORRECTED = (
    "the measured torque has corrected the temperatures that friction follows, as in the monitor: "
    "torque errors of the model without it may be larger"
)
BETTER = 0.9  # torque error with it over that without, from which on it is worth a sentence [-]


@takes(ReplayOptions)
def evaluate(
    bags: str | Path | Sequence[str | Path],
    model: ModelName,
    *,
    temperature: float | Literal["fallback"] = FALLBACK,
    **options: Unpack[ReplayOptions],
) -> EvaluationReport:
    """Compare a model with what was measured in recordings: torque, shafts, meter.

    The model is run as the monitor runs it. The same model with friction at one temperature,
    and a prediction of nothing, are compared in the same way, so that the errors have a scale.

    Args:
        bags: MCAP files or rosbag2 folders, with measured torque, a power meter, or both.
        model: A model, its file, or the name of a shipped one.
        temperature: Of the fixed friction; ``fallback``: that which the model assumes without
            measurement. [degC]
        **options: What is read and how: see `ReplayOptions`; ``effort`` says what the torque is.

    Returns:
        Errors of each recording and of all together, and whether each was held out.

    Raises:
        BagError: If a bag cannot be read, or nothing was measured in any.
        RobotEnergyError: If the model or an option cannot be used.
    """
    used = model_of(model)
    fixed, change = fixed_friction(used, temperature)
    paths = [bags] if isinstance(bags, str | Path) else list(bags)
    if not paths:
        raise BagError("no recording", "one or more")
    runs: list[tuple[str, RobotModel, str | None, ReplayOptions]] = [
        (MODEL, used, None, {}),
        (FIXED, fixed, change, {}),
    ]
    if all(options.get(name) is None for name in ("derivative_window", "out", "inputs")):
        runs.append((WINDOW, used, None, {"derivative_window": LONGER}))
    done, progress = 0, options.get("progress")
    together: dict[str, ScoreSums] = {}
    recordings: list[RecordingScore] = []
    effort = ""

    def show(share: float) -> None:
        if progress is not None:
            progress((done + share) / (len(paths) * len(runs)))

    for path in paths:
        sums: dict[str, ScoreSums] = {}
        for name, variant, text, more in runs:
            report, sums[name], degc = _run(
                path, variant, text, {**options, **more, "progress": show}
            )
            done += 1
            if name == MODEL:
                effort = EffortMeaning.NONE.value if report.shaft is None else report.shaft.effort
                recordings.append(_recording(path, used, report, degc))
        notes = recordings[-1].notes
        if WINDOW in sums:
            notes = (*notes, *_of_window(sums[MODEL], sums.pop(WINDOW)))
        recordings[-1] = replace(recordings[-1], scores=_scores(sums), notes=notes)
        for name, found in sums.items():
            together[name] = together[name].plus(found) if name in together else found
    if all(one.measured_energy is None and one.scores[0].all_joints is None for one in recordings):
        raise BagError(
            f"neither torque nor power was measured in {', '.join(map(str, paths))}",
            "recordings with a power meter, or with torque or current in the joint states",
            "say with --effort what the effort is",
        )
    return EvaluationReport(model_used(used), effort, tuple(recordings), _scores(together))


def _scores(sums: Mapping[str, ScoreSums]) -> tuple[ModelScore, ...]:
    return (*(one.score(name) for name, one in sums.items()), sums[MODEL].zero())


def _run(
    path: str | Path, model: RobotModel, change: str | None, options: ReplayOptions
) -> tuple[ReplayReport, ScoreSums, tuple[float, float]]:
    torque, degc = TorqueErrorSums(model), [math.inf, -math.inf]
    compared = [NO_INTERVALS]

    def take(output: Output) -> None:
        if output.power is None:
            return
        torque.step(output.power)
        warm = output.power.motor_temperature_degc
        warm = warm[np.isfinite(warm)]
        if len(warm):
            degc[:] = min(degc[0], float(warm.min())), max(degc[1], float(warm.max()))

    def compare(part: Compared) -> None:
        compared.append(by_second(part))

    result = replay(path, model, ReplaySetup.of(options), on_output=take, on_compared=compare)
    torque.finish()
    report = replay_report(result, change)
    notes = list(report.notes)
    step = step_of(Compared.concatenate(compared), result.account.registers.time.start_ns or 0)
    if step is not None:
        notes.append(f"{step.sentence}: {step.remedy}")
    estimated = result.account.counts.quality[Quality.TEMPERATURE_ESTIMATED]
    if report.shaft is not None and (estimated or any(joint.gear for joint in model.joints)):
        notes.append(CORRECTED)
    report = replace(report, notes=tuple(notes))
    return report, ScoreSums.of(report, torque, result.power_error), (degc[0], degc[1])


def _of_window(given: ScoreSums, longer: ScoreSums) -> list[str]:
    before, after = (float(one.torque.relative_of_all[1]) for one in (given, longer))
    if not after < BETTER * before:
        return []
    return [
        f"accelerations from {LONGER:g} s in place of {Settings.derivative_window:g} s would lower "
        f"the error of the motor torque from {100 * before:.1f} to {100 * after:.1f} %: set "
        f"derivative_window to {LONGER:g} (--derivative-window; the parameter of the node)"
    ]


def _recording(
    path: str | Path, model: RobotModel, report: ReplayReport, degc: tuple[float, float]
) -> RecordingScore:
    bag = Path(path).resolve()
    sha256 = sha256_of(bag)
    seen, reason = seen_in_fit(model, bag.name, sha256)
    meter = report.comparison
    place = None if meter.measured_energy is None else meter.meter_location
    return RecordingScore(
        bag.name, sha256, seen, reason, report.origin, report.time.observed_time, *degc,
        place, meter.compared_time, meter.measured_energy,
        meter.half_relative, report.uncertainty.inside_parametric, (), report.problems,
        report.notes,
    )  # fmt: skip
