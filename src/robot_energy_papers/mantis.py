"""The measurements of paper B on the virtual Mantis: excitation, validation and printed wall.

Every run is recorded to a bag as a robot's own topics would be, power of the drives included, and
read back by the stages of the monitor.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from robot_energy.foundation.described import Described
from robot_energy.messages.fields import DRIVE_POWER_TOPIC
from robot_energy.model import RobotModel
from robot_energy.timeline.blocks import NANOSECOND, EffortMeaning, Float
from robot_energy_identify.data.recordings import Recording, channels_of, read_recording
from robot_energy_identify.drives.drive_data import BRIDGED
from robot_energy_identify.drives.drive_power import DrivePowerTopics, MeasuredDrivePower
from robot_energy_identify.dynamics.dynamics import Dynamics, DynamicsSettings, identify_dynamics
from robot_energy_identify.dynamics.torque_model import standard_columns
from robot_energy_identify.excitation.excitation import ExcitationSettings, optimise_excitation
from robot_energy_identify.excitation.limits import ExcitationLimits
from robot_energy_papers.experiment import LEAD
from robot_energy_plan.motion import (
    FourierBasis,
    FourierMotion,
    JointMotion,
    Trajectory,
)
from robot_energy_rig import PlantProfile, RigConfig, VirtualRig
from robot_energy_rig.record import record

RATE = 500.0  # Hz; paper B samples at 2.5 kHz, which changes nothing at these speeds
HARMONICS, PERIOD = 5, 20.0  # of the Fourier series; paper B: five, "20 Hz" (see decision 0042)
START_DEGC = 25.0
SIGN_VELOCITY = 2e-3  # rad/s of the smooth sign; paper B has a plain one, joints print at 0.05


class PrintRun(Described):
    """One recorded motion, read back with one model."""

    recording: Recording
    power: MeasuredDrivePower
    begin: Annotated[int, "First instant of the motion itself. [ns]"]
    end: int

    @property
    def rows(self) -> NDArray[np.bool_]:
        """Samples of the motion itself with sound figures, shape (N,)."""
        stamp = self.recording.torque.stamp_ns
        inside = (stamp >= self.begin) & (stamp <= self.end)
        return np.asarray(self.recording.sound & inside)

    @property
    def duration(self) -> Float:
        """Time that each of the `rows` stands for. [s]"""
        stamp = self.recording.torque.stamp_ns[self.rows]
        return np.asarray(np.gradient((stamp - stamp[0]) * NANOSECOND))

    @property
    def time(self) -> Float:
        """Time of the `rows` since the motion began. [s]"""
        return (self.recording.torque.stamp_ns[self.rows] - self.begin) * NANOSECOND

    @property
    def shaft_predicted(self) -> Float:
        """Shaft power of the model, motor side, shape (N, n). [W]"""
        power = self.recording.power
        return (power.rigid_power + power.friction_power)[self.rows]

    @property
    def shaft_measured(self) -> Float:
        """Measured torque times speed, motor side (paper B, eq. 4), shape (N, n). [W]"""
        return self.recording.power.shaft_power_measured[self.rows]

    @property
    def electrical(self) -> Float:
        """Measured input of the drives (paper B, eq. 1), shape (N, n). [W]"""
        return self.power.at(self.recording.torque.stamp_ns[self.rows], BRIDGED)


class AfterRest:
    """A motion that begins after a rest, and rests at its end.

    Args:
        duration: After which it rests. [s]
    """

    def __init__(self, motion: JointMotion, duration: float) -> None:
        self._motion = motion
        self._duration = duration
        self.n_joints = motion.n_joints

    def sample(self, time: Float) -> Trajectory:
        """Return the motion.

        Args:
            time: Since the start of the rest, shape (N,). [s]
        """
        local = np.asarray(time, dtype=np.float64) - LEAD
        moving = ((local >= 0.0) & (local <= self._duration))[:, None]
        # A whole period is the start again: stay just before it.
        path = self._motion.sample(np.clip(local, 0.0, self._duration * (1.0 - 1e-12)))
        return Trajectory(
            path.joint_position, path.joint_velocity * moving, path.joint_acceleration * moving
        )


class Smooth:
    """A planned motion of a tool as a motion that can be sampled anywhere.

    Args:
        blocks: Times, shape (N,) [s], and joints of the planned motion, as of `ToolMotion.blocks`.
    """

    def __init__(self, blocks: Iterable[tuple[Float, Trajectory]]) -> None:
        from scipy.interpolate import make_interp_spline

        parts = list(blocks)
        time = np.concatenate([part[0] for part in parts])
        position = np.concatenate([part[1].joint_position for part in parts])
        spline = make_interp_spline(time, position, k=5)
        self._curves = [spline, spline.derivative(1), spline.derivative(2)]
        self.duration = float(time[-1])
        self.n_joints = position.shape[1]

    def sample(self, time: Float) -> Trajectory:
        """Return the motion, held at both ends.

        Args:
            time: Since its start, shape (N,). [s]
        """
        inside = np.clip(time, 0.0, self.duration)
        return Trajectory(*(np.asarray(curve(inside)) for curve in self._curves))


def excitation(
    model: RobotModel, profile: PlantProfile, seed: int, iterations: int = 40
) -> FourierMotion:
    """Return an optimised excitation motion (paper B, 4.3.2)."""
    limits = ExcitationLimits(model, profile.acceleration)
    settings = ExcitationSettings(
        harmonics=HARMONICS, period=PERIOD, starts=1, iterations=iterations, seed=seed
    )
    return optimise_excitation(model, limits, settings).motion


def slower(motion: FourierMotion, share: float) -> FourierMotion:
    """Return the same path at a share of the speed: accelerations fall with its square.

    Args:
        share: Share of the speed. [-]
    """
    basis = FourierBasis(motion.basis.harmonics, motion.period / share)
    weights = motion.weights.copy()
    weights[1:] *= share
    return FourierMotion(basis, weights)


def recorded(
    profile: PlantProfile,
    motion: JointMotion,
    duration: float,
    path: Path,
    seed: int,
    config: RigConfig | None = None,
    rate: float = RATE,
) -> Path:
    """Return the bag of a motion between two rests on the rig.

    Args:
        duration: Duration of the motion. [s]
        rate: Of the joint states. [Hz]
    """
    rig = VirtualRig(
        profile, AfterRest(motion, duration), config, seed, START_DEGC, START_DEGC, rate_hz=rate
    )
    record(rig, duration + 2.0 * LEAD, path, drive_power=True, overwrite=True)
    return path


def read_run(path: Path, model: RobotModel) -> PrintRun:
    """Return a recorded run, read back with a model."""
    recording = read_recording(path, model, EffortMeaning.MOTOR_TORQUE)
    power = DrivePowerTopics((DRIVE_POWER_TOPIC,)).read(path, model.joint_names)
    stamp = recording.torque.stamp_ns
    lead = round(LEAD / NANOSECOND)
    return PrintRun(recording, power, int(stamp[0]) + lead, int(stamp[-1]) - lead)


def identify_mechanics(
    runs: Sequence[PrintRun], model: RobotModel, method: Literal["ols", "wls"]
) -> Dynamics:
    """Return bodies and friction that are identified from excitation runs."""
    channels = channels_of([run.recording.motion for run in runs])
    columns = standard_columns(SIGN_VELOCITY)
    return identify_dynamics(channels, model, DynamicsSettings(columns, method))
