"""Figures of the study worked out by hand, and the plant in figures."""

import numpy as np
import pytest

from robot_energy.model import load
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.rigid_body import Robot
from robot_energy_papers.calibration import FLOWS, calibrate, holding_power
from robot_energy_papers.models import (
    UNKNOWN,
    SetRow,
    normalised,
    with_capacitor,
    without_knowledge,
    worst,
)
from robot_energy_papers.paper_a import ShaftCurve
from robot_energy_papers.soaked_rigs import (
    EFFECTS,
    EffectRow,
    PlantRow,
    configurations,
    error_spreads,
)
from robot_energy_plan.motion import Program
from robot_energy_rig import RigConfig, VirtualRig, load_profile

PROFILE = load_profile("kr16")


def row(degc, measured, predicted, way="heating"):
    return SetRow(
        "bag", way, degc, (degc, degc), 0.5, 1.0, measured, 10.0, 8e3, {"m": predicted}, 0.0
    )


def test_errors_and_normalisation_by_hand():
    rows = [row(40.0, 8e3, 7.6e3), row(20.0, 10e3, 10.4e3), row(24.0, 9.6e3, 9.6e3)]
    assert [entry.error("m") for entry in rows] == pytest.approx([-0.05, 0.04, 0.0])
    assert worst(rows, "m") == pytest.approx(-0.05)
    assert rows[0].mean_power == 800.0
    # Half way from 20 to 24 degC: half way from 1000 to 960 W.
    assert normalised(rows, 22.0) == pytest.approx(980.0)
    assert normalised(rows, 10.0) == pytest.approx(1000.0)


def test_mean_shaft_power_is_work_over_time():
    time = np.array([0.0, 1.0, 2.0, 4.0])
    power = np.array([0.0, 100.0, -50.0, 150.0])
    curve = ShaftCurve(20.0, 20.0, time, power)
    assert curve.mean_power == pytest.approx((50.0 + 25.0 + 100.0) / 4.0)


def test_power_at_rest_is_copper_and_inverter_of_gravity():
    """A pose with the arm stretched out, by hand from gravity and by the rig at rest."""
    pose = np.array([[0.4, -0.3, 0.5, 0.2, -0.6, 0.1]])
    model = load("kr16")
    still = np.zeros_like(pose)
    joint = Robot.from_model(model).joint_torque(pose, still, still)
    motor = Drivetrain.from_model(model).motor_torque_from_joint(joint)[0]
    degc = 60.0
    current = motor / (PROFILE.torque_constant * (1 - PROFILE.torque_constant_fall * (degc - 20)))
    resistance = PROFILE.resistance * (1 + PROFILE.resistance_rise * (degc - 20))
    copper = 3.0 * resistance * current**2
    inverter = 2.5 * np.abs(current) + 0.05 * current**2
    by_hand = (copper.sum() + inverter.sum() + 90.0) / 0.985 + 250.0
    assert holding_power(PROFILE, pose, degc)[0] == pytest.approx(by_hand, rel=1e-12)
    robot, _ = PROFILE.mechanics()
    rest = Program(pose, PROFILE.motion_limits(robot), dwell=1.0)
    truth = VirtualRig(PROFILE, rest, RigConfig().without("warming"), 0, degc).step(10).truth
    np.testing.assert_allclose(truth.grid_power, by_hand, rtol=1e-12)


def test_flows_of_the_plant_add_up_to_the_grid():
    found = calibrate(PROFILE, 0, programs=1, moves=3)
    for degc, flow in found.flows.items():
        parts = sum(flow[name] for name in FLOWS if name != "grid_power")
        assert parts == pytest.approx(flow["grid_power"], rel=1e-9)
        column = found.start_degc.tolist().index(degc)
        assert found.mean_power[0, column] == pytest.approx(flow["grid_power"], rel=0.01)
    assert found.ratio(20.0, 60.0)[0] == pytest.approx(
        found.mean_power[0, 0] / found.mean_power[0, 2]
    )


def test_every_rig_of_the_table_differs_by_its_effect_alone():
    rigs = configurations()
    everything, bare = rigs["all effects"], rigs["none of them"]
    assert everything == RigConfig()
    assert bare == RigConfig.plain().having("lubricant_temperature")
    assert len(rigs) == 3 + 2 * len(EFFECTS)
    assert rigs["without iron"] == everything.without("iron")
    assert rigs["only iron"] == bare.having("iron")
    assert rigs["without copper"] == everything.without("copper", "copper_temperature")
    assert rigs["only copper_temperature"] == bare.having("copper", "copper_temperature")
    covered = {switch for switches in EFFECTS.values() for switch in switches}
    switches = {name for name, on in vars(RigConfig()).items() if on is True}
    assert covered == switches - {"lubricant_temperature"}
    assert EffectRow("x", (0.01, -0.03), (0.0, 0.0)).mean == pytest.approx(-0.01)
    assert EffectRow("x", (0.01, -0.03), (0.0, 0.0)).worst == -0.03


def test_the_start_of_identification_knows_bodies_and_nothing_else():
    model = load("kr16")
    blank = without_knowledge(model)
    assert blank.urdf_xml == model.urdf_xml
    assert blank.drive == "ideal"
    for joint, before in zip(blank.joints, model.joints, strict=True):
        assert joint.gear_ratio == before.gear_ratio
        assert joint.friction.coulomb.value == 0.0
        assert joint.friction.viscous.viscous.value == 0.0
        assert joint.friction.coulomb.source == UNKNOWN
    assert blank.cabinet.loss_grid.value == blank.cabinet.loss_dc.value == 100.0
    plate = with_capacitor(blank, PROFILE.supply).cabinet.capacitor
    assert plate.swing == pytest.approx(0.5 * 1.5e-3 * (700.0**2 - 566.0**2))


def test_spread_of_errors_over_plants_by_hand():
    rows = [
        PlantRow(1, {"follows": (0.1, -0.3), "losses": (0.0, 0.02)}),
        PlantRow(2, {"follows": (0.2, 0.2)}),
        PlantRow(3, {}, "no rest"),
    ]
    found = error_spreads(rows)
    assert found["follows"].median == pytest.approx(0.2)
    assert found["follows"].ninety == pytest.approx(0.27)  # 0.7 of the way from 0.2 to 0.3
    assert (found["follows"].worst, found["follows"].least) == (-0.3, -0.3)
    assert found["follows"].greatest == 0.2
    assert found["losses"].worst == 0.02
