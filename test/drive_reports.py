"""What the drives of the virtual rig would report: their electrical power, with noise and peaks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from robot_energy.timeline.blocks import Float, MeterLocation, MeterMeaning
from robot_energy_identify.drives.drive_data import DriveData, drive_data_of_logs
from robot_energy_logs.recording import FileAccount, LogBlock, RecordingContents, write_bag
from robot_energy_plan.motion import random_program
from robot_energy_rig import RigConfig, VirtualRig, load_profile
from robot_energy_rig.config import RigOutput, Truth
from robot_energy_rig.record import outputs

NOISE = 0.02  # of the power, and
FLOOR = 2.0  # W
PEAKS = 0.003  # share of the samples
PEAK = 300.0  # W


def run(
    seed: int,
    duration: float = 40.0,
    degc: float = 40.0,
    config: RigConfig | None = None,
    rate: float = 250.0,
) -> tuple[VirtualRig, RigOutput]:
    """Play the KR 16 class rig."""
    profile = load_profile("kr16")
    limits = profile.motion_limits(profile.mechanics()[0])
    program = random_program(limits, seed, dwell=0.3)
    rig = VirtualRig(profile, program, config or RigConfig(), seed, degc, rate_hz=rate)
    return rig, RigOutput.concatenate(list(outputs(rig, duration)))


def electrical(truth: Truth) -> Float:
    """True input of every drive, shape (N, n). [W]"""
    shaft = truth.rigid_power + truth.friction_power
    return shaft + truth.iron_loss + truth.copper_loss + truth.inverter_loss


def reported(power: Float, seed: int) -> Float:
    """The same with the noise and the peaks of a real drive's own measurement. [W]"""
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=power.shape) * (FLOOR + NOISE * np.abs(power))
    peaks = rng.random(power.shape) < PEAKS
    return power + noise + np.where(peaks, rng.normal(scale=PEAK, size=power.shape), 0.0)


def log_block(output: RigOutput, power: Float, motor_side: bool) -> LogBlock:
    """Rows of a log; the temperatures are the true ones, the reading that of the DC bus."""
    truth, joints = output.truth, output.joints
    bus = power.sum(axis=1) + truth.loss_dc
    return LogBlock(
        joints.stamp_ns,
        joints.joint_position,
        truth.motor_velocity if motor_side else joints.joint_velocity,
        joints.measured_motor_torque,
        truth.motor_temperature_degc,
        bus,
        power,
    )


def contents(names: tuple[str, ...]) -> RecordingContents:
    """A log with everything."""
    return RecordingContents(
        names,
        True,
        True,
        True,
        MeterMeaning.INSTANTANEOUS,
        MeterLocation.DC_BUS,
        drive_power=True,
    )


def drive_data(seeds: list[int], config: RigConfig | None = None, **options: float) -> DriveData:
    """Samples of several runs, as logs give them, motor side."""
    logs: list[tuple[RecordingContents, list[LogBlock]]] = []
    for seed in seeds:
        rig, output = run(seed, config=config, **options)
        power = reported(electrical(output.truth), seed)
        logs.append((contents(rig.joint_names), [log_block(output, power, motor_side=True)]))
    return drive_data_of_logs(logs, "newton_metre")


def record(folder: Path, seed: int, duration: float = 40.0, grid: bool = False) -> Path:
    """Write a bag with the power of the drives, and a meter at the DC bus or the grid.

    The meter at the bus also counts what the drives feed back beyond what the bus uses.
    """
    rig, output = run(seed, duration)
    power = reported(electrical(output.truth), seed)
    block = log_block(output, power, motor_side=False)
    held = contents(rig.joint_names)
    if grid:
        block = replace(block, reading=output.truth.grid_power)
        held = replace(held, location=MeterLocation.GRID)
    write_bag(folder, held, [block], [FileAccount(path=Path("rig.csv"))], origin="virtual rig")
    return folder
