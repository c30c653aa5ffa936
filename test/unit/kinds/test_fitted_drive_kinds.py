"""Identification of drives next to a drive model of a user, with and without a fit of its own."""

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from robot_energy.foundation.errors import (
    NotIdentifiableError,
)
from robot_energy.model import validate
from robot_energy.model.drive_models import DRIVE_MODELS
from robot_energy_identify.drives.all_drives import DrivesReport
from robot_energy_identify.drives.drive_data import drive_data_of_logs
from robot_energy_identify.drives.drives import AxisFit, DrivesFit, fit_drives, with_drives
from robot_energy_identify.drives.losses import TERMS, Losses
from robot_energy_logs.recording import LogBlock, RecordingContents
from robot_energy_report.document import Document
from robot_energy_report.drives import drives_document
from robot_energy_report.printing import print_document
from toy_kinds import (
    SQUARE_ROOT,
    TOY,
    wheel,
)


def test_identification_says_that_the_kind_has_no_fit(toys):
    terms = dict.fromkeys(TERMS, 1.0)
    losses = Losses(terms, dict.fromkeys(TERMS, 0.1), (), (), 100, 1.0, {})
    fit = DrivesFit((AxisFit("axle", losses, None, ()),), (), "loss_model", 1.0)
    model, notes = DrivesReport("", fit, None, None, ()).write(
        validate(wheel(), "toy.yaml"), "test"
    )
    assert model.drive == "loss_model"
    assert DRIVE_MODELS[TOY].of(model.joints[0]) is not None
    assert len(notes) == 1
    assert TOY in notes[0]


def drive_samples(seed):
    """One drive that loses 3 W at 1 rad/s, with the root of its speed."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, 30.0, 0.01)
    phase = random.uniform(0, 6, 3)
    velocity = 80 * np.sin(0.9 * time + phase[0]) + 60 * np.sin(2.3 * time + phase[1])
    torque = 1.5 * np.sin(1.7 * time + phase[2])
    power = torque * velocity + 3.0 * np.sqrt(np.abs(velocity)) + random.normal(size=len(time))
    none = np.full((len(time), 1), np.nan)
    stamp = (seed * 1000 + time * 1e9).astype(np.int64)
    wide = (none, velocity[:, None], torque[:, None], none)
    return LogBlock(stamp, *wide, none[:, 0], power[:, None])


def test_a_fit_of_a_user_is_compared_on_held_out_data_and_chosen(toys):
    held = RecordingContents(("axle",), True, True, False, drive_power=True)
    data = drive_data_of_logs([(held, [drive_samples(seed)]) for seed in (1, 2)], "newton_metre")
    fit = fit_drives(data)
    for comparison in fit.comparisons:
        assert comparison.scores[SQUARE_ROOT].rms == pytest.approx(1.0, rel=0.1)  # the noise
        assert comparison.scores["losses"].rms > 1.3
        assert comparison.scores["map"].rms > 1.3
        assert comparison.scores["loss_map"].rms > comparison.scores[SQUARE_ROOT].rms
    assert fit.chosen == SQUARE_ROOT
    model = with_drives(validate(wheel(), "toy.yaml"), fit, "test")
    assert model.drive == SQUARE_ROOT
    assert DRIVE_MODELS[SQUARE_ROOT].of(model.joints[0]).loss.value == pytest.approx(3.0, rel=0.02)
    page, console = Document(), Console(width=200, file=io.StringIO())
    drives_document(DrivesReport("log", fit, None, None, ()), page)
    print_document(page, console)
    shown = console.file.getvalue()
    assert shown.count(DRIVE_MODELS[SQUARE_ROOT].label) >= 3  # energy, power, what was chosen


def test_a_user_s_fit_that_fails_leaves_the_comparison_of_the_others(toys):
    kind = DRIVE_MODELS[SQUARE_ROOT]

    def nothing(axis, source):
        raise NotIdentifiableError("no loss")

    DRIVE_MODELS[SQUARE_ROOT] = replace(kind, fitted=nothing)
    try:
        held = RecordingContents(("axle",), True, True, False, drive_power=True)
        fit = fit_drives(drive_data_of_logs([(held, [drive_samples(1)])], "newton_metre"))
    finally:
        DRIVE_MODELS[SQUARE_ROOT] = kind
    assert fit.chosen in ("loss_model", "loss_map", "efficiency_map")
    assert SQUARE_ROOT not in fit.comparisons[0].scores
