"""DC link, chopper and rectifier of the plant."""

import numpy as np
import pytest

from robot_energy_rig import RigConfig, load_profile
from robot_energy_rig.plant import Supply

PROFILE = load_profile("kr16")
DC = PROFILE.supply.loss_dc
GRID = PROFILE.supply.loss_grid
STEP = 0.004
SWING = 0.5 * 1.5e-3 * (700.0**2 - 566.0**2)  # J up to the switch-on voltage
BAND = 0.5 * 1.5e-3 * (700.0**2 - 680.0**2)
BRAKE = 690.0**2 / 30.0


def test_without_capacitor_it_is_the_plain_balance_of_paper_a():
    supply = Supply(PROFILE, RigConfig.plain(), STEP)
    flows = supply.step(np.array([1000.0, -50.0, -500.0]))
    np.testing.assert_allclose(flows.grid_power, [1000 + DC + GRID, DC - 50 + GRID, GRID])
    np.testing.assert_allclose(flows.brake_power, [0.0, 0.0, 500.0 - DC])


def test_rectifier_loses_its_share():
    supply = Supply(PROFILE, RigConfig.plain().having("rectifier"), STEP)
    flows = supply.step(np.array([1000.0]))
    assert flows.grid_power[0] == pytest.approx((1000 + DC) / 0.985 + GRID)
    assert flows.rectifier_loss[0] == pytest.approx((1000 + DC) * (1 / 0.985 - 1))


def test_link_takes_excess_gives_it_back_and_blocks_the_grid_meanwhile():
    supply = Supply(PROFILE, RigConfig.plain().having("capacitor"), STEP)
    charge = supply.step(np.full(5, -DC - 2000.0))  # 40 J
    np.testing.assert_allclose(charge.capacitor_power, 2000.0)
    np.testing.assert_allclose(charge.grid_power, GRID)
    assert charge.bus_voltage[-1] == pytest.approx(np.sqrt(566.0**2 + 2 * 40.0 / 1.5e-3))
    give = supply.step(np.full(6, 2500.0 - DC))  # 10 J each
    np.testing.assert_allclose(
        give.grid_power, GRID + np.array([0, 0, 0, 0, 2500, 2500]), atol=1e-9
    )
    assert give.bus_voltage[-1] == pytest.approx(566.0)


def test_chopper_switches_with_hysteresis():
    supply = Supply(PROFILE, RigConfig.plain().having("capacitor"), 1e-4)
    flows = supply.step(np.full(2000, -DC - 5000.0))
    volts = flows.bus_voltage
    assert volts.max() == pytest.approx(700.0, abs=0.5)
    on = int(np.argmax(flows.brake_power > 0))
    assert on * 1e-4 == pytest.approx(SWING / 5000.0, abs=1e-4)
    assert volts[on:].min() == pytest.approx(680.0, abs=0.8)
    cycles = int(((flows.brake_power[1:] > 0) & (flows.brake_power[:-1] == 0)).sum())
    period = BAND / 5000.0 + BAND / (BRAKE - 5000.0)
    assert cycles == pytest.approx((0.2 - SWING / 5000.0) / period, abs=1.5)


def test_step_length_changes_nothing_but_the_means():
    demand = np.repeat([-6000.0, 300.0, -3000.0, 4000.0], 25)
    coarse = Supply(PROFILE, RigConfig(), STEP).step(demand)
    fine = Supply(PROFILE, RigConfig(), STEP / 8).step(np.repeat(demand, 8))
    np.testing.assert_allclose(
        fine.grid_power.reshape(-1, 8).mean(axis=1), coarse.grid_power, rtol=1e-9, atol=1e-6
    )
    np.testing.assert_allclose(fine.bus_voltage[7::8], coarse.bus_voltage, rtol=1e-9)


def test_energy_is_conserved():
    rng = np.random.default_rng(1)
    demand = rng.normal(0, 4000, 5000)
    flows = Supply(PROFILE, RigConfig(), STEP).step(demand)
    spent = demand + DC + GRID + flows.rectifier_loss + flows.brake_power + flows.capacitor_power
    np.testing.assert_allclose(flows.grid_power, spent, rtol=1e-12, atol=1e-8)
    stored = 0.5 * 1.5e-3 * (flows.bus_voltage[-1] ** 2 - 566.0**2)
    assert flows.capacitor_power.sum() * STEP == pytest.approx(stored, abs=1e-6)
    assert (flows.grid_power >= GRID).all()
    assert (flows.brake_power >= 0).all()
