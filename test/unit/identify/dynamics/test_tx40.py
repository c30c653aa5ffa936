"""A real six-axis robot with a coupled wrist, against its published friction."""

import os
import time
from pathlib import Path

import numpy as np
import pytest

from places import ROOT
from robot_energy_identify.data.log_channels import model_of, read_channels
from robot_energy_identify.dynamics.dynamics import identify_dynamics
from robot_energy_identify.dynamics.dynamics_model import friction_at_joints, to_model
from robot_energy_logs.mapping import load_mapping

MAPPING = ROOT / "src/examples/identify/tx40.yaml"
DATA = Path(os.environ.get("ROBOT_ENERGY_DATA", "/nonexistent")) / "tx40"


def test_the_users_part_is_at_most_thirty_lines():
    log = load_mapping(MAPPING)
    assert log.joints.names[5] == "joint_6"
    assert len(MAPPING.read_text().splitlines()) <= 30


@pytest.fixture(scope="module")
def identified():
    if not DATA.is_dir():
        pytest.skip("no data folder (ROBOT_ENERGY_DATA)")
    log = load_mapping(MAPPING)
    model = model_of(log, [DATA])
    begin = time.process_time()
    (channels,) = read_channels([DATA], log, model).values()
    result = identify_dynamics(channels, model)
    return log, result, time.process_time() - begin


def test_base_parameters_are_those_of_the_literature(identified):
    _, result, _ = identified
    assert (len(result.base), result.n_inertial) == (61, 36)


def test_friction_is_within_five_percent_of_all_published_values(identified):
    log, result, _ = identified
    friction = friction_at_joints(result)
    for kind in ("viscous", "coulomb"):
        known = np.array(getattr(log.reference, kind))
        assert np.abs(friction[kind][0] / known - 1.0).max() < 0.05, kind


def test_held_out_error_with_standstill_is_below_the_best_known(identified):
    _, result, _ = identified
    assert result.held_out().with_standstill <= 0.082
    assert result.held_out().total <= 0.06
    assert result.held_out_consistent().with_standstill <= 0.082
    assert result.in_sample.total < result.held_out().total


def test_model_file_loses_nothing_of_the_fit(identified):
    """Without the joint-side terms that a model file has no place for."""
    _, result, _ = identified
    assert result.held_out_consistent().total < 1.05 * result.held_out().total
    assert to_model(result).joints[2].rotor_inertia.tag == "identified"


def test_wrist_coupling_is_not_lost(identified):
    """Without it, joint 5 has an error of 54 % in a published tool."""
    _, result, _ = identified
    assert result.held_out().joint[4] < 0.15
    place = result.fit.names.index("coulomb joint_6")
    assert result.fit.values[place] == pytest.approx(1.95, rel=0.05)  # published


def test_it_is_quick(identified):
    """0.3 s on an idle core, 1.4 s on a busy one; the limit leaves room for slower machines."""
    assert identified[2] < 15.0
