"""From a recording to a model file that the monitor runs."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from excited import coming_to_rest, fourier_motion, monitor_torque, recorded
from plants import PROGRAM, two_link_profile
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import load, save, validate
from robot_energy.physics.drivetrain import Drivetrain
from robot_energy.physics.rigid_body import Robot
from robot_energy_identify.data.observations import Channels, Filters, stretches
from robot_energy_identify.dynamics.dynamics import DynamicsSettings, identify_dynamics
from robot_energy_identify.dynamics.dynamics_model import friction_at_joints, to_model
from robot_energy_identify.dynamics.torque_model import standard_columns
from robot_energy_rig import RigConfig, VirtualRig

SMOOTH = 0.05
COLUMNS = standard_columns(SMOOTH)
QUICK = DynamicsSettings(columns=COLUMNS, delay_span=0.0)
MOTION = fourier_motion(2, np.arange(1000) / 200.0, seed=7)  # not the one that is fitted


def arm(**changes):
    """The two-link arm with the smooth sign, whose bodies are uncertain in the file."""
    data = {**robots.two_link_data(), **changes}
    for joint in data["joints"]:
        smooth = SMOOTH * abs(joint["gear_ratio"]["value"])
        joint["friction"]["smooth_velocity"] = robots.figure(smooth)
    return validate(data, "arm")


def uninformed(model):
    """The same robot as a user knows it first: other masses, no friction, no rotors."""
    urdf = model.urdf_xml.replace(f'mass value="{robots.M1}"', 'mass value="6.0"')
    urdf = urdf.replace(f'mass value="{robots.M2}"', 'mass value="1.0"')
    assert urdf.count('mass value="6.0"') == urdf.count('mass value="1.0"') == 1
    joints = []
    for joint in model.joints:
        zero = {"value": 0.0, "tag": "assumed"}
        friction = {"coulomb": zero, "viscous": {"law": "constant", "viscous": zero}}
        data = joint.model_dump(exclude_none=True) | {"rotor_inertia": zero, "friction": friction}
        joints.append(data)
    data = model.model_dump(exclude_none=True) | {"joints": joints, "urdf": {"xml": urdf}}
    return validate(data, "uninformed")


def relative(found, expected):
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


@pytest.mark.parametrize("method", ["ols", "wls", "irls"])
def test_monitor_with_the_identified_model_gives_the_robots_torque(method, tmp_path):
    truth = arm()
    start = uninformed(truth)
    result = identify_dynamics([recorded(truth)], start, replace(QUICK, method=method))
    save(to_model(result), tmp_path / "arm.yaml")
    found = monitor_torque(load(tmp_path / "arm.yaml"), MOTION)
    assert relative(monitor_torque(start, MOTION), monitor_torque(truth, MOTION)) > 0.3
    assert relative(found, monitor_torque(truth, MOTION)) < 2e-3


@pytest.mark.parametrize("stribeck", [None, 0.3])
def test_monitor_gives_the_torque_of_the_fit_to_every_digit(stribeck, tmp_path):
    """With a payload, whose mass stays apart from the bodies."""
    payload = [{"link": "fore", "mass": 1.5, "centre_of_mass": [0.2, 0, 0.05], "tag": "assumed"}]
    truth = arm(payload=payload)
    settings = replace(QUICK, columns=standard_columns(SMOOTH, stribeck))
    result = identify_dynamics([recorded(truth, noise=0.1)], uninformed(truth), settings)
    save(to_model(result), tmp_path / "arm.yaml")
    written = load(tmp_path / "arm.yaml")
    assert [body.mass for body in written.payload] == [1.5]
    np.testing.assert_allclose(
        monitor_torque(written, MOTION), result.motor_torque(MOTION), rtol=1e-8, atol=1e-9
    )
    assert Robot.from_model(written).link_parameters == pytest.approx(result.standard[:20])


def test_known_payload_is_not_taken_for_a_heavier_link():
    payload = [{"link": "fore", "mass": 1.5, "centre_of_mass": [0.2, 0, 0], "tag": "assumed"}]
    loaded, bare = (
        identify_dynamics([recorded(model)], model, QUICK)
        for model in (arm(payload=payload), arm())
    )
    np.testing.assert_allclose(loaded.fit.values, bare.fit.values, rtol=0.01, atol=5e-3)


def test_model_file_says_what_is_identified_and_how_well(tmp_path):
    result = identify_dynamics([recorded(arm(), noise=0.05)], uninformed(arm()), QUICK)
    written = to_model(result, ["arm.csv"])
    shoulder, elbow = written.joints
    assert elbow.rotor_inertia.tag == "identified"
    assert elbow.rotor_inertia.value == pytest.approx(2e-5, abs=3 * elbow.rotor_inertia.std)
    assert shoulder.rotor_inertia.tag == "derived"
    assert shoulder.rotor_inertia.std is None
    assert "rotor_inertia shoulder" in shoulder.rotor_inertia.source
    assert "Iyy shoulder" in shoulder.rotor_inertia.source
    viscous = elbow.friction.viscous.viscous
    assert viscous.tag == "identified"
    assert viscous.value == pytest.approx(2e-4, abs=3 * viscous.std)
    assert written.provenance.bags == ("arm.csv",)
    assert written.urdf.tags["inertias"] == "derived"
    assert written.urdf.tags["torque"] == "identified"


@pytest.mark.parametrize("delay", [0.0, 0.004, -0.0013])
def test_delay_of_the_torque_channel_is_found_and_undone(delay):
    """4 ms: what trimming one side alone once did to a published tool."""
    result = identify_dynamics(
        [recorded(arm(), delay=delay, noise=0.02)], arm(), DynamicsSettings(columns=COLUMNS)
    )
    assert result.delay.value == pytest.approx(delay, abs=2e-4)
    assert result.delay.applied == (result.delay.value if delay else 0.0)
    undone = dict(zip(result.fit.names, result.fit.values, strict=True))
    assert undone["rotor_inertia elbow"] == pytest.approx(0.05, rel=0.02)


def test_the_chain_itself_delays_nothing():
    """Filters, differences, decimation and trimming: both sides meet at the same instant."""
    exact = identify_dynamics([recorded(arm(), rate=5000.0, duration=10.0)], arm(), QUICK)
    assert exact.in_sample.total < 1e-3
    # A shift of 4 ms between the sides would leave this much:
    shifted = identify_dynamics(
        [recorded(arm(), rate=5000.0, duration=10.0, delay=0.004)], arm(), QUICK
    )
    assert shifted.in_sample.total > 10 * exact.in_sample.total


def test_channels_far_apart_in_time_are_noted():
    result = identify_dynamics(
        [recorded(arm(), delay=0.05)], arm(), DynamicsSettings(columns=COLUMNS)
    )
    assert result.delay.at_edge
    assert any("--delay" in note for note in result.notes)


def test_stretches_of_a_recording_count_together():
    whole = recorded(arm(), duration=24.0)
    parts = [
        Channels(whole.rate, whole.joint_position[a:b], whole.motor_torque[a:b])
        for a, b in ((0, 6000), (6000, 12000))
    ]
    one, two = (identify_dynamics(data, arm(), QUICK) for data in ([whole], parts))
    np.testing.assert_allclose(one.fit.values, two.fit.values, rtol=5e-3, atol=2e-3)
    assert set(two.observations.segment) == {0, 1}


def test_standstill_does_not_pull_parameters_away():
    """A robot at rest keeps torque anywhere below its Coulomb friction."""
    still = coming_to_rest(arm(), 20.0, 10.0, 500.0)
    kept = replace(QUICK, filters=Filters(standing_velocity=1e-9))
    truth = identify_dynamics([recorded(arm())], arm(), QUICK).fit.values
    error = {
        name: np.linalg.norm(identify_dynamics([still], arm(), settings).fit.values - truth)
        for name, settings in (("left out", QUICK), ("kept", kept))
    }
    assert error["left out"] < 0.02 * np.linalg.norm(truth)
    assert error["kept"] > 5 * error["left out"]


def test_held_out_error_exceeds_that_of_the_fitted_data():
    result = identify_dynamics([recorded(arm(), noise=0.3, memory=0.9)], arm(), QUICK)
    held = result.held_out()
    assert held.total > result.in_sample.total
    assert held.joint.shape == (2,)
    assert result.held_out_consistent().total < 1.5 * held.total


def test_virtual_rig_comes_back_within_its_deviations(tmp_path):
    """The plant's own friction law, with its encoders and the noise of its torque sensors."""
    off = RigConfig.plain()
    config = replace(off, encoder=True, torque_noise=True, stamp_jitter=True)
    profile = two_link_profile(tmp_path)
    rig = VirtualRig(profile, PROGRAM, config, seed=3, start_temperature_degc=40.0)
    joints = rig.step(250 * 40).joints
    model = load(profile.body)
    parts = stretches(
        joints.stamp_ns,
        np.zeros(len(joints), dtype=np.int64),
        joints.joint_position,
        joints.measured_motor_torque,
    )
    settings = DynamicsSettings(columns=standard_columns(0.01), delay_span=0.0)
    result = identify_dynamics(parts, model, settings)
    ratio = np.abs(np.diagonal(Drivetrain.from_model(model).transmission))
    half = 2.576 * result.fit.std  # of 99 %
    for joint, name in enumerate(model.joint_names):
        place = result.fit.names.index(f"coulomb {name}")
        expected = profile.coulomb[joint] * ratio[joint]
        assert abs(result.fit.values[place] - expected) < half[place]
    base = result.base.matrix[:, :20] @ Robot.from_model(model).link_parameters
    inertial = result.base.independent < 20
    error = np.abs(result.fit.values - base)[inertial]
    rotor = np.array([joint.rotor_inertia.value for joint in model.joints]) * ratio**2
    error[list(np.array(result.base.labels)[inertial]).index("Iyy shoulder")] -= rotor[0]
    assert (np.abs(error) < half[inertial] + 1e-3).all()


def bad(**changes):
    """A recording with something wrong."""
    good = recorded(arm(), duration=changes.pop("duration", 20.0))
    return [replace(good, **{name: change(good) for name, change in changes.items()})]


def frozen(good):
    position = good.joint_position.copy()
    position[:, 1] = 0.3
    return position


def dead(good):
    torque = good.motor_torque.copy()
    torque[:, 0] = 0.0
    return torque


def with_hole(good):
    torque = good.motor_torque.copy()
    torque[100, 1] = np.nan
    return torque


@pytest.mark.parametrize(
    ("channels", "words"),
    [
        ([], "no stretch"),
        (bad(duration=1.0), r"for 15 parameters.*Record at least 2 s"),
        (bad(joint_position=frozen), r"no motion faster.*elbow.*excitation trajectory"),
        (bad(motor_torque=dead), "torque of shoulder never changes"),
        (bad(motor_torque=with_hole), "torque of elbow is missing"),
        (bad(joint_position=lambda g: np.rad2deg(g.joint_position)), "faster than.*shoulder"),
    ],
)
def test_unusable_recording_is_refused_and_says_what_to_record(channels, words):
    with pytest.raises(NotIdentifiableError, match=words) as caught:
        identify_dynamics(channels, arm(), QUICK)
    assert "\n" not in str(caught.value)


def test_motion_that_does_not_excite_a_parameter_is_refused_by_name():
    """Both joints move alike: the inertias of the two links cannot be distinguished."""
    good = recorded(arm(coupling=[]))
    position = good.joint_position.copy()
    position[:, 1] = position[:, 0]
    with pytest.raises(NotIdentifiableError, match=r"does not excite .*Iyy elbow"):
        identify_dynamics(
            [replace(good, joint_position=position)],
            arm(coupling=[]),
            QUICK,
        )


def test_wrong_zero_or_unit_of_torque_is_noted():
    good = recorded(arm())
    wrong = replace(good, joint_position=good.joint_position[::-1].copy())
    result = identify_dynamics([wrong], arm(), QUICK)
    assert any("check units, gear ratios" in note for note in result.notes)


def test_friction_at_a_coupled_joint_sums_over_its_motors():
    """By hand: the elbow's motor adds (1/5)^2 of its viscous friction to the shoulder."""
    result = identify_dynamics([recorded(arm())], arm(), QUICK)
    friction = friction_at_joints(result)
    viscous = [(1e-4 + 1e-3 * np.exp(-25 / 20)) * 100.0**2 + 0.5 / 25, 2e-4 * 50.0**2]
    np.testing.assert_allclose(friction["viscous"][0], viscous, rtol=0.01)
    # All Coulomb friction of the elbow is its motor's, which the shoulder turns as well.
    np.testing.assert_allclose(friction["coulomb"][0], [10.0, 0.0], rtol=0.01, atol=0.01)
    place = result.fit.names.index("joint_coulomb elbow")
    assert friction["coulomb"][1][1] == pytest.approx(result.fit.std[place])
    motor = result.fit.values[result.fit.names.index("coulomb elbow")]
    assert motor == pytest.approx(2.5, rel=0.01)


def test_what_a_recording_hardly_says_is_marked_by_name():
    """Under noise of twice the torque, the inertia of the elbow drowns."""
    full = identify_dynamics([recorded(arm(), noise=0.05)], arm(), QUICK)
    assert full.poorly_known == ()
    slow = identify_dynamics([recorded(arm(), noise=2.0, memory=0.99)], arm(), QUICK)
    assert "Iyy elbow" in slow.poorly_known
    assert any("less precisely than the URDF" in n and "Iyy elbow" in n for n in slow.notes)
