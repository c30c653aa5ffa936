"""Counterbalances from torque: found where motion shows them, else refused."""

import pytest

import robots
from excited import recorded
from refusals import refused
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import validate
from robot_energy_identify.dynamics.dynamics import DynamicsSettings, identify_dynamics
from robot_energy_identify.dynamics.dynamics_model import to_model
from robots import figure

SETTINGS = DynamicsSettings(delay_span=0.0)
SPRING = {"kind": "spring", "stiffness": figure(15.0), "rest": figure(0.4)}
LEVER = {"kind": "lever", "moment": figure(12.0), "angle": figure(2.8)}
GAS = {
    "kind": "gas_spring", "a": figure(0.1), "b": figure(0.3), "angle": figure(-0.5),
    "force": figure(150.0), "rate": figure(400.0), "length": figure(0.4),
}  # fmt: skip
OPEN = {"value": 0.0, "tag": "assumed"}


def arm(joint, entry):
    data = robots.two_link_data()
    data["joints"][joint]["friction"]["viscous"] = {"law": "constant", "viscous": figure(1e-3)}
    data["joints"][joint]["counterbalance"] = entry
    return validate(data, "arm")


def identified(joint, true, **unknown):
    start = arm(joint, {**true, **unknown})
    found = identify_dynamics([recorded(arm(joint, true), noise=0.01)], start, SETTINGS)
    return found, to_model(found, ["test"]).joints[joint].counterbalance


def test_a_torsion_spring_comes_back_with_its_deviation():
    found, spring = identified(0, SPRING, stiffness=OPEN, rest=OPEN)
    stiffness = spring.stiffness
    assert stiffness.tag == "identified"
    assert stiffness.value == pytest.approx(15.0, abs=2.5 * stiffness.std)
    assert stiffness.std < 1.0
    assert spring.rest.value == pytest.approx(0.4, abs=0.05)
    assert found.held_out_consistent().joint[0] < 0.03


def test_a_lever_spring_behind_a_moving_link_comes_back():
    """The inertia of the forearm at the moving shoulder separates its weight from the spring."""
    _, lever = identified(1, LEVER, moment=OPEN, angle=OPEN)
    assert lever.moment.value == pytest.approx(12.0, abs=2.5 * lever.moment.std)
    assert lever.angle.value == pytest.approx(2.8, abs=2.5 * lever.angle.std)


def test_a_gas_spring_of_known_geometry_comes_back():
    _, gas = identified(1, GAS, force=OPEN, rate=OPEN)
    assert gas.force.value == pytest.approx(150.0, abs=2.5 * gas.force.std)
    assert gas.rate.value == pytest.approx(400.0, abs=2.5 * gas.rate.std)
    assert gas.length.value == 0.4


def test_a_lever_spring_that_a_weight_cannot_be_told_from_is_refused():
    """At a joint whose axis rests no motion separates it from the weight of the first link."""
    with refused(NotIdentifiableError, found=("shoulder", "weight"), remedy=("data sheet",)):
        identified(0, LEVER, moment=OPEN, angle=OPEN)


def test_a_spring_that_is_not_there_is_refused():
    start = arm(1, {**SPRING, "stiffness": OPEN, "rest": OPEN})
    without = arm(1, None)
    with refused(NotIdentifiableError, found=("elbow",), remedy=("leave the entry out",)):
        identify_dynamics([recorded(without, noise=0.01)], start, SETTINGS)


def test_a_published_spring_is_known_and_not_a_heavier_link():
    published = {"value": 15.0, "tag": "published"}
    truth = arm(0, {**SPRING, "stiffness": published})
    found = identify_dynamics([recorded(truth, noise=0.001)], truth, SETTINGS)
    written = to_model(found, ["test"])
    assert written.joints[0].counterbalance == truth.joints[0].counterbalance
    assert not any("stiffness" in name for name in found.torque_model.names)
    assert found.held_out_consistent().total < 0.01
