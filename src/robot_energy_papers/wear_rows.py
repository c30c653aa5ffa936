"""Rows of the rig for many days of work: computed once a load, summed up at any temperature.

A thousand hours of a rig sampled at 25 Hz take hours. Its robot repeats one program, so all
that changes from one cycle to the next are temperatures, payload and noise. For each payload one
cycle runs on the rig and through the pipeline. Of every part of that cycle the sums of

- rigid torque of the plant, its dry friction, its viscous friction, its iron drag,
- rigid torque of the monitor, its Coulomb and its viscous friction,

along the motion are kept, by direction and bucket of speed. At any gear and motor temperature
the parts are then sums of these with the laws of plant and model, exactly. The thermal
network of the rig runs on through all days with the heat of each cycle. So every hour is
computed and none repeated: hall, payloads, lag of gear and sensor, offsets and noise are of that
hour. What the rig would do and this does not: noise of velocity and stamps is that of one cycle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from robot_energy.blocks import NANOSECOND, Float
from robot_energy.condition.joint_friction import MotionSums
from robot_energy.model import RobotModel, load
from robot_energy.model.payload import Payload, payload
from robot_energy.physics.friction import FrictionModel
from robot_energy.rig import PlantProfile, RigConfig
from robot_energy.rig.plant import COULOMB_DEGC, MIN_COULOMB_SHARE, REFERENCE_DEGC, PlantFriction
from robot_energy.rig.thermal import ThermalNetwork
from robot_energy_papers.learning_study import work
from robot_energy_papers.wear_cycle import RATE, CycleSums, cycle_sums

PART = 15.0  # s summed up together
LOADS = 8  # pairs of true and known payload of a plant
HIDDEN = 3.0  # greatest mass that the monitor does not get [kg]
CHANGE_EVERY = 1800.0  # s between two payloads
COLD, HOT = (15.0, 22.0), (52.0, 60.0)  # of the hall, night and day, drawn for each day [degC]
DAY = 86_400.0  # s
HOTTEST = (
    125.0  # of a motor on the hottest day; a cell that gets hotter waits between cycles [degC]
)
WAITS = (0.0, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0)  # s of waiting per second of a cycle
MAX_STEP = 40.0  # s of the thermal network at once
READINGS = 5  # of the temperature sensors that a part averages
START_NS = 1_700_000_000_000_000_000


Day = list[MotionSums]
Wear = Callable[[Float], Float]


class _State(NamedTuple):
    """A cycle: temperatures at its start, those of the sensors, its load, wear of each axis."""

    gear_degc: Float
    motor_degc: Float
    seen_degc: Float
    load: int
    worn: Float


class MeterRow(NamedTuple):
    """A window of the power meter, as `robot_energy.condition.wear.WearMonitor` takes it."""

    stamp_ns: int
    duration: float
    residual: float
    friction: float
    degc: float


class WearRows:
    """One drawn plant at one program, with payloads that change, day after day.

    Args:
        profile: The plant.
        seed: Of work, payloads, weather and sensors.
        part: What is summed up together. [s]

    Attributes:
        payloads: True ones, each with the one that the monitor gets.
        cycle: Length of a cycle. [s]
    """

    def __init__(self, profile: PlantProfile, seed: int, part: float = PART) -> None:
        self.profile = profile
        self.model: RobotModel = load(profile.body)
        self._part = part
        self._config = RigConfig.hard()
        self._random = np.random.default_rng([seed, 0x77656172])
        self._program = work(profile, seed)
        self._law = FrictionModel.from_model(self.model)
        self._friction = PlantFriction(profile, self._config, 1.0 / RATE)
        self._parts = max(1, round(self._program.period / part))
        self.cycle = self._parts * part
        self.payloads = self._payloads()
        self._loads = [
            cycle_sums(profile, self.model, self._program, seed, part, self._parts, carried, known)
            for carried, known in self.payloads
        ]
        self._wait = self.cycle * next(
            (wait for wait in WAITS if self._hottest(1.0 / (1.0 + wait)) < HOTTEST), WAITS[-1]
        )
        offset = self._config.sensors.temperature_offset
        self._meter_gain = 1.0 + self._config.sensors.meter_class * self._random.uniform(-1.0, 1.0)
        self._offset: Float = offset * self._random.standard_normal(profile.n_joints)

    def _payloads(self) -> list[tuple[list[Payload], Payload | None]]:
        """True payloads, with the one that the monitor gets."""
        if not self.model.payload:
            return [([], None)]
        body = self.model.payload[0]
        pairs: list[tuple[list[Payload], Payload | None]] = []
        for number in range(LOADS):
            known = body.mass * (1.0 if number % 2 else self._random.uniform(0.2, 1.0))
            true = known + (self._random.uniform(0.0, HIDDEN) if number % 4 >= 2 else 0.0)
            carried = [
                payload(body.link, float(mass), body.centre_of_mass, body.inertia)
                for mass in (true, known)
            ]
            pairs.append((carried[:1], carried[1]))
        return pairs

    def days(self, days: int, wear: Wear | None = None) -> Iterator[Day]:
        """Run day after day, with the torque of every motor.

        Args:
            days: How many.
            wear: Factor on the friction of each axis, of its hours of motion, shape (n,) both.

        Yields:
            The parts of each.
        """
        for day, states in self._states(days, wear):
            yield self._day(day, states)

    def meter_days(self, days: int, wear: Wear | None = None) -> Iterator[list[MeterRow]]:
        """Run day after day, with a power meter alone.

        Grid power is that of the rig at `COULOMB_DEGC`, plus what friction and copper of the plant
        take more at the present temperatures, over the efficiency of the rectifier; the prediction
        follows the temperature by its friction alone.

        Args:
            days: How many.
            wear: As for `days`.

        Yields:
            The windows of each.
        """
        for day, states in self._states(days, wear):
            yield self._meter_day(day, states)

    def _states(self, days: int, wear: Wear | None) -> Iterator[tuple[int, list[_State]]]:
        profile, config = self.profile, self._config
        length = self.cycle + self._wait
        cycles = round(DAY / length)
        steps = int(np.ceil(length / MAX_STEP))
        start = np.full(profile.n_joints, 35.0)
        network = ThermalNetwork(profile, length / steps, start, start, 35.0)
        lag = np.exp(-length / config.sensors.temperature_lag)
        hours, worn, sensed = np.zeros_like(start), np.ones_like(start), start
        cold, which = self._random.uniform(*COLD), 0
        hold = max(1, round(CHANGE_EVERY / length))
        for day in range(days):
            hot, next_cold = self._random.uniform(*HOT), self._random.uniform(*COLD)
            states: list[_State] = []
            for number in range(cycles):
                if number % hold == 0:
                    which = int(self._random.integers(len(self._loads)))
                phase = 2.0 * number / cycles
                low = cold if phase < 1.0 else next_cold
                network.ambient_degc = float(low + (hot - low) * 0.5 * (1 - np.cos(np.pi * phase)))
                gear, motor = network.gear_temperature_degc, network.motor_temperature_degc
                heat, friction = self._heat(self._loads[which], gear, motor, worn)
                share = profile.friction_to_motor
                duty = self.cycle / length
                for _ in range(steps):
                    network.step(duty * (heat + share * friction), duty * (1.0 - share) * friction)
                settled = network.motor_temperature_degc
                sensed = settled + lag * (sensed - settled)
                states.append(_State(gear, motor, sensed, which, worn))
                hours = hours + self._loads[which].time.sum(axis=(0, 1, 3)) / 3600.0
                if wear is not None:
                    worn = wear(hours)
            cold = next_cold
            yield day, states

    def _heat(self, one: CycleSums, gear: Float, motor: Float, worn: Float) -> tuple[Float, Float]:
        """Heat of the motors without friction, and friction, means of a cycle. [W]"""
        heat, friction = self._powers(one, gear, motor, worn)
        return heat.mean(axis=0), friction.mean(axis=0)

    def _powers(
        self, one: CycleSums, gear: Float, motor: Float, worn: Float
    ) -> tuple[Float, Float]:
        """Iron and copper losses, and friction, of every part, shape (P, n) each. [W]"""
        profile = self.profile
        dry, viscous = self._at(gear)
        weights = np.stack([np.ones_like(dry), worn * dry, worn * viscous])
        warmer = motor - REFERENCE_DEGC
        constant = profile.torque_constant * (1.0 - profile.torque_constant_fall * warmer)
        resistance = profile.resistance * (1.0 + profile.resistance_rise * warmer)
        square = np.einsum("an,bn,pabn->pn", weights, weights, one.square) / constant**2
        friction = worn * (dry * one.power[:, 1] + viscous * one.power[:, 2])
        return 3.0 * resistance * square + one.power[:, 0], friction

    def _hottest(self, duty: float) -> float:
        """Temperature of the hottest motor after hours in the hottest hall. [degC]"""
        profile = self.profile
        gear = motor = np.full(profile.n_joints, HOT[1])
        share = profile.friction_to_motor
        highest = 0.0
        for one in self._loads:
            for _ in range(60):  # a fixed point; the warmth of copper and oil act on themselves
                heat, friction = self._heat(one, gear, motor, np.ones_like(gear))
                own = duty * (heat + share * friction)
                gear = HOT[1] + duty * (heat + friction) / profile.gear_conductance
                motor = np.minimum(gear + own / profile.motor_conductance, 300.0)
            highest = max(highest, float(motor.max()))
        return highest

    def _at(self, gear_degc: Float) -> tuple[Float, Float]:
        """Factor on dry friction, and viscous coefficient of the plant."""
        fall = self.profile.hard.coulomb_fall
        dry = np.maximum(1.0 - fall * (gear_degc - COULOMB_DEGC), MIN_COULOMB_SHARE)
        return dry, self._friction.viscous(gear_degc)

    def _meter_day(self, day: int, states: list[_State]) -> list[MeterRow]:
        sensors, supply = self._config.sensors, self.profile.supply
        first_ns = START_NS + round(day * DAY / NANOSECOND)
        base = np.full(self.profile.n_joints, COULOMB_DEGC)
        unworn = np.ones_like(base)
        length = self.cycle + self._wait
        rows: list[MeterRow] = []
        for cycle, state in enumerate(states):
            one = self._loads[state.load]
            now = np.add(*self._powers(one, state.gear_degc, state.motor_degc, state.worn))
            then = np.add(*self._powers(one, base, base, unworn))
            more = (now - then).sum(axis=1) / supply.rectifier_efficiency
            degc = np.rint(state.seen_degc + self._offset)
            friction = one.own[:, 0] + self._law.viscous(degc) * one.own[:, 1]
            before = one.own[:, 0] + self._law.viscous(base) * one.own[:, 1]
            predicted = (
                one.grid[:, 1] + (friction - before).sum(axis=1) / supply.rectifier_efficiency
            )
            noise = sensors.meter_noise / np.sqrt(self._part * sensors.meter_rate)
            gain = self._meter_gain + noise * self._random.standard_normal(self._parts)
            residual = gain * (one.grid[:, 0] + more) - predicted
            waits = round(self._wait / self._part)
            offs = [*residual.tolist(), *[gain[0] * one.rest[0] - one.rest[1]] * waits]
            owns = [*friction.sum(axis=1).tolist(), *[0.0] * waits]
            for number, (off, own) in enumerate(zip(offs, owns, strict=True)):
                stamp_ns = first_ns + round(
                    (cycle * length + (number + 1) * self._part) / NANOSECOND
                )
                energies = (self._part * float(off), self._part * float(own))
                rows.append(MeterRow(stamp_ns, self._part, *energies, float(degc.mean())))
        return rows

    def _day(self, day: int, states: list[_State]) -> Day:
        sensors = self._config.sensors
        seen = np.array([state.seen_degc for state in states]) + self._offset
        shape = (len(states), self._parts, READINGS, self.profile.n_joints)
        noise = sensors.temperature_noise * self._random.standard_normal(shape)
        degc = np.rint(seen[:, None, None] + noise).mean(axis=2)
        first_ns = START_NS + round(day * DAY / NANOSECOND)
        parts: Day = []
        for cycle, state in enumerate(states):
            one = self._loads[state.load]
            measured, model = self.torques(
                state.load, state.gear_degc, state.motor_degc, degc[cycle], state.worn
            )
            scatter = sensors.torque_noise * np.sqrt(one.time / RATE)
            measured = measured + scatter * self._random.standard_normal(scatter.shape)
            for number in range(self._parts):
                at = cycle * (self.cycle + self._wait) + (number + 1) * self._part
                parts.append(
                    MotionSums(
                        first_ns + round(at / NANOSECOND),
                        model[number],
                        measured[number],
                        one.time[number],
                        one.load[number],
                        degc[cycle, number],
                    )
                )
        return parts

    def torques(
        self, load: int, gear_degc: Float, motor_degc: Float, seen_degc: Float, worn: Float
    ) -> tuple[Float, Float]:
        """Return what the parts of a cycle say of friction, without noise.

        Args:
            load: Which payload.
            gear_degc: Shape (n,). [degC]
            motor_degc: Shape (n,). [degC]
            seen_degc: What the monitor takes for it, shape (n,) or (P, n). [degC]
            worn: Factor on the friction of the plant, shape (n,). [-]

        Returns:
            Sums of measured and of model friction, shape (P, 2, n, SPEED_BUCKETS). [N m s]
        """
        rigid, still, turning, drag, own, coulomb, turn = self._loads[load].sums
        fall = self.profile.torque_constant_fall
        gain = 1.0 / (1.0 - fall * (motor_degc - REFERENCE_DEGC))[:, None]
        dry, viscous, wear = (each[:, None] for each in (*self._at(gear_degc), worn))
        measured = gain * (rigid + wear * (dry * still + viscous * turning) + drag) - own
        law = np.broadcast_to(self._law.viscous(seen_degc), (self._parts, len(worn)))
        return measured, coulomb + law[:, None, :, None] * turn
