"""Bands of robots on one DC bus: the truth is that of the rig's circuit, and claims are counted."""

from pathlib import Path

import numpy as np
import pytest
from bus_study import (
    ADVISED,
    DriveWork,
    JudgedBus,
    common_supply,
    count,
    true_saving,
)

from robot_energy.model import load
from robot_energy_rig import random_profile

STEP = 4e-3


def test_what_one_robot_feeds_back_moves_the_other_in_the_circuit_of_the_rig():
    """Two robots take turns: P drawn, then P fed back; with losses L of each DC side.

    Apart, one draws ``P + L`` and then burns; the other stores S first and draws ``P + L - S``. On
    one bus only ``2 L`` is drawn. Saved is ``(2 P - 2 L - S) / eta``, S between the energies at
    which the chopper opens and closes.
    """
    profile = random_profile("kr16", 7)
    supply, power = profile.supply, np.full(250, 2000.0)
    turns = np.concatenate([power, -power]), np.concatenate([-power, power])
    one, other = (DriveWork(profile, load("kr16"), Path(), turn, STEP) for turn in turns)
    saved, apart = true_saving(one, other)
    opens, closes = (
        0.5 * supply.capacitance * (voltage**2 - supply.rectified_voltage**2)
        for voltage in (supply.chopper_off_voltage, supply.chopper_on_voltage)
    )
    most = 2.0 * (2000.0 - supply.loss_dc) * 1.0
    assert (most - closes) / supply.rectifier_efficiency <= saved
    assert saved <= (most - opens) / supply.rectifier_efficiency
    assert apart - saved == pytest.approx(
        4.0 * (supply.loss_dc / supply.rectifier_efficiency + supply.loss_grid)
    )
    # a second later the other does the same at the same time: only the capacitor is shared
    assert true_saving(one, other, 250)[0] == pytest.approx(0.0, abs=closes)


def test_a_common_supply_has_capacitors_and_resistors_in_parallel():
    one, other = (random_profile("kr16", seed).supply for seed in (7, 8))
    both = common_supply(one, other)
    assert both.capacitance == pytest.approx(one.capacitance + other.capacitance)
    assert 1.0 / both.brake_resistance == pytest.approx(
        1.0 / one.brake_resistance + 1.0 / other.brake_resistance
    )
    assert both.loss_dc == pytest.approx(one.loss_dc + other.loss_dc)


def test_only_bands_that_hold_the_truth_count():
    rows = [JudgedBus(ADVISED, 1, 10.0, half, truth, 99.0) for half, truth in ((2, 9), (2, 13))]
    (line,) = count(rows)
    assert "1 of 2 bands hold the truth (50 %); 2 claimed, 2 of these with the right sign" in line


def test_a_claim_where_nothing_is_saved_is_off_by_all_of_it():
    """Where the capacitors take all, the truth is 0, which no error can be a share of."""
    rows = [JudgedBus(ADVISED, 1, 10.0, 8.0, truth, 99.0) for truth in (0.0, 10.0)]
    rows.append(JudgedBus(ADVISED, 1, 0.0, 0.0, 0.0, 99.0))
    (line,) = count(rows)
    assert "2 of 3 bands" in line
    assert "median error 50 %, half width 80 % of the claim" in line
