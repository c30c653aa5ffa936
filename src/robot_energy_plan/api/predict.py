"""Prediction: the energy of a motion before it is made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any, Unpack

from robot_energy.foundation.described import Described
from robot_energy.foundation.options import takes
from robot_energy.foundation.shown import Shown
from robot_energy.model import RobotModel
from robot_energy.physics.rigid_body import Robot
from robot_energy.replay.power_table import power_table
from robot_energy.replay.setup import ModelName, model_of
from robot_energy.results.energy import EnergyBreakdown, JointEnergy, PhaseEnergy
from robot_energy.timeline.blocks import Float
from robot_energy.timeline.time_series import TimeSeries
from robot_energy_plan import prediction
from robot_energy_plan.motion.load_motion import LoadedMotion, ToolOptions, load_motion
from robot_energy_plan.motion.planned import PlannedMotion
from robot_energy_plan.options import PredictOptions
from robot_energy_plan.prediction import Prediction
from robot_energy_plan.results.prediction import PredictionReport, prediction_report


class PredictionResult(Described, Shown):
    """The energy of a motion that has not been made."""

    program: Annotated[str, "Name of the motion."]
    model: Annotated[RobotModel, "The model used."]
    duration: Annotated[float, "Of all repetitions. [s]"]
    power: Annotated[
        TimeSeries,
        "Mean power over short periods, with the columns of a replay but those of the meter; "
        "stamps begin at 1 s.",
    ]
    energy: Annotated[EnergyBreakdown, "Where the energy will go."]
    joints: Annotated[tuple[JointEnergy, ...], "The same per joint, in model order."]
    phases: Annotated[dict[str, PhaseEnergy], "By phase: ``hold``, ``motion``, ``generating``."]
    notes: Annotated[tuple[str, ...], "What a reader should know, one sentence each."]
    problems: Annotated[tuple[str, ...], "What makes the figures doubtful, one sentence each."]
    report: Annotated[PredictionReport, "All figures, those above among them."] = field(repr=False)
    prediction: Annotated[Prediction, "The accounting behind the figures."] = field(repr=False)

    def __repr__(self) -> str:
        return (
            f"PredictionResult({self.program}, {self.model.robot.type}, {self.duration:.1f} s: "
            f"{self.energy.net:.0f} J)"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values: a run in the JSON of ``robot-energy predict``."""
        return self.report.to_dict()


@takes(PredictOptions)
def predict(
    program: str | Path | PlannedMotion | LoadedMotion,
    model: ModelName,
    temperature: float | Sequence[float] | Float,
    *,
    topic: str | None = None,
    tool: ToolOptions | None = None,
    **options: Unpack[PredictOptions],
) -> PredictionResult:
    """Predict the energy of a motion program.

    Args:
        program: G-code, a YAML file of moves, a bag or CSV with a JointTrajectory; or a motion
            in memory, such as a `robot_energy_plan.motion.planned.SampledMotion`.
        model: A model, its file, or the name of a shipped one.
        temperature: Of all motors, or one per joint, held throughout. [degC]
        topic: Of the JointTrajectory in a bag.
        tool: What G-code does not state.
        **options: What is predicted: see `PredictOptions`. A payload counts besides what the
            model has on other links, which is noted.

    Returns:
        Power over time and energies.

    Raises:
        MotionError: If the motion cannot be made, or is too long.
        RobotEnergyError: If program or model cannot be used.
    """
    used = model_of(model)
    if isinstance(program, str | Path):
        program = load_motion(program, Robot.from_model(used), tool, topic)
    motion = program if isinstance(program, LoadedMotion) else LoadedMotion(program, "the motion")
    given: PredictOptions = {"repeat": motion.repeat, **options}
    result = prediction.predict(
        used, motion.motion, temperature, motion.name, notes=motion.notes, **given
    )
    report = prediction_report(result, motion)
    means = [] if result.means is None else [result.means]
    power = power_table(means, used.joint_names, unmodelled=used.unmodelled)
    return PredictionResult(
        program=result.program,
        model=used,
        duration=result.duration,
        power=power,
        energy=report.energy,
        joints=report.joints,
        phases=report.phases,
        notes=report.notes,
        problems=report.problems,
        report=report,
        prediction=result,
    )
