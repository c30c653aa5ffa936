"""Rows of the rig for many days of work: computed once a load, summed up at any temperature.

A thousand hours of a rig sampled at 25 Hz take hours. Its robot repeats one program, so all
that changes from one cycle to the next are temperatures, payload and noise. For each payload one
cycle runs on the rig and through the pipeline. Of every part of that cycle the sums of

- rigid torque of the plant, its dry friction, its viscous friction, its iron drag,
- rigid torque of the monitor, its Coulomb and its viscous friction,

along the motion are kept, by direction and bucket of speed. At any gear and motor temperature
the parts are then sums of these with the laws of plant and model, exactly. The thermal
network of the rig runs on through all days with the heat of each cycle. So every hour is
computed and none repeated: hall, payloads, collisions, lag of gear and sensor, offsets and noise
are of that hour. What the rig would do and this does not: noise of velocity and stamps is that of
one cycle.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from robot_energy.condition.joint_friction import MotionSums
from robot_energy.foundation.units import DAY
from robot_energy.model import RobotModel, load
from robot_energy.model.payload import Payload, payload
from robot_energy.physics.friction import FrictionModel
from robot_energy.timeline.blocks import NANOSECOND, Float
from robot_energy_plan.motion.ptp import Program
from robot_energy_rig import PlantProfile, RigConfig
from robot_energy_rig.plant import (
    COULOMB_DEGC,
    MIN_COULOMB_SHARE,
    REFERENCE_DEGC,
    PlantFriction,
    ThermalNetwork,
)
from robot_energy_studies.learning_study import HIDDEN, work
from wear_cycle import RATE, CycleSums, cycle_sums

PART = 15.0  # s summed up together
LOADS = 8  # pairs of true and known payload of a plant
CHANGE_EVERY = 1800.0  # s between two payloads
JOB_LOADS = 4  # the same of a program that is drawn later
KNOWN_JOB = 0.5  # probability that the next program ran before
MOVES, ZONES, OVERRIDES = (6, 40), (0.25, 0.8), (0.3, 1.0)  # of these; share of ranges, of speed
COLD, HOT = (15.0, 22.0), (52.0, 60.0)  # of the hall, night and day, drawn for each day [degC]
HOTTEST = (
    125.0  # of a motor on the hottest day; a cell that gets hotter waits between cycles [degC]
)
WAITS = (0.0, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0)  # s of waiting per second of a cycle
MAX_STEP = 40.0  # s of the thermal network at once
COLLIDE_EVERY = 14_400.0  # s of work between two collisions of an axis, mean
COLLISION = 3.0  # greatest impulse of one, over that of the model's friction in a part
READINGS = 5  # of the temperature sensors that a part averages
START_NS = 1_700_000_000_000_000_000


Day = list[MotionSums]
_Payloads = list[tuple[list[Payload], Payload | None]]
Wear = Callable[[Float], Float]


class _Job(NamedTuple):
    """A program: its cycle with each payload, the length of a cycle, and the wait after it. [s]"""

    loads: list[CycleSums]
    cycle: float
    wait: float


class _State(NamedTuple):
    """A cycle: its beginning [s of the day], wait, temperatures at its start, load, wear."""

    start: float
    wait: float
    gear_degc: Float
    motor_degc: Float
    seen_degc: Float
    load: CycleSums
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
        part: What is summed up together. [s]
        changes: Shortest and longest time with one program, half of them never run before; None
            for the same program always. [h]

    Attributes:
        payloads: True ones of the first program, each with the one that the monitor gets.
        cycle: Length of its cycle. [s]
    """

    def __init__(
        self,
        profile: PlantProfile,
        seed: int,
        part: float = PART,
        changes: tuple[float, float] | None = None,
    ) -> None:
        self.profile = profile
        self.model: RobotModel = load(profile.body)
        self._part, self._seed = part, seed
        self._config = RigConfig.hard()
        self._random = np.random.default_rng([seed, 0x77656172])
        self._law = FrictionModel.from_model(self.model)
        self._bumps = np.random.default_rng([seed, 0x62756D70])
        self._friction = PlantFriction(profile, self._config, 1.0 / RATE)
        self._changes = changes
        self.payloads = self._payloads(self._random, LOADS)
        first = self._job(work(profile, seed), seed, self.payloads)
        self.loads, self.cycle = first.loads, first.cycle
        self._jobs = [first]
        offset = self._config.sensors.temperature_offset
        self._meter_gain = 1.0 + self._config.sensors.meter_class * self._random.uniform(-1.0, 1.0)
        self._offset: Float = offset * self._random.standard_normal(profile.n_joints)

    def _job(self, program: Program, seed: int, payloads: _Payloads) -> _Job:
        """Compute the cycle of a program; it waits so long that no motor gets too hot."""
        parts = max(1, round(program.period / self._part))
        profile, part, cycle = self.profile, self._part, parts * self._part
        loads = [
            cycle_sums(profile, self.model, program, seed, part, parts, carried, known)
            for carried, known in payloads
        ]
        cool = (wait for wait in WAITS if self._hottest(loads, 1.0 / (1.0 + wait)) < HOTTEST)
        return _Job(loads, cycle, cycle * next(cool, WAITS[-1]))

    def _next_job(self, random: np.random.Generator) -> _Job:
        """A program that ran before, or a new one: other poses, range, speed and payloads."""
        if random.random() < KNOWN_JOB:
            return self._jobs[int(random.integers(len(self._jobs)))]
        seed = int(random.integers(1 << 30))
        moves, zone = int(random.integers(*MOVES)), random.uniform(*ZONES)
        program = work(self.profile, seed, moves, zone, random.uniform(*OVERRIDES))
        self._jobs.append(self._job(program, seed, self._payloads(random, JOB_LOADS)))
        return self._jobs[-1]

    def _payloads(self, random: np.random.Generator, loads: int) -> _Payloads:
        """True payloads, with the one that the monitor gets."""
        if not self.model.payload:
            return [([], None)]
        body = self.model.payload[0]
        pairs: _Payloads = []
        for number in range(loads):
            known = body.mass * (1.0 if number % 2 else random.uniform(0.2, 1.0))
            true = known + (random.uniform(0.0, HIDDEN) if number % 4 >= 2 else 0.0)
            carried = [
                payload(body.link, float(mass), body.centre_of_mass, body.inertia)
                for mass in (true, known)
            ]
            pairs.append((carried[:1], carried[1]))
        return pairs

    def days(self, days: int, wear: Wear | None = None) -> Iterator[Day]:
        """Yield the parts of day after day, with the torque of every motor.

        Args:
            wear: Factor on the friction of each axis, of its hours of motion, shape (n,) both.
        """
        for day, states in self._states(days, wear):
            yield self._day(day, states)

    def meter_days(self, days: int, wear: Wear | None = None) -> Iterator[list[MeterRow]]:
        """Yield the windows of day after day, with a power meter alone.

        Grid power is that of the rig at `COULOMB_DEGC`, plus what friction and copper of the plant
        take more at the present temperatures, over the efficiency of the rectifier; the prediction
        follows the temperature by its friction alone.
        """
        for day, states in self._states(days, wear):
            yield self._meter_day(day, states)

    def _states(self, days: int, wear: Wear | None) -> Iterator[tuple[int, list[_State]]]:
        profile = self.profile
        start = np.full(profile.n_joints, 35.0)
        gear = motor = sensed = start
        hours, worn = np.zeros_like(start), np.ones_like(start)
        cold, which, at = self._random.uniform(*COLD), 0, 0.0
        plan = np.random.default_rng([self._seed, 0x6A6F6273])
        job, until = self._jobs[0], self._until(0.0, plan)
        network, left = self._network(job, gear, motor), 0
        for day in range(days):
            hot, next_cold = self._random.uniform(*HOT), self._random.uniform(*COLD)
            states: list[_State] = []
            while at < DAY:
                length = job.cycle + job.wait
                if left == 0:
                    which = int(self._random.integers(len(job.loads)))
                    left = max(1, round(CHANGE_EVERY / length))
                left -= 1
                phase = 2.0 * at / DAY
                low = cold if phase < 1.0 else next_cold
                network.ambient_degc = float(low + (hot - low) * 0.5 * (1 - np.cos(np.pi * phase)))
                gear, motor = network.gear_temperature_degc, network.motor_temperature_degc
                load = job.loads[which]
                heat, friction = (p.mean(axis=0) for p in self._powers(load, gear, motor, worn))
                share = profile.friction_to_motor
                duty = job.cycle / length
                for _ in range(_steps(length)):
                    network.step(duty * (heat + share * friction), duty * (1.0 - share) * friction)
                settled = network.motor_temperature_degc
                lag = np.exp(-length / self._config.sensors.temperature_lag)
                sensed = settled + lag * (sensed - settled)
                states.append(_State(at, job.wait, gear, motor, sensed, load, worn))
                hours = hours + load.time.sum(axis=(0, 1, 3)) / 3600.0
                if wear is not None:
                    worn = wear(hours)
                at += length
                if day * DAY + at >= until:
                    job, until = self._next_job(plan), self._until(day * DAY + at, plan)
                    gear, motor = network.gear_temperature_degc, network.motor_temperature_degc
                    network, left = self._network(job, gear, motor), 0
            cold, at = next_cold, at - DAY
            yield day, states

    def _until(self, now: float, plan: np.random.Generator) -> float:
        """When the program changes that begins now. [s]"""
        if self._changes is None:
            return math.inf
        least, most = map(math.log, self._changes)
        return now + 3600.0 * math.exp(plan.uniform(least, most))

    def _network(self, job: _Job, gear_degc: Float, motor_degc: Float) -> ThermalNetwork:
        length = job.cycle + job.wait
        return ThermalNetwork(
            self.profile,
            length / _steps(length),
            motor_temperature_degc=motor_degc,
            gear_temperature_degc=gear_degc,
            ambient_degc=35.0,
        )

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

    def _hottest(self, loads: list[CycleSums], duty: float) -> float:
        """Temperature of the hottest motor after hours in the hottest hall. [degC]"""
        profile = self.profile
        gear = motor = np.full(profile.n_joints, HOT[1])
        share = profile.friction_to_motor
        highest = 0.0
        for one in loads:
            for _ in range(60):  # a fixed point; the warmth of copper and oil act on themselves
                parts = self._powers(one, gear, motor, np.ones_like(gear))
                heat, friction = (part.mean(axis=0) for part in parts)
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
        rows: list[MeterRow] = []
        for state in states:
            one = state.load
            parts = len(one.time)
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
            gain = self._meter_gain + noise * self._random.standard_normal(parts)
            residual = gain * (one.grid[:, 0] + more) - predicted
            waits = round(state.wait / self._part)
            offs = [*residual.tolist(), *[gain[0] * one.rest[0] - one.rest[1]] * waits]
            owns = [*friction.sum(axis=1).tolist(), *[0.0] * waits]
            for number, (off, own) in enumerate(zip(offs, owns, strict=True)):
                stamp_ns = first_ns + round((state.start + (number + 1) * self._part) / NANOSECOND)
                energies = (self._part * float(off), self._part * float(own))
                rows.append(MeterRow(stamp_ns, self._part, *energies, float(degc.mean())))
        return rows

    def _day(self, day: int, states: list[_State]) -> Day:
        sensors = self._config.sensors
        first_ns = START_NS + round(day * DAY / NANOSECOND)
        parts: Day = []
        for state in states:
            one = state.load
            shape = (len(one.time), READINGS, self.profile.n_joints)
            noise = sensors.temperature_noise * self._random.standard_normal(shape)
            degc = np.rint(state.seen_degc + self._offset + noise).mean(axis=1)
            measured, model = self.torques(one, state.gear_degc, state.motor_degc, degc, state.worn)
            scatter = sensors.torque_noise * np.sqrt(one.time / RATE)
            measured = measured + scatter * self._random.standard_normal(scatter.shape)
            measured += self._collisions(model.shape[0], model.shape[2])[:, :, :, None] * model
            for number in range(len(one.time)):
                at = state.start + (number + 1) * self._part
                parts.append(
                    MotionSums(
                        first_ns + round(at / NANOSECOND),
                        model[number],
                        measured[number],
                        one.time[number],
                        one.load[number],
                        degc[number],
                    )
                )
        return parts

    def _collisions(self, parts: int, n_joints: int) -> Float:
        """Torque from outside over the model's friction, mostly none, shape (parts, 2, n). [-]"""
        hit = self._bumps.random((parts, 1, n_joints)) < self._part / COLLIDE_EVERY
        way = self._bumps.integers(2, size=(parts, 1, n_joints)) == np.arange(2)[:, None]
        return hit * way * self._bumps.uniform(-COLLISION, COLLISION, (parts, 1, n_joints))

    def torques(
        self, load: CycleSums, gear_degc: Float, motor_degc: Float, seen_degc: Float, worn: Float
    ) -> tuple[Float, Float]:
        """Return sums of measured and of model friction in a cycle, without noise. [N m s]

        Shape (P, 2, n, SPEED_BUCKETS) each.

        Args:
            gear_degc: Shape (n,). [degC]
            motor_degc: Shape (n,). [degC]
            seen_degc: What the monitor takes for it, shape (n,) or (P, n). [degC]
            worn: Factor on the friction of the plant, shape (n,). [-]
        """
        rigid, still, turning, drag, own, coulomb, turn = load.sums
        fall = self.profile.torque_constant_fall
        gain = 1.0 / (1.0 - fall * (motor_degc - REFERENCE_DEGC))[:, None]
        dry, viscous, wear = (each[:, None] for each in (*self._at(gear_degc), worn))
        measured = gain * (rigid + wear * (dry * still + viscous * turning) + drag) - own
        law = np.broadcast_to(self._law.viscous(seen_degc), (len(load.time), len(worn)))
        return measured, coulomb + law[:, None, :, None] * turn


def _steps(length: float) -> int:
    return int(np.ceil(length / MAX_STEP))
