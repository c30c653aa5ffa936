"""The plant is of the class it claims, by its own laws."""

import numpy as np
import pytest

from plants import joint_block
from refusals import refused
from robot_energy.foundation.errors import RigError
from robot_energy.model import load
from robot_energy.physics.friction import FrictionModel, with_fixed_friction
from robot_energy.pipeline import EnergyPipeline
from robot_energy_plan.motion import Program, random_program, tool_above
from robot_energy_rig import RigConfig, VirtualRig, load_profile

PROFILE = load_profile("kr16")
ROBOT, _ = PROFILE.mechanics()
LIMITS = PROFILE.motion_limits(ROBOT)
PROGRAM = random_program(LIMITS, 0, accept=tool_above(ROBOT, "flange", 0.3))


def drag(degc):
    """Viscous drag that a torque trace shows: oil and eddy currents. [N m s/rad]"""
    oil = [float(o.friction_factor(degc)) for o in PROFILE.lubricant]
    return PROFILE.viscous_40 * oil + PROFILE.eddy_viscous


def test_an_unknown_plant_is_refused_with_those_that_exist():
    with refused(RigError, found="'kr99'", expected="irb4600, kr16, mantis, testbed"):
        load_profile("kr99")


def test_viscous_drag_is_near_the_class_profile_at_two_temperatures():
    cold = np.array([7.5, 10.0, 8.7, 2.2, 2.2, 1.6]) * 1e-3
    hot = np.array([2.4, 3.2, 2.8, 0.70, 0.70, 0.50]) * 1e-3
    residual = np.stack([drag(20.0) / cold, drag(60.0) / hot]) - 1.0
    assert np.abs(residual[:, :3]).max() < 0.04
    assert np.abs(residual[:, 3:]).max() < 0.12
    assert np.abs(residual).min() > 1e-3  # not the law of the model in disguise


def test_viscous_law_is_not_that_of_the_shipped_model():
    model = FrictionModel.from_model(load("kr16"))
    degc = np.linspace(20.0, 80.0, 13)
    ratio = np.stack([drag(t) for t in degc]) / model.viscous(np.tile(degc[:, None], 6))
    assert np.ptp(ratio, axis=0).min() > 0.05


def test_hold_power_is_about_400_w():
    config = RigConfig().without("warming")
    power = [
        VirtualRig(PROFILE, Program(via[None, :], LIMITS, 1.0), config, 0, 40.0)
        .step(2)
        .truth.grid_power[-1]
        for via in PROGRAM.via
    ]
    assert 350 < np.mean(power) < 450
    assert np.ptp(power) < 160


def test_experiment_of_paper_a():
    """Fixed friction is tens of percent off, temperature-aware within about 5 %."""
    shipped = load("kr16")
    models = {
        "aware": shipped,
        "fixed_60": with_fixed_friction(shipped, 60.0),
        "fixed_22": with_fixed_friction(shipped, 22.0),
    }
    mean: dict[float, float] = {}
    error: dict[str, list[float]] = {name: [] for name in models}
    peak = 0.0
    for seed, degc in enumerate((20.0, 40.0, 60.0, 80.0)):
        rig = VirtualRig(PROFILE, PROGRAM, None, seed, degc)
        output = rig.step(round(PROGRAM.period / rig.period))
        mean[degc] = output.truth.grid_power.mean()
        peak = max(peak, output.truth.grid_power.max())
        for name, model in models.items():
            pipeline = EnergyPipeline(model)
            pipeline.step(joint_block(output.joints), output.temperatures, output.meter)
            pipeline.flush()
            found = pipeline.account.comparison
            error[name].append(found.predicted_energy / found.measured_energy - 1.0)
    assert 1.4 < mean[20.0] / mean[60.0] < 1.6
    assert 6e3 < peak < 10e3
    assert np.abs(error["aware"]).max() < 0.055
    assert error["fixed_60"][0] == pytest.approx(-0.35, abs=0.04)
    assert error["fixed_22"][-1] > 0.4
