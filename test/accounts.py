"""Power and books for the tests of registers, restarts and state files."""

from __future__ import annotations

import numpy as np

from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.record import Identity
from robot_energy.certainty.deviation import (
    BUS,
    CABINET_DEVIATIONS,
    FORM,
    JOINT_DEVIATIONS,
    LOSS_GRID,
)
from robot_energy.timeline.blocks import (
    NANOSECOND,
    Float,
    HeldRows,
    Int,
    MeterBlock,
    MeterLocation,
    MeterMeaning,
    PowerBlock,
)

NAMES = ("shoulder", "elbow")
IDENTITY = Identity(robot_type="arm", robot_serial="7", joint_names=NAMES, model_id="m1")
SECOND = 10**9


def power_block(stamp_ns: Int, grid: Float, segment: int | Int = 0) -> PowerBlock:
    """Power samples of two joints: grid power as given, shares that are odd numbers."""
    size = len(stamp_ns)
    none = np.zeros((size, 2))
    shares = np.stack([grid * 0.123, grid * -0.017], axis=1)
    return PowerBlock(
        stamp_ns=np.asarray(stamp_ns, dtype=np.int64),
        segment=np.broadcast_to(np.asarray(segment, dtype=np.int64), (size,)),
        quality=np.zeros(size, dtype=np.uint32),
        phase=np.full(size, 2, dtype=np.uint8),
        motor_velocity=none,
        motor_torque=none,
        motor_torque_measured=none,
        shaft_power_measured=shares * 0.9,
        payload_mass=np.zeros(size),
        rigid_power=shares,
        friction_power=np.abs(shares) * 0.3,
        drive_loss=np.abs(shares) * 0.1,
        coulomb=none,
        viscous=none,
        motor_temperature_degc=none,
        bus_power=grid - 50.0,
        loss_dc=np.full(size, 20.0),
        loss_grid=np.full(size, 30.0),
        brake_power=np.maximum(-grid, 0.0) * 0.5,
        capacitor_power=np.zeros(size),
        grid_power=grid,
        deviation=HeldRows(np.nan_to_num(deviations(grid)), np.arange(size), np.isfinite(grid)),
    )


def deviations(grid: Float) -> Float:
    """Deviations of two joints: losses of 3 and 4 W, axes 2 % each, form 5 % of the grid power."""
    first = len(CABINET_DEVIATIONS)
    columns = np.zeros((len(grid), first + 2 * len(JOINT_DEVIATIONS)))
    columns[:, CABINET_DEVIATIONS.index("loss_dc")] = 3.0
    columns[:, LOSS_GRID] = 4.0
    columns[:, FORM] = 0.05 * np.abs(grid)
    columns[:, first : first + 2] = 0.02 * np.abs(grid)[:, None]
    columns[:, BUS] = np.sqrt(9.0 + 2 * (0.02 * grid) ** 2)
    return columns


def steady(start_s: float, end_s: float, watt: float = 100.0, rate: float = 100.0) -> PowerBlock:
    """Constant grid power from ``start_s`` to ``end_s``, both included."""
    stamp = np.rint(np.arange(start_s, end_s + 0.5 / rate, 1 / rate) * 1e9).astype(np.int64)
    return power_block(stamp, np.full(len(stamp), watt))


def counter(start_s: float, end_s: float, watt: float = 90.0) -> MeterBlock:
    """A cumulative meter read every 0.1 s; its count began long before."""
    stamp = np.rint(np.arange(start_s, end_s + 0.05, 0.1) * 1e9).astype(np.int64)
    nothing = np.full(len(stamp), np.nan)
    energy = 1e6 + watt * stamp * NANOSECOND
    return MeterBlock(stamp, nothing, energy, nothing, MeterMeaning.CUMULATIVE, MeterLocation.GRID)


def restarted(account: EnergyAccount) -> EnergyAccount:
    """Books that continue, in another process as it were, from the JSON of these."""
    text = account.state(IDENTITY).to_json()
    fresh = EnergyAccount(len(NAMES))
    fresh.restore(type(account.state(IDENTITY)).from_json(text))
    return fresh
