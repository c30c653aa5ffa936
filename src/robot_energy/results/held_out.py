"""Energy on recordings that an identified model has not seen."""

from __future__ import annotations

from dataclasses import dataclass

from robot_energy.identify.stats.held_out_energy import HeldOutEnergy
from robot_energy.results.base import Number, Result


@dataclass(frozen=True)
class HeldOutFigures(Result):
    """A model on one held-out recording.

    Attributes:
        energy: Predicted, where it was compared; None without a meter. [J]
        relative: Predicted over measured energy less 1. [-]
        rms: Of predicted less measured power, per reading. [W]
        shaft_energy: Of all axes, from the model's torque. [J]
    """

    energy: Number
    relative: Number
    rms: Number
    shaft_energy: Number


@dataclass(frozen=True)
class HeldOutRecording(Result):
    """One held-out recording.

    Attributes:
        name: Of the recording, or of the block.
        compared_time: Time that was compared with the meter. [s]
        measured_energy: That the meter saw in it. [J]
        measured_shaft_energy: Of all axes. [J]
        beyond_fit_kelvin: How far a motor was colder or warmer than in the fit. [K]
        taken: Subjects of which this test's model has new figures.
        predicted: By ``given`` and by each subject, as the model was after its step.
    """

    name: str
    compared_time: float
    measured_energy: Number
    measured_shaft_energy: Number
    beyond_fit_kelvin: float
    taken: tuple[str, ...]
    predicted: dict[str, HeldOutFigures]


@dataclass(frozen=True)
class HeldOutReport(Result):
    """Energy on recordings that the model has not seen.

    Attributes:
        held_out: ``test``, ``recordings`` or ``blocks``.
        stages: ``given``, then the subjects in the order of the steps.
        recordings: One entry per held-out recording or block.
        mean_error: Mean size of the energy error, by stage; None without a meter. [-]
    """

    held_out: str
    stages: tuple[str, ...]
    recordings: tuple[HeldOutRecording, ...]
    mean_error: dict[str, Number]


def held_out_report(test: HeldOutEnergy) -> HeldOutReport:
    """Return the test of the whole.

    Args:
        test: The test.
    """
    return HeldOutReport(
        test.kind,
        test.stages,
        tuple(
            HeldOutRecording(
                name=entry.name,
                compared_time=entry.duration,
                measured_energy=entry.measured,
                measured_shaft_energy=entry.shaft,
                beyond_fit_kelvin=entry.beyond,
                taken=entry.taken,
                predicted={
                    stage: HeldOutFigures(
                        part.energy if entry.measured > 0 else None,
                        entry.error(stage),
                        part.rms,
                        part.shaft,
                    )
                    for stage, part in entry.predictions.items()
                },
            )
            for entry in test.tested
        ),
        {stage: test.mean_error(stage) if test.metered else None for stage in test.stages},
    )
