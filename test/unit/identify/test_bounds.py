"""A figure that stops at its bound has no standard deviation in the model file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from robot_energy.blocks import MeterLocation
from robot_energy.identify.cabinet import CabinetFit, with_cabinet
from robot_energy.identify.losses import fit_losses
from robot_energy.identify.total_power import _entry, fit_structure, with_total
from robot_energy.identify.total_sums import Sums
from robot_energy.model_file import load
from robot_energy.report.drives import total_summary


def test_a_loss_that_comes_out_negative_has_no_deviation():
    random = np.random.default_rng(1)
    columns = np.column_stack([np.ones(200), random.uniform(0.0, 1.0, (200, 2))])
    target = columns @ [10.0, 5.0, -3.0] + random.normal(0.0, 0.1, 200)
    fit = fit_losses(columns, target, np.arange(200) // 10, ["constant", "copper", "linear"], "x")
    assert fit.negative == ("linear",)
    figure = fit.figure("linear", "bag")
    assert (figure.value, figure.std, figure.tag) == (0.0, None, "identified")
    assert figure.source == "at its bound 0: bag"
    assert fit.figure("copper", "bag").std > 0.0


@pytest.fixture
def total():
    """Two axes behind one meter: the second seems to have a copper loss below zero."""
    random = np.random.default_rng(2)
    terms = random.uniform(0.0, 1.0, (300, 3, 2))
    measured = 100.0 + terms[:, 0] @ [50.0, -20.0] + random.normal(0.0, 0.1, 300)
    unknown = np.full(300, np.nan)
    return Sums(
        ("one", "two"),
        MeterLocation.DC_BUS,
        np.ones(300),
        measured,
        np.zeros(300),
        terms,
        unknown,
        unknown,
        np.zeros(300, dtype=np.int64),
        np.arange(300) // 10,
        np.ones((3, 2)),
    )


def test_losses_behind_one_meter_say_it_by_name(total):
    fit = fit_structure(total, "axis_copper")
    notes = total_summary(total, fit, "blocks", {})["notes"]
    assert any("at its bound 0" in note and "copper of two" in note for note in notes)
    entries = [_entry(fit, joint, "bag") for joint in range(2)]
    assert (entries[1].copper.value, entries[1].copper.std) == (0.0, None)
    assert entries[1].copper.source == "at its bound 0: bag"
    assert entries[0].copper.std > 0.0


def test_a_cabinet_loss_below_zero_is_at_its_bound():
    fit = CabinetFit(MeterLocation.GRID, None, None, 250.0, 1.0, -4.0, 2.0, ())
    cabinet = with_cabinet(load("kr16"), fit, "bag").cabinet
    assert (cabinet.loss_dc.value, cabinet.loss_dc.std) == (0.0, None)
    assert (cabinet.loss_grid.value, cabinet.loss_grid.std) == (250.0, 1.0)


def test_with_total_writes_no_deviation_of_zero(total):
    fit = fit_structure(total, "shaft")
    model = load("kr16")
    zeros = np.zeros((3, 6))
    fit = replace(fit, coefficients=zeros, deviations=zeros)
    written, _ = with_total(model, fit, MeterLocation.DC_BUS, "bag")
    for joint in written.joints:
        assert (joint.losses.copper.std, joint.losses.copper.tag) == (None, "assumed")
