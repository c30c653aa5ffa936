"""The virtual test rig: a plant that runs a program.

Independent of the monitored model: both share rigid bodies and drivetrain, nothing else.
The robot follows its program exactly. With elastic joints its links do: each motor turns ahead
by what its gear winds up, quasi-statically (joint torque over stiffness), and the encoders see
the motors; links do not vibrate.

Inside, the rig works in blocks of a fixed number of samples (about one second, less when
the temperatures are sped up) and hands them out in any cut, so that the cut changes no
bit of the output. Temperatures are held over a block and then advanced by its mean heat.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple, TypeVar

import numpy as np

from robot_energy.foundation.described import documented
from robot_energy.foundation.errors import RigError
from robot_energy.model.payload import Payload
from robot_energy.physics.rigid_body import Robot
from robot_energy.timeline.blocks import (
    NANOSECOND,
    Block,
    Float,
    Int,
    MeterBlock,
    TemperatureBlock,
    sum_over_joints,
)
from robot_energy_plan.motion import JointMotion, Trajectory
from robot_energy_rig.config import RigConfig, RigJoints, RigOutput, Truth
from robot_energy_rig.plant import (
    DriveFlows,
    Fan,
    PlantDrives,
    PlantFriction,
    Supply,
    ThermalNetwork,
    longest_step,
)
from robot_energy_rig.profile import PlantProfile
from robot_energy_rig.sensors import GridMeter, JointSensors, TemperatureSensor

BLOCK = 1.0  # s of samples over which temperatures are held, at most
AHEAD = 1024  # samples of the motion that are computed at once, at least a block
EPOCH_NS = 1_000_000_000 * 1_000_000_000  # an arbitrary instant in 2001
PLAUSIBLE_DEGC = (-20.0, 150.0)
DIFFERENCE = 0.004  # s to either side, over which the wind-up of elastic joints is differentiated
Waiting = TypeVar("Waiting", bound=Block)


@documented
class Motion(NamedTuple):
    """What a program makes the robot do from one sample on."""

    first: int
    links: Trajectory
    motors: Annotated[Trajectory, "Joint side; that of the links if gears are rigid."]
    motor_velocity: Annotated[Float, "Shape (N, n). [rad/s]"]
    rigid_torque: Annotated[Float, "Of bodies and rotors, motor side, shape (N, n). [N m]"]

    def part(self, first: int, rows: int) -> Motion:
        cut = slice(first - self.first, first - self.first + rows)
        links, motors = self.links[cut], self.motors[cut]
        return Motion(first, links, motors, self.motor_velocity[cut], self.rigid_torque[cut])


class VirtualRig:
    """Plays one robot with its cabinet, thermometers and grid meter.

    Args:
        program: What the robot does, from its start onward.
        config: Effects and sensors; everything on by default.
        seed: The same seed gives the same bytes.
        start_temperature_degc: Motors and gears, one value or (n,). [degC]
        ambient_degc: [degC]
        start_stamp_ns: Stamp of the first sample. [ns]
        rate_hz: Rate of the joint states. [Hz]
        device_seed: Seed of the constant errors of the sensors; None for ``seed``. Runs with
            the same one have the same sensors, whatever their noise.
        start_gear_degc: Gears, where they do not start as warm as the motors, one value or (n,).
            [degC]

    Attributes:
        joint_names: Names, in the order of every array.
        samples: How many samples were handed out.
        seed: As given.
    """

    def __init__(
        self,
        profile: PlantProfile,
        program: JointMotion,
        config: RigConfig | None = None,
        seed: int = 0,
        start_temperature_degc: float | Float = 20.0,
        ambient_degc: float = 20.0,
        start_stamp_ns: int = EPOCH_NS,
        rate_hz: float = 250.0,
        device_seed: int | None = None,
        start_gear_degc: float | Float | None = None,
    ) -> None:
        config = config or RigConfig()
        device = seed if device_seed is None else device_seed
        if program.n_joints != profile.n_joints:
            raise RigError(
                f"the program moves {program.n_joints} joints", f"{profile.n_joints} as the profile"
            )
        if not 1 <= rate_hz <= 10_000:
            raise RigError(f"the rate is {rate_hz} Hz", "1 to 10000 Hz")
        if start_gear_degc is None:
            start_gear_degc = start_temperature_degc
        start, gears, _ = (
            _temperatures(name, values, profile.n_joints)
            for name, values in (
                ("start temperature", start_temperature_degc),
                ("start temperature of the gears", start_gear_degc),
                ("ambient", ambient_degc),
            )
        )
        self.profile = profile
        self.samples = 0
        self.seed = seed
        self._program = program
        self._robot, self._drivetrain = profile.mechanics()
        self.joint_names = self._robot.joint_names
        self._start_ns = int(start_stamp_ns)
        self._period_ns = round(1.0 / (rate_hz * NANOSECOND))
        allowed = longest_step(profile) / (self.period * config.thermal_speedup)
        if config.warming and allowed < 1:
            raise RigError(
                f"thermal_speedup is {config.thermal_speedup:g}",
                f"at most {longest_step(profile) / self.period:.4g} at this rate",
                "reduce it: temperatures would run ahead of the samples",
            )
        self._block = max(1, int(min(allowed, round(BLOCK / self.period))))
        self._warming = config.warming
        self._friction = PlantFriction(profile, config, self.period)
        self._drives = PlantDrives(profile, config)
        self._supply = Supply(profile, config, self.period)
        self._thermal = ThermalNetwork(
            profile, self._block * self.period * config.thermal_speedup, start, gears, ambient_degc
        )
        self._joint_sensors = JointSensors(config, self._drivetrain, seed, self._period_ns, device)
        self._thermometer = TemperatureSensor(
            config, seed, self._start_ns, profile.n_joints, device
        )
        self._compliance = _compliance(profile, self._robot) if config.elastic_joints else None
        self._fan = Fan(profile.hard) if config.fan else None
        self._meter = GridMeter(config, seed, self._start_ns, self._period_ns, device)
        self._computed = 0
        self._ahead: Motion | None = None
        self._ready: tuple[RigJoints, Truth] | None = None
        self._temperatures: TemperatureBlock | None = None
        self._readings: MeterBlock | None = None

    @property
    def period(self) -> float:
        """Time between samples. [s]"""
        return self._period_ns * NANOSECOND

    @property
    def stamp_ns(self) -> int:
        """True instant of the next sample. [ns]"""
        return self._start_ns + self.samples * self._period_ns

    def change(
        self,
        ambient_degc: float | None = None,
        payload: Sequence[Payload] | None = None,
        wear: Float | None = None,
    ) -> None:
        """Change what surrounds the robot, what it carries or how it runs.

        It counts from the next block of samples on, at most a second later.

        Args:
            ambient_degc: None leaves it. [degC]
            payload: Instead of all that it carries; None leaves it.
            wear: Factor on the friction of each axis, shape (n,); None leaves it. [-]
        """
        if ambient_degc is not None:
            self._thermal.ambient_degc = ambient_degc
        if payload is not None:
            self._robot = self._robot.with_payload(payload)
            self._ahead = None
        if wear is not None:
            self._friction.wear = np.array(wear, dtype=np.float64)

    def step_until(self, stamp_ns: int) -> RigOutput | None:
        """Return what became due up to an instant, as at every tick of a live rig; None if nothing.

        Args:
            stamp_ns: The last sample is at or before it. [ns]
        """
        due = (stamp_ns - self.stamp_ns) // self._period_ns + 1
        return self.step(due) if due > 0 else None

    def step(self, n_samples: int) -> RigOutput:
        """Return the next samples and the readings that are due by the last of them."""
        if n_samples < 1:
            raise RigError(f"a step of {n_samples} samples was asked for", "at least 1")
        joints: list[RigJoints] = []
        truth: list[Truth] = []
        left = n_samples
        while left:
            if self._ready is None:  # as many blocks as hold the samples wanted
                blocks = [self._advance() for _ in range(-(-left // self._block))]
                plant = Truth.concatenate([block[0] for block in blocks])
                motors = Trajectory.concatenate([block[1] for block in blocks])
                torque = np.concatenate([block[2] for block in blocks])
                self._ready = self._joint_sensors.read(plant, motors, torque), plant
            read, plant = self._ready
            used = min(left, len(read))
            joints.append(read[slice(0, used)])
            truth.append(plant[slice(0, used)])
            rest = slice(used, None)
            self._ready = (read[rest], plant[rest]) if used < len(read) else None
            left -= used
        self.samples += n_samples
        temperatures, self._temperatures = self._due(self._temperatures)
        readings, self._readings = self._due(self._readings)
        return RigOutput(
            RigJoints.concatenate(joints), temperatures, readings, Truth.concatenate(truth)
        )

    def _due(self, waiting: Waiting | None) -> tuple[Waiting | None, Waiting | None]:
        if waiting is None:
            return None, None
        due = int(np.searchsorted(waiting.stamp_ns, self.stamp_ns - self._period_ns, "right"))
        return waiting[slice(0, due)] if due else None, waiting[slice(due, None)]

    def _advance(self) -> tuple[Truth, Trajectory, Float]:
        """Advance by one block; what happens, how the motors move, and the torque reported."""
        first, rows = self._computed, self._block
        self._computed += rows
        since_ns = np.arange(first, first + rows, dtype=np.int64) * self._period_ns
        motion = self._motion(first, rows)
        truth, drives = self._plant(since_ns, motion)
        motor_before = self._thermal.motor_temperature_degc
        if self._warming:
            friction = truth.friction_power.mean(axis=0)
            motor = (truth.iron_loss + truth.copper_loss).mean(axis=0)
            share = self.profile.friction_to_motor
            self._thermal.step(motor + share * friction, (1.0 - share) * friction)
        self._readings = _joined(self._readings, self._meter.read(first, truth.grid_power))
        temperatures = self._thermometer.read(
            first * self._period_ns,
            (first + rows) * self._period_ns,
            motor_before,
            self._thermal.motor_temperature_degc,
        )
        self._temperatures = _joined(self._temperatures, temperatures)
        return truth, motion.motors, drives.measured_motor_torque

    def _motion(self, first: int, rows: int) -> Motion:
        """Return the motion of a block. It does not depend on temperatures: many blocks at once."""
        if self._ahead is None or first >= self._ahead.first + len(self._ahead.motor_velocity):
            count = max(AHEAD // rows, 1) * rows
            since_ns = np.arange(first, first + count, dtype=np.int64) * self._period_ns
            time: Float = since_ns.astype(np.float64) * NANOSECOND
            links = self._program.sample(time)
            torque = self._robot.joint_torque(
                links.joint_position, links.joint_velocity, links.joint_acceleration
            )
            motors = self._motors(time, links, torque)
            self._ahead = Motion(
                first,
                links,
                motors,
                self._drivetrain.motor_velocity_from_joint(motors.joint_velocity),
                self._drivetrain.motor_torque_from_joint(torque)
                + self._drivetrain.rotor_torque(motors.joint_acceleration),
            )
        return self._ahead.part(first, rows)

    def _plant(self, since_ns: Int, motion: Motion) -> tuple[Truth, DriveFlows]:
        motor_degc = self._thermal.motor_temperature_degc
        gear_degc = self._thermal.gear_temperature_degc
        speed, rigid = motion.motor_velocity, motion.rigid_torque
        friction = self._friction.torque(speed, rigid, gear_degc)
        torque = rigid + friction
        drives = self._drives.flows(speed, torque, motor_degc)
        rigid_power, friction_power = rigid * speed, friction * speed
        losses = drives.iron_loss + drives.copper_loss + drives.inverter_loss
        supply = self._supply.step(sum_over_joints(rigid_power + friction_power + losses))
        rows = len(since_ns)
        fan = self._fan.power(motor_degc) if self._fan else 0.0
        truth = Truth(
            stamp_ns=since_ns + self._start_ns,
            joint_position=motion.links.joint_position,
            joint_velocity=motion.links.joint_velocity,
            joint_acceleration=motion.links.joint_acceleration,
            motor_velocity=speed,
            motor_torque=torque,
            motor_torque_friction=friction,
            motor_temperature_degc=np.tile(motor_degc, (rows, 1)),
            gear_temperature_degc=np.tile(gear_degc, (rows, 1)),
            rigid_power=rigid_power,
            friction_power=friction_power,
            iron_loss=drives.iron_loss,
            copper_loss=drives.copper_loss,
            inverter_loss=drives.inverter_loss,
            loss_dc=np.full(rows, self.profile.supply.loss_dc),
            loss_grid=np.full(rows, self.profile.supply.loss_grid + fan),
            **{**supply.__dict__, "grid_power": supply.grid_power + fan},
        )
        return truth, drives

    def _motors(self, time: Float, links: Trajectory, joint_torque: Float) -> Trajectory:
        """Return the motion of the motors, joint side; that of the links if gears are rigid."""
        if self._compliance is None:
            return links
        before, after = (
            self._robot.joint_torque(at.joint_position, at.joint_velocity, at.joint_acceleration)
            for at in (
                self._program.sample(np.maximum(time + step, 0.0))
                for step in (-DIFFERENCE, DIFFERENCE)
            )
        )
        slope = (after - before) / (2.0 * DIFFERENCE)
        curvature = (after - 2.0 * joint_torque + before) / DIFFERENCE**2
        return Trajectory(
            links.joint_position + self._compliance * joint_torque,
            links.joint_velocity + self._compliance * slope,
            links.joint_acceleration + self._compliance * curvature,
        )


def _compliance(profile: PlantProfile, robot: Robot) -> Float:
    """Return the wind-up of each joint by its torque, shape (n,). [rad/(N m)] or [m/N]"""
    effort = robot.limits.effort
    if not np.isfinite(effort).all():
        raise RigError(
            f"the URDF of '{profile.body}' gives no effort limit of every joint",
            "effort limits, from which the stiffness of elastic joints follows",
        )
    return profile.hard.elastic_deflection / effort


def _joined(waiting: Waiting | None, more: Waiting) -> Waiting:
    return more if waiting is None else type(more).concatenate([waiting, more])


def _temperatures(name: str, given: float | Float, n_joints: int) -> Float:
    """Check temperatures and return one for each joint, shape (n,). [degC]"""
    degc = np.asarray(given, dtype=np.float64)
    if degc.shape not in ((), (n_joints,)):
        raise RigError(f"the {name} has shape {degc.shape}", f"one value or {n_joints}")
    low, high = PLAUSIBLE_DEGC
    if not ((degc >= low) & (degc <= high)).all():
        raise RigError(f"the {name} is {degc.tolist()} degC", f"{low:g} to {high:g} degC")
    return np.array(np.broadcast_to(degc, n_joints))
