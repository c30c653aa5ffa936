"""Compiled forms of the arithmetic that takes most of the time of a replay.

They are optional: without a C compiler the library is installed without them, and the numpy and
Pinocchio forms compute the same. Sums, slopes and places in bags agree bit for bit, the rigid-body
torque to about 1e-15 of the greatest torque.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import Any, Protocol, cast

from numpy.typing import NDArray

MAX_JOINTS = 64  # joints of a robot that the kernel of the rigid-body torque takes

MAX_COLUMNS = 32  # fields of a message that the kernel takes together

Array = NDArray[Any]

SWITCH = "ROBOT_ENERGY_KERNELS"
"""The environment variable that switches them off with the value ``off``."""


class Compiled(Protocol):
    """What the compiled module offers; the lock of the interpreter is free meanwhile.

    All raise TypeError or ValueError where an array has another type, shape or order, or stamps
    fall or lie beyond 2^62 ns, and OverflowError where a whole number has more than 64 bits.
    """

    def inverse_dynamics(
        self,
        table: Array,
        gravity: Array,
        position: Array,
        velocity: Array,
        acceleration: Array,
        torque: Array,
    ) -> None:
        """Rigid-body torque of a tree of joints, by recursive Newton-Euler (paper A, eq. 2).

        Args:
            table: A row per joint, a parent before its children, shape (n, 27) with n up to
                ``MAX_JOINTS``: number of the parent from 1 on, 0 for the base; 1 for a prismatic
                joint, 0 for a revolute one; rotation, by rows, and position [m] of its frame in
                that of the parent, z along its axis; mass [kg], first moment [kg m] and inertia
                [kg m^2] of its body about the origin of the frame.
            gravity: In the base frame, shape (3,). [m/s^2]
            position: Joint side, shape (N, n). [rad] or [m]
            velocity: Joint side, shape (N, n). [rad/s] or [m/s]
            acceleration: Joint side, shape (N, n). [rad/s^2] or [m/s^2]
            torque: Written to, joint side, order F, shape (N, n). [N m] or [N]
        """
        ...

    def slopes(
        self,
        stamp_ns: Array,
        values: Array,
        slope: Array,
        start: int,
        behind_ns: int,
        ahead_ns: int,
        least_behind: int,
        least_ahead: int,
        scale: float,
    ) -> bool:
        """Slopes of local quadratics, as `robot_energy.physics.derivative` fits them.

        Args:
            stamp_ns: Rising, shape (N,). [ns]
            values: Order F, shape (N, n). [unit]
            slope: Written to, of the rows from ``start`` on, order F, shape (M, n). [unit/s]
            least_behind: Samples that it has behind at least, if there are so many.
            scale: Unit of time in the fit. [s]

        Returns:
            False where a window has more samples than the kernel takes.
        """
        ...

    def add_exactly(self, energy: Array, microjoule: Array, remainder: Array) -> None:
        """Add energies to sums, as `robot_energy.accounting.exact_sum` does.

        Args:
            energy: Finite, below 2 MJ each, shape (N, R). [J]
            microjoule: Added to, int64, shape (R,). [uJ]
            remainder: Added to, int64, shape (R,). [2^-40 uJ]
        """
        ...

    def integrate(
        self,
        cabinet: tuple[Array, ...],
        joint: tuple[Array, ...],
        before: Array,
        half: Array,
        last: Array,
        energy: Array,
        microjoule: Array,
        remainder: Array,
    ) -> bool:
        """Energies behind the R registers of a robot, and their sums.

        Args:
            cabinet: Power from the grid, of the brake resistor, both constant losses, and into the
                capacitor, shape (N,) each. [W]
            joint: Rigid, friction and drive loss power, order F, shape (N, n) each. [W]
            before: Powers behind the registers at the sample before, shape (R,). [W]
            half: Half of the time of each interval, shape (N,). [s]
            last: Written to, the powers at the last sample, shape (R,). [W]
            energy: Written to, of the first registers, order F, shape (N, R) or less. [J]
            microjoule: Added to, int64, shape (R,). [uJ]
            remainder: Added to, int64, shape (R,). [2^-40 uJ]

        Returns:
            Whether each energy is a number up to 2 MJ; else nothing written is of use.
        """
        ...

    def compare(
        self,
        measured: tuple[Array, ...],
        predicted: tuple[Array, ...],
        start: int,
        until: int,
        available: Array,
        duration: Array,
        energy: Array,
    ) -> int:
        """Energies of two curves over what both cover, cut at every edge of either.

        Args:
            measured: Begins and ends of its pieces [ns] and the powers there [W], shape (M,) each.
            predicted: The same, shape (P,) each.
            available: Written to, end of the measured piece of each interval, shape (room,). [ns]
            duration: Written to, shape (room,). [ns]
            energy: Written to, measured and predicted, order F, shape (room, 2). [J]

        Returns:
            How many intervals there are.
        """
        ...

    def columns(
        self,
        buffer: Array,
        offset: Array,
        key: bytes,
        starts: Array,
        stops: Array,
        places: tuple[int, ...],
        outs: tuple[Array, ...],
    ) -> bool:
        """Take columns of numbers out of messages of one layout.

        Args:
            offset: First byte of each, which has the length of the key, shape (N,).
            starts: First byte of each span that must agree with the key, int64, shape (S,).
            stops: First byte behind each, int64, shape (S,).
            places: First byte of the numbers of each column, up to ``MAX_COLUMNS``.
            outs: Written to, order F, shape (N,) or (N, k) each: k numbers that follow each other.

        Returns:
            Whether all messages agree; else nothing written is of use.
        """
        ...

    def messages(
        self, data: memoryview, table: Array, others: Array, limit: int
    ) -> tuple[int, int, int]:
        """Find the messages in a block of MCAP records.

        Args:
            table: Written to, int64, shape (4, room): channel, log time [ns], first byte and
                length of each message.
            others: Written to, int64, shape (room,): where each schema and channel begins.

        Returns:
            Number of messages, of others, and the first byte behind the last whole record.
        """
        ...


def _load() -> Compiled | None:
    if os.environ.get(SWITCH) == "off":
        return None
    try:
        return cast("Compiled", import_module("robot_energy.physics.kernels._compiled"))
    except ImportError:
        return None


compiled: Compiled | None = _load()
"""The kernels; None where there are none, or they are switched off."""
