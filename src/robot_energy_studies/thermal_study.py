"""The thermal observer on the virtual rig with its sensors hidden.

Plants drawn at random; friction over temperature and the thermal networks are identified
from one run, and another program at another ambient is replayed with the temperature sensors and
without them. The time of the temperatures runs four times as fast as that of the motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.model import RobotModel, load
from robot_energy.pipeline import EnergyPipeline, Output, Settings
from robot_energy.timeline.blocks import (
    EffortMeaning,
    Float,
    Int,
    JointBlock,
    PowerBlock,
    Quality,
    TemperatureBlock,
    TorqueBlock,
)
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.friction.friction import fit_axes, with_friction
from robot_energy_identify.friction.samples import friction_data
from robot_energy_identify.thermal.network import (
    fit_networks,
    runs_of_recordings,
    with_networks,
    without_networks,
)
from robot_energy_plan.motion import Program, random_program, tool_above
from robot_energy_rig import PlantProfile, RigConfig, Sensors, VirtualRig, random_profile
from robot_energy_rig.record import ORIGIN, outputs
from robot_energy_studies.learning_study import joint_block

ROBOTS = ("kr16", "ur10e", "irb4600")
SPEEDUP = 4.0
RATE = 50.0  # Hz
PIECE = 20.0  # s of samples at once
TRAIN, TEST = 1800.0, 1350.0  # s of motion: two hours, and an hour and a half of temperatures
EARLY = 1200.0 / SPEEDUP  # s: the first twenty minutes
REST = 75.0  # s in which the robot stands, five minutes of temperatures
AMBIENT_SPREAD = 3.0  # K between the air of the model file and that of the test, either way
HOTTEST = 120.0  # degC, beyond which a plant is worked at half the speed


class HiddenPlant(Described):
    """One plant, its test replayed without temperature sensors."""

    name: str
    warm_rms: Annotated[Float, "Error of the estimate after twenty minutes, by joint. [K]"]
    early_rms: Annotated[Float, "The same within them. [K]"]
    fallback_rms: Annotated[Float, "Error of the fallback temperature in the test, by joint. [K]"]
    std: Annotated[float, "Mean standard deviation that the estimate states. [K]"]
    covered: Annotated[float, "Share of the samples with the truth in the 90 % band. [-]"]
    energy_change: Annotated[
        float, "Energy without sensors less that with them, over the true one. [-]"
    ]
    fallback_change: Annotated[float, "The same with the fallback temperature instead. [-]"]
    refused: Annotated[tuple[str, ...], "Why joints have no network, one sentence each."] = ()


@dataclass(frozen=True)
class _Run:
    """What the rig gave: joint states, readings and the truth at every sample."""

    joints: list[JointBlock]
    temperatures: list[TemperatureBlock | None]
    stamp_ns: Int
    motor_degc: Float
    grid_power: Float


def hidden_sensors(body: str, seed: int) -> HiddenPlant:
    """Return the errors of temperatures of a drawn, identified plant without sensors."""
    profile = random_profile(body, seed)
    rng = np.random.default_rng([seed, 7])
    ambient = float(rng.uniform(15.0, 30.0))
    trained = _play(profile, seed, 0, TRAIN, ambient)
    model, refused = _identified(load(body), trained, ambient)
    there = ambient + float(rng.uniform(-AMBIENT_SPREAD, AMBIENT_SPREAD))
    test = _play(profile, seed, 1, TEST, there)
    seen, hidden = _replayed(model, test), _replayed(model, test, hide=True)
    fallback = _replayed(without_networks(model), test, hide=True)[0]
    power, std = hidden[0], hidden[1]
    own = np.array([joint.thermal is not None for joint in model.joints])
    rows = np.searchsorted(test.stamp_ns, power.stamp_ns).clip(0, len(test.stamp_ns) - 1)
    truth = test.motor_degc[rows]
    error = (power.motor_temperature_degc - truth)[:, own]
    early = (power.stamp_ns - power.stamp_ns[0]) * 1e-9 < EARLY
    assert (power.quality & np.uint32(Quality.TEMPERATURE_ESTIMATED)).any()
    energy = float(test.grid_power[rows].sum())
    predicted, with_sensors, held = (
        float(block.grid_power.sum()) for block in (power, seen[0], fallback)
    )
    return HiddenPlant(
        f"{body}, plant {seed}",
        np.sqrt(np.mean(error[~early] ** 2, axis=0)),
        np.sqrt(np.mean(error[early] ** 2, axis=0)),
        np.sqrt(np.mean((model.temperature.fallback_degc - truth[:, own]) ** 2, axis=0)),
        float(std[:, own].mean()),
        float(np.mean(np.abs(error) < 1.645 * std[:, own])),
        (predicted - with_sensors) / energy,
        (held - with_sensors) / energy,
        tuple(refused),
    )


def _program(profile: PlantProfile, seed: int, number: int, override: float) -> Program:
    """Hard work, light work and a rest, over and over."""
    bodies, _ = profile.mechanics()
    limits = profile.motion_limits(bodies)
    accept = tool_above(bodies, "tool0", 0.0) if bodies.n_joints == 6 else None
    via = random_program(limits, 100 * seed + number, 90, accept=accept).via
    dwell = np.where(np.arange(len(via)) < len(via) // 2, 0.2, 2.0 + number)
    dwell[-1] = REST
    return Program(via, limits, dwell, override)


def _play(profile: PlantProfile, seed: int, number: int, seconds: float, ambient: float) -> _Run:
    """Run the rig from the temperature of the air on."""
    config = RigConfig.hard() if seed % 2 else RigConfig()
    sensors = Sensors(velocity_noise=0.02, temperature_lag=Sensors().temperature_lag / SPEEDUP)
    config = replace(config, thermal_speedup=SPEEDUP, sensors=sensors)
    for override in (1.0, 0.5, 0.25):
        rig = VirtualRig(
            profile, _program(profile, seed, number, override), config, seed, ambient, ambient,
            rate_hz=RATE,
        )  # fmt: skip
        pieces = list(outputs(rig, seconds, PIECE))
        if pieces[-1].truth.motor_temperature_degc.max() < HOTTEST:
            break
    truth = [piece.truth for piece in pieces]
    return _Run(
        [joint_block(piece.joints) for piece in pieces],
        [piece.temperatures for piece in pieces],
        np.concatenate([part.stamp_ns for part in truth]),
        np.concatenate([part.motor_temperature_degc for part in truth]),
        np.concatenate([part.grid_power for part in truth]),
    )


def _replayed(
    model: RobotModel, run: _Run, hide: bool = False, effort: bool = False
) -> tuple[PowerBlock, Float, TorqueBlock]:
    """Power of a run, the deviation of its temperatures, and the torques."""
    meaning = EffortMeaning.MOTOR_TORQUE if effort else EffortMeaning.NONE
    pipeline = EnergyPipeline(model, Settings(effort=meaning))
    power: list[PowerBlock] = []
    torque: list[TorqueBlock] = []
    std: list[Float] = []

    def take(output: Output) -> None:
        if output.torque is not None:
            torque.append(output.torque)
        if output.power is not None:
            power.append(output.power)
            std.append(np.tile(pipeline.condition.thermal.std, (len(output.power), 1)))

    for block, readings in zip(run.joints, run.temperatures, strict=True):
        take(pipeline.step(block, None if hide else readings))
    take(pipeline.flush())
    return PowerBlock.concatenate(power), np.concatenate(std), TorqueBlock.concatenate(torque)


def _identified(model: RobotModel, run: _Run, ambient: float) -> tuple[RobotModel, list[str]]:
    def recording(of: RobotModel) -> Recording:
        power, _, torque = _replayed(of, run, effort=True)
        return Recording(Path("rig"), of, torque, power, None, ORIGIN, ())

    first = recording(model)
    axes = [friction_data([first], joint) for joint in range(len(model.joints))]
    fits, refused = fit_axes(axes, "rig")
    model = with_friction(model, fits, "rig")
    second = recording(model)
    runs = [runs_of_recordings([second], joint) for joint in range(len(model.joints))]
    _, networks, without = fit_networks(model.joint_names, runs, ambient, "rig")
    temperature = model.temperature.model_copy(update={"fallback_degc": ambient})
    model = with_networks(model.changed(temperature=temperature), networks, ambient)
    return model, [*refused, *without]
