"""All that recordings say of a robot, from the bodies to the grid, in one model.

The order is that of the power: bodies, rotors and friction from measured torque; friction
over temperature on what the bodies leave; then the supply. One meter for all determines the
cabinet first, while nothing moves, and the drives from the rest, then both again, each with
the other, until they agree. Where the power of each
drive is measured, the drives come first, because the cabinet is the meter minus the drives.
What the DC link stores follows: drives and constants decide when it fills. Thermal networks of
the motors are last, as the losses are their heat.
Every step reads the recordings with the model that the step before left. What the
recordings do not allow is left out with a sentence, and what is no better than the model
already has is not taken.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import (
    ImplausibleIdentificationError,
    ModelFileError,
    NotIdentifiableError,
)
from robot_energy.foundation.process_memory import give_back_freed_memory
from robot_energy.model import RobotModel
from robot_energy.model.schema import CabinetFan
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.effort import Effort
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_identify.blas_threads import one_thread
from robot_energy_identify.cabinet.cabinet import CabinetFit, fit_cabinet, with_likely_fan
from robot_energy_identify.cabinet.dc_link import Voltages
from robot_energy_identify.cabinet.fan import FanFound, with_begin
from robot_energy_identify.data.bags import Bag, BagFacts, powers_of, read_all
from robot_energy_identify.data.recordings import spread
from robot_energy_identify.drives.all_drives import DrivesReport
from robot_energy_identify.drives.delays import meter_lags, with_response
from robot_energy_identify.drives.drive_data import DriveData, drive_data
from robot_energy_identify.provenance import identified_from
from robot_energy_identify.stats.lag import Delay, MeterDelay, MeterTimeConstant
from robot_energy_identify.steps import (
    STEPS,
    SUBJECTS,
    MadeStep,
    Step,
    Subject,
    cabinet_step,
    capacitor_step,
    constants_step,
    drives_step,
    dynamics_step,
    fan_refused,
    friction_step,
)

SUPPLY: tuple[Subject, ...] = ("cabinet", "drives", "capacitor")  # what the meter determines
Progress = Callable[[str, float], None]
OWN_ENERGY = 0.08  # of the energy of a recording; sound ones of bags/drawn_train_* miss 0.02
AS_ASKED = "left out, as asked"
MAX_TURNS = 4  # of cabinet and drives, each found with what the other found
MAX_MOVE, MIN_MOVE = 0.2, 0.1  # of a deviation, W: a constant that moves by less has settled


class FullIdentification(Described):
    """All that was identified."""

    given: Annotated[RobotModel, "The model that it began with."]
    steps: Annotated[tuple[Step, ...], "In the order in which they were done."]
    meter_delay: MeterDelay = None
    share_shape: Annotated[
        bool, "Whether axes of too small a range borrowed the temperature shape of others."
    ] = False
    meter_time_constant: MeterTimeConstant = None

    @property
    def model(self) -> RobotModel:
        """The model with all that was taken."""
        return self.steps[-1].model

    @property
    def taken(self) -> tuple[Subject, ...]:
        """Subjects whose figures are in the model."""
        return tuple(step.subject for step in self.steps if step.taken)

    def step(self, subject: Subject) -> Step:
        """Return the step about a subject."""
        return next(step for step in self.steps if step.subject == subject)


@one_thread
def identify_everything(
    bags: Sequence[Bag],
    model: RobotModel,
    skip: Sequence[Subject] = (),
    progress: Progress | None = None,
    effort_refused: str = "",
    voltages: Voltages | None = None,
    strict: bool = True,
    share_shape: bool = False,
) -> FullIdentification:
    """Return every subject with what the bags say of it, or why nothing.

    Args:
        progress: Called with the subject and the share done, 0 to 1.
        effort_refused: Why the effort of the bags cannot be used, from `usable_effort`.
        voltages: Of the DC link, rectified and of the chopper; None if they are not known. [V]
        strict: Whether a step that comes out implausible ends it all; else it is left out, as in a
            fold, and no step has the rows of the dynamics.
        share_shape: Whether axes of too small a range borrow the temperature shape of others.
    """
    source = ", ".join(dict.fromkeys(bag.name for bag in bags))
    steps: list[Step] = []
    now = model
    order = order_of(bags)
    delay: Delay | None = None
    low_pass: Delay | None = None
    in_time = False
    base = model
    for kept in (bag.kept for bag in bags if bag.kept is not None):
        kept.forget()
    for number, subject in enumerate(order):
        if progress is not None:
            progress(subject, number / len(order))
        give_back_freed_memory()
        if subject in SUPPLY and subject not in skip and not in_time:
            in_time = True
            low_pass, delay = _meter_lags(bags, now)
            now, base = (with_response(one, low_pass, delay, source) for one in (now, base))
            undone: list[Bag] = [bag.with_meter_undone(low_pass, delay) for bag in bags]
            bags = undone
        if subject in skip:
            step = Step(subject, None, AS_ASKED, now)
        elif effort_refused and subject in ("dynamics", "friction"):
            step = Step(subject, None, effort_refused, now)
        else:
            found = [part.found for part in steps if part.taken]
            drives = next((one for one in found if isinstance(one, DrivesReport)), None)
            make: dict[Subject, MadeStep] = {
                **STEPS,
                "dynamics": partial(dynamics_step, in_fold=not strict),
                "friction": partial(friction_step, share=share_shape),
                "capacitor": partial(capacitor_step, voltages=voltages, drives=drives),
            }
            step = _made(make[subject], subject, bags, now, source, strict)
        before = steps[-1].found if steps and subject == "drives" else None
        if isinstance(before, CabinetFit) and before.fan is not None:
            if reason := fan_refused(step):
                again = partial(constants_step, without_fan=reason)
                steps[-1] = _made(again, "cabinet", bags, base, source, strict)
                now = steps[-1].model
                if subject in skip:
                    step = replace(step, model=now)
                else:
                    step = _made(drives_step, subject, bags, now, source, strict)
        steps.append(step)
        if subject == "drives" and step.taken and len(steps) > 1:
            cabinet = steps[-2]
            if isinstance(cabinet.found, CabinetFit) and cabinet.taken:
                steps[-2:] = in_turns(cabinet, step, bags, base, source)
        if {part.subject for part in steps[-2:]} == {"cabinet", "drives"}:
            fits = [part.found for part in steps[-2:] if isinstance(part.found, CabinetFit)]
            likely = sum(fit.fan_likely for fit in fits)
            steps[-1] = replace(steps[-1], model=with_likely_fan(steps[-1].model, likely))
        now = steps[-1].model
        if subject == "friction":
            base = now
    return FullIdentification(model, tuple(steps), delay, share_shape, low_pass)


def _made(
    make: MadeStep,
    subject: Subject,
    bags: Sequence[Bag],
    model: RobotModel,
    source: str,
    strict: bool,
) -> Step:
    """A step, or one left out with its reason."""
    try:
        return make(bags, model, source)
    except (NotIdentifiableError, ImplausibleIdentificationError) as error:
        if strict and isinstance(error, ImplausibleIdentificationError):
            raise
        return Step(subject, None, str(error), model)


def _meter_lags(bags: Sequence[Bag], model: RobotModel) -> tuple[Delay | None, Delay | None]:
    """Low pass and delay of the meters, by the torque of the model."""

    def read(constant: float) -> DriveData:
        undone = [replace(bag, meter_time_constant=constant) for bag in bags]
        recordings, powers = powers_of(undone, model)
        return drive_data(spread(recordings), powers, measured_torque=False)

    return meter_lags(read)


def in_turns(
    cabinet: Step, drives: Step, bags: Sequence[Bag], model: RobotModel, source: str
) -> tuple[Step, Step]:
    """Return cabinet and drives behind one meter, each found with the other, until they agree.

    What the drives take at rest and while braking decides which readings show the constants,
    and the constants which readings show the drives. In the end the model of the drives has both.
    """
    fan = cabinet.model.cabinet.fan  # by its step: what drives fit would drift from turn to turn
    if fan is not None:
        if isinstance(cabinet.found, CabinetFit) and cabinet.found.fan is not None:
            fan = with_begin(fan, read_all(bags, drives.model), source)
            drives = replace(drives, model=_with_fan(drives.model, fan))
        model = _with_fan(model, fan)
    times = 1
    while times <= MAX_TURNS:
        times += 1
        before = drives.model.cabinet
        try:
            seen = _with_fan(drives.model, model.cabinet.fan)
            fit = fit_cabinet(read_all(bags, seen))
            if isinstance(cabinet.found, CabinetFit):
                known = cabinet.found
                fit = fit.with_fan(FanFound(known.fan, known.fan_reason, known.fan_likely))
            again = cabinet_step(model, fit, source)
            new = drives_step(bags, again.model, source, seen)
        except (NotIdentifiableError, ImplausibleIdentificationError) as error:
            note = (
                "cabinet and drives were not identified again, each with the result of the "
                f"other: {error}"
            )
            return cabinet, replace(drives, notes=(*drives.notes, note))
        if not new.taken:
            return cabinet, drives
        cabinet, drives = again, new
        after = drives.model.cabinet
        pairs = ((before.loss_grid, after.loss_grid), (before.loss_dc, after.loss_dc))
        if all(
            abs(now.value - old.value) <= max(MAX_MOVE * (now.std or 0.0), MIN_MOVE)
            for old, now in pairs
        ):
            break
    note = f"cabinet and drives were identified {times} times, each with the result of the other"
    return cabinet, replace(drives, notes=(*drives.notes, note))


def _with_fan(model: RobotModel, fan: CabinetFan | None) -> RobotModel:
    return model.changed(cabinet=model.cabinet.model_copy(update={"fan": fan}))


def order_of(bags: Sequence[Bag]) -> tuple[Subject, ...]:
    """Return the order of the steps: what is measured on its own comes before what is left."""
    if any(bag.drive_power is not None for bag in bags):
        return ("dynamics", "friction", "drives", "cabinet", "capacitor", "thermal")
    return SUBJECTS


def usable_effort(model: RobotModel, effort: EffortMeaning) -> str:
    """Return why an effort of this meaning cannot be used with a model; empty if it can."""
    try:
        Effort.from_model(model, effort, Drivetrain.from_model(model))
    except ModelFileError as error:
        return str(error)
    return ""


def own_energies(bags: Sequence[Bag], result: FullIdentification) -> tuple[str, ...]:
    """Return the recordings of the fit whose energy the model misses, one sentence each."""
    skipped = {step.subject for step in result.steps if step.reason == AS_ASKED}
    if {"drives", "cabinet"} & skipped or not {"friction", "drives"} & {*result.taken}:
        return ()  # then most figures are as they were given
    found: list[str] = []
    for bag in bags:
        undone = bag.with_meter_undone(result.meter_time_constant, result.meter_delay)
        compared = undone.whole(result.model).compared
        measured = float(sum(part.measured.sum() for part in compared))
        off = (
            float(sum(part.drawn.sum() for part in compared)) / measured - 1.0 if measured else 0.0
        )
        if abs(off) > OWN_ENERGY:
            found.append(
                f"{bag.name}: the identified model is {100.0 * off:+.0f} % off the energy of this "
                "recording of its own fit: one recording has another scale of its meter, another "
                "load, payload or robot, or there are too few; do not rely on its energies"
            )
    return tuple(found)


def with_provenance(result: FullIdentification, read: Sequence[BagFacts]) -> RobotModel:
    """Return the model with the names and hashes of the bags it was made from."""
    before = result.given.provenance
    dates = sorted(entry.date for entry in read if entry.date)
    origins = sorted({entry.origin for entry in read if entry.origin})
    done = f"Identified: {', '.join(result.taken)}."
    if origins:
        done += f" Recordings from: {', '.join(origins)}."
    bags = [f"{entry.name} sha256:{entry.sha256}" for entry in read]
    provenance = identified_from(before, done, bags, dates[-1] if dates else "")
    return result.model.changed(provenance=provenance)
