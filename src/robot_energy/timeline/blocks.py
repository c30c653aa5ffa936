"""Frozen records of numpy arrays that travel between the stages.

A block holds ``N >= 1`` samples in time order. Arrays are ``(N,)`` or ``(N, n_joints)``
with joints in model order, each joint contiguous in memory (order F), as almost every
operation runs along the samples; the other order is slower and as right.
Stamps are integer nanoseconds of the instant that the sample describes. SI units without
suffix; temperatures in degC.

``segment`` grows by one at every gap and at every backward jump of the stamps: nothing is
integrated or differentiated across a change of it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from enum import IntEnum, IntFlag, StrEnum
from operator import attrgetter
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described

Float = NDArray[np.floating[Any]]  # float64 throughout; numpy types many results this wide
Int = NDArray[np.int64]
Bits = NDArray[np.uint32]

NANOSECOND = 1e-9  # s
PLAUSIBLE_DEGC = (-40.0, 200.0)  # what a motor can read


class Quality(IntFlag):
    """Bits that qualify one sample; the same values as ``ros2_energy_msgs/Quality``."""

    OK = 0
    TEMPERATURE_MISSING = 1
    TEMPERATURE_STALE = 2
    TEMPERATURE_IMPLAUSIBLE = 4
    EXTRAPOLATED = 8
    ACCELERATION_INCOMPLETE = 16
    VELOCITY_DERIVED = 32
    AFTER_GAP = 64
    DRIVE_EXTRAPOLATED = 128
    NOT_FINITE = 256
    JOINT_STATE_IMPLAUSIBLE = 512
    TEMPERATURE_STUCK = 1024
    TEMPERATURE_ESTIMATED = 2048
    LEARNED = 4096


DOUBTFUL = Quality.ACCELERATION_INCOMPLETE | Quality.AFTER_GAP | Quality.NOT_FINITE  # torques


class Phase(IntEnum):
    """What the robot does at an instant (paper A, figure 1)."""

    UNKNOWN = 0
    HOLD = 1
    MOTION = 2
    GENERATING = 3


class TemperatureOrigin(IntEnum):
    """Where the temperature behind a friction coefficient comes from."""

    UNKNOWN = 0
    MEASURED = 1
    FALLBACK = 2
    ESTIMATED = 3


class EffortMeaning(StrEnum):
    """What a driver reports as the effort of a joint; a setting, never inferred."""

    NONE = "none"
    """Not used."""
    MOTOR_CURRENT = "motor_current"
    """Current of the motor [A]; times the torque constant of the model file."""
    MOTOR_TORQUE = "motor_torque"
    """Torque at the motor shaft, motor side [N m]."""
    JOINT_TORQUE = "joint_torque"
    """Torque or force at the joint, joint side [N m] or [N]."""


class Learning(StrEnum):
    """What is done with learned figures."""

    OFF = "off"
    """Nothing is learned."""
    OBSERVE = "observe"
    """Learned and published; predictions use the model file alone."""
    APPLY = "apply"
    """Predictions use the learned figures where they are valid."""


class MeterMeaning(IntEnum):
    """What one sample of a power meter stands for."""

    UNKNOWN = 0
    INSTANTANEOUS = 1
    MEAN_OVER_INTERVAL = 2
    CUMULATIVE = 3


class MeterLocation(IntEnum):
    """Where in the supply a meter sits."""

    UNKNOWN = 0
    GRID = 1
    DC_BUS = 2


class HeldRows(Described):
    """What is computed at some samples only, and holds until the next one of them."""

    values: Annotated[NDArray[np.floating[Any]], "Shape (M, K)."]
    row: Annotated[NDArray[np.int64], "Which of them holds at each sample, shape (N,)."]
    begins: Annotated[
        NDArray[np.bool_],
        "Whether it was computed at that sample, shape (N,); else it goes on, at the first sample "
        "of a block from the block before.",
    ]
    ndim = 1  # of arrays of one value per sample, which it is cut as

    def __getitem__(self, rows: slice | NDArray[np.bool_] | NDArray[np.int64]) -> HeldRows:
        """Return what holds at some of the samples, without values of others before or behind."""
        row = self.row[rows]
        first = int(row.min()) if len(row) else 0
        last = int(row.max()) if len(row) else 0
        return HeldRows(self.values[first : last + 1], row - first, self.begins[rows])

    @staticmethod
    def concatenate(parts: Sequence[HeldRows]) -> HeldRows:
        """Return what holds at blocks of samples, joined."""
        sizes = np.cumsum([0, *(len(part.values) for part in parts)]).tolist()
        return HeldRows(
            np.concatenate([part.values for part in parts]),
            np.concatenate([part.row + size for part, size in zip(parts, sizes, strict=False)]),
            np.concatenate([part.begins for part in parts]),
        )

    def __array__(
        self, dtype: np.dtype[Any] | None = None, copy: bool | None = None
    ) -> NDArray[Any]:
        """Return what holds at each sample, shape (N, K)."""
        return self.values[self.row].astype(dtype or np.float64, copy=False)


class Rows(Described):
    """Base of records whose arrays all have a row for each sample: cutting and joining."""

    def __len__(self) -> int:
        entries: dict[str, Any] = self.__dict__
        return next(len(each) for each in entries.values() if type(each) is np.ndarray)

    def __getitem__(self, rows: slice | NDArray[np.bool_] | Int) -> Self:
        """Return the samples ``rows``; what is one for all stays."""
        entries = self.__dict__.copy()
        for name, value in entries.items():
            if isinstance(value, np.ndarray | HeldRows):
                entries[name] = value[rows] if isinstance(rows, slice) else taken(value, rows)
        block = object.__new__(type(self))  # much quicker than ``dataclasses.replace``
        block.__dict__.update(entries)
        return block

    @classmethod
    def concatenate(cls, blocks: Sequence[Self]) -> Self:
        """Return several joined in the order given."""
        first = blocks[0]
        if len(blocks) == 1:
            return first
        entries = first.__dict__.copy()
        for name, value in entries.items():
            parts: list[Any] = [*map(attrgetter(name), blocks)]
            if isinstance(value, HeldRows):
                entries[name] = HeldRows.concatenate(parts)
            elif isinstance(value, np.ndarray):
                flat = value.ndim != 2  # else each column contiguous
                entries[name] = (
                    np.concatenate(parts)
                    if flat
                    else np.concatenate([*map(np.transpose, parts)], axis=1).T
                )
            elif value is None and any(part is not None for part in parts):
                raise ValueError(f"{name} is in some of the rows to be joined, and not in all")
        block = object.__new__(type(first))
        block.__dict__.update(entries)
        return block


class Block(Rows):
    """Base of all blocks: rows with stamps."""

    stamp_ns: Int

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @classmethod
    def arranged(cls, blocks: Sequence[Self], rows: Sequence[Int]) -> tuple[Self, Int]:
        """Return blocks joined in the order of their samples' numbers, and the numbers.

        Args:
            rows: Number of each sample, one array per block.
        """
        number = np.concatenate(rows) if len(rows) > 1 else rows[0]
        whole = cls.concatenate(blocks)
        if len(blocks) == 1:
            return whole, number
        order = np.argsort(number)
        return whole[order], number[order]


class JointBlock(Block):
    """Joint states, joint side."""

    stamp_ns: Annotated[
        Int, "Measurement time, strictly increasing within a segment, shape (N,). [ns]"
    ]
    segment: Int
    quality: Bits
    joint_position: Annotated[Float, "Shape (N, n). [rad] or [m]"]
    joint_velocity: Annotated[
        Float, "Shape (N, n); NaN until derived where not reported. [rad/s] or [m/s]"
    ]
    joint_acceleration: Annotated[
        Float, "Shape (N, n). [rad/s^2] or [m/s^2] NaN until differentiated."
    ]
    joint_effort: Annotated[
        Float, "As the driver sent it, NaN for none, shape (N, n); meaning: a setting."
    ]


class TorqueBlock(Block):
    """Rigid-body torque at the instants of the joint states."""

    segment: Int
    quality: Bits
    joint_position: Annotated[Float, "Joint side, shape (N, n). [rad] or [m]"]
    joint_velocity: Annotated[Float, "Joint side, shape (N, n). [rad/s] or [m/s]"]
    joint_acceleration: Annotated[Float, "Joint side, shape (N, n). [rad/s^2] or [m/s^2]"]
    joint_torque_rigid: Annotated[
        Float, "Joint side without rotor inertia, shape (N, n). [N m] or [N]"
    ]
    motor_velocity: Annotated[Float, "Motor side, shape (N, n). [rad/s]"]
    motor_torque_rigid: Annotated[Float, "Motor side with rotor inertia, shape (N, n). [N m]"]
    motor_torque_measured: Annotated[
        Float,
        "Motor side, from the effort of the driver, not corrected for warm magnets, shape (N, n); "
        "NaN where unknown. [N m]",
    ]
    payload_mass: Annotated[Float, "Mass of all payload in force, shape (N,). [kg]"]

    def motor_side(self) -> TorqueBlock:
        """Return the same for no joint at the joint side: what follows needs the motors only."""
        none = np.empty((len(self), 0))
        sides = ("joint_position", "joint_velocity", "joint_acceleration", "joint_torque_rigid")
        return replace(self, **dict.fromkeys(sides, none))


class TemperatureBlock(Block):
    """Motor temperatures as they arrive; several sources may interleave."""

    motor_temperature_degc: Annotated[
        Float, "Shape (N, n); NaN where a sample says nothing of a joint. [degC]"
    ]


class FrictionBlock(Block):
    """Friction coefficients, each row valid from its stamp onward, motor side."""

    stamp_ns: Annotated[Int, "First instant of validity, shape (N,). [ns]"]
    quality: Bits
    coulomb: Annotated[Float, "Shape (N, n). [N m]"]
    viscous: Annotated[Float, "At the row's temperature, shape (N, n). [N m s/rad]"]
    viscous_std: Annotated[
        Float, "Standard deviation of it; NaN: not known, shape (N, n). [N m s/rad]"
    ]
    viscous_shared_std: Annotated[
        Float, "Part of it with the same error at all joints. [N m s/rad]"
    ]
    viscous_fallback: Annotated[Float, "Used once the temperature is stale. [N m s/rad]"]
    viscous_fallback_std: Annotated[Float, "Used once the temperature is stale. [N m s/rad]"]
    motor_temperature_degc: Annotated[Float, "NaN where never seen, shape (N, n). [degC]"]
    temperature_stamp_ns: Annotated[
        Int, "Stamp of that temperature, 0 where never seen, shape (N, n). [ns]"
    ]


class MeterBlock(Block):
    """Readings of the power meter, all of one meaning and location."""

    stamp_ns: Annotated[Int, "Instant of the reading, or the end of its interval, shape (N,). [ns]"]
    power: Annotated[
        Float, "Positive from the supply towards the load, shape (N,); NaN if cumulative. [W]"
    ]
    energy: Annotated[Float, "Counter reading, shape (N,); NaN unless cumulative. [J]"]
    interval: Annotated[
        Float, "That ends at the stamp, NaN unless the meter gives means, shape (N,). [s]"
    ]
    meaning: MeterMeaning
    location: MeterLocation


class SupplyBlock(Block):
    """Predicted power wherever a meter can sit; a tenth of a power block."""

    segment: Int
    grid_power: Annotated[Float, "Drawn from the grid, shape (N,). [W]"]
    loss_grid: Annotated[Float, "Loss between the grid and the DC bus, shape (N,). [W]"]

    def power_at(self, location: MeterLocation) -> Float:
        """Return the predicted power at the place of a meter, shape (N,). [W]"""
        at_bus = location is MeterLocation.DC_BUS
        return self.grid_power - self.loss_grid if at_bus else self.grid_power


class PowerBlock(SupplyBlock):
    """Where each watt goes at each instant. Positive = from grid towards load.

    ``grid_power = sum_i(rigid + friction + drive_loss)_i + losses + brake + capacitor`` holds.
    """

    loss_grid: Annotated[Float, "Constant loss on the grid side plus supply loss, shape (N,). [W]"]
    grid_power: Annotated[Float, "Drawn from the grid; negative while fed back, shape (N,). [W]"]
    quality: Bits
    phase: Annotated[NDArray[np.uint8], "`Phase` values, shape (N,)."]
    motor_velocity: Annotated[Float, "Motor side, shape (N, n). [rad/s]"]
    motor_torque: Annotated[Float, "Rigid plus friction, motor side, shape (N, n). [N m]"]
    motor_torque_measured: Annotated[
        Float, "At the shaft, with warm magnets, shape (N, n); NaN where unknown. [N m]"
    ]
    shaft_power_measured: Annotated[
        Float, "Measured torque times speed, NaN: unknown, shape (N, n). [W]"
    ]
    rigid_power: Annotated[Float, "Motor side, shape (N, n). [W]"]
    friction_power: Annotated[Float, "Motor side, >= 0, shape (N, n). [W]"]
    drive_loss: Annotated[Float, "Drive input minus shaft power, shape (N, n). [W]"]
    coulomb: Annotated[Float, "Coefficient used, motor side, shape (N, n). [N m]"]
    viscous: Annotated[Float, "Coefficient used, motor side, shape (N, n). [N m s/rad]"]
    motor_temperature_degc: Annotated[Float, "Temperature used, shape (N, n). [degC]"]
    payload_mass: Annotated[Float, "Mass of all payload in force, shape (N,). [kg]"]
    bus_power: Annotated[Float, "Sum of the drive inputs (P_dc), shape (N,). [W]"]
    loss_dc: Annotated[Float, "Constant loss on the DC side, shape (N,). [W]"]
    brake_power: Annotated[Float, "Dissipated in the brake resistor, >= 0, shape (N,). [W]"]
    capacitor_power: Annotated[Float, "Into the DC-link capacitor, signed, shape (N,). [W]"]
    deviation: Annotated[
        HeldRows, "How sure it is, see `robot_energy.certainty.deviation`, K columns. [W]"
    ]

    @property
    def shaft_power(self) -> Float:
        """Shaft power per motor, rigid plus friction, shape (N, n). [W]"""
        return self.rigid_power + self.friction_power

    @property
    def supply(self) -> SupplyBlock:
        """What a meter can see, alone."""
        return SupplyBlock(self.stamp_ns, self.segment, self.grid_power, self.loss_grid)


def taken(values: Any, rows: NDArray[np.bool_] | Int) -> Any:
    """Return some samples of what a block of samples holds of one attribute.

    Args:
        rows: Which samples: a mask of shape (N,), or numbers.
    """
    if values.ndim != 2:
        return values[rows]
    places = rows.nonzero()[0] if rows.dtype == np.bool_ else rows
    return values.T.take(places, axis=1).T  # each column contiguous


def known_part(name: str, values: Any, unmodelled: Collection[str]) -> Float:
    """Return a part of power or energy as it is shown: NaN for 0 where the model lacks it.

    Args:
        values: Of any shape, or a number. [W] or [J]
        unmodelled: Registers of the parts that the model lacks, as `RobotModel.unmodelled`. One
            that counted under an earlier model keeps its figure.
    """
    found: Float = np.asarray(values, dtype=float)
    return np.where(found == 0.0, np.nan, found) if name in unmodelled else found


def sum_over_joints(values: Float) -> Float:
    """Return the sum in a fixed order, that it never depends on ``N``, shape (N,).

    Args:
        values: Any quantity of the joints, shape (N, n). [-]
    """
    total = np.zeros(len(values))
    for joint in range(values.shape[1]):
        total += values[:, joint]
    return total


def differences(values: Int, before: int) -> Int:
    """Return steps from predecessors, shape (N,); on few values faster than numpy.diff.

    Args:
        values: Shape (N,), N >= 1.
        before: What came before the first value.
    """
    steps = np.empty(len(values), dtype=np.int64)
    steps[0] = values[0] - before
    np.subtract(values[1:], values[:-1], out=steps[1:])
    return steps


def mark(quality: Bits, rows: NDArray[np.bool_], bit: Quality) -> None:
    """Set a quality bit in place.

    Args:
        quality: Quality bits, shape (N,).
        rows: Which samples, shape (N,).
    """
    if rows.any():
        quality[rows] |= np.uint32(bit)
