"""What motors hold at rest, found in measured torque of the virtual rig."""

import numpy as np
import pytest

import robots
from plants import LIMITS, PROGRAM, two_link_profile
from robot_energy.model.schema import Hold
from robot_energy.timeline.blocks import EffortMeaning
from robot_energy_identify.data.recordings import read_recording
from robot_energy_identify.friction.friction import fit_axes, with_friction
from robot_energy_identify.friction.hold import fit_hold
from robot_energy_identify.friction.samples import friction_data
from robot_energy_plan.motion import Program
from robot_energy_report.identify_all import changes
from robot_energy_rig import RigConfig, VirtualRig
from robot_energy_rig.record import record

MODEL = robots.two_link()
RESTING = Program(PROGRAM.via, LIMITS, dwell=1.0)
NOISE = ("velocity_noise", "torque_noise")


@pytest.mark.parametrize(
    ("effects", "kept", "carried"),
    [((), 0.0, 0.0), (("presliding",), 1.0, 0.0), (("presliding", "creep"), 0.1, 0.9)],
)
def test_a_spring_keeps_the_torque_of_the_motion_until_it_carries_the_load(
    tmp_path, effects, kept, carried
):
    profile = two_link_profile(tmp_path)
    config = RigConfig.plain().having(*NOISE, *effects)
    rig = VirtualRig(profile, RESTING, config, 3, 30.0, 30.0)
    bag = record(rig, 120.0, tmp_path / "bag")
    recording = read_recording(bag.path, MODEL, EffortMeaning.MOTOR_TORQUE)
    fits, _ = fit_axes([friction_data([recording], joint) for joint in (0, 1)])
    model = with_friction(MODEL, fits, "bag")
    found = fit_hold([recording], model)
    assert found is not None
    assert found.kept[0] == pytest.approx(kept, abs=0.2)
    assert found.carried[0] == pytest.approx(carried, abs=0.2)
    assert found.std < 0.2
    assert (found.load_std > 0.5) == bool(effects)
    written = found.write(model, "bag")
    assert written.hold is not None
    assert written.hold.kept.value == pytest.approx(min(found.kept[0], 1.0))


def test_too_few_rests_show_nothing(tmp_path):
    profile = two_link_profile(tmp_path)
    rig = VirtualRig(profile, RESTING, RigConfig.plain(), 3, 30.0, 30.0)
    bag = record(rig, 10.0, tmp_path / "bag")
    recording = read_recording(bag.path, MODEL, EffortMeaning.MOTOR_TORQUE)
    assert fit_hold([recording], MODEL) is None


def test_static_friction_of_a_joint_is_more_than_its_coulomb_torque(tmp_path):
    profile = two_link_profile(tmp_path, stribeck=[0.012, 0.0])
    config = RigConfig.plain().having(*NOISE, "presliding", "stribeck")
    bag = record(VirtualRig(profile, RESTING, config, 3, 30.0, 30.0), 120.0, tmp_path / "bag")
    recording = read_recording(bag.path, MODEL, EffortMeaning.MOTOR_TORQUE)
    fits, _ = fit_axes([friction_data([recording], joint) for joint in (0, 1)])
    model = with_friction(MODEL, fits, "bag")
    found = fit_hold([recording], model)
    assert found is not None
    assert found.static is not None
    coulomb = [joint.friction.coulomb.value for joint in model.joints]
    static = np.array(found.static) * coulomb * found.kept[0]
    assert static == pytest.approx([0.02 + 0.012, 0.01], rel=0.05)
    assert found.std < 0.15
    written = found.write(model, "bag")
    assert found.write(written, "bag") == written
    assert fit_hold([recording], written) == found  # whatever was found before


def test_changes_of_the_model_name_the_static_friction_of_each_joint():
    given = robots.two_link()
    shares = {"kept": robots.figure(0.4), "carried": robots.figure(0.1), "std": 0.1}
    alike = given.changed(hold=Hold(**shares))
    apart = given.changed(hold=Hold(**shares, static=(1.5, 0.5)))
    kept, carried, *rows = changes(given, apart)
    assert kept.unit == carried.unit == "of static friction"
    assert [(one.name, one.unit, one.before, one.after.value) for one in rows] == [
        (f"{name} static friction", "of Coulomb", None, value)
        for name, value in zip(given.joint_names, (1.5, 0.5), strict=True)
    ]
    assert len(changes(given, alike)) == 2
    assert [one.name for one in changes(alike, apart)] == [one.name for one in rows]
