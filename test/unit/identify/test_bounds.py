"""A figure that stops at its bound has no standard deviation in the model file."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from robot_energy.model import load
from robot_energy.timeline.blocks import MeterLocation
from robot_energy_identify.bounds import identified, is_at_bound
from robot_energy_identify.cabinet.cabinet import CabinetFit, with_cabinet
from robot_energy_identify.drives.all_drives import TotalPower
from robot_energy_identify.drives.losses import fit_losses
from robot_energy_identify.drives.total_power import _entry, fit_structure, with_total
from robot_energy_identify.drives.total_sums import Sums
from robot_energy_identify.dynamics.torque_model import Estimate
from robot_energy_identify.friction.friction import fit_friction
from robot_energy_identify.friction.laws import fit_law
from robot_energy_identify.friction.samples import FrictionData
from robot_energy_report.document import Document
from robot_energy_report.identification import losses_section
from robot_energy_report.identify_all import changes_document
from robot_energy_report.printing import print_document
from terminal_tables import recorded_tables


def test_a_loss_that_comes_out_negative_has_no_deviation():
    random = np.random.default_rng(1)
    columns = np.column_stack([np.ones(200), random.uniform(0.0, 1.0, (200, 2))])
    target = columns @ [10.0, 5.0, -3.0] + random.normal(0.0, 0.1, 200)
    fit = fit_losses(columns, target, np.arange(200) // 10, ["constant", "copper", "linear"], "x")
    assert fit.negative == ("linear",)
    figure = fit.figure("linear", "bag")
    assert (figure.value, figure.std, figure.tag) == (0.0, None, "assumed")
    assert figure.source == "at the bound 0: bag"
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
        (np.ones(2),) * 3,
        np.zeros((300, 2)),
    )


def test_losses_behind_one_meter_say_it_by_name(total):
    fit = fit_structure(total, "axis_copper")
    notes = TotalPower.of(total, fit, "blocks", {}).notes
    assert any("at the bound 0" in note and "copper of two" in note for note in notes)
    entries = [_entry(fit, joint, "bag") for joint in range(2)]
    assert (entries[1].copper.value, entries[1].copper.std) == (0.0, None)
    assert entries[1].copper.source == "at the bound 0: bag"
    assert entries[0].copper.std > 0.0


def test_a_cabinet_loss_below_zero_is_at_its_bound():
    fit = CabinetFit(MeterLocation.GRID, None, None, 250.0, 1.0, -4.0, 2.0, ())
    cabinet = with_cabinet(load("kr16"), fit, "bag").cabinet
    assert (cabinet.loss_dc.value, cabinet.loss_dc.std) == (0.0, None)
    assert (cabinet.loss_dc.tag, cabinet.loss_grid.tag) == ("assumed", "identified")
    assert (cabinet.loss_grid.value, cabinet.loss_grid.std) == (250.0, 1.0)


def test_with_total_writes_no_deviation_of_zero(total):
    fit = fit_structure(total, "shaft")
    model = load("kr16")
    zeros = np.zeros((3, 6))
    fit = replace(fit, coefficients=zeros, deviations=zeros)
    written, _ = with_total(model, fit, MeterLocation.DC_BUS, "bag")
    for joint in written.joints:
        assert (joint.losses.copper.std, joint.losses.copper.tag) == (None, "assumed")


@pytest.mark.parametrize("value", [0.0, -1e-3, float("nan")])
def test_what_is_not_above_the_bound_is_never_called_identified(value):
    figure = identified(value, 0.5, "bag")
    assert is_at_bound(figure)
    assert (figure.value, figure.tag, figure.std) == (0.0, "assumed", None)


def test_a_figure_of_the_dynamics_at_the_bound_but_for_rounding_is_at_the_bound():
    entry = Estimate(1e-9, 0.1, "identified", "identify dynamics").figure(1.0)
    assert is_at_bound(entry)
    assert (entry.tag, entry.std) == ("assumed", None)
    assert Estimate(0.05, 0.1, "identified", "x").figure(2.0).value == 0.1


def test_friction_that_comes_out_below_zero_is_at_the_bound():
    random = np.random.default_rng(3)
    speed = 100.0 * np.sin(np.arange(4000) / 50.0)
    degc = np.linspace(20.0, 60.0, 4000)
    block = np.arange(4000) // 100
    torque = 1e-2 * speed - 1e-3 * np.sign(speed) + random.normal(0.0, 1e-4, 4000)
    data = FrictionData("a", speed, torque, degc, block, block // 10, np.empty((4000, 0)))
    entry = fit_friction(data, "bag").entry(load("kr16").joints[0].friction, "bag")
    assert is_at_bound(entry.coulomb)
    falling = replace(data, friction_torque=-data.friction_torque)
    law, _ = fit_law("constant", falling, "bag")
    assert is_at_bound(law.viscous)
    table, _ = fit_law("table", falling, "bag")
    assert (set(table.viscous), table.tag) == ({0.0}, "assumed")


def test_the_report_shows_the_bound_instead_of_a_deviation():
    model = load("kr16")
    fit = CabinetFit(MeterLocation.GRID, None, None, 250.0, 1.0, -4.0, 2.0, ())
    with recorded_tables() as tables:
        page = Document()
        changes_document(model, with_cabinet(model, fit, "bag"), page)
        losses_section(fit, page)
        print_document(page, Console(file=io.StringIO()))
    rows = [tuple(row) for _, part, _ in tables for row in part]
    assert ("DC side constant loss", "W", "150", "0", "-", "assumed", "at its bound") in rows
    assert ("DC", "0, at bound") in rows
    assert ("grid", "250.0 +- 1.0") in rows
