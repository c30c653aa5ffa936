"""Deviations of power and energy, against models whose figures are off by one deviation."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import robots
from robot_energy.certainty import figure_deviations
from robot_energy.certainty.deviation import (
    CABINET_DEVIATIONS,
    TOGETHER_NAME,
    Z90,
    energy_variances,
    half_width,
    names_of,
    scores,
)
from robot_energy.certainty.figure_deviations import TORQUE_TAG, payload_shares
from robot_energy.certainty.friction_certainty import FrictionCertainty
from robot_energy.certainty.priors import MISSING_LOSS, SPREAD
from robot_energy.foundation.errors import ModelFileError
from robot_energy.model import RobotModel, validate
from robot_energy.model.payload import Payload, payload
from robot_energy.physics.friction import FrictionModel, with_fixed_friction
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.timeline.blocks import TemperatureBlock
from robot_energy_identify.starter.priors import CLASSES

NAMES = names_of(("shoulder", "elbow"))


def data() -> dict[str, Any]:
    """The two-link arm with loss models; no figure has a deviation of its own yet."""
    found = robots.two_link_data()
    found["drive"] = "loss_model"
    for joint in found["joints"]:
        joint["friction"]["viscous"] = {"law": "constant", "viscous": robots.figure(2e-4)}
        joint["losses"] = {
            "constant": robots.figure(3.0),
            "linear": robots.figure(0.01),
            "quadratic": robots.figure(1e-5),
            "copper": robots.figure(0.5),
        }
    return found


def place(found: dict[str, Any], path: str) -> dict[str, Any]:
    """The figure at a path such as ``joints.0.friction.coulomb``."""
    here: Any = found
    for key in path.split("."):
        here = here[int(key)] if key.isdigit() else here[key]
    return here


def certain(found: dict[str, Any]) -> dict[str, Any]:
    """Every figure with a deviation of 0."""
    for joint in found["joints"]:
        joint["friction"]["coulomb"]["std"] = 0.0
        joint["friction"]["viscous"]["viscous"]["std"] = 0.0
        for figure in joint["losses"].values():
            figure["std"] = 0.0
    for name in ("loss_grid", "loss_dc"):
        found["cabinet"][name]["std"] = 0.0
    found["hold"] = {"kept": robots.figure(0.0), "carried": robots.figure(0.0), "std": 0.0}
    return found


def made(found: dict[str, Any]) -> RobotModel:
    return validate(found, "test").with_urdf(robots.TWO_LINK_URDF, "test")


def run(model: RobotModel, seconds: float = 4.0, payload: Payload | None = None) -> EnergyPipeline:
    stamp = 50.0 + np.arange(0.0, seconds, 0.004)
    angle = np.stack([2.0 * stamp, 3.0 * stamp], axis=1)
    rate = np.array([2.0, 3.0])
    pipeline = EnergyPipeline(model, Settings(temperature_wait=0.0))
    if payload is not None:
        pipeline.torque.set_payload(payload)
    degc = TemperatureBlock(np.array([49 * 10**9]), np.full((1, 2), 20.0))
    block = robots.joint_block(stamp, np.sin(angle), rate * np.cos(angle))
    pipeline.step(block, degc)
    pipeline.flush()
    return pipeline


def net(pipeline: EnergyPipeline) -> float:
    registers = pipeline.account.registers
    return registers.cabinet("grid_import") - registers.cabinet("grid_return")


def stds(pipeline: EnergyPipeline) -> dict[str, float]:
    registers = pipeline.account.registers
    variances = energy_variances(registers.deviation)
    return dict(zip(NAMES, np.sqrt(variances).tolist(), strict=True))


@pytest.mark.parametrize(
    ("path", "std", "name"),
    [
        ("joints.0.friction.coulomb", 1e-3, "friction of shoulder"),
        ("joints.1.friction.viscous.viscous", 1e-5, "friction of elbow"),
        ("joints.0.friction.load_coulomb", 1e-3, "friction of shoulder"),
        ("joints.0.friction.viscous.viscous", 1e-5, "friction of shoulder"),
        ("joints.0.friction.viscous_exponent.exponent", 1e-3, "friction of shoulder"),
        ("joints.0.losses.constant", 0.05, "drive of shoulder"),
        ("joints.1.losses.linear", 1e-3, "drive of elbow"),
        ("joints.1.losses.quadratic", 1e-5, "drive of elbow"),
        ("joints.0.losses.copper", 5e-3, "drive of shoulder"),
        ("cabinet.loss_dc", 0.05, "constant loss, DC side"),
        ("cabinet.loss_grid", 0.5, "constant loss, grid side"),
        ("cabinet.fan.power", 0.5, "constant loss, grid side"),
    ],
)
def test_the_deviation_of_an_energy_is_what_one_deviation_of_its_figure_changes(
    path, std, name, monkeypatch
):
    """Friction also changes the torque, and with it copper loss: second order, left out."""
    monkeypatch.setattr(figure_deviations, "FORM_AT_REST", 0.0)
    found = certain(data())
    found["joints"][0]["friction"]["load_coulomb"] = {**robots.figure(0.02), "std": 0.0}
    found["joints"][0]["friction"]["viscous_exponent"] = {
        "exponent": {**robots.figure(0.7), "std": 0.0},
        "velocity": robots.figure(20.0),
    }
    warm = {"power": {**robots.figure(30.0), "std": 0.0}, "on_above_degc": robots.figure(15.0)}
    found["cabinet"]["fan"] = warm
    place(found, path)["std"] = std
    if "friction" in path:
        for joint in found["joints"]:
            joint["losses"]["copper"]["value"] = 0.0
    base = run(made(found))
    changed = copy.deepcopy(found)
    place(changed, path)["value"] += std
    expected = abs(net(run(made(changed))) - net(base))
    assert expected > 1e-3
    assert stds(base)[name] == pytest.approx(expected, rel=0.02)
    others = {one: value for one, value in stds(base).items() if one.split(" ")[0] in name}
    assert sum(value > 0 for value in others.values()) == 1


def test_a_fan_that_recordings_began_without_may_run_at_another_start(monkeypatch):
    """At 20 degC, between stop and start, half of the fans of 30 W run.

    About the expected 15 W the mean square is 15 * 15 W^2; about 0 W it is 30^2 / 2. Of 5/12 about
    0 W it is 375 W^2, about 30 W 7/12 of 900.
    """
    monkeypatch.setattr(figure_deviations, "FORM_AT_REST", 0.0)
    found, deviation = certain(data()), []
    fan = {"power": {**robots.figure(30.0), "std": 0.0}, "on_above_degc": robots.figure(23.0)}
    for begins in ({}, {"begins_off_to_degc": robots.figure(21.0)}):
        found["cabinet"]["fan"] = {**fan, "hysteresis": robots.figure(6.0), **begins}
        deviation.append(stds(run(made(found)))["constant loss, grid side"])
    assert deviation[1] / deviation[0] == pytest.approx(2.0**0.5, rel=1e-6)
    powers = np.array([[0.0, 15.0, 30.0], [12.5, 15.0, 12.5]])
    by_hand = figure_deviations.FigureDeviations(made(found)).grid_side(powers)
    np.testing.assert_allclose(by_hand, np.sqrt([375.0, 225.0, 525.0]), rtol=1e-12)


TOGETHER = {
    "loss_dc": ("cabinet.loss_dc", 0.05),
    "copper of shoulder": ("joints.0.losses.copper", 5e-3),
    "linear of elbow": ("joints.1.losses.linear", 1e-3),
    "quadratic of elbow": ("joints.1.losses.quadratic", 1e-5),
    "coulomb of elbow": ("joints.1.friction.coulomb", 1e-3),
    "viscous of shoulder": ("joints.0.friction.viscous.viscous", 1e-5),
    "loss_grid": ("cabinet.loss_grid", 0.05),
}


def test_the_deviation_of_figures_known_together_is_that_of_their_covariance(monkeypatch):
    """``d' C d`` with the changes d of the energy by each figure, from one run for each.

    The error of viscous friction is in deviations of its law.
    """
    monkeypatch.setattr(figure_deviations, "FORM_AT_REST", 0.0)
    found = certain(data())
    for joint in found["joints"]:  # else friction also changes the copper loss: second order
        joint["losses"]["copper"]["value"] = 0.0
    base = net(run(made(found)))
    changes: list[float] = []
    for path, size in TOGETHER.values():
        other = copy.deepcopy(found)
        place(other, path)["value"] += size
        changes.append((net(run(made(other))) - base) / size)
    scale = np.array([size for _, size in TOGETHER.values()])
    root = np.random.default_rng(7).normal(size=(7, 7)) * scale[:, None]
    viscous = list(TOGETHER).index("viscous of shoulder")
    root[viscous] /= scale[viscous]
    changes[viscous] *= scale[viscous]
    matrix = root @ root.T
    for path, _ in TOGETHER.values():
        place(found, path)["std"] = 1e3  # of a figure for itself: does not count
    place(found, TOGETHER["viscous of shoulder"][0])["std"] = scale[viscous]
    found["covariance"] = {"figures": list(TOGETHER), "matrix": matrix.tolist()}
    registers = run(made(found)).account.registers
    variances = energy_variances(registers.deviation)
    shared = [name in (TOGETHER_NAME, "constant loss, grid side") for name in NAMES]
    assert sum(variances[shared]) == pytest.approx(changes @ matrix @ changes, rel=0.02)
    assert sum(stds(run(made(found)))[f"friction of {name}"] for name in ("shoulder", "elbow")) == 0


def test_friction_and_a_loss_whose_sum_is_known_have_no_deviation():
    """Coulomb friction goes with speed as the linear loss does: what one has more, the other lacks.

    Where both have the same error, it adds; deviations hold for 10 ms.
    """
    found = certain(data())
    found["covariance"] = {
        "figures": ["linear of elbow", "coulomb of elbow"],
        "matrix": [[1e-4, -1e-4], [-1e-4, 1e-4]],
    }
    model = made(found)
    shared = np.array(NAMES) == TOGETHER_NAME
    assert energy_variances(run(model).account.registers.deviation)[shared].sum() < 1e-9
    found["covariance"]["matrix"] = [[1e-4, 1e-4], [1e-4, 1e-4]]
    energy = energy_variances(run(made(found)).account.registers.deviation)[shared].sum()
    assert energy == pytest.approx((0.02 * travelled(model)) ** 2, rel=0.05)


def travelled(model: RobotModel) -> float:
    """Integral of the motor speed of the elbow over the run. [rad]"""
    stamp = np.arange(0.0, 4.0, 0.004)
    ratio = abs(model.joints[1].gear_ratio.value)
    return float(np.trapezoid(ratio * np.abs(3.0 * np.cos(3.0 * (50.0 + stamp))), stamp))


def test_a_sum_that_is_known_has_no_deviation():
    """A grid side that is not known takes from the DC side what it has more: the sum is known."""
    found = certain(data())
    found["covariance"] = {
        "figures": ["loss_dc", "loss_grid"],
        "matrix": [[400.0, -400.0], [-400.0, 400.0]],
    }
    registers = run(made(found)).account.registers
    shared = np.array(NAMES) == TOGETHER_NAME
    assert registers.cabinet("brake") == 0.0  # all of the DC side reaches the grid
    assert energy_variances(registers.deviation)[shared].sum() < 1e-9
    form = stds(run(made(found)))["constant loss, grid side"]
    assert form == pytest.approx(0.1 * made(found).constant_power() * 3.996, rel=0.01)


@pytest.mark.parametrize(
    ("matrix", "why"),
    [
        ([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]], "2 rows of 2"),
        ([[1.0, 2.0], [2.0, 1.0]], "not a covariance of loss_dc and linear of elbow"),
        ([[1.0, 0.5], [0.4, 1.0]], "not a covariance"),
        ([[-1.0, 0.0], [0.0, 1.0]], "variance of loss_dc is negative"),
    ],
)
def test_a_matrix_that_is_no_covariance_is_refused(matrix, why):
    found = data()
    found["covariance"] = {"figures": ["loss_dc", "linear of elbow"], "matrix": matrix}
    with pytest.raises(ModelFileError, match=why):
        made(found)


def test_a_covariance_holds_for_the_figures_that_it_came_with():
    found = data()
    figures = ["loss_dc", "coulomb of elbow"]
    found["covariance"] = {"figures": figures, "matrix": [[4.0, 1.0], [1.0, 9.0]]}
    model = made(found)
    assert model.changed(drive="loss_model").covariance == model.covariance
    cabinet = model.cabinet.model_copy(
        update={"loss_dc": model.cabinet.loss_dc.model_copy(update={"value": 1.0})}
    )
    left = model.changed(cabinet=cabinet)
    assert left.covariance is not None
    assert (left.covariance.figures, left.covariance.matrix) == (("coulomb of elbow",), ((9.0,),))
    friction = model.joints[1].friction
    other = friction.model_copy(
        update={"coulomb": friction.coulomb.model_copy(update={"value": 1.0})}
    )
    joints = [model.joints[0], model.joints[1].model_copy(update={"friction": other})]
    assert left.changed(joints=joints).covariance is None
    assert with_fixed_friction(model, 20.0).covariance == model.covariance
    found["covariance"] = {"figures": ["linear of wrist"], "matrix": [[4.0]]}
    with pytest.raises(ModelFileError, match="the unknown figure 'linear of wrist'"):
        made(found)


def test_certain_losses_at_rest_are_sure_but_for_what_their_form_leaves_out():
    model = made(certain(data()))
    found = stds(run(model, 4.0))
    seconds = 4.0 - 0.004
    share = found["constant loss, grid side"] / (model.constant_power() * seconds)
    assert share == pytest.approx(0.1, rel=0.01)
    assert found["constant loss, DC side"] == 0.0


def test_what_figures_cause_grows_with_time_and_the_rest_with_its_root():
    one, two = (stds(run(made(data()), seconds)) for seconds in (np.pi * 2, np.pi * 4))
    assert two["friction of elbow"] == pytest.approx(2.0 * one["friction of elbow"], rel=0.05)
    rest = "what the model leaves out"
    assert two[rest] == pytest.approx(np.sqrt(2.0) * one[rest], rel=0.05)


def test_nothing_of_the_bus_is_unsure_while_the_brake_takes_all():
    found = data()
    found["cabinet"]["loss_dc"] = robots.figure(0.0)
    pipeline = EnergyPipeline(made(found), Settings(temperature_wait=0.0))
    stamp = 50.0 + np.arange(0.0, 2.0, 0.002)
    fast = np.stack([np.cos(6.0 * stamp), 0.0 * stamp], axis=1)
    rate = np.stack([-6.0 * np.sin(6.0 * stamp), 0.0 * stamp], axis=1)
    power = pipeline.step(robots.joint_block(stamp, fast, rate)).power
    assert power is not None
    power = power[power.deviation.begins]  # where deviations are computed, not held
    braked = power.brake_power > 0
    assert 10 < braked.sum() < len(power)
    columns = dict(
        zip(
            NAMES,
            np.delete(np.asarray(power.deviation), CABINET_DEVIATIONS.index("bus"), axis=1).T,
            strict=True,
        )
    )
    assert (columns["friction of shoulder"][braked] == 0).all()
    assert (columns["drive of elbow"][braked] == 0).all()
    assert (columns["constant loss, grid side"][braked] > 0).all()
    assert (columns["friction of shoulder"][~braked] > 0).any()


def test_a_drive_without_losses_is_as_unsure_as_its_shaft_power_is_great():
    found = data()
    found["drive"] = "ideal"
    for joint in found["joints"]:
        del joint["losses"]
    pipeline = EnergyPipeline(made(found), Settings(temperature_wait=0.0))
    stamp = 50.0 + np.arange(0.0, 2.0, 0.004)
    turned = np.stack([2.0 * stamp, 3.0 * stamp], axis=1)
    block = robots.joint_block(stamp, turned, np.full_like(turned, [2.0, 3.0]))
    power = pipeline.step(block).power
    assert power is not None
    row = int(np.flatnonzero(power.deviation.begins)[-1])
    drives = len(CABINET_DEVIATIONS) + 2
    shaft = power.rigid_power[row] + power.friction_power[row]
    assert (np.abs(power.friction_power[row]) > 0.01 * np.abs(shaft)).all()
    deviation = np.asarray(power.deviation)[row, drives : drives + 2]
    np.testing.assert_allclose(deviation, MISSING_LOSS * np.abs(shaft))


def test_the_payload_has_its_share_of_the_torque():
    bare = robots.two_link()
    assert (payload_shares(bare) == 0).all()
    body = payload("fore", 5.0, (0.3, 0.0, 0.0))
    loaded = bare.changed(payload=(body,))
    shares = payload_shares(loaded)
    # Static torque of the elbow: payload 5 kg at 0.3 m, link 2 kg at 0.15 m.
    assert shares[1] == pytest.approx(5.0 * 0.3 / (5.0 * 0.3 + 2.0 * 0.15), abs=0.05)


def test_bodies_that_were_found_with_the_payload_err_as_one_with_it():
    """What is wrong with a payload is in the bodies that were found with it, until it changes.

    Of the power W of both, 4 % as identified, in place of 20 % of each part as assumed.
    """
    guessed = made(data()).changed(payload=(payload("fore", 5.0, (0.3, 0.0, 0.0)),))
    tagged = guessed.urdf.model_copy(update={"tags": {TORQUE_TAG: "identified"}})
    found = guessed.changed(urdf=tagged)

    def deviations(model: RobotModel, mass: float) -> list[float]:
        """Of bodies and payload. [J]"""
        change = payload("fore", mass, (0.3, 0.0, 0.0))
        sums = run(model, payload=change).account.registers.deviation
        return [sums[NAMES.index(name)] for name in ("bodies", "payload")]

    before = deviations(guessed, 5.0)
    assert min(map(abs, before)) > 1.0
    assert deviations(found, 5.0) == pytest.approx([0.04 / 0.2 * sum(before), 0.0], rel=1e-6)
    assert deviations(guessed, 0.0)[1] == 0.0
    assert abs(deviations(found, 0.0)[1]) > 1.0
    assert abs(deviations(found, 10.0)[1]) > 1.0


def test_priors_are_those_of_first_models():
    for entry in CLASSES.values():
        for name in ("coulomb", "viscous", "copper", "constant", "linear", "quadratic"):
            assert getattr(entry, name).spread == SPREAD[name]
        assert entry.loss_grid.spread == SPREAD["loss_grid"]
        assert entry.loss_dc.spread == SPREAD["loss_dc"]


@pytest.mark.parametrize("scale", [0.2, 1.0, 1.6, 1.7, 5.0])
def test_a_score_is_the_scale_of_the_band_that_just_holds_the_error(scale):
    rest, temperature = np.array([3.0, 3.0]), np.array([0.0, 2.0])
    error = half_width(rest, temperature, scale)
    np.testing.assert_allclose(scores(error, rest, temperature), scale, rtol=1e-12)


def test_readings_never_narrow_what_an_unknown_temperature_adds():
    assert half_width(0.0, 2.0, 0.1) == pytest.approx(Z90 * 2.0)


def test_viscous_friction_is_less_sure_beyond_its_range_and_without_a_temperature():
    model = robots.two_link()  # fitted from 20 to 80 degC, no deviation of its own
    certainty, friction = FrictionCertainty(model), FrictionModel.from_model(model)
    degc = np.array([[np.nan, 40.0], [40.0, 40.0], [10.0, 40.0], [0.0, 40.0]])
    std, shared = certainty.std(degc)
    relative = std[:, 0] / friction.viscous(np.nan_to_num(degc, nan=25.0))[:, 0]
    assert relative[1] == pytest.approx(SPREAD["viscous"])
    assert relative[1] < relative[2] < relative[3]
    assert relative[0] > relative[1]
    assert shared[1, 0] == 0.0
    assert 0.0 < shared[2, 0] < shared[3, 0] < std[3, 0]


@pytest.mark.parametrize("own", [None, 3e-5])
def test_an_unknown_temperature_adds_to_what_is_unsure_of_the_law(own):
    """Deviation of the law, or its prior, and distance over the range combine in squares."""
    joints = robots.two_link_data()["joints"]
    if own is not None:
        joints[0]["friction"]["viscous"]["std"] = own
    certainty = FrictionCertainty(robots.two_link(joints=joints))
    degc = np.linspace(20.0, 80.0, 601)
    off = 1e-3 * (np.exp(-degc / 20.0) - np.exp(-25.0 / 20.0))  # of fv from that at the fallback
    spread = np.sqrt(np.trapezoid(off**2, degc) / 60.0)
    prior = SPREAD["viscous"] * (1e-4 + 1e-3 * np.exp(-25.0 / 20.0))
    assert certainty.fallback_shared_std[0] == pytest.approx(spread, rel=1e-3)
    assert certainty.fallback_std[0] == pytest.approx(np.hypot(own or prior, spread), rel=1e-3)
    assert certainty.fallback_shared_std[1] == 0.0  # the elbow has a constant law


def test_a_fallback_outside_the_fitted_range_errs_alike_at_all_joints():
    found = robots.two_link_data()["temperature"] | {"fallback_degc": -20.0}
    certainty = FrictionCertainty(robots.two_link(temperature=found))
    known, shared = certainty.std(np.array([[-20.0, -20.0]]))
    assert certainty.fallback_std[0] == pytest.approx(known[0, 0])
    assert certainty.fallback_shared_std[0] == shared[0, 0] > 0.0
