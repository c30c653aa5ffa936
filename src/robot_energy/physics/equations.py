"""The power chain as pure functions over arrays, without a model file.

Arrays broadcast; the last axis is that of the joints. Torque, velocity and power are on the
motor side unless a name says ``joint_``. Power is positive from the grid towards the load. The
stages of the pipeline compute with these functions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import ShapeError
from robot_energy.timeline.blocks import Float

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator

REFERENCE_DEGC = 20.0  # at which copper losses are stated
UNBOUNDED = (-np.inf, np.inf)
CACHED = 30_000  # numbers worked on at a time, so few that they stay in the cache
_float: Callable[[ArrayLike], Float] = partial(np.asarray, dtype=np.float64)


class Balance(Described):
    """Power flows at the cabinet, shape (N,) each. [W]"""

    loss_dc: Annotated[Float, "Constant loss on the DC side."]
    loss_grid: Annotated[
        Float, "Constant loss on the grid side plus the loss of a regenerative supply."
    ]
    brake_power: Annotated[Float, "Into the brake resistor, >= 0."]
    capacitor_power: Annotated[Float, "Into the capacitor, signed."]
    grid_power: Annotated[Float, "From the grid; negative while a regenerative supply feeds back."]


def mapped(matrix: Float, values: Float) -> Float:
    """Return each row times ``matrix``, in a fixed order of operations, shape (..., n).

    A matrix product of a library may sum in an order that depends on the number of rows;
    this one does not, so a sample gives the same bits in every block.

    Args:
        matrix: Shape (n, n). [any unit]
        values: Shape (..., n). [any unit]
    """
    diagonal, coupling = _entries(matrix.tobytes(), len(matrix))
    result = values * diagonal
    for row, column, entry in coupling:
        result[..., row] += entry * values[..., column]
    return result


@lru_cache(maxsize=64)
def _entries(matrix: bytes, size: int) -> tuple[Float, list[tuple[int, int, float]]]:
    """The diagonal of a matrix, and the place and value of every other entry that is not 0."""
    whole = np.frombuffer(matrix).reshape(size, size)
    diagonal = np.diagonal(whole)
    places = np.argwhere(whole - np.diag(diagonal)).tolist()
    return diagonal.copy(), [(row, column, float(whole[row, column])) for row, column in places]


def constant_viscous(motor_temperature_degc: ArrayLike, viscous: float) -> Float:
    """Return viscous friction that is the same at every temperature.

    Args:
        motor_temperature_degc: Any shape. [degC]
        viscous: The coefficient. [N m s/rad]

    Returns:
        fv, same shape, motor side; NaN where the temperature is NaN. [N m s/rad]
    """
    degc = _float(motor_temperature_degc)
    return np.where(np.isnan(degc), degc, viscous)


def exponential_viscous(
    motor_temperature_degc: ArrayLike,
    a: float,
    b: float,
    c: float,
    fitted_degc: tuple[float, float] = UNBOUNDED,
) -> Float:
    """Return viscous friction by the exponential law ``fv(T) = a + b exp(-T / c)``.

    Source: paper A, eq. 8. Outside the fitted range the value at the edge is held.

    Args:
        motor_temperature_degc: T, any shape. [degC]
        a: Value that is approached when hot. [N m s/rad]
        b: Share that falls with temperature. [N m s/rad]
        c: Temperature over which it falls to 1/e. [K]
        fitted_degc: Range of the fit. [degC]

    Returns:
        fv, same shape, motor side; NaN where the temperature is NaN. [N m s/rad]
    """
    degc = _float(motor_temperature_degc)
    if fitted_degc != UNBOUNDED:
        degc = np.clip(degc, *fitted_degc)
    return a + b * np.exp(-degc / c)


def table_curve(points_degc: Sequence[float], viscous: Sequence[float]) -> PchipInterpolator:
    """Return the monotone curve through identified points; outside it extrapolates. [N m s/rad]

    Args:
        points_degc: Rising, shape (K,). [degC]
        viscous: fv at each, shape (K,). [N m s/rad]
    """
    from scipy.interpolate import PchipInterpolator  # heavy to import

    return PchipInterpolator(points_degc, viscous)


def table_viscous(
    motor_temperature_degc: ArrayLike, points_degc: Sequence[float], viscous: Sequence[float]
) -> Float:
    """Return viscous friction by monotone interpolation of identified points.

    Source: paper A, section II-B, coefficients "saved directly". Outside the points the value
    at the edge is held.

    Args:
        motor_temperature_degc: Any shape. [degC]
        points_degc: Rising, shape (K,). [degC]
        viscous: fv at each, shape (K,). [N m s/rad]

    Returns:
        fv, same shape, motor side; NaN where the temperature is NaN. [N m s/rad]
    """
    degc = np.clip(_float(motor_temperature_degc), points_degc[0], points_degc[-1])
    return np.asarray(table_curve(points_degc, viscous)(degc))


def friction_torque(
    motor_velocity: ArrayLike,
    coulomb: ArrayLike,
    viscous: ArrayLike,
    *,
    motor_torque_rigid: ArrayLike = 0.0,
    load_coulomb: ArrayLike = 0.0,
    load_saturation: ArrayLike = np.inf,
    stribeck_torque: ArrayLike = 0.0,
    stribeck_velocity: ArrayLike = 1.0,
    stribeck_exponent: ArrayLike = 1.0,
    smooth_velocity: ArrayLike = 0.0,
    viscous_exponent: ArrayLike = 1.0,
    exponent_velocity: ArrayLike = 1.0,
    standing: NDArray[np.bool_] | None = None,
) -> Float:
    """Return the torque that the drive must add against friction.

    ``(fc + load min(|tau|, taus) + fs exp(-(|w| / ws)^p)) sgn(w) + fv w`` (paper A, eq. 3); with
    a smooth velocity ``w0 > 0`` the sign is ``tanh(w / w0)``, with a viscous exponent w in the last
    term is `viscous_velocity`. Optional terms are off by default.

    Args:
        motor_velocity: w, shape (..., n). [rad/s]
        coulomb: fc, shape (..., n). [N m]
        viscous: fv at the present temperature, shape (..., n). [N m s/rad]
        motor_torque_rigid: tau, for load-dependent friction, shape (..., n). [N m]
        load_coulomb: Friction per load torque, shape (n,). [-]
        load_saturation: taus, beyond which that rises no further, shape (n,). [N m]
        stribeck_torque: fs, shape (n,). [N m]
        stribeck_velocity: ws, shape (n,). [rad/s]
        stribeck_exponent: p, shape (n,). [-]
        smooth_velocity: w0, shape (n,); 0 for the sharp sign. [rad/s]
        viscous_exponent: q, shape (n,); 1 for friction in proportion to speed. [-]
        exponent_velocity: wq, at which it changes nothing, shape (n,). [rad/s]
        standing: Where the axis stands still: the torque is 0 there, shape (..., n).

    Returns:
        Motor side, with the sign of w, shape (..., n). [N m]
    """
    speed = _float(motor_velocity)
    constant = _float(coulomb)
    if np.any(load_coulomb):
        constant = constant + _float(load_coulomb) * np.minimum(
            np.abs(_float(motor_torque_rigid)), _float(load_saturation)
        )
    if np.any(stribeck_torque):
        ratio = np.abs(speed) / _float(stribeck_velocity)
        constant = constant + _float(stribeck_torque) * np.exp(
            -(ratio ** _float(stribeck_exponent))
        )
    sign = np.sign(speed)
    if np.any(smooth_velocity):
        with np.errstate(divide="ignore", invalid="ignore"):
            smooth = _float(smooth_velocity)
            sign = np.where(smooth > 0, np.tanh(speed / smooth), sign)
    if np.any(_float(viscous_exponent) != 1.0):
        speed = viscous_velocity(speed, viscous_exponent, exponent_velocity)
    torque = constant * sign + _float(viscous) * speed
    return torque if standing is None else np.where(standing, 0.0, torque)


def viscous_velocity(
    motor_velocity: ArrayLike, exponent: ArrayLike, exponent_velocity: ArrayLike
) -> Float:
    """Return what viscous friction is in proportion to, ``wq sgn(w) (|w| / wq)^q``.

    A lubricant film drags with less than the first power of its speed, as the speed torque of a
    rolling bearing does, with ``(viscosity speed)^(2/3)`` (Palmgren).

    Args:
        motor_velocity: w, shape (..., n). [rad/s]
        exponent: q > 0, shape (n,). [-]
        exponent_velocity: wq > 0, at which it is w, shape (n,). [rad/s]

    Returns:
        Same shape as ``motor_velocity``, with its sign. [rad/s]
    """
    speed, unit = _float(motor_velocity), _float(exponent_velocity)
    return unit * np.sign(speed) * (np.abs(speed) / unit) ** _float(exponent)


def shaft_power(motor_torque: ArrayLike, motor_velocity: ArrayLike) -> Float:
    """Return the mechanical power at the shafts, ``P = tau w`` (paper A, eq. 5).

    Args:
        motor_torque: tau, shape (..., n). [N m]
        motor_velocity: w, shape (..., n). [rad/s]

    Returns:
        Positive where the motor drives, shape (..., n). [W]
    """
    return _float(motor_torque) * _float(motor_velocity)


def loss_model_power(
    shaft_power: ArrayLike,
    motor_velocity: ArrayLike,
    motor_torque: ArrayLike,
    motor_temperature_degc: ArrayLike = REFERENCE_DEGC,
    *,
    constant: ArrayLike = 0.0,
    linear: ArrayLike = 0.0,
    quadratic: ArrayLike = 0.0,
    copper: ArrayLike = 0.0,
    copper_temperature_coefficient: ArrayLike = 0.0,
) -> Float:
    """Return the electrical input of drives: shaft power plus losses.

    ``P_el = P + c0 + c1 |w| + c2 w^2 + k (1 + alpha (T - 20)) tau^2``.

    Args:
        shaft_power: P, shape (..., n). [W]
        motor_velocity: w, shape (..., n). [rad/s]
        motor_torque: tau, rigid plus friction, shape (..., n). [N m]
        motor_temperature_degc: T of the windings, shape (..., n). [degC]
        constant: c0, shape (n,). [W]
        linear: c1, shape (n,). [W s/rad]
        quadratic: c2, shape (n,). [W s^2/rad^2]
        copper: k at 20 degC, shape (n,). [W/(N m)^2]
        copper_temperature_coefficient: alpha, shape (n,). [1/K]

    Returns:
        Shape (..., n). [W]
    """
    speed, torque = np.abs(_float(motor_velocity)), _float(motor_torque)
    degc = _float(motor_temperature_degc)
    winding = 1 + _float(copper_temperature_coefficient) * (degc - REFERENCE_DEGC)
    slope = _float(linear) + _float(quadratic) * speed
    loss = _float(constant) + slope * speed
    loss = loss + _float(copper) * winding * torque * torque
    return _float(shaft_power) + loss


def grid_balance(
    bus_power: ArrayLike,
    loss_dc: float = 0.0,
    loss_grid: Float | float = 0.0,
    capacitor_power: ArrayLike = 0.0,
    regeneration_efficiency: float | None = None,
) -> Balance:
    """Balance the DC bus (paper A, eq. 6): what the grid gives and the brake resistor takes.

    With ``D = P_dc + P_l,dc + P_capacitor``: ``P_grid = D + P_l,grid`` and no brake power where
    ``D >= 0``; else ``P_grid = P_l,grid`` and ``P_brake = |D|``. A regenerative supply returns
    a share of ``|D|`` to the grid and loses the rest, which counts as loss on the grid side.

    Args:
        bus_power: P_dc, sum of the drive inputs, shape (N,); NaN gives NaN. [W]
        loss_dc: P_l,dc, constant. [W]
        loss_grid: P_l,grid, constant or with a fan, shape () or (N,). [W]
        capacitor_power: Into the DC-link capacitor, signed, shape (N,). [W]
        regeneration_efficiency: Share that a regenerative supply returns; None: the supply
            returns nothing and a resistor brakes. [-]

    Returns:
        The flows.
    """
    demand = _float(bus_power) + loss_dc
    capacitor = np.zeros_like(demand) + _float(capacitor_power)
    supplied = demand + capacitor
    excess = np.maximum(-supplied, 0.0)
    brake, grid_side = excess, np.full_like(demand, loss_grid)
    if regeneration_efficiency is not None:
        brake = excess * 0.0
        grid_side = loss_grid + excess * (1 - regeneration_efficiency)
    return Balance(
        loss_dc=np.full_like(demand, loss_dc),
        loss_grid=grid_side,
        brake_power=brake,
        capacitor_power=capacitor,
        grid_power=supplied + brake + grid_side,
    )


def trapezoid_energy(time: ArrayLike, power: ArrayLike) -> Float:
    """Return the energy ``E = integral P dt`` by trapezoids (paper A, eq. 7).

    Args:
        time: Rising, shape (N,). [s]
        power: Shape (N,) or (N, R). [W]

    Returns:
        Energy from the first to the last sample, shape () or (R,); NaN where a power is. [J]

    Raises:
        ShapeError: If there are not as many times as powers.
    """
    stamps, values = _float(time), _float(power)
    if not values.ndim or stamps.shape != values.shape[:1]:
        raise ShapeError(f"{stamps.shape} times for powers of shape {values.shape}", "(N,) each")
    if not values.size:
        return np.zeros(values.shape[1:])
    columns = values.reshape(len(values), -1)
    energy, _ = interval_energy(columns, columns[0], np.diff(stamps, prepend=stamps[0]))
    return np.asarray(energy.sum(axis=0).reshape(values.shape[1:]))


def interval_energy(power: Float, before: Float, duration: Float) -> tuple[Float, float]:
    """Return the trapezoid of each interval that ends at a sample (paper A, eq. 7).

    Args:
        power: Shape (N, R), N >= 1. [W]
        before: Power at the sample before the first, shape (R,). [W]
        duration: Of each interval, shape (N,). [s]

    Returns:
        Energy of each interval, shape (N, R), and the greatest amount among them, NaN if one
        is NaN. [J]
    """
    energy, half = np.empty_like(power), (0.5 * duration)[:, None]
    np.add(power[0], before, out=energy[0])
    peaks: list[float] = []
    size = max(1, CACHED // len(power))
    for first in range(0, power.shape[1], size):
        columns = slice(first, first + size)
        part, given = energy[:, columns], power[:, columns]
        np.add(given[1:], given[:-1], out=part[1:])
        part *= half
        peaks += (float(part.max()), -float(part.min()))
    return energy, float(np.max(peaks))
