"""Identification: figures of a model from recordings, ready to be run by the monitor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeVar, Unpack

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.foundation.options import takes
from robot_energy.foundation.shown import Shown
from robot_energy.model import RobotModel, save
from robot_energy.replay.setup import ModelName, model_of
from robot_energy.results.base import Result
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_identify.api.bag_source import BagSource
from robot_energy_identify.auxiliary import (
    LoadsFit,
    LoadStatesReport,
    fit_outlet,
    fit_own,
    outlet_readings,
    own_readings,
    read_loads,
    with_states,
)
from robot_energy_identify.cabinet.supply import CabinetReport, fit_supply
from robot_energy_identify.check.evidence import Evidence
from robot_energy_identify.data.bags import BagFacts, Kept, Span, facts, folds_of
from robot_energy_identify.data.observations import Channels
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.drives.drive_power import drive_topics
from robot_energy_identify.dynamics.dynamics import DynamicsReport, DynamicsSettings
from robot_energy_identify.dynamics.dynamics import identify_dynamics as fit_dynamics
from robot_energy_identify.dynamics.dynamics_model import to_model
from robot_energy_identify.dynamics.leave_one_out import across_recordings
from robot_energy_identify.friction_and_thermal import (
    FrictionReport,
    ThermalReport,
    find_friction,
    find_thermal,
)
from robot_energy_identify.options import IdentifyOptions, SourceOptions, silent
from robot_energy_identify.plausibility import check_cabinet, check_dynamics, check_signs
from robot_energy_identify.provenance import hashed, identified_from, require_distinct, require_some
from robot_energy_identify.refused_recordings import (
    bodies_known,
    cause_named,
    evidence_of_rows,
    notes_on_torque,
    on_one_clock,
    refuse_meter,
    refuse_motion,
    refuse_shared,
    refuse_torque,
    stepping_meters,
    torque_evidence,
)
from robot_energy_identify.results.identification import (
    IdentificationReport,
    identification_report,
)
from robot_energy_identify.run_all import identify_everything, own_energies, with_provenance
from robot_energy_identify.stats.held_out_energy import held_out_energy
from robot_energy_identify.stats.systematic import DEFAULT_LIMITS
from robot_energy_identify.thermal.network import without_networks

Found = TypeVar("Found", bound=Result)
Names = str | Path | Sequence[str | Path]


@dataclass(frozen=True)
class IdentificationResult(Shown, Generic[Found]):
    """What recordings say about a robot.

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


@takes(SourceOptions)
def identify_friction(
    bags: Names | BagSource,
    model: ModelName,
    effort: str | None = None,
    *,
    share_shape: bool = False,
    **options: Unpack[SourceOptions],
) -> IdentificationResult[FrictionReport]:
    """Identify the friction of every axis over its motor temperature (paper A, eq. 8 to 10).

    Args:
        bags: Recordings of one robot, cold, warm and in between, with measured torque;
            or how they are read.
        model: Model to begin with: the model, its file, or the name of a shipped one.
        effort: What the effort in the joint states is: ``motor_torque``, ``joint_torque`` or
            ``motor_current``; None: as ``inputs`` says.
        share_shape: Whether axes of too small a range borrow the temperature shape of others.
        **options: How the recordings are read: see `SourceOptions`.

    Returns:
        Laws per axis, and the model with them.

    Raises:
        NotIdentifiableError: If no axis moves enough.
        ImplausibleIdentificationError: If what was found contradicts physics.
        RobotEnergyError: If recordings or model cannot be used.
    """
    used, read = model_of(model), _source(bags, effort, options)
    recordings, (meaning, _) = read.with_effort(used), read.meaning()
    source = read.names
    with cause_named(lambda: [torque_evidence(part, meaning) for part in recordings]):
        found = find_friction(recordings, used, source, share_shape)
    found = replace(found, effort=read.effort or "measured")
    written = _made_from(found.write(used, source), "Friction identified.", read)
    return IdentificationResult(written, found)


@takes(SourceOptions)
def identify_thermal(
    bags: Names | BagSource,
    model: ModelName,
    *,
    ambient_degc: float | None = None,
    **options: Unpack[SourceOptions],
) -> IdentificationResult[ThermalReport]:
    """Identify the thermal network of every motor from the losses of the model.

    Args:
        bags: Recordings of one robot from a cold start, with motor temperatures; or how they
            are read.
        model: Model with friction and drives; the model, its file, or the name of a shipped one.
        ambient_degc: Temperature of the air; None: the coldest first reading. [degC]
        **options: How the recordings are read: see `SourceOptions`.

    Returns:
        Networks with held-out errors, and the model with them.

    Raises:
        NotIdentifiableError: If no motor warms enough, or losses predict no temperature.
        RobotEnergyError: If recordings or model cannot be used.
    """
    used, read = model_of(model), _source(bags, None, options)
    recordings = read.recordings(without_networks(used))
    with read.progress("identifying"):
        found = find_thermal(recordings, used, ambient_degc, read.names)
    written = _made_from(found.write(used), "Thermal networks identified.", read)
    return IdentificationResult(written, found)


@takes(SourceOptions)
def identify_cabinet(
    bags: Names | BagSource,
    model: ModelName,
    *,
    link_voltages: tuple[float, float] | None = None,
    **options: Unpack[SourceOptions],
) -> IdentificationResult[CabinetReport]:
    """Identify constant losses and the DC link from a power meter (paper A, section II-A).

    Args:
        bags: Recordings of one robot with rest and hard braking, with a power meter; or
            how they are read.
        model: Model to begin with: the model, its file, or the name of a shipped one.
        link_voltages: Of the DC link: rectified mains, start of the brake chopper. [V]
        **options: How the recordings are read: see `SourceOptions`.

    Returns:
        Losses with intervals, and the model with them.

    Raises:
        NotIdentifiableError: If the recordings do not show both phases.
        ImplausibleIdentificationError: If what was found contradicts physics.
        RobotEnergyError: If recordings or model cannot be used.
    """
    used, read = model_of(model), _source(bags, None, options)
    recordings, moved = on_one_clock(read.recordings(used))
    refuse_meter(recordings, EffortMeaning.NONE)
    found = fit_supply(recordings, read.names, link_voltages)
    losses = replace(found.losses, notes=(*moved, *found.losses.notes))
    check_cabinet(losses)
    written = _made_from(found.model, "Constant losses of the cabinet identified.", read)
    return IdentificationResult(written, replace(found, losses=losses))


@takes(SourceOptions)
def identify_auxiliary(
    bags: Names | BagSource,
    model: ModelName,
    *,
    outlet_meter: bool = False,
    **options: Unpack[SourceOptions],
) -> IdentificationResult[LoadStatesReport]:
    """Identify the power of each state of loads outside of the cabinet (paper B, figure 1).

    Args:
        bags: Recordings of one cell with the states of its loads, and their meters or that of the
            outlet; or how they are read.
        model: Model with the loads: the model, its file, or the name of a shipped one.
        outlet_meter: Whether the power meter sits at the outlet and sees the loads as well; then
            those without a meter of their own are found while the robot stands still.
        **options: How the recordings are read: see `SourceOptions`.

    Returns:
        Powers with intervals and held-out errors, and the model with them.

    Raises:
        NotIdentifiableError: If no state of any load can be found.
        RobotEnergyError: If recordings or model cannot be used.
    """
    used, source = model_of(model), _source(bags, None, options)
    loads = used.auxiliary or ()
    if not any(load.metered or len(load.states) > 1 for load in loads):
        raise NotIdentifiableError(
            "the model has no auxiliary load with a meter or with several states",
            "the key auxiliary with loads, their states and the topics of both",
        )
    _, read = source.meaning()
    gain = (source.sensors or DEFAULT_LIMITS).std.meter
    held = [read_loads(path, loads, read) for path in source.paths]
    fits: list[LoadsFit] = []
    refused: list[NotIdentifiableError] = []
    for load in loads:
        if load.metered:
            try:
                fits.append(fit_own(load, [own_readings(part, load) for part in held], gain))
            except NotIdentifiableError as error:
                refused.append(error)
    others = [load for load in loads if not load.metered and len(load.states) > 1]
    if others and outlet_meter:
        recordings = source.recordings(used)
        parts = [
            outlet_readings(part, [load for load in loads if load.metered or load in others], own)
            for part, own in zip(recordings, held, strict=True)
        ]
        try:
            fits.append(fit_outlet(others, parts, gain))
        except NotIdentifiableError as error:
            refused.append(error)
    elif others:
        names = ", ".join(load.name for load in others)
        refused.append(
            NotIdentifiableError(
                f"no meter of {names}",
                "a meter of each load, or one at the outlet that sees the cabinet as well",
                "state --outlet-meter where the power meter of the recordings sits there",
            )
        )
    if not fits:
        raise NotIdentifiableError(
            "; ".join(dict.fromkeys(one.found for one in refused)),
            refused[0].expected,
            refused[0].remedy,
        )
    written = with_states(used, fits, source.names)
    written = _made_from(written, "Powers of auxiliary loads identified.", source)
    return IdentificationResult(written, LoadStatesReport(tuple(fits), tuple(map(str, refused))))


@takes(SourceOptions)
def identify_dynamics(
    bags: Names | BagSource,
    model: ModelName,
    effort: str | None = None,
    *,
    settings: DynamicsSettings | None = None,
    **options: Unpack[SourceOptions],
) -> IdentificationResult[DynamicsReport]:
    """Identify bodies, rotors and friction from motion and motor torque.

    Args:
        bags: Recordings of one robot in which all joints move at once; or how they are read.
        model: Model to begin with: the model, its file, or the name of a shipped one.
        effort: What the effort in the joint states is: ``motor_torque``, ``joint_torque`` or
            ``motor_current``; None: as ``inputs`` says.
        settings: Regression, columns and filters; None for those of the command.
        **options: How the recordings are read: see `SourceOptions`.

    Returns:
        Parameters with standard deviations, and the model with them.

    Raises:
        NotIdentifiableError: If the motion does not excite the parameters.
        ImplausibleIdentificationError: If what was found contradicts physics.
        RobotEnergyError: If recordings or model cannot be used.
    """
    used, read = model_of(model), _source(bags, effort, options)
    recordings = read.channels(used)
    how = settings or DynamicsSettings()
    how = how if read.sensors is None else replace(how, sensors=read.sensors)
    with read.progress("identifying"):
        return dynamics_of(recordings, used, how, [hashed(path) for path in read.paths])


def dynamics_of(
    recordings: Mapping[str, Sequence[Channels]],
    model: RobotModel,
    settings: DynamicsSettings,
    bags: Sequence[str],
) -> IdentificationResult[DynamicsReport]:
    """Return what recordings show of the dynamics; of several each is held out whole, too."""
    result = fit_dynamics([part for own in recordings.values() for part in own], model, settings)
    found = result.report()
    with cause_named(lambda: [evidence_of_rows(result)]):
        check_dynamics(result, found.torque_error["held_out_model_file"])
    if len(recordings) > 1:
        found = replace(found, across=across_recordings(recordings, model, settings))
    return IdentificationResult(to_model(result, bags), found)


def _source(bags: Names | BagSource, effort: str | None, options: SourceOptions) -> BagSource:
    read = bags
    if not isinstance(read, BagSource):
        paths = [read] if isinstance(read, str | Path) else list(read)
        read = BagSource(paths, effort, **options)
    require_distinct(read.paths)
    require_some(read.paths)
    return read


def _made_from(model: RobotModel, done: str, read: BagSource) -> RobotModel:
    bags = [hashed(path) for path in read.paths]
    return model.changed(provenance=identified_from(model.provenance, done, bags))


@takes(IdentifyOptions)
def identify_all(
    bags: Names, model: ModelName, effort: str | None = None, **options: Unpack[IdentifyOptions]
) -> IdentificationResult[IdentificationReport]:
    """Identify everything that the recordings allow, and test it on what was held out.

    Args:
        bags: Recordings of one robot.
        model: Model to begin with: the model, its file, or the name of a shipped one.
        effort: What the effort in the joint states is: ``motor_torque``, ``joint_torque`` or
            ``motor_current``; None: as ``inputs`` says. Without it neither bodies nor friction
            can be identified.
        **options: What is identified and how it is tested: see `IdentifyOptions`.

    Returns:
        Every step with its reason where nothing was found, and the model with all of them.

    Raises:
        NotIdentifiableError: If nothing can be identified, with the reason of every step.
        RobotEnergyError: If recordings or model cannot be used.
    """
    given, skip = model_of(model), options.get("skip", ())
    progress = options.get("progress", silent)
    drives = drive_topics(
        options.get("drive_power"), options.get("drive_joints"), options.get("dq_scaling", "peak")
    )
    paths, test_paths = (
        [Path(one)] if isinstance(one, str | Path) else [Path(bag) for bag in one]
        for one in (bags, options.get("test", ()))
    )
    require_distinct(paths)
    require_distinct(test_paths)
    require_distinct(paths, test_paths)
    source = BagSource(paths, effort, options.get("inputs"), sensors=options.get("sensors"))
    fitted, refused = source.lazy(given, drives)
    tests, _ = BagSource(test_paths, effort, source.inputs).lazy(given, drives)
    known: list[tuple[BagFacts, Span]] = []
    evidence: list[Evidence] = []
    recordings: list[Recording] = []
    states: list[str] = []
    for bag in (*fitted, *tests):
        with progress(f"reading {bag.name}") as report:
            recording = bag.whole(given, report)
        states += refuse_motion(recording, bag.effort)
        recordings.append(recording)
        known.append((facts(bag, recording), recording.span_ns))
        evidence.append(torque_evidence(recording, bag.effort))
        if len(known) <= len(fitted):
            check_signs([recording], bag.effort)
    refuse_shared(recordings)
    recordings, moved = on_one_clock(recordings)
    for bag, recording in zip(fitted, recordings, strict=False):
        refuse_meter([recording], bag.effort)
    kept = [
        replace(bag, kept=Kept(recording)) if recording.in_order else bag
        for bag, recording in zip((*fitted, *tests), recordings, strict=True)
    ]
    del recordings
    fitted, tests = kept[: len(fitted)], kept[len(fitted) :]
    read = [entry for entry, _ in known[: len(fitted)]]
    fit_parts, test_parts = evidence[: len(fitted)], evidence[len(fitted) :]
    with progress("comparing with the model"):
        compare = refuse_torque if bodies_known(given) else notes_on_torque
        notes = [
            *states,
            *moved,
            *compare(fit_parts),
            *notes_on_torque(test_parts, "in the test: "),
        ]
    with progress("identifying") as report, cause_named(lambda: fit_parts):

        def shown(_: str, share: float) -> None:
            report(share)

        whole = identify_everything(
            fitted,
            given,
            skip,
            shown,
            refused,
            options.get("link_voltages"),
            share_shape=options.get("share_shape", False),
        )
    if all(step.found is None for step in whole.steps):
        reasons = " ".join(f"{step.subject.capitalize()}: {step.reason}" for step in whole.steps)
        raise NotIdentifiableError(
            f"nothing can be identified from these recordings. {reasons}",
            remedy="record with torque or current, temperature, or a power meter",
        )
    undone = [bag.with_meter_undone(whole.meter_time_constant, whole.meter_delay) for bag in fitted]
    notes += own_energies(fitted, whole)
    notes += stepping_meters(bag.whole(whole.model) for bag in undone)
    energy = None
    if options.get("held_out", True):
        kind, folds = folds_of(fitted, tests, [span for _, span in known])
        with progress("testing on what was held out") as report:
            energy = held_out_energy(kind, folds, whole, skip, report)
    written = with_provenance(whole, read)
    tested = [entry for entry, _ in known[len(fitted) :]]
    found = identification_report(whole, written, read, tested, energy, notes)
    return IdentificationResult(written, found)
