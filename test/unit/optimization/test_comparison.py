"""Motions compared: energies as predicted alone, and bands of differences."""

import numpy as np
import pytest

from robot_energy.certainty.figure_deviations import TORQUE_TAG
from robot_energy.certainty.friction_certainty import FrictionCertainty
from robot_energy.certainty.priors import figure_std
from robot_energy.foundation.errors import MotionError
from robot_energy.model import load
from robot_energy.model.figure import PositiveFigure
from robot_energy.model.joint import ViscousExponent
from robot_energy.model.schema import Covariance
from robot_energy.physics.friction import FrictionModel
from robot_energy_plan.motion.joint_trajectory import JointTrajectory
from robot_energy_plan.optimization.chain import PowerChain
from robot_energy_plan.optimization.comparison import compare_motions
from robot_energy_plan.optimization.deviations import DeviationSums, EnergyDeviations
from robot_energy_plan.prediction import predict

MODEL = load("kr16")
DEGC = np.full(6, 40.0)
FIRST = np.array([0.0, -1.2, 1.2, 0.0, 0.3, 0.0])


def motion(seconds, reach=0.5, names=MODEL.joint_names):
    still = np.zeros((2, 6))
    position = np.stack([FIRST, FIRST + reach * np.array([1.0, 0.3, -0.3, 0.2, 0.1, 0.1])])
    return JointTrajectory(names, np.array([0.0, seconds]), position, still, still)


def test_rest_has_the_columns_of_the_power_chain():
    """A motion that stands: integrated sample by sample, and one second times its length."""
    standing = JointTrajectory(
        MODEL.joint_names, np.array([0.0, 5.0]), np.stack([FIRST, FIRST]), np.zeros((2, 6))
    )
    sums = DeviationSums(MODEL)
    predict(MODEL, standing.planned(), DEGC, on_output=sums.take)
    held = PowerChain(MODEL, DEGC[None, :]).rests(FIRST[None, :])
    assert sums.energy == pytest.approx(5.0 * held.columns[0], rel=0.01)


def test_columns_of_figures_known_together_are_those_of_their_covariance():
    """``d' C d`` in place of ``sum (d s)^2``, with the way of the motor and the time as d."""
    model, seconds, of_speed = load("ur3e"), 6.0, 0.02
    joint = model.joints[0]
    friction = joint.friction.model_copy(
        update={"coulomb": joint.friction.coulomb.model_copy(update={"std": of_speed})}
    )
    losses = joint.losses.model_copy(
        update={"linear": joint.losses.linear.model_copy(update={"std": of_speed})}
    )
    first = joint.model_copy(update={"friction": friction, "losses": losses})
    model = model.changed(joints=[first, *model.joints[1:]])
    way = abs(joint.gear_ratio.value) * 0.5
    change = np.array([way, way, seconds])
    stds = np.array([of_speed, of_speed, figure_std(model.cabinet.loss_grid, "loss_grid")])
    rows = np.array([[1.0, -0.9, 0.3], [-0.9, 1.0, -0.2], [0.3, -0.2, 1.0]])
    matrix = rows * np.outer(stds, stds)
    together = Covariance(
        figures=(f"linear of {joint.name}", f"coulomb of {joint.name}", "loss_grid"),
        matrix=tuple(map(tuple, matrix.tolist())),
    )
    variances = []
    for covariance in (None, together):
        used = model.changed(covariance=covariance)
        sums = DeviationSums(used)
        path = motion(seconds, names=model.joint_names).planned()
        predict(used, path, DEGC, on_output=sums.take)
        assert sums.braked == 0.0  # the grid sees all of it
        variances.append(sums.energy @ sums.energy)
    expected = change @ matrix @ change - np.square(change * stds).sum()
    assert variances[1] - variances[0] == pytest.approx(expected, rel=0.01)


def test_an_exponent_of_the_speed_is_in_the_columns_of_friction():
    """One joint at a constant speed w: ``s(fv) |w u|`` and ``s(q) fv |w u ln(w / wq)|``."""
    exponent, std, velocity, speed, degc = 0.7, 0.3, 100.0, 300.0, np.full(6, 40.0)
    term = ViscousExponent(
        exponent=PositiveFigure(value=exponent, tag="identified", std=std),
        velocity=PositiveFigure(value=velocity, tag="derived"),
    )
    joint = MODEL.joints[0]
    friction = joint.friction.model_copy(update={"viscous_exponent": term})
    bent = MODEL.changed(
        joints=[joint.model_copy(update={"friction": friction}), *MODEL.joints[1:]]
    )
    turning = np.zeros((1, 6))
    turning[0, 0] = speed
    still, nothing = np.zeros((1, 6)), np.zeros(1)
    squares = [
        np.square(EnergyDeviations(model).columns(turning, still, still, still, still, still, degc,
                                                  nothing)).sum()
        for model in (MODEL, bent)
    ]  # fmt: skip
    moved = speed * velocity * (speed / velocity) ** exponent  # w u
    viscous = FrictionModel.from_model(MODEL).viscous(degc)[0]
    sure = FrictionCertainty(MODEL).std(degc[None, :])[0][0, 0]
    by_law = sure**2 * (moved**2 - speed**4)
    by_exponent = (std * viscous * moved * np.log(speed / velocity)) ** 2
    assert squares[1] - squares[0] == pytest.approx(by_law + by_exponent, rel=1e-6)
    assert by_exponent > 0.1 * abs(by_law)


def test_bodies_that_were_found_with_the_payload_have_one_column_with_it():
    """Of a rigid power of 100 W on one axis: 4 % as identified, none for the payload."""
    still, power = np.zeros((1, 6)), np.zeros((1, 6))
    power[0, 1] = 100.0
    tags = {**MODEL.urdf.tags, TORQUE_TAG: "identified"}
    known = MODEL.changed(urdf=MODEL.urdf.model_copy(update={"tags": tags}))
    guessed, found = (
        EnergyDeviations(model).columns(
            still, still, power, still, still, still, np.full(6, 40.0), np.zeros(1)
        )[0]
        for model in (MODEL, known)
    )
    differ = np.flatnonzero(guessed != found)
    assert len(differ) == 2
    assert found[differ] == pytest.approx([4.0, 0.0])
    assert guessed[differ].min() > 4.0


def test_a_band_of_a_difference_is_far_below_that_of_an_energy():
    found = compare_motions(MODEL, [lambda: motion(3.0), lambda: motion(3.1)], DEGC)
    first, second = found.candidates
    more, half = second.more_than(first)
    assert more == pytest.approx(second.energy - first.energy)
    assert 0 < half < 0.2 * first.half


def test_a_wait_until_the_cycle_time_costs_what_rest_costs():
    bare = compare_motions(MODEL, [lambda: motion(3.0)], DEGC).candidates[0]
    waits = compare_motions(MODEL, [lambda: motion(3.0)], DEGC, cycle_time=8.0).candidates[0]
    end = motion(3.0).sample(np.array([3.0])).joint_position
    watts = PowerChain(MODEL, DEGC[None, :]).rests(end).energy[0]
    assert waits.energy - bare.energy == pytest.approx(5.0 * watts)


def test_what_is_wrong_with_one_leaves_the_others():
    def broken():
        raise MotionError("it has no points", "two")

    found = compare_motions(MODEL, [broken, lambda: motion(3.0), lambda: motion(0.05)], DEGC)
    assert found.order == (1,)
    assert "no points" in found.candidates[0].message
    assert "speed limit" in found.candidates[2].message
    assert np.isnan(found.advantage[0])


def test_too_many_samples_are_refused_before_the_work():
    found = compare_motions(MODEL, [lambda: motion(3.0)] * 2, DEGC, max_samples=1000)
    assert found.candidates[0].feasible
    assert "too many samples" in found.candidates[1].message


@pytest.mark.parametrize("options", [{"cycle_time": -1.0}, {"peak_limit": 0.0}])
def test_figures_that_make_no_sense_are_refused(options):
    with pytest.raises(MotionError):
        compare_motions(MODEL, [lambda: motion(3.0)], DEGC, **options)
