"""Identification: figures of a model from recordings, ready to be run by the monitor."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from robot_energy.api.inputs import ModelName, effort_meaning, model_of
from robot_energy.blocks import EffortMeaning
from robot_energy.errors import ModelFileError, NotIdentifiableError, ParameterError
from robot_energy.identify.data.bags import Bag, BagFacts, Span, facts
from robot_energy.identify.data.recordings import Recording, channels_of, read_recording
from robot_energy.identify.steps import Subject
from robot_energy.inputs.inputs_file import read_inputs
from robot_energy.inputs.sources import Inputs
from robot_energy.model import RobotModel, save
from robot_energy.results.base import Result

if TYPE_CHECKING:
    from robot_energy.identify.data.signals import Channels
    from robot_energy.identify.dynamics.dynamics import DynamicsSettings
    from robot_energy.identify.friction.samples import FrictionData
    from robot_energy.identify.run_all import FullIdentification
    from robot_energy.results.dynamics import DynamicsReport
    from robot_energy.results.identification import (
        CabinetReport,
        FrictionReport,
        IdentificationReport,
    )

EFFORTS = ("motor_torque", "joint_torque", "motor_current")
NEVER_GUESSED = "the effort of a driver is never guessed"
Found = TypeVar("Found", bound=Result)
Stages = Callable[[str], AbstractContextManager[Callable[[float], None]]]
Names = str | Path | Sequence[str | Path]


@contextmanager
def silent(label: str) -> Generator[Callable[[float], None], None, None]:
    """Show no progress.

    Args:
        label: What is going on.

    Yields:
        To be called with the share done, 0 to 1.
    """
    yield lambda share: None


@dataclass(frozen=True)
class IdentificationResult(Generic[Found]):
    """What recordings tell about a robot.

    Attributes:
        model: The model with what was identified.
        found: Figures, standard deviations and held-out errors behind it.
    """

    model: RobotModel
    found: Found

    def save(self, path: str | Path) -> None:
        """Write the model file that the monitor runs.

        Args:
            path: A new file, or one that this tool wrote.

        Raises:
            ModelFileError: If it cannot be written, or must not be replaced.
        """
        save(self.model, path)

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values: the JSON of ``robot-energy identify``."""
        return self.found.to_dict()


def identify_friction(
    bags: Names,
    model: ModelName,
    effort: str | None = None,
    *,
    inputs: str | Path | None = None,
    progress: Stages = silent,
) -> IdentificationResult[FrictionReport]:
    """Identify the friction of every axis over its motor temperature (paper A, eq. 8 to 10).

    Args:
        bags: Recordings of one robot, cold, warm and in between, with measured torque.
        model: Model to begin with: the model, its file, or the name of a shipped one.
        effort: What the effort in the joint states is: ``motor_torque``, ``joint_torque`` or
            ``motor_current``; None: as ``inputs`` says.
        inputs: Parameter file of a monitor: read the bags as that node reads its topics.
        progress: Called with what is going on; gives a function of the share done.

    Returns:
        Laws per axis, and the model with them.

    Raises:
        NotIdentifiableError: If no axis moves enough.
        ImplausibleIdentificationError: If what was found contradicts physics.
        RobotEnergyError: If recordings or model cannot be used.
    """
    from robot_energy.identify.friction.friction import fit_axes, with_friction
    from robot_energy.identify.plausibility import check_friction
    from robot_energy.results.identification import FrictionReport

    used, paths = model_of(model), _paths(bags)
    data = friction_samples(paths, used, effort, inputs, progress)
    source = _names(paths)
    fits, refused = fit_axes(data, source)
    check_friction(fits)
    found = FrictionReport(effort or "measured", tuple(fits), tuple(refused))
    return IdentificationResult(with_friction(used, fits, source), found)


def identify_cabinet(
    bags: Names,
    model: ModelName,
    *,
    link_voltages: tuple[float, float] | None = None,
    inputs: str | Path | None = None,
    progress: Stages = silent,
) -> IdentificationResult[CabinetReport]:
    """Identify constant losses and the DC link from a power meter (paper A, section II-A).

    Args:
        bags: Recordings of one robot with rest and hard braking, with a power meter.
        model: Model to begin with: the model, its file, or the name of a shipped one.
        link_voltages: Of the DC link: rectified mains, start of the brake chopper. [V]
        inputs: Parameter file of a monitor: read the bags as that node reads its topics.
        progress: Called with what is going on; gives a function of the share done.

    Returns:
        Losses with intervals, and the model with them.

    Raises:
        NotIdentifiableError: If the recordings do not show both phases.
        ImplausibleIdentificationError: If what was found contradicts physics.
        RobotEnergyError: If recordings or model cannot be used.
    """
    from robot_energy.identify.cabinet.supply import fit_supply
    from robot_energy.identify.plausibility import check_cabinet
    from robot_energy.results.identification import cabinet_report

    used, paths = model_of(model), _paths(bags)
    recordings = read_recordings(paths, used, None, inputs, False, progress)
    found = fit_supply(recordings, _names(paths), link_voltages)
    check_cabinet(found.cabinet)
    return IdentificationResult(found.model, cabinet_report(found))


def identify_dynamics(
    bags: Names,
    model: ModelName,
    effort: str | None = None,
    *,
    settings: DynamicsSettings | None = None,
    inputs: str | Path | None = None,
    progress: Stages = silent,
) -> IdentificationResult[DynamicsReport]:
    """Identify bodies, rotors and friction from motion and motor torque.

    Args:
        bags: Recordings of one robot in which all joints move at once.
        model: Model to begin with: the model, its file, or the name of a shipped one.
        effort: What the effort in the joint states is: ``motor_torque``, ``joint_torque`` or
            ``motor_current``; None: as ``inputs`` says.
        settings: Regression, columns and filters; None for those of the command.
        inputs: Parameter file of a monitor: read the bags as that node reads its topics.
        progress: Called with what is going on; gives a function of the share done.

    Returns:
        Parameters with standard deviations, and the model with them.

    Raises:
        NotIdentifiableError: If the motion does not excite the parameters.
        ImplausibleIdentificationError: If what was found contradicts physics.
        RobotEnergyError: If recordings or model cannot be used.
    """
    from robot_energy.identify.dynamics.dynamics import DynamicsSettings, identify_dynamics
    from robot_energy.identify.dynamics.dynamics_model import to_model
    from robot_energy.identify.plausibility import check_dynamics
    from robot_energy.results.dynamics import dynamics_report

    used, paths = model_of(model), _paths(bags)
    recordings = dynamics_channels(paths, used, effort, inputs, progress)
    stretches = [part for parts in recordings.values() for part in parts]
    with progress("identifying"):
        result = identify_dynamics(stretches, used, settings or DynamicsSettings())
    held_out, consistent = result.held_out(), result.held_out_consistent()
    check_dynamics(result, consistent)
    written = to_model(result, [path.name for path in paths])
    return IdentificationResult(written, dynamics_report(result, held_out, consistent))


def identify_all(
    bags: Names,
    model: ModelName,
    effort: str | None = None,
    *,
    test: Names = (),
    held_out: bool = True,
    skip: Sequence[Subject] = (),
    drive_power: str | None = None,
    drive_joints: Sequence[str] | None = None,
    link_voltages: tuple[float, float] | None = None,
    inputs: str | Path | None = None,
    progress: Stages = silent,
) -> IdentificationResult[IdentificationReport]:
    """Identify everything that the recordings allow, and test it on what was held out.

    Args:
        bags: Recordings of one robot.
        model: Model to begin with: the model, its file, or the name of a shipped one.
        effort: What the effort in the joint states is: ``motor_torque``, ``joint_torque`` or
            ``motor_current``; None: as ``inputs`` says. Without it neither bodies nor friction
            can be identified.
        test: Recordings for the test alone.
        held_out: Whether to test the energy on held-out recordings.
        skip: Subjects that stay as the model has them.
        drive_power: Topic of an array with the power of each drive. [W]
        drive_joints: Joints in the order of that array; None: of the model.
        link_voltages: Of the DC link: rectified mains, start of the brake chopper. [V]
        inputs: Parameter file of a monitor: read the bags as that node reads its topics.
        progress: Called with what is going on; gives a function of the share done.

    Returns:
        Every step with its reason where nothing was found, and the model with all of them.

    Raises:
        NotIdentifiableError: If nothing can be identified, with the reason of every step.
        RobotEnergyError: If recordings or model cannot be used.
    """
    from robot_energy.identify.run_all import identify_everything, with_provenance
    from robot_energy.identify.stats.held_out_energy import folds_of, held_out_energy
    from robot_energy.results.identification import identification_report

    given = model_of(model)
    source = (effort, inputs, drive_power, drive_joints)
    fitted, refused = _bags(_paths(bags), given, *source)
    tests, _ = _bags(_paths(test), given, *source)
    known: list[tuple[BagFacts, Span]] = []
    for bag in (*fitted, *tests):
        with progress(f"reading {bag.name}") as report:
            recording = bag.whole(given, report)
        known.append((facts(bag, recording), recording.span_ns))
    read = [entry for entry, _ in known[: len(fitted)]]
    with progress("identifying") as report:
        whole = identify_everything(
            fitted, given, skip, lambda _, share: report(share), refused, link_voltages
        )
    _require_something(whole)
    energy = None
    if held_out:
        kind, folds = folds_of(fitted, tests, [span for _, span in known])
        with progress("testing on what was held out") as report:
            energy = held_out_energy(kind, folds, whole, skip, lambda _, share: report(share))
    written = with_provenance(whole, read)
    tested = [entry for entry, _ in known[len(fitted) :]]
    found = identification_report(whole, written, read, tested, energy)
    return IdentificationResult(written, found)


def read_sources(
    effort: str | None, inputs: str | Path | None
) -> tuple[EffortMeaning, Inputs | None]:
    """Return what the effort means, as given or else by the parameter file, and the inputs.

    Args:
        effort: What the effort in the joint states is.
        inputs: Parameter file of a monitor.

    Raises:
        RobotEnergyError: If the parameter file cannot be used.
    """
    read = None
    if inputs is not None:
        read, notes = read_inputs(inputs)
        if notes:
            raise ParameterError(notes[0], remedy=f"change {inputs}")
    named = effort or (
        read.joint_states.effort_meaning if read is not None else EffortMeaning.NONE.value
    )
    return effort_meaning(named), read


def read_recordings(
    bags: Sequence[str | Path],
    model: RobotModel,
    effort: str | None = None,
    inputs: str | Path | None = None,
    needs_effort: bool = False,
    progress: Stages = silent,
) -> list[Recording]:
    """Run bags through the stages of the monitor.

    Args:
        bags: MCAP files or rosbag2 folders.
        model: Of the robot.
        effort: What the effort in the joint states is.
        inputs: Parameter file of a monitor.
        needs_effort: Whether to refuse an effort without a meaning.
        progress: Called with what is going on; gives a function of the share done.

    Raises:
        RobotEnergyError: If a bag cannot be used, or its effort has no meaning but needs one.
    """
    meaning, read = read_sources(effort, inputs)
    if needs_effort and meaning is EffortMeaning.NONE:
        raise ModelFileError(
            f"{inputs or 'nothing'} does not say what the effort means",
            f"an effort, one of {', '.join(EFFORTS)}",
            NEVER_GUESSED,
        )
    recordings: list[Recording] = []
    for bag in bags:
        with progress(f"reading {Path(bag).name}") as report:
            recordings.append(read_recording(bag, model, meaning, None, report, read))
    return recordings


def friction_samples(
    bags: Sequence[str | Path],
    model: RobotModel,
    effort: str | None,
    inputs: str | Path | None,
    progress: Stages = silent,
) -> list[FrictionData]:
    """Return what is needed to identify friction, one entry per joint.

    Args:
        bags: MCAP files or rosbag2 folders.
        model: Of the robot.
        effort: What the effort in the joint states is.
        inputs: Parameter file of a monitor.
        progress: Called with what is going on; gives a function of the share done.

    Raises:
        RobotEnergyError: If a bag cannot be used, or a joint turns the other way.
    """
    from robot_energy.identify.friction.samples import friction_data
    from robot_energy.identify.plausibility import check_signs

    recordings = read_recordings(bags, model, effort, inputs, True, progress)
    check_signs(recordings, read_sources(effort, inputs)[0])
    return [friction_data(recordings, joint) for joint in range(len(model.joints))]


def dynamics_channels(
    bags: Sequence[str | Path],
    model: RobotModel,
    effort: str | None,
    inputs: str | Path | None,
    progress: Stages = silent,
) -> dict[str, list[Channels]]:
    """Return evenly sampled motion and torque of each recording by its name.

    Args:
        bags: MCAP files or rosbag2 folders.
        model: Of the robot.
        effort: What the effort in the joint states is.
        inputs: Parameter file of a monitor.
        progress: Called with what is going on; gives a function of the share done.

    Raises:
        RobotEnergyError: If a bag cannot be used, or a joint turns the other way.
    """
    from robot_energy.identify.plausibility import check_signs

    read = read_recordings(bags, model, effort, inputs, True, progress)
    check_signs(read, read_sources(effort, inputs)[0])
    recordings: dict[str, list[Channels]] = {}
    rate: float | None = None
    for bag, part in zip(bags, read, strict=True):
        found = channels_of([part], rate=rate)
        rate = found[0].rate
        name = Path(bag).name
        recordings[str(bag) if name in recordings else name] = found
    return recordings


def _bags(
    paths: Sequence[Path],
    model: RobotModel,
    effort: str | None,
    inputs: str | Path | None,
    drive_power: str | None,
    drive_joints: Sequence[str] | None,
) -> tuple[list[Bag], str]:
    """The bags, and why their effort cannot be used; empty if it can, or was not told."""
    from robot_energy.identify.drives.drive_power import read_drive_power
    from robot_energy.identify.run_all import usable_effort

    meaning, read = read_sources(effort, inputs)
    refused = usable_effort(model, meaning)
    used = EffortMeaning.NONE if refused else meaning
    return [
        Bag(
            path,
            used,
            read,
            read_drive_power(path, drive_power, model.joint_names, drive_joints)
            if drive_power
            else None,
        )
        for path in paths
    ], refused


def _require_something(whole: FullIdentification) -> None:
    """Refuse to report where not one step could be done.

    Raises:
        NotIdentifiableError: With the reason of every step.
    """
    if all(step.found is None for step in whole.steps):
        reasons = " ".join(f"{step.subject.capitalize()}: {step.reason}" for step in whole.steps)
        raise NotIdentifiableError(
            f"nothing can be identified from these recordings. {reasons}",
            remedy="record with torque or current, temperature, or a power meter",
        )


def _paths(bags: Names) -> list[Path]:
    return [Path(bags)] if isinstance(bags, str | Path) else [Path(bag) for bag in bags]


def _names(paths: Sequence[Path]) -> str:
    return ", ".join(path.name for path in paths)
