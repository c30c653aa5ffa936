"""The experiment of paper A on the rig: energy of one program over start temperatures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from robot_energy.errors import RigError
from robot_energy.model import RobotModel
from robot_energy.motion import Program
from robot_energy.pipeline import EnergyPipeline
from robot_energy.rig.config import RigConfig
from robot_energy.rig.profile import PlantProfile
from robot_energy.rig.record import outputs
from robot_energy.rig.virtual_rig import VirtualRig


@dataclass(frozen=True)
class RigStudyRow:
    """One start temperature.

    Attributes:
        start_temperature_degc: Of motors and gears. [degC]
        true_power: Mean power from the grid. [W]
        peak_power: Greatest power from the grid. [W]
        measured_energy: By the rig's meter, over the compared intervals. [J]
        error: Of the predicted energy over the same intervals, by model, relative to the
            measured energy. [-]
    """

    start_temperature_degc: float
    true_power: float
    peak_power: float
    measured_energy: float
    error: dict[str, float]


def temperature_study(
    profile: PlantProfile,
    program: Program,
    models: Mapping[str, RobotModel],
    start_temperature_degc: Sequence[float] = (20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0),
    duration: float | None = None,
    config: RigConfig | None = None,
    seed: int = 0,
    ambient_degc: float = 20.0,
) -> list[RigStudyRow]:
    """Run the rig from several temperatures and compare models with its meter.

    Args:
        profile: The plant.
        program: The same motions at every temperature.
        models: Models to compare, by name.
        start_temperature_degc: Of motors and gears at the start of each run. [degC]
        duration: Of each run; default one loop of the program. [s]
        config: Effects and sensors of the rig.
        seed: Of the rig; every run has its own, counted up from it.
        ambient_degc: [degC]

    Returns:
        One row per temperature.

    Raises:
        RigError: If a run is too short to compare.
    """
    rows: list[RigStudyRow] = []
    for index, degc in enumerate(start_temperature_degc):
        rig = VirtualRig(profile, program, config, seed + index, degc, ambient_degc)
        pipelines = {name: EnergyPipeline(model) for name, model in models.items()}
        energy, peak, samples = 0.0, 0.0, 0
        for output in outputs(rig, program.period if duration is None else duration):
            power = output.truth.grid_power
            energy, peak = energy + float(power.sum()), max(peak, float(power.max()))
            samples += len(power)
            for pipeline in pipelines.values():
                pipeline.step(output.joints.joint_block(), output.temperatures, output.meter)
        row = RigStudyRow(degc, energy / max(samples, 1), peak, 0.0, {})
        for name, pipeline in pipelines.items():
            pipeline.flush()
            books = pipeline.ledger.comparison
            if not books.measured_energy > 0:
                raise RigError(
                    f"at {degc:g} degC the meter covers nothing",
                    "readings during the run",
                    "run longer",
                )
            row.error[name] = books.predicted_energy / books.measured_energy - 1.0
            row = replace(row, measured_energy=books.measured_energy)
        rows.append(row)
    return rows
