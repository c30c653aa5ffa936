"""Cabinet and DC link together, each found again with what the other says.

Rest determines the constants only once the DC link has given what it holds, and the constants say
when that is. So the constants come first, then the link, then both once more. A third round
changes nothing that matters: rest is determined by readings half a second and more after motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from typing import Annotated

from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import RobotModel
from robot_energy.model.schema import Cabinet
from robot_energy.physics.drives_and_cabinet import CabinetStage, FanStage
from robot_energy.results.base import Result
from robot_energy_identify.cabinet.cabinet import (
    CabinetFit,
    fit_cabinet,
    with_cabinet,
    with_likely_fan,
)
from robot_energy_identify.cabinet.dc_link import LinkFit, Voltages, fit_link, with_link
from robot_energy_identify.cabinet.fan import with_fan
from robot_energy_identify.data.recordings import Recording, spread
from robot_energy_identify.drives.delays import (
    meter_lags,
    with_meters_earlier,
    with_response,
)
from robot_energy_identify.drives.drive_data import DriveData, drive_data
from robot_energy_identify.stats.lag import MeterDelay, MeterTimeConstant, applied


class CabinetReport(Result, name="cabinet"):
    """Constant losses of the cabinet, and energy of the DC link."""

    losses: Annotated[CabinetFit, "Constant losses."]
    meter_delay: MeterDelay
    meter_time_constant: MeterTimeConstant
    link: Annotated[LinkFit | None, "Energy of the DC link; None where it was not determined."]
    link_reason: Annotated[str, "Why the model does not have it; empty if it has."]
    link_note: Annotated[str, "Where its voltages come from; empty if the model has none."]
    model: Annotated[RobotModel, "With all that was taken."] = field(repr=False)


def fit_supply(
    recordings: Sequence[Recording], source: str, voltages: Voltages | None = None
) -> CabinetReport:
    """Return constant losses, DC link, and the model with both.

    Args:
        source: Where the data come from.
        voltages: Of the DC link, rectified and of the chopper; None if they are not known. [V]

    Raises:
        NotIdentifiableError: If not even the constants are determined.
    """

    def read(constant: float) -> DriveData:
        some = spread(recordings)
        data = drive_data(some, [None] * len(some), measured_torque=False)
        return with_meters_earlier(data, 0.0, constant)

    low_pass, delay = meter_lags(read)
    undone = applied(delay), applied(low_pass)
    recordings = [part.with_meter_earlier(*undone) for part in recordings]
    given, fan = with_fan(recordings[0].model, recordings, source)
    if fan.fan is not None:
        recordings = [_rebalanced(part, given.cabinet) for part in recordings]
    cabinet = fit_cabinet(recordings).with_fan(fan)
    model = with_cabinet(given, cabinet, source)
    link, reason = _link(recordings, model)
    note = ""
    if link is not None:
        # Judged after both rounds: before, readings at rest may still be too low.
        linked, _ = with_link(model, link, source, voltages)
        again = fit_cabinet([_rebalanced(part, linked.cabinet) for part in recordings])
        again = again.with_fan(fan)
        if again.loss_dc is not None or cabinet.loss_dc is None:  # enough rest is left
            link, reason = _link(recordings, with_cabinet(given, again, source))
            if not reason:
                cabinet, model = again, with_cabinet(given, again, source)
    if link is not None and not reason:
        model, note = with_link(model, link, source, voltages)
    model = with_likely_fan(with_response(model, low_pass, delay, source), fan.likely)
    return CabinetReport(cabinet, delay, low_pass, link, reason, note, model)


def _link(recordings: Sequence[Recording], model: RobotModel) -> tuple[LinkFit | None, str]:
    try:
        link = fit_link(recordings, model.cabinet)
    except NotIdentifiableError as error:
        return None, str(error)
    return link, link.reason


def _rebalanced(recording: Recording, cabinet: Cabinet) -> Recording:
    """A recording as if its model had another cabinet; what was compared stays out."""
    power = recording.power
    fan = FanStage(cabinet).step(power.motor_temperature_degc)
    flows = CabinetStage(cabinet).step(power.stamp_ns, power.segment, power.bus_power, fan)
    return replace(
        recording,
        model=recording.model.model_copy(update={"cabinet": cabinet}),
        power=replace(power, **flows.__dict__),
        known=(),
    )
