"""Predictions of trajectories: any supply, any grid of points, and points at almost one instant."""

from operator import add

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_energy.model import RobotModel
from robot_energy.model.schema import Cabinet
from robot_energy.physics.drives_and_cabinet import CabinetStage
from robot_energy_plan.motion.joint_trajectory import JointTrajectory
from robot_energy_plan.prediction import predict
from robot_energy_plan.results.prediction import prediction_report
from robots import figure, one_wheel, two_link

GRID = 5e-3  # s, at which a trajectory is sampled at most
GAPS = (0.0, 3e-10, 1e-9, 1.4e-9, 4e-8, 9.99e-7, 1.1e-6, 2e-5, 1e-3)  # s after an instant
CABINET = ("grid_import", "grid_return", "loss_dc", "loss_grid", "brake", "capacitor")

figures = st.floats(0.0, 500.0).map(figure)
capacitors = st.builds(
    lambda farad, nominal, more: {
        "capacitance": figure(farad),
        "nominal_voltage": figure(nominal),
        "chopper_voltage": figure(nominal + more),
    },
    st.floats(1e-6, 0.1),
    st.floats(24.0, 700.0),
    st.floats(0.1, 300.0),
)
cabinets = st.fixed_dictionaries(
    {"loss_grid": figures, "loss_dc": figures},
    optional={
        "regeneration_efficiency": st.floats(0.0, 1.0).map(figure),
        "capacitor": capacitors,
    },
)


@st.composite
def models(draw: st.DrawFn) -> RobotModel:
    """A wheel or an arm with a cabinet and drives from the schema."""
    plain = draw(st.sampled_from([one_wheel, two_link]))
    return plain(cabinet=draw(cabinets))


@st.composite
def paths(draw: st.DrawFn, n_joints: int) -> tuple[JointTrajectory, int]:
    """A smooth motion through points at equal or unequal distances, with what the points have."""
    count = draw(st.integers(2, 12))
    steps = st.sampled_from([GRID, 0.008, 0.01, 0.1, 1 / 3]) | st.floats(0.004, 0.4)
    if draw(st.booleans()):
        step = np.full(count - 1, draw(steps))
    else:
        step = np.array(draw(st.lists(steps, min_size=count - 1, max_size=count - 1)))
    time = draw(st.sampled_from([0.0, 0.37, 1e-9])) + np.concatenate([[0.0], np.cumsum(step)])
    size, turns = draw(st.floats(0.01, 0.8)), draw(st.floats(0.5, 6.0))
    angle = turns * (time - time[0])[:, None] + 0.3 * np.arange(n_joints)
    position, velocity = size * np.sin(angle), size * turns * np.cos(angle)
    given = (position, velocity, -(turns**2) * position)[: draw(st.integers(1, 3))]
    joints = ("axle",) if n_joints == 1 else ("shoulder", "elbow")
    return JointTrajectory(joints, time, *given), len(given)


def with_points(path: JointTrajectory, given: int, more: np.ndarray) -> JointTrajectory:
    """The same motion, with more of its own points."""
    time = np.sort(np.concatenate([path.instants, more[more <= path.duration]]))
    at = path.sample(time)
    states = (at.joint_position, at.joint_velocity, at.joint_acceleration)
    return JointTrajectory(path.joint_names, time, *states[:given])


@settings(deadline=None, max_examples=25)
@given(data=st.data())
def test_any_supply_and_any_points_give_one_energy(data):
    """Points on others, next to them, and next to the grid of samples change nothing."""
    model = data.draw(models())
    path, given = data.draw(paths(len(model.joints)))
    grid = np.arange(int(path.duration / GRID) + 1) * GRID
    places = st.sampled_from([*grid.tolist(), *path.instants.tolist()])
    more = data.draw(st.lists(st.builds(add, places, st.sampled_from(GAPS)), max_size=20))
    few = predict(model, path.planned(), 40.0)
    many = predict(model, with_points(path, given, np.array(more)).planned(), 40.0)
    for found in (few, many):
        assert prediction_report(found).energy.balanced
        assert found.account.registers.time.gap_ns == 0
    step = GRID * few.account.counts.peak_power  # J: a jump may lie anywhere between two samples
    for name in CABINET:
        one, other = (found.account.registers.cabinet(name) for found in (few, many))
        assert abs(other - one) <= step + 1e-3 * abs(one), name


@settings(deadline=None, max_examples=25)
@given(
    st.lists(
        st.tuples(st.sampled_from([0, 1, 10**6, 10**8]), st.floats(-3e3, 3e3)),
        min_size=1,
        max_size=40,
    ),
    capacitors,
    st.floats(0.0, 1.0) | st.none(),
)
def test_a_cabinet_takes_repeated_stamps(samples, capacitor, returned):
    """Any stamps in any order: the flows sum, and what is stored stays within the swing."""
    entry = {"loss_grid": figure(9.0), "loss_dc": figure(5.0), "capacitor": capacitor}
    if returned is not None:
        entry["regeneration_efficiency"] = figure(returned)
    cabinet = Cabinet.model_validate(entry)
    steps, bus = (np.array(column) for column in zip(*samples, strict=True))
    stamp = np.cumsum(steps).astype(np.int64)
    flows = CabinetStage(cabinet).step(stamp, np.zeros(len(bus), dtype=np.int64), bus)
    parts = bus + flows.loss_dc + flows.loss_grid + flows.brake_power + flows.capacitor_power
    np.testing.assert_allclose(flows.grid_power, parts, atol=1e-6)
    lasted = np.diff(stamp, prepend=stamp[0]) * 1e-9
    stored = np.cumsum(flows.capacitor_power * lasted)
    swing = cabinet.capacitor.swing
    assert (stored >= -1e-9 * swing).all()
    assert (stored <= swing * (1 + 1e-9)).all()
