"""Drives and cabinet: electrical input of the drives, DC bus balance, brake resistor, grid power.

Four models of drives, motor side: `Ideal` (paper A: the drive loses nothing), `EfficiencyMaps`
(paper B, section 6: measured efficiencies, looked up at the nearest torque and speed), `LossModel`
(shaft power plus losses: single-valued and safe near zero speed, where an efficiency is not) and
`LossMaps` (the same with losses of any form that rise with speed and torque).

Their sum is P_dc. With the demand ``D = P_dc + P_l,dc`` on the DC bus (paper A, section II):

- ``D >= 0``: ``P_grid = D + P_l,grid``, ``P_brake = 0``
- ``D < 0``: ``P_grid = P_l,grid``, ``P_brake = |D|``

A regenerative supply returns the share ``eta`` of ``|D|`` to the grid and loses the
rest, which is counted as loss on the grid side. A DC-link capacitor takes excess first
and gives it back first. In every case
``P_grid = P_dc + P_l,dc + P_l,grid + P_brake + P_capacitor``.

A fan that the warmest motor switches is a part of ``P_l,grid``: ``p P_fan``, with the probability
``p`` that it runs. At a warmest motor of T this is ``max(min(p, P(T > T_off)), P(T > T_on))``, with
``T_off = T_on - hysteresis``; on the right is the previous ``p``. Start and stop are uniform within
their deviations. Above all possible starts ``p`` is 1. Below all possible stops it is 0. Between
stop and start ``p`` does not change. Before the first temperature it is 1/2. At the first it is
the less of 1/2 and ``1/2 (P(T > T_off) + P(T > T_on))``: of the fans between stop and start half
run. Up to the temperature at which recordings began without the fan it is ``P(T > T_on)``.
Thermometer i reads ``T_i + o_i``, where o_i is known; T is the greatest of the readings less o_i. A
meter may show odds b that the fan runs: then ``q b / (1 - q + q b)`` counts, with q as p without
that temperature, and p goes on as before.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from math import hypot, inf, isfinite
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.errors import KindError, ModelFileError
from robot_energy.model.drive_models import (
    DRIVE_MODELS,
    DriveModel,
    EfficiencyMap,
    LossDrive,
    LossMap,
)
from robot_energy.model.schema import Cabinet, RobotModel
from robot_energy.physics.equations import (
    REFERENCE_DEGC,
    Balance,
    grid_balance,
    loss_model_power,
)
from robot_energy.physics.torque_constant import TorqueConstants
from robot_energy.timeline.blocks import NANOSECOND, Float, Int

COPPER_KEY = "copper_temperature_coefficient"  # of entries whose losses follow the windings
UNSEEN = 0.5  # probability that a fan runs before any temperature is known
HALF_WIDTH = 3.0**0.5  # of a uniform distribution, over its standard deviation


class Drive(Protocol):
    """Turns shaft power into electrical input, for all axes of a robot."""

    def input_power(
        self, shaft_power: Float, motor_velocity: Float, motor_torque: Float,
        motor_temperature_degc: Float,
    ) -> tuple[Float, NDArray[np.bool_] | None]:  # fmt: skip
        """Return the electrical input, shape (N, n) [W], and where it is extrapolated, if at all.

        Args:
            shaft_power: Shape (N, n). [W]
            motor_velocity: Shape (N, n). [rad/s]
            motor_torque: Rigid plus friction, shape (N, n). [N m]
            motor_temperature_degc: Of the windings, shape (N, n). [degC]
        """
        ...


class Ideal:
    """P_el = P_mech (paper A, eq. 6)."""

    def input_power(
        self, shaft_power: Float, motor_velocity: Float, motor_torque: Float,
        motor_temperature_degc: Float,
    ) -> tuple[Float, NDArray[np.bool_] | None]:  # fmt: skip
        """Return the shaft power itself; arguments and result as in `Drive.input_power`."""
        return shaft_power, None


class LossModel:
    """P_el = P_mech + c0 + c1 |w| + c2 w^2 + k (1 + alpha (T - 20)) tau^2."""

    def __init__(self, entries: list[LossDrive]) -> None:
        names = "constant", "linear", "quadratic", "copper", "copper_temperature_coefficient"
        self._figures = {
            name: np.asarray([getattr(entry, name).value for entry in entries]) for name in names
        }

    def input_power(
        self, shaft_power: Float, motor_velocity: Float, motor_torque: Float,
        motor_temperature_degc: Float,
    ) -> tuple[Float, NDArray[np.bool_] | None]:  # fmt: skip
        """Return shaft power plus losses, which are never negative, as in `Drive.input_power`."""
        given = shaft_power, motor_velocity, motor_torque, motor_temperature_degc
        return loss_model_power(*given, **self._figures), None


class EfficiencyMaps:
    """P_el = P_mech / eta, eta of the nearest measured (torque, speed) (paper B, 6.2.1).

    Distances are standardised Euclidean: each coordinate is divided by its standard
    deviation over the points of the map.
    """

    def __init__(self, entries: list[EfficiencyMap]) -> None:
        from scipy.spatial import KDTree  # heavy to import, needed for this model only

        self._scales: list[Float] = []
        self._trees: list[KDTree] = []
        self._efficiency: list[Float] = []
        self._reach = [entry.reach for entry in entries]
        for entry in entries:
            points = np.column_stack([entry.motor_torque, entry.motor_velocity])
            scale = points.std(axis=0, ddof=1) if len(points) > 1 else np.ones(2)
            scale = np.where(scale > 0, scale, 1.0)
            self._scales.append(scale)
            self._trees.append(KDTree(points / scale))
            self._efficiency.append(np.asarray(entry.efficiency))

    def input_power(
        self, shaft_power: Float, motor_velocity: Float, motor_torque: Float,
        motor_temperature_degc: Float,
    ) -> tuple[Float, NDArray[np.bool_] | None]:  # fmt: skip
        """Return shaft power over the efficiency at the nearest point as in `Drive.input_power`."""
        power = np.full_like(shaft_power, np.nan)
        extrapolated = np.zeros(shaft_power.shape, dtype=np.bool_)
        for joint, tree in enumerate(self._trees):
            query = np.column_stack([motor_torque[:, joint], motor_velocity[:, joint]])
            finite = np.isfinite(query).all(axis=1)
            distance, nearest = tree.query(query[finite] / self._scales[joint])
            eta = self._efficiency[joint][nearest]
            power[finite, joint] = shaft_power[finite, joint] / eta
            extrapolated[finite, joint] = np.asarray(distance) > self._reach[joint]
        return power, extrapolated


class LossMaps:
    """P_el = P_mech + L(|w|, |tau| sqrt(1 + alpha (T - 20))), L bilinear between knots."""

    def __init__(self, entries: list[LossMap]) -> None:
        self._maps = [
            tuple(np.asarray(part) for part in (one.motor_velocity, one.motor_torque, one.loss))
            for one in entries
        ]
        # Rises of the last cells beyond the knots, no more than where the other axis is higher: or
        # losses would fall along that axis out there.
        self._beyond = [
            tuple(
                np.minimum.accumulate(rises[::-1])[::-1]
                for rises in (loss[-1] - loss[-2], loss[:, -1] - loss[:, -2])
            )
            for _, _, loss in self._maps
        ]
        self._alpha = [entry.copper_temperature_coefficient.value for entry in entries]

    def input_power(
        self, shaft_power: Float, motor_velocity: Float, motor_torque: Float,
        motor_temperature_degc: Float,
    ) -> tuple[Float, NDArray[np.bool_] | None]:  # fmt: skip
        """Return shaft power plus losses, which are never negative, as in `Drive.input_power`."""
        power, extrapolated = shaft_power.copy(), np.zeros(shaft_power.shape, dtype=np.bool_)
        for joint, (speeds, loads, loss) in enumerate(self._maps):
            faster, heavier = self._beyond[joint]
            speed = np.abs(motor_velocity[:, joint])
            degc = motor_temperature_degc[:, joint]
            load = equal_heat_torque(motor_torque[:, joint], degc, self._alpha[joint])
            (i, x), (j, y) = knot_cells(speeds, speed), knot_cells(loads, load)
            outside = (x > 1.0) | (y > 1.0)
            low, high = loss[i, j], loss[i + 1, j]
            inside_x, inside_y = np.minimum(x, 1.0), np.minimum(y, 1.0)
            by_speed = high - low + inside_y * (loss[i + 1, j + 1] - high - loss[i, j + 1] + low)
            power[:, joint] += low + inside_x * by_speed + inside_y * (loss[i, j + 1] - low)
            along_speed = faster[j] + inside_y * (faster[j + 1] - faster[j])
            along_load = heavier[i] + inside_x * (heavier[i + 1] - heavier[i])
            power[:, joint] += (x - inside_x) * along_speed + (y - inside_y) * along_load
            extrapolated[:, joint] = outside
        return power, extrapolated


class WarmMagnets:
    """Drives whose windings take more current where warm magnets are weaker.

    Args:
        drive: Whose losses follow the torque.
    """

    def __init__(self, drive: Drive, constants: TorqueConstants) -> None:
        self._drive, self._constants = drive, constants

    def input_power(
        self, shaft_power: Float, motor_velocity: Float, motor_torque: Float,
        motor_temperature_degc: Float,
    ) -> tuple[Float, NDArray[np.bool_] | None]:  # fmt: skip
        """Return shaft power plus losses at the current that the torque takes.

        Arguments and result as in `Drive.input_power`.
        """
        torque = motor_torque / self._constants.left(motor_temperature_degc)
        return self._drive.input_power(shaft_power, motor_velocity, torque, motor_temperature_degc)


def equal_heat_torque(torque: Float, degc: Float, alpha: float) -> Float:
    """Return the torque that heats windings at 20 degC as a torque at T does, >= 0. [N m]

    ``|tau| sqrt(1 + alpha (T - 20))``: the copper loss is ``k (1 + alpha (T - 20)) tau^2``.

    Args:
        torque: Any shape. [N m]
        degc: T, same shape. [degC]
        alpha: Of the resistance. [1/K]
    """
    rise = 1.0 + alpha * (degc - REFERENCE_DEGC)
    return np.abs(torque) * np.sqrt(np.maximum(rise, 0.0))


def knot_cells(knots: Float, values: Float) -> tuple[Int, Float]:
    """Return the cell of each value and its place in it: 0 to 1, above 1 beyond the last knot.

    Args:
        knots: From 0, rising, shape (K,). [any unit]
        values: Not negative; NaN gives the last cell and NaN, shape (N,). [any unit]
    """
    cell = np.clip(np.searchsorted(knots, values, side="right") - 1, 0, len(knots) - 2)
    return cell, (values - knots[cell]) / np.diff(knots)[cell]


def ideal(entries: list[object]) -> Ideal:
    """Return the drives of joints that lose nothing.

    Args:
        entries: None: there is no entry.
    """
    return Ideal()


def drive_from_model(model: RobotModel) -> Drive:
    """Return the drives that a model file names, joints in model order."""
    kind = DRIVE_MODELS[model.drive]
    entries = kind.entries(model.joints)
    if kind.entry is not None and len(entries) < len(model.joints):
        raise ModelFileError(
            f"{len(entries)} of {len(model.joints)} joints have the key '{kind.key}'",
            f"it at every joint, as the drive model '{model.drive}' needs it",
        )
    if kind.physics is None:
        raise KindError(f"the drive model '{kind.name}' has no physics", "a `Drive`")
    return with_warm_magnets(kind, kind.physics(entries), TorqueConstants.of(model))


def with_warm_magnets(kind: DriveModel, drive: Drive, constants: TorqueConstants | None) -> Drive:
    """Return drives whose losses follow warm magnets where they follow the temperature at all.

    Args:
        constants: Of their motors; None where no torque constant falls.
    """
    warms = kind.entry is not None and COPPER_KEY in kind.entry.model_fields
    return drive if constants is None or not warms else WarmMagnets(drive, constants)


class FanStage:
    """Power of the fan by the temperature of the warmest motor.

    Args:
        assumed: Whether temperatures are those of the motors and not what thermometers show.

    Attributes:
        powers: ``p P_fan`` and ``q P_fan`` of the last step, q being p without the temperature up
            to which recordings began without the fan, shape (2, N); None without a fan. [W]
        odds: That it runs, by a power meter alone; 1 without one. [-]
    """

    def __init__(self, cabinet: Cabinet, assumed: bool = False) -> None:
        fan = cabinet.fan
        self._power = 0.0
        if fan is not None:
            self._power = fan.power.value
            self._thermometers = None if assumed else fan.thermometers
            self._on, width = fan.on_above_degc.value, fan.on_above_degc.std or 0.0
            less = fan.hysteresis
            self._off = self._on - (0.0 if less is None else less.value)
            begins = fan.begins_off_to_degc
            self._begins_off = -inf if begins is None else begins.value
            self._widths = width, width if less is None else hypot(width, less.std or 0.0)
        self._runs: Float | None = None  # p and q; before any temperature
        self.powers: Float | None = None
        self.odds = 1.0

    def step(self, motor_temperature_degc: Float) -> Float | float:
        """Return the power that is to be expected, shape (N,); 0 without a fan. [W]

        Args:
            motor_temperature_degc: NaN where unknown, shape (N, n). [degC]
        """
        if self._power == 0.0:
            return 0.0
        warmest = warmest_degc(motor_temperature_degc, self._thermometers)
        begins = np.flatnonzero(np.diff(warmest, prepend=np.nan) != 0.0)
        runs = np.full((2, len(begins)), UNSEEN)
        for place, degc in enumerate(warmest[begins].tolist()):
            if isfinite(degc):
                least = _warmer(degc, self._on, self._widths[0])
                most = _warmer(degc, self._off, self._widths[1])
                before = self._runs
                if before is None:
                    half = min(UNSEEN, 0.5 * (least + most))
                    before = np.array([0.0 if degc <= self._begins_off else half, half])
                self._runs = np.maximum(np.minimum(before, most), least)
            if self._runs is not None:
                runs[:, place] = self._runs
        if self.odds != 1.0:
            sure = abs(self.odds - 1.0) / (self.odds + 1.0)
            runs[0] += sure * (runs[1] - runs[0])
            runs = self.odds * runs / (1.0 - runs + self.odds * runs)
        samples = np.diff(np.append(begins, len(warmest)))
        self.powers = self._power * np.repeat(runs, samples, axis=1)
        return self.powers[0]


def warmest_degc(motor_temperature_degc: Float, thermometers: Sequence[float] | None) -> Float:
    """Return the temperature of the warmest motor, NaN where none is known, shape (N,). [degC]

    Args:
        motor_temperature_degc: Readings, shape (N, n). [degC]
        thermometers: What each shows above the mean of all; None: 0. [K]
    """
    if thermometers is not None:
        motor_temperature_degc = motor_temperature_degc - np.asarray(thermometers)
    return np.fmax.reduce(motor_temperature_degc, axis=1)


def _warmer(degc: float, limit: float, std: float) -> float:
    """Probability that a temperature is above a limit of some deviation."""
    half = HALF_WIDTH * std
    if half == 0.0:
        return float(degc > limit)
    return min(max(0.5 + 0.5 * (degc - limit) / half, 0.0), 1.0)


class CabinetStage:
    """Balances the bus sample by sample; stateful only with a capacitor.

    Attributes:
        offset_dc: Added to the constant loss of the DC side. [W]
        offset_grid: Added to that of the grid side. [W]
    """

    def __init__(self, cabinet: Cabinet) -> None:
        self._loss_dc = cabinet.loss_dc.value
        self._loss_grid = cabinet.loss_grid.value
        regeneration = cabinet.regeneration_efficiency
        self._returned = None if regeneration is None else regeneration.value
        self._swing = 0.0 if cabinet.capacitor is None else cabinet.capacitor.swing
        self.offset_dc = self.offset_grid = 0.0
        self._stored = 0.0  # J above nominal voltage
        self._last: tuple[int, int] | None = None  # stamp, segment

    def step(
        self, stamp_ns: Int, segment: Int, bus_power: Float, fan_power: Float | float = 0.0
    ) -> Balance:
        """Return the balance of a block.

        Args:
            stamp_ns: Shape (N,); stamps may repeat. [ns]
            segment: Shape (N,). The capacitor is empty at the start of a segment.
            bus_power: P_dc, sum of the drive inputs, shape (N,); NaN gives NaN. [W]
            fan_power: Added to the loss on the grid side, shape (N,). [W]
        """
        loss_dc = self._loss_dc + self.offset_dc
        loss_grid = self._loss_grid + self.offset_grid + fan_power
        demand = bus_power + loss_dc
        capacitor: Float | float = 0.0
        if self._swing > 0:
            capacitor = self._charge(stamp_ns, segment, demand)
        return grid_balance(bus_power, loss_dc, loss_grid, capacitor, self._returned)

    def _charge(self, stamp_ns: Int, segment: Int, demand: Float) -> Float:
        """Power into the capacitor, taken as constant over the interval before a sample."""
        flow = np.zeros_like(demand)
        stamp, part = (stamp_ns[0], segment[0]) if self._last is None else self._last
        duration = np.diff(stamp_ns, prepend=stamp) * NANOSECOND
        fresh = np.diff(segment, prepend=part) != 0
        fresh[0] |= self._last is None
        self._last = int(stamp_ns[-1]), int(segment[-1])
        fed = np.flatnonzero(demand < 0).tolist()
        row, place, stored = 0, 0, self._stored
        while row < len(demand):
            if stored == 0.0:  # nothing happens before the drives feed back again
                place = bisect_left(fed, row, place)
                if place == len(fed):
                    break
                row = fed[place]
            wanted, time = float(demand[row]), float(duration[row])
            if fresh[row]:
                stored = 0.0
            elif isfinite(wanted) and time > 0:
                energy = min(max(-wanted * time, -stored), self._swing - stored)
                stored += energy
                flow[row] = energy / time
            elif isfinite(wanted) and (stored > 0 if wanted > 0 else stored < self._swing):
                flow[row] = -wanted  # at a repeated stamp: what flows as soon as time goes on
            row += 1
        self._stored = stored
        return flow
