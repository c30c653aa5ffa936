"""Gates: what no robot can be is refused by name, what is merely off passes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excited import recorded
from robot_energy.foundation.errors import ImplausibleIdentificationError
from robot_energy.timeline.blocks import MeterLocation
from robot_energy_identify import plausibility
from robot_energy_identify.cabinet.cabinet import CabinetFit, Level
from robot_energy_identify.data.observations import Channels
from robot_energy_identify.drives.drives import fit_drives
from robot_energy_identify.drives.total_sums import Sums
from robot_energy_identify.dynamics.dynamics import identify_dynamics
from robot_energy_identify.friction.friction import fit_friction
from robot_energy_identify.friction.samples import FrictionData
from robot_energy_identify.plausibility import (
    check_cabinet,
    check_drives,
    check_dynamics,
    check_friction,
    check_total,
    opposite_joints,
)
from robot_energy_identify.stats.cross_validation import EnergyScore
from unit.identify.drives.test_drives import data
from unit.identify.dynamics.test_dynamics import QUICK, arm, uninformed


def spoiled(factors, model=None) -> Channels:
    truth = recorded(model or arm(), noise=0.05)
    return replace(truth, motor_torque=truth.motor_torque * np.asarray(factors))


def gate(channels: Channels, model=None) -> None:
    result = identify_dynamics([channels], model or uninformed(arm()), QUICK)
    check_dynamics(result, result.held_out_consistent())


@pytest.mark.parametrize("factors", [[1.0, 1.0], [2**0.5, 2**0.5], [0.5, 0.5]])
def test_what_is_right_or_merely_off_passes(factors):
    gate(spoiled(factors))


@pytest.mark.parametrize(
    ("factors", "joints"),
    [([-1.0, -1.0], "all joints"), ([-1.0, 1.0], "shoulder"), ([1.0, -1.0], "elbow")],
)
def test_torque_of_the_wrong_sign_is_refused_by_joint_and_remedy(factors, joints):
    with pytest.raises(ImplausibleIdentificationError) as error:
        gate(spoiled(factors))
    assert f"torque of {joints} is opposite in sign" in error.value.found
    assert f"sign of the torque of {joints}" in error.value.remedy


def test_a_scale_that_no_urdf_explains_is_refused_with_the_factor():
    with pytest.raises(ImplausibleIdentificationError, match=r"take 8\.. times .* URDF 6 kg"):
        gate(spoiled([8.0, 8.0]), arm())


def test_a_centre_of_mass_far_from_its_link_is_refused():
    result = identify_dynamics([spoiled([1.0, 1.0])], arm(), QUICK)
    error = result.held_out_consistent()
    check_dynamics(result, error)
    moved = result.standard.copy()
    moved[11] += 5.0 * moved[10]  # first moment of the elbow: its centre 5 m away
    with pytest.raises(ImplausibleIdentificationError) as refused:
        _refuse_mass_of(replace(result, standard=moved))
    assert "centre of mass of the link behind elbow is" in refused.value.found
    assert "times the size of the link" in refused.value.found


def _refuse_mass_of(result):
    """The gate of the bodies alone, with a wide limit for the torque they take."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plausibility, "MAX_BODY_FACTOR", 1e6)
        check_dynamics(result, result.held_out_consistent())


def test_friction_that_drives_is_refused_by_name():
    truth = arm()
    joints = [
        joint.model_copy(
            update={
                "friction": joint.friction.model_copy(
                    update={"coulomb": joint.friction.coulomb.model_copy(update={"value": value})}
                )
            }
        )
        for joint, value in zip(truth.joints, (0.5, -1.0), strict=True)
    ]
    driving = truth.model_copy(update={"joints": joints}).with_urdf(truth.urdf_xml, "x")
    with pytest.raises(ImplausibleIdentificationError, match="elbow"):
        gate(spoiled([1.0, 1.0], driving))


def test_a_prediction_no_better_than_zero_is_refused():
    result = identify_dynamics([spoiled([1.0, 1.0])], uninformed(arm()), QUICK)
    error = replace(result.held_out_consistent(), total=1.07)
    with pytest.raises(ImplausibleIdentificationError, match="107 % off"):
        check_dynamics(result, error)


def axis(coulomb: float, viscous: float, noise: float = 0.02) -> FrictionData:
    random = np.random.default_rng(3)
    speed = 100.0 * np.sin(np.arange(4000) / 50.0)
    torque = coulomb * np.sign(speed) + viscous * speed + random.normal(0.0, noise, 4000)
    degc = np.full(4000, 30.0)
    block = np.arange(4000) // 100
    return FrictionData("axis", speed, torque, degc, block, block // 10, np.empty((4000, 0)))


@pytest.mark.parametrize(
    ("coulomb", "viscous", "said"),
    [(0.5, 1e-2, ""), (-0.5, 2e-2, "Coulomb"), (0.5, -1e-2, "viscous"), (-1e-3, 1e-2, "")],
)
def test_negative_friction_is_refused_where_it_is_sure_and_matters(coulomb, viscous, said):
    fit = fit_friction(axis(coulomb, viscous))
    if not said:
        check_friction([fit])
        return
    with pytest.raises(ImplausibleIdentificationError, match=f"{said} friction of axis"):
        check_friction([fit])


def test_an_axis_whose_friction_is_negative_leaves_the_others():
    good, bad = fit_friction(axis(0.5, 1e-2)), fit_friction(axis(-0.5, 2e-2))
    kept, refused = check_friction([bad, good])
    assert kept == [good]
    assert len(refused) == 1
    assert "Coulomb friction of axis" in refused[0]


def test_a_law_that_was_not_chosen_is_not_judged():
    """Slow motion was cold and fast motion warm: the constant is negative, the law is not."""
    fit = replace(fit_friction(axis(0.5, 1e-2)), viscous=-1e-2, viscous_std=1e-4)
    with pytest.raises(ImplausibleIdentificationError, match="viscous"):
        check_friction([fit])
    chosen = replace(fit, chosen="exponential", errors={"exponential": fit.errors["constant"]})
    assert check_friction([chosen]) == ([chosen], [])


def test_friction_that_predicts_nothing_is_refused():
    random = np.random.default_rng(4)
    noise = replace(axis(0.0, 0.0), friction_torque=random.normal(0.0, 1.0, 4000))
    fit = fit_friction(noise)
    lost = replace(fit, errors={fit.chosen: replace(fit.errors[fit.chosen], rms=1.01 * fit.torque)})
    with pytest.raises(ImplausibleIdentificationError, match="no better than zero"):
        check_friction([lost])
    check_friction([lost, fit_friction(axis(0.5, 1e-2))])  # one of several is for the errors


def test_a_meter_that_reads_below_zero_at_rest_is_refused():
    def fit(power: float) -> CabinetFit:
        hold = Level(power, 1.0, 100, 5, 0.0)
        return CabinetFit(MeterLocation.GRID, hold, None, power, 1.0, None, None, ())

    check_cabinet(fit(400.0))
    check_cabinet(fit(-2.0))
    with pytest.raises(ImplausibleIdentificationError) as error:
        check_cabinet(fit(-400.0))
    assert "load_negative" in error.value.remedy


def test_drives_whose_power_falls_with_their_shaft_power_are_refused():
    right = data(0, 1)
    fit = fit_drives(right)
    check_drives(right, fit)
    with pytest.raises(ImplausibleIdentificationError, match="axle -0"):
        check_drives(replace(right, motor_torque=-right.motor_torque), fit)
    part = fit.comparisons[0]
    lost = replace(part, size=0.5 * part.scores["losses"].rms)
    with pytest.raises(ImplausibleIdentificationError, match="no better than predicting zero"):
        check_drives(right, replace(fit, chosen="loss_model", comparisons=(lost,)))


def test_a_meter_that_is_predicted_no_better_than_by_zero_is_refused():
    unknown = np.full(100, np.nan)
    numbers = np.zeros(100, dtype=np.int64)
    pieces = Sums(("axle",), MeterLocation.GRID, np.ones(100), np.full(100, 50.0), unknown,
                  np.zeros((100, 3, 1)), unknown, unknown, numbers, numbers,
                  (np.ones(1),) * 3, np.zeros((100, 1)))  # fmt: skip
    check_total(pieces, {"identified": EnergyScore(49.0, 0.1, 0.1)})
    with pytest.raises(ImplausibleIdentificationError, match="sign, the unit and the clock"):
        check_total(pieces, {"identified": EnergyScore(51.0, 0.1, 0.1)})


def test_a_joint_that_hardly_moves_has_no_sign():
    one = np.ones((50, 1))
    assert opposite_joints(["a"], -one, one, one, one > 0) == {}
