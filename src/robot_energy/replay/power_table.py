"""Power over time as a table: one row per sample, or per averaging period."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from robot_energy.accounting.averaging import MeanBlock
from robot_energy.accounting.energy_curve import EnergyCurve, EnergyRows, add_compared
from robot_energy.certainty.deviation import power_std
from robot_energy.timeline.blocks import (
    NANOSECOND,
    Float,
    Int,
    PowerBlock,
    known_part,
    sum_over_joints,
)
from robot_energy.timeline.pieces import Compared
from robot_energy.timeline.time_series import TimeSeries

UNITS = {
    name: unit
    for unit, names in (
        ("W", "predicted_grid_power predicted_power_std measured_power predicted_power_at_meter"),
        ("W", "residual_power bus_power rigid_power friction_power drive_loss loss_dc loss_grid"),
        ("W", "brake_power capacitor_power"),
        ("", "phase quality"),
        ("W", "joint_shaft_power joint_rigid_power joint_friction_power joint_drive_loss"),
        ("W", "joint_shaft_power_measured"),
        ("rad/s", "motor_velocity"),
        ("N m", "motor_torque"),
        ("degC", "motor_temperature_degc"),
        ("N m s/rad", "viscous_friction"),
    )
    for name in names.split()
}
WHOLE: dict[str, Any] = {"phase": np.uint8, "quality": np.uint32}  # columns without a fraction
MEASURED = ("measured_power", "predicted_power_at_meter", "residual_power")
ALL_ROWS = 2**62  # a table keeps every interval of the comparison


def power_table(
    blocks: Sequence[PowerBlock] | Sequence[MeanBlock],
    joint_names: Sequence[str],
    compared: Sequence[Compared] | None = None,
    unmodelled: Collection[str] = (),
) -> TimeSeries:
    """Return every sample, or means over periods with motor quantities at their end.

    Measured power is the mean from reading to reading, NaN without one. Without ``compared`` the
    table has no measured columns.
    """
    if not blocks:
        return _empty_table(joint_names)
    block = type(blocks[0]).concatenate(blocks)  # pyright: ignore[reportArgumentType]
    if isinstance(block, PowerBlock):
        rigid, friction, loss = block.rigid_power, block.friction_power, block.drive_loss
        shaft, capacitor = block.shaft_power, block.capacitor_power
        known: dict[str, Any] = {
            "predicted_grid_power": block.grid_power,
            "bus_power": block.bus_power,
            "loss_dc": block.loss_dc,
            "loss_grid": block.loss_grid,
            "brake_power": block.brake_power,
        }
    else:
        power = block.powers
        rigid, friction, loss = power["rigid"], power["friction"], power["drive_loss"]
        shaft, capacitor = rigid + friction, power["capacitor"]
        known = {
            "predicted_grid_power": block.predicted_power,
            "bus_power": sum_over_joints(shaft + loss),
            "loss_dc": power["loss_dc"],
            "loss_grid": power["loss_grid"],
            "brake_power": power["brake"],
        }
    loss = known_part("drive_loss", loss, unmodelled)
    known |= {
        **({} if compared is None else _measured(block.stamp_ns, compared)),
        "predicted_power_std": power_std(np.asarray(block.deviation)),
        "capacitor_power": known_part("capacitor", capacitor, unmodelled),
        "rigid_power": sum_over_joints(rigid),
        "friction_power": sum_over_joints(friction),
        "drive_loss": sum_over_joints(loss),
        "phase": block.phase.astype(np.uint8),
        "quality": block.quality,
        "joint_shaft_power": shaft,
        "joint_rigid_power": rigid,
        "joint_friction_power": friction,
        "joint_drive_loss": loss,
        "joint_shaft_power_measured": block.shaft_power_measured,
        "motor_velocity": block.motor_velocity,
        "motor_torque": block.motor_torque,
        "motor_temperature_degc": block.motor_temperature_degc,
        "viscous_friction": block.viscous,
    }
    return _table(
        block.stamp_ns, {name: known[name] for name in UNITS if name in known}, joint_names
    )


def _empty_table(joint_names: Sequence[str]) -> TimeSeries:
    names = [name for name in UNITS if name not in MEASURED]
    first = names.index("joint_shaft_power")
    columns = {name: np.empty(0, dtype=WHOLE.get(name)) for name in names[:first]}
    joints = {name: np.empty((0, len(joint_names))) for name in names[first:]}
    return _table(np.empty(0, dtype=np.int64), columns | joints, joint_names)


def _table(stamp_ns: Int, columns: dict[str, Any], joint_names: Sequence[str]) -> TimeSeries:
    return TimeSeries(
        stamp_ns,
        {name: values for name, values in columns.items() if values.ndim == 1},
        {name: values for name, values in columns.items() if values.ndim == 2},
        tuple(joint_names),
        {name: UNITS[name] for name in columns},
    )


def _measured(stamp_ns: Int, compared: Sequence[Compared]) -> dict[str, Float]:
    """Mean powers over the interval between readings that holds each stamp."""
    curve = EnergyCurve(3, ALL_ROWS)
    for part in compared:
        add_compared(curve, part)
    measured, predicted = _at(stamp_ns, curve.rows())
    return dict(zip(MEASURED, (measured, predicted, predicted - measured), strict=True))


def _at(stamp_ns: Int, rows: EnergyRows) -> tuple[Float, Float]:
    """Mean of both energies in the row that holds each stamp, epoch by epoch."""
    found = np.full((len(stamp_ns), 2), np.nan)
    power = rows.energy[:, :2] / (rows.duration_ns * NANOSECOND)[:, None]
    jumps = np.flatnonzero(np.diff(rows.stamp_ns) < 0) + 1
    epochs = np.split(np.arange(len(rows.stamp_ns)), jumps)
    runs = np.split(np.arange(len(stamp_ns)), np.flatnonzero(np.diff(stamp_ns) < 0) + 1)
    for run in runs:
        for epoch in epochs:
            if not len(epoch):
                continue
            row = np.searchsorted(rows.stamp_ns[epoch], stamp_ns[run], side="left")
            row = epoch[np.minimum(row, len(epoch) - 1)]
            stamp = stamp_ns[run]
            held = (rows.begin_ns[row] <= stamp) & (stamp <= rows.stamp_ns[row])
            held &= np.isnan(found[run, 0])
            found[run[held]] = power[row[held]]
    return found[:, 0], found[:, 1]
