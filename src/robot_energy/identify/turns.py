"""Cabinet and drives behind one meter, each found with what the other found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from robot_energy.errors import ImplausibleIdentificationError, NotIdentifiableError
from robot_energy.identify.cabinet.cabinet import fit_cabinet
from robot_energy.identify.data.bags import Bag, read_all
from robot_energy.identify.steps import Step, cabinet_step, drives_step
from robot_energy.model import RobotModel
from robot_energy.model.schema import Cabinet

MAX_TURNS = 4
MAX_MOVE, MIN_MOVE = 0.2, 0.1  # of a deviation, W: a constant that moves by less has settled


def in_turns(
    cabinet: Step, drives: Step, bags: Sequence[Bag], model: RobotModel, source: str
) -> tuple[Step, Step]:
    """Return cabinet and drives behind one meter, each found with the other, until they agree.

    What the drives take at rest and while braking decides which readings show the constants,
    and the constants which readings show the drives.

    Args:
        cabinet: Found with the drives of ``model``.
        drives: Found with that cabinet.
        bags: Of the fit.
        model: As the steps before left it.
        source: Where the data come from.

    Returns:
        Both, as they were found last; the last one's model has both.
    """
    times = 1
    while times <= MAX_TURNS:
        times += 1
        before = drives.model.cabinet
        try:
            fit = fit_cabinet(read_all(bags, drives.model))
            again = cabinet_step(model, fit, source)
            new = drives_step(bags, again.model, source)
        except (NotIdentifiableError, ImplausibleIdentificationError) as error:
            note = f"cabinet and drives were not found again, each with the other: {error}"
            return cabinet, replace(drives, notes=(*drives.notes, note))
        if not new.taken:
            return cabinet, drives
        cabinet, drives = again, new
        if _agree(before, drives.model.cabinet):
            break
    note = f"cabinet and drives were found {times} times, each with the other"
    return cabinet, replace(drives, notes=(*drives.notes, note))


def _agree(before: Cabinet, after: Cabinet) -> bool:
    """Whether both constants moved by little, compared with their deviations."""
    pairs = ((before.loss_grid, after.loss_grid), (before.loss_dc, after.loss_dc))
    return all(
        abs(new.value - old.value) <= max(MAX_MOVE * (new.std or 0.0), MIN_MOVE)
        for old, new in pairs
    )
