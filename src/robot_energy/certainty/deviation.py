"""Standard deviation and 90 % band of power and energy, from deviations of the model's figures.

To first order the error of the predicted power is ``sum_k g_k e_k``: ``g_k`` is the change of the
power with figure k, ``e_k`` the error of that figure. A column of `PowerDeviation` is
``g_k s_k`` in watts, with the standard deviation ``s_k``. Errors of figures are constant or
change slowly, so the columns are integrated before they are squared: the standard deviation of
an energy is ``sqrt(sum_k (integral g_k s_k dt)^2)``, which grows with time. Different figures
are taken as independent, but for losses and friction with a covariance C in the model: with
``C = L L'`` their columns are ``g' L``, which are independent and have a sign.

Motor side, per joint: ``|w| s(fc)`` and ``w^2 s(fv)`` are one column, as are all losses of the
drive; that adds them a little too much (Minkowski), never too little. Of ``s(fv)``, what errs
alike at all joints (an unknown temperature) is a column of the robot. What the brake resistor takes
never reaches the grid: there the columns are 0.

What the form of the model leaves out of friction and drive losses is a share of them; a meter
shows it, so it counts only without one. What it leaves out of the losses that flow all the time is
in their column on the grid side. What no figure explains (delays, elasticity) is taken as
a share of the shaft power with a short correlation time; its variance grows with time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from functools import partial
from typing import Annotated

import numpy as np

from robot_energy.certainty.figure_deviations import (
    TOGETHER_TERMS,
    DriveDeviation,
    FigureDeviations,
    known_together,
)
from robot_energy.certainty.priors import figure_std, relative_std
from robot_energy.foundation.described import Described
from robot_energy.model import RobotModel
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy.model.figure import tag_of
from robot_energy.physics.derivative import windows_of
from robot_energy.physics.equations import Balance
from robot_energy.timeline.blocks import Float, Int, differences

CABINET_DEVIATIONS = (
    "bodies", "payload", "loss_dc", "together", "loss_grid", "temperature", "form", "random",
    "bus",
)  # fmt: skip
"""Columns of the robot; ``random`` is in W^2 s, ``bus`` the root sum of squares of all but
``loss_grid``, ``temperature`` and ``form``; ``together`` begins what has a covariance."""
JOINT_DEVIATIONS = ("friction", "drive", *(f"together_{term}" for term in TOGETHER_TERMS))
TOGETHER_NAME = "losses and friction known together"
FORM_SHARE = 0.06
"""What the form of friction and drive losses leaves out, over their power. [-]

Real losses follow other laws of speed, load and temperature than those of the model."""
UNEXPLAINED = 0.06
"""Standard deviation of the power that no figure explains, over the sum of |shaft power|. [-]"""
UNEXPLAINED_TIME = 0.02
"""Its correlation time: the integral of its autocorrelation from 0 on. [s]

Short: most of it is a matter of a few tenths of a second (delays, elastic gears), where what is
missing now comes a moment later."""
SLOT_NS, RECENT_SLOTS = 20_000_000, 25
"""It follows the shaft power of the last half second, sampled every 20 ms."""
MAX_DEVIATION = 1e6  # no interval becomes too large for a register [W]
Z90 = 1.6448536269514722
"""Half width of the middle 90 % of a normal distribution, over its standard deviation."""
Z95 = 1.959964  # the same of the middle 95 %
MEDIAN_TO_STD = 1.4826
"""Standard deviation of a normal variable over the median of its absolute deviation."""
_FIRST = len(CABINET_DEVIATIONS)
LOSS_GRID, BUS, TEMPERATURE, FORM, _RANDOM = (
    CABINET_DEVIATIONS.index(name) for name in ("loss_grid", "bus", "temperature", "form", "random")
)
_SYSTEMATIC = [
    CABINET_DEVIATIONS.index(name) for name in ("bodies", "payload", "loss_dc", "together")
]


class PowerDeviation:
    """Columns ``g_k s_k`` of one robot."""

    def __init__(self, model: RobotModel) -> None:
        first, own = len(CABINET_DEVIATIONS), 2 * len(model.joints)
        last = first + len(JOINT_DEVIATIONS) * len(model.joints)
        self._places = [CABINET_DEVIATIONS.index("together"), *range(first + own, last)]
        figures = self._figures = FigureDeviations(model)
        model = figures.model
        self._coulomb_squared = figures.coulomb**2
        by_load = [joint.friction.load_coulomb for joint in model.joints]
        self._by_load = np.asarray(
            [0.0 if one is None else figure_std(one, "coulomb") for one in by_load]
        )
        self._viscous_prior = np.asarray(
            [relative_std("viscous", tag_of(joint.friction.viscous)) for joint in model.joints]
        )
        kind = DRIVE_MODELS[model.drive]
        self._drive: DriveDeviation | None = None
        if kind.deviation is not None:
            self._drive = kind.deviation(kind.entries(model.joints))
        elif not kind.lossless:
            self._drive = partial(_share_of_loss, share=figures.drive_share)
        self._payload_mass = sum(body.mass for body in model.payload)
        self._slot = -1
        self._recent: Float = np.zeros(RECENT_SLOTS)

    def _recent_peak(self, stamp_ns: Int, power: Float) -> Float:
        """Greatest of the newest slots, each by its first sample, and of the sample itself."""
        slot = stamp_ns // SLOT_NS
        begins = differences(slot, self._slot) != 0
        self._slot = int(slot[-1])
        if not begins.any():
            return np.maximum(self._recent.max(), power)
        fresh = power[begins]
        if not np.isfinite(fresh.sum()):
            fresh = np.nan_to_num(fresh)
        values = np.concatenate([self._recent, fresh])
        self._recent = values[-RECENT_SLOTS:]
        peaks = windows_of(values, RECENT_SLOTS).max(axis=1)
        return np.maximum(peaks[np.cumsum(begins)], power)

    def columns(
        self,
        motor_velocity: Float,
        motor_torque: Float,
        rigid_power: Float,
        friction_power: Float,
        drive_loss: Float,
        viscous: Float,
        viscous_std: Float,
        shared_std: Float,
        held: Float,
        fan_powers: Float | None,
        payload_mass: Float,
        balance: Balance,
        stamp_ns: Int,
    ) -> Float:
        """Return the deviations of the power that a meter at the grid sees, shape (N, K).

        Args:
            motor_velocity: 0 where the axis stands, shape (N, n). [rad/s]
            motor_torque: That heats the windings, shape (N, n). [N m]
            rigid_power: Shape (N, n). [W]
            friction_power: Shape (N, n). [W]
            drive_loss: Shape (N, n). [W]
            viscous: Coefficient in use, shape (N, n). [N m s/rad]
            viscous_std: Its deviation, NaN for that of the prior, shape (N, n). [N m s/rad]
            shared_std: The part whose error is common to all joints, shape (N, n). [N m s/rad]
            held: Deviation of the loss at rest by what motors hold there, shape (N, n). [W]
            fan_powers: As of `FigureDeviations.grid_side`, shape (2, N). [W]
            payload_mass: In force, shape (N,). [kg]
            stamp_ns: Shape (N,). [ns]
        """
        figures, (size, n_joints) = self._figures, rigid_power.shape
        first = len(CABINET_DEVIATIONS)
        columns = np.empty((size, first + len(JOINT_DEVIATIONS) * n_joints), order="F")
        bodies, payload, loss_dc, _, loss_grid, temperature, form, random, bus = columns[
            :, :first
        ].T
        friction, drive = np.hsplit(columns[:, first : first + 2 * n_joints], 2)
        speed, shaft = np.abs(motor_velocity), np.abs(rigid_power + friction_power)
        squared = speed**2
        std, shared = viscous_std, shared_std
        if np.isnan(std.sum()):
            std = np.where(np.isnan(std), self._viscous_prior * viscous, std)
            shared = np.nan_to_num(shared)
        bent = None
        if figures.exponent_std is not None:
            bent = figures.by_exponent(motor_velocity, figures.exponent_std)
            std, shared = std * bent[0], shared * bent[0]
        variance = std**2
        if shared.any():
            variance -= shared**2
        variance *= squared
        np.maximum(variance, 0.0, out=variance)
        together = None
        if figures.together is not None:
            of_viscous = np.sqrt(variance) * speed
            together = known_together(figures.together, speed, motor_torque, of_viscous)
            variance *= figures.viscous
        variance += self._coulomb_squared
        np.sqrt(variance, out=friction)
        friction *= speed
        if self._by_load.any():  # of friction by load: its share times the torque of the bodies
            np.hypot(friction, self._by_load * rigid_power, out=friction)
        if bent is not None:
            np.hypot(friction, bent[1] * viscous, out=friction)
        if self._drive is None:
            np.multiply(figures.drive_share, shaft, out=drive)
        else:
            drive[:] = self._drive(speed, motor_torque, drive_loss)
        if held.any():
            np.hypot(drive, held, out=drive)
        carried = figures.payload_share
        if self._payload_mass > 0:
            part = payload_mass / self._payload_mass
            if figures.with_payload:  # only what was put down or added since errs by itself
                part = np.abs(1.0 - part)
            carried = carried * np.minimum(part, 1.0)[:, None]
        table = np.empty((6, n_joints, size))
        table[0], table[2] = rigid_power.T, shaft.T
        np.multiply(rigid_power, carried, out=table[1].T)
        np.multiply(shared, squared, out=table[3].T)
        np.multiply(friction, friction, out=table[4].T)
        table[4] += (drive**2).T
        np.abs(drive_loss, out=table[5].T)
        table[5] += friction_power.T
        # one joint after the other, so that a sum never depends on the number of samples
        sums = np.add.accumulate(table, axis=1)[:, -1]
        rigid, of_payload, moved, temperature[:], squares, lost = sums
        np.multiply(FORM_SHARE, lost, out=form)
        np.multiply(figures.payload, of_payload, out=payload)
        np.multiply(figures.bodies, rigid - of_payload, out=bodies)
        loss_dc[:] = figures.loss_dc
        of_grid = figures.loss_grid if figures.fan is None else figures.grid_side(fan_powers)
        loss_grid[:] = np.hypot(of_grid, figures.at_rest)
        unexplained = (UNEXPLAINED * self._recent_peak(stamp_ns, moved)) ** 2
        np.multiply(2.0 * UNEXPLAINED_TIME, unexplained, out=random)
        squares = squares + bodies**2 + payload**2 + loss_dc**2
        reaches = np.where(balance.brake_power > 0, 0.0, 1.0)
        if figures.returned:
            reaches[balance.grid_power < balance.loss_grid] = figures.returned
        if together is not None:
            squares = squares + (together**2).sum(axis=1)
        if (reaches < 1.0).any():
            for column in (bodies, payload, temperature, form, loss_dc, *friction.T, *drive.T):
                column *= reaches
            squares *= reaches**2
        columns[:, self._places] = (
            0.0 if together is None else together * reaches[:, None] + figures.of_grid
        )
        np.sqrt(squares + unexplained, out=bus)
        if not max(float(columns.max()), -float(columns.min())) <= MAX_DEVIATION:
            np.fmin(columns, MAX_DEVIATION, out=columns)
            np.fmax(columns, -MAX_DEVIATION, out=columns)
        return columns


def _share_of_loss(speed: Float, torque: Float, loss: Float, *, share: float) -> Float:
    return share * np.abs(loss)


def names_of(joint_names: Sequence[str]) -> tuple[str, ...]:
    """Return words for every column but ``bus``, in their order."""
    return (
        "bodies",
        "payload",
        "constant loss, DC side",
        TOGETHER_NAME,
        "constant loss, grid side",
        "temperature of the friction",
        "form of friction and drive losses",
        "what the model leaves out",
        *(f"friction of {name}" for name in joint_names),
        *(f"drive of {name}" for name in joint_names),
        *(TOGETHER_NAME for _ in TOGETHER_TERMS for _ in joint_names),
    )


class BandKind(IntEnum):
    """What a 90 % band rests on."""

    NONE = 0
    """Without a band."""
    PARAMETRIC = 1
    """The standard deviations and priors of the model's figures."""
    CALIBRATED = 2
    """These, scaled so that 90 % of what the meter measured lay within."""


class EnergyBand(Described):
    """How sure a predicted energy is."""

    std: Annotated[float, "Standard deviation from the figures of the model. [J]"]
    half: Annotated[float, "Half width of the 90 % band. [J]"]
    kind: BandKind


def half_width(
    rest: Float | float, temperature: Float | float, scale: Float | float = Z90
) -> Float:
    """Return half the width of a band, same shape and unit.

    Readings of the meter at known temperatures may show that the figures are better known than
    they say. They do not show that an unknown temperature is: that part is never made narrower.

    Args:
        rest: Standard deviation of all but the temperature, any shape (...). [W] or [J]
        temperature: Standard deviation from the temperature, same shape. [W] or [J]
        scale: Half width over standard deviation, one value or same shape. [-]
    """
    return np.hypot(scale * np.asarray(rest), np.maximum(scale, Z90) * np.asarray(temperature))


def scores(error: Float, rest: Float, temperature: Float) -> Float:
    """Return the scale with which a band would just hold each error, shape (N,). [-]

    Args:
        error: Without sign, shape (N,). [W] or [J]
        rest: As for `half_width`, > 0, shape (N,). [W] or [J]
        temperature: As for `half_width`, shape (N,). [W] or [J]
    """
    plain = error / np.hypot(rest, temperature)
    beyond = np.maximum(error**2 - (Z90 * temperature) ** 2, 0.0)
    return np.where(plain < Z90, np.sqrt(beyond) / rest, plain)


def power_std(deviation: Float) -> Float:
    """Return the standard deviation of the mean power of short periods from the grid, (W,). [W]

    Args:
        deviation: Means of the deviations, shape (W, K). [W]
    """
    rest = np.hypot(deviation[:, BUS], deviation[:, LOSS_GRID])
    return np.hypot(rest, deviation[:, TEMPERATURE])


def energy_variances(deviation: Float) -> Float:
    """Return the variance of an energy by each figure alone, by `names_of`, shape (K - 1,). [J^2]

    The errors of figures grow with time, what no figure explains with its root.

    Args:
        deviation: Integrals of the deviations, shape (K,). [J]
    """
    columns = [*_SYSTEMATIC, LOSS_GRID, TEMPERATURE, FORM]
    random = max(float(deviation[_RANDOM]), 0.0)
    return np.concatenate([deviation[columns] ** 2, [random], deviation[_FIRST:] ** 2])


def figures_of(deviation: Float) -> Float:
    """Return the columns of the figures, shape (K - 4,): all but temperature, form and random.

    Args:
        deviation: Deviations or their integrals, shape (K,). [W] or [J]
    """
    return np.concatenate([deviation[[*_SYSTEMATIC, LOSS_GRID]], deviation[_FIRST:]])


def energy_parts(
    deviation: Float, at_bus: bool = False, systematic: bool = False
) -> tuple[float, float]:
    """Return deviations of an energy by all but temperature and form, and by the temperature. [J]

    What the form leaves out a meter shows, and without one it is added.

    Args:
        deviation: Integrals of the deviations, shape (K,). [J]
        at_bus: Whether the energy is that of the DC bus.
        systematic: Whether to leave out what no figure explains.
    """
    variances = energy_variances(deviation)
    grid, temperature, form, random = variances[len(_SYSTEMATIC) :][:4].tolist()
    left_out = (temperature + form) + (grid if at_bus else 0.0) + (random if systematic else 0.0)
    rest = math.sqrt(max(float(variances.sum()) - left_out, 0.0))
    return rest, float(abs(deviation[TEMPERATURE]))


def energy_std(deviation: Float, at_bus: bool = False) -> float:
    """Return the standard deviation of an energy from the figures of the model. [J]

    Args:
        deviation: Integrals of the deviations, shape (K,). [J]
        at_bus: Whether the energy is that of the DC bus.
    """
    return math.hypot(*energy_parts(deviation, at_bus), float(deviation[FORM]))
