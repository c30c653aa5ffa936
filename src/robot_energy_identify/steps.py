"""The steps of a whole identification: what each finds, and when it is taken.

Every step reads the recordings with the model that the step before left.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import field, replace
from typing import Annotated, Literal

import numpy as np

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.foundation.process_memory import give_back_freed_memory
from robot_energy.model import RobotModel
from robot_energy.model.friction_laws import FRICTION_LAWS
from robot_energy.physics.friction import viscous_law
from robot_energy.results.base import Result, Texts
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_identify.cabinet.cabinet import (
    CabinetFit,
    fit_cabinet,
    rest_of_drives,
    with_cabinet,
)
from robot_energy_identify.cabinet.dc_link import LinkFit, Voltages, fit_link, with_link
from robot_energy_identify.cabinet.fan import FanFound, with_fan
from robot_energy_identify.data.bags import Bag, motion_time, powers_of, read_all
from robot_energy_identify.data.recordings import MotionBlock, Recording, channels_of
from robot_energy_identify.drives.all_drives import DrivesReport, TotalPower, find_drives
from robot_energy_identify.drives.drive_data import drive_data
from robot_energy_identify.dynamics.dynamics import (
    DynamicsReport,
    DynamicsSettings,
    identify_dynamics,
)
from robot_energy_identify.dynamics.dynamics_model import SOURCE, to_model
from robot_energy_identify.friction.friction import (
    FrictionFit,
    fit_laws,
)
from robot_energy_identify.friction.samples import FrictionData, friction_data
from robot_energy_identify.friction_and_thermal import (
    FrictionReport,
    ThermalReport,
    find_friction,
    find_thermal,
)
from robot_energy_identify.plausibility import (
    check_cabinet,
    check_drives,
    check_dynamics,
    check_signs,
    check_total,
)
from robot_energy_identify.stats.cross_validation import GAIN
from robot_energy_identify.thermal.network import without_networks

Subject = Literal["dynamics", "friction", "cabinet", "drives", "capacitor", "thermal"]
SUBJECTS: tuple[Subject, ...] = (
    "dynamics", "friction", "cabinet", "drives", "capacitor", "thermal",
)  # fmt: skip


Found = DynamicsReport | FrictionReport | CabinetFit | DrivesReport | LinkFit | ThermalReport


class Step(Result):
    """One step of the whole."""

    subject: Annotated[Subject, "What it is about."]
    taken: Annotated[bool, "Whether the model has what was found."] = field(
        default=False, kw_only=True
    )
    found: Annotated[Found | None, "What the recordings show; None if the step was left out."]
    reason: Annotated[str, "Why it was left out, or not taken; empty otherwise."]
    model: Annotated[RobotModel, "After the step."] = field(repr=False)
    notes: Annotated[Texts, "What was decided without data, one sentence each."] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "taken", self.found is not None and not self.reason)


def _measured(bags: Sequence[Bag], model: RobotModel) -> list[Recording]:
    """Recordings with measured torque."""
    stated = [bag for bag in bags if bag.effort is not EffortMeaning.NONE]
    if not stated:
        raise NotIdentifiableError(
            "the meaning of the effort in the joint states is not stated",
            "measured torque or current",
            "say it with --effort, or record a driver that sends torque or current",
        )
    known = [
        part
        for part in read_all(stated, model)
        if np.isfinite(part.torque.motor_torque_measured).any()
    ]
    if not known:
        raise NotIdentifiableError(
            "the joint states of the recordings have no effort",
            "measured torque or current of every joint",
            "record a driver that sends it",
        )
    return known


def _warm(recordings: Sequence[Recording]) -> bool:
    return any(np.isfinite(part.power.motor_temperature_degc).any() for part in recordings)


def dynamics_step(
    bags: Sequence[Bag], model: RobotModel, source: str, in_fold: bool = False
) -> Step:
    """Return bodies, rotors and friction; taken if the bodies predict torque better than the old.

    In a fold the least-squares fit is not tested, and no rows are kept.
    """
    recordings = _measured(bags, model)
    stated = [bag for bag in bags if bag.effort is not EffortMeaning.NONE]
    seconds = motion_time(recordings, len(stated))
    check_signs(recordings, bags[0].effort)
    pieces = [part for bag in stated for part in bag.motion(model, seconds)]
    level, notes = _at_one_temperature(recordings, pieces)
    kept = stated[0].kept if len(stated) == 1 and np.isfinite(seconds) else None
    seen = None if kept is None else kept.rows  # the same pieces in every fold
    settings = DynamicsSettings(sensors=bags[0].sensors, seen=seen)
    give_back_freed_memory()
    result = identify_dynamics(channels_of(level), model, settings)
    tests = "held_out_model_file", "held_out_given_bodies"
    found = result.report(tests if in_fold else ("held_out", *tests))
    error, given = (found.torque_error[test] for test in tests)
    new, old = error.total, given.total
    if np.isfinite(seconds):
        notes += (f"of each recording {seconds:.0f} s were used",)
    if in_fold:
        small = replace(result, observations=result.observations.without_rows())
        found = replace(found, result=small)
    # without temperatures this step alone determines friction, so equal bodies will do
    if new < old * (GAIN if _warm(recordings) else 1.0 / GAIN):
        check_dynamics(result, error)
        return Step("dynamics", found, "", to_model(result, ()), notes)
    return Step(
        "dynamics",
        found,
        f"the bodies as given predict held-out torque as well or better ({100 * old:.1f} % off, "
        f"the identified ones {100 * new:.1f} %), so they stay",
        model,
        notes,
    )


def _at_one_temperature(
    recordings: Sequence[Recording], pieces: Sequence[MotionBlock]
) -> tuple[list[MotionBlock], tuple[str, ...]]:
    """Measured torque of the pieces as if every motor always had its median temperature.

    The dynamics know one viscous friction fv per joint. Where friction follows the temperature
    T, ``(fv(T) - fv(T_median)) w`` is taken off, by laws fitted with the bodies as given. Their
    difference over temperature hardly depends on the bodies.
    """
    fits = [
        _over_temperature(friction_data(recordings, joint))
        for joint in range(len(recordings[0].model.joints))
    ]
    warm = {
        fit.name: viscous_law(fit.law)
        for fit in fits
        if fit is not None and FRICTION_LAWS[fit.chosen].follows_temperature
    }
    if not warm:
        return list(pieces), ()
    torques = [part.motor_torque_measured.copy() for part in pieces]
    for joint, name in enumerate(recordings[0].model.joint_names):
        if name not in warm:
            continue
        degc = [part.power.motor_temperature_degc[:, joint] for part in recordings]
        usual = float(warm[name].viscous(float(np.nanmedian(np.concatenate(degc)))))
        for part, torque in zip(pieces, torques, strict=True):
            own = part.motor_temperature_degc[:, joint]
            known = np.where(np.isfinite(own), warm[name].viscous(own), usual)
            torque[:, joint] -= (known - usual) * part.motor_velocity[:, joint]
    level = [
        replace(part, motor_torque_measured=torque)
        for part, torque in zip(pieces, torques, strict=True)
    ]
    return level, (
        f"the effect of temperature on the friction of {', '.join(warm)} was removed first, so the "
        "friction of this step is that at the median temperature",
    )


def _over_temperature(axis: FrictionData) -> FrictionFit | None:
    """Friction of one axis for its temperature alone: with friction by load, shown or not.

    None where the data do not determine it.
    """
    loaded = [axis.by_load(np.inf)] if axis.rigid is not None and axis.rigid.any() else []
    for tried in (*loaded, axis):
        with suppress(NotIdentifiableError):
            return fit_laws(replace(tried, rigid=None))
    return None


def friction_step(bags: Sequence[Bag], model: RobotModel, source: str, share: bool = False) -> Step:
    """Return the friction over temperature of every axis.

    With ``share`` axes of too small a range borrow the temperature shape of others.
    """
    recordings = _measured(bags, model)
    check_signs(recordings, bags[0].effort)
    if not _warm(recordings) and all(
        SOURCE in joint.friction.coulomb.source for joint in model.joints
    ):
        raise NotIdentifiableError(
            "no motor temperature is known, so the friction stays that of the dynamics, a constant",
            remedy="record motor temperatures, or name their topic with --inputs",
        )
    found = find_friction(recordings, model, source, share)
    notes: tuple[str, ...] = ()
    if any(bag.effort is EffortMeaning.JOINT_TORQUE for bag in bags):
        notes = (
            "joint torque was measured: a sensor behind the gear sees none of the friction "
            "before it, and then this friction is too small",
        )
    return Step("friction", found, "", found.write(model, source), notes)


def constants_step(
    bags: Sequence[Bag], model: RobotModel, source: str, without_fan: str = ""
) -> Step:
    """Return the constants of the cabinet and its fan.

    Args:
        without_fan: Why no fan is looked for; empty if one is.
    """
    fan = FanFound(None, without_fan)
    if not without_fan:
        model, fan = with_fan(model, read_all(bags, model), source)
    recordings, powers = powers_of(bags, model)
    rest = None
    if any(power is not None for power in powers):
        rest = rest_of_drives(drive_data(recordings, powers, measured_torque=False), model)
    return cabinet_step(model, fit_cabinet(recordings, rest).with_fan(fan), source)


def cabinet_step(model: RobotModel, fit: CabinetFit, source: str) -> Step:
    """Return a model with the constants that a meter shows."""
    check_cabinet(fit)
    if fit.loss_grid is None and fit.loss_dc is None:
        raise NotIdentifiableError(
            "the meter determines neither the loss of the grid side nor that of the DC side",
            "rest, or hard braking with a meter at the grid",
            "record at least ten seconds of rest with active drives, and fast motions",
        )
    return Step("cabinet", fit, "", with_cabinet(model, fit, source))


def drives_step(
    bags: Sequence[Bag], model: RobotModel, source: str, seen: RobotModel | None = None
) -> Step:
    """Return the losses of the drives.

    Each drive by measured torque; one meter for all by that of the model, which is what runs.

    Args:
        seen: Model whose drives and cabinet say which readings the DC link feeds; None for
            ``model``.
    """
    recordings, powers = powers_of(bags, model if seen is None else seen)
    measured = any(power is not None for power in powers) and all(
        bag.effort in (EffortMeaning.MOTOR_TORQUE, EffortMeaning.MOTOR_CURRENT)
        and np.isfinite(part.torque.motor_torque_measured).any()
        for bag in bags
        for part in recordings
    )
    data = drive_data(recordings, powers, measured)
    found = find_drives(data, model, source, in_time=True)
    reason = ""
    if found.drives is not None:
        check_drives(data, found.drives)
    if found.drives is None and found.total is not None:
        reason = _not_better(found.total)
    if reason:
        return Step("drives", found, reason, model)
    if found.drives is None and found.total is not None:
        check_total(found.total.data, found.total.ways)
    written, notes = found.write(model, source)
    return Step("drives", found, "", written, tuple(notes))


def fan_refused(drives: Step) -> str:
    """Return why the fan that was taken off the readings is not taken; empty if it is."""
    total = drives.found.total if isinstance(drives.found, DrivesReport) else None
    if total is None or not total.fan_test:
        return "without losses of the drives it cannot be tested on held-out readings"
    new, old = total.fan_test[0]  # all readings, then those at rest
    if new.as_good_as(old) and any(one.beats(other) for one, other in total.fan_test):
        return ""
    return (
        f"with a fan held-out readings are predicted no better (energy "
        f"{100 * new.energy_error:.1f} % off and {new.rms:.3g} W RMS; without "
        f"{100 * old.energy_error:.1f} % and {old.rms:.3g} W)"
    )


def _not_better(total: TotalPower) -> str:
    """Why losses from one meter are not taken; empty if they are better than the model's own."""
    given, new = total.ways.get("given"), total.ways.get("identified")
    if new is None:
        return "too few readings to test the losses on readings that they have not seen"
    if given is None or not np.isfinite(given.rms):
        return ""
    if new.beats(given):
        return ""
    return (
        "the drives as given predict held-out readings of the meter as well or better "
        f"(energy {100 * given.energy_error:.1f} % off and {given.rms:.3g} W RMS; losses fitted "
        f"to the meter {100 * new.energy_error:.1f} % and {new.rms:.3g} W), so they stay"
    )


def capacitor_step(
    bags: Sequence[Bag],
    model: RobotModel,
    source: str,
    voltages: Voltages | None = None,
    drives: DrivesReport | None = None,
) -> Step:
    """Return what was found of the DC link's energy, after all that decides when it fills.

    Args:
        voltages: Of the link, rectified and of the chopper; None if they are not known. [V]
        drives: Found in the same recordings; None if they are given.
    """
    fit = fit_link(read_all(bags, model), drives=drives)
    if fit.reason:
        return Step("capacitor", fit, fit.reason, model)
    written, note = with_link(model, fit, source, voltages)
    return Step("capacitor", fit, "", written, (note,))


def _thermal(bags: Sequence[Bag], model: RobotModel, source: str) -> Step:
    """Thermal networks come last: the losses are their heat."""
    found = find_thermal(read_all(bags, without_networks(model)), model, None, source)
    note = (
        "the air is taken to be as warm as the coldest first reading, "
        f"{found.ambient_degc:.1f} degC"
    )
    return Step("thermal", found, "", found.write(model), (note,))


MadeStep = Callable[[Sequence[Bag], RobotModel, str], Step]
STEPS: dict[Subject, MadeStep] = {
    "dynamics": dynamics_step,
    "friction": friction_step,
    "cabinet": constants_step,
    "drives": drives_step,
    "capacitor": capacitor_step,
    "thermal": _thermal,
}
