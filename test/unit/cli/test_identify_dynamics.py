"""`robot-energy identify dynamics` on bags."""

import numpy as np
import pytest

from plants import LIMITS, PROGRAM, two_link_profile
from robot_energy.model import load
from robot_energy_cli import main
from robot_energy_identify.provenance import hashed
from robot_energy_plan.motion import Program
from robot_energy_rig import RigConfig, VirtualRig
from robot_energy_rig.record import record


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Two recordings of the rig without effects that no model has, and its model file."""
    folder = tmp_path_factory.mktemp("bags")
    profile = two_link_profile(folder)
    config = RigConfig.plain()
    for number in (1, 2):
        program = Program(PROGRAM.via, LIMITS, 0.1 * number)  # plain: nothing else differs
        rig = VirtualRig(profile, program, config, seed=number, start_temperature_degc=40.0)
        record(rig, 20.0, folder / f"bag_{number}")
    return folder, profile


def test_bags_become_a_model_that_loads(bags, capsys):
    folder, profile = bags
    out = folder / "identified.yaml"
    code = main(
        ["identify", "dynamics", str(folder / "bag_1"), str(folder / "bag_2"), "--model",
         str(profile.body), "--effort", "motor_torque", "--out", str(out)]
    )  # fmt: skip
    text, err = capsys.readouterr()
    assert code == 0, err
    assert "held out" in text
    assert "no longer follows the temperature" in text  # the shoulder's law of the model file
    written = load(out)
    assert written.provenance.bags == tuple(hashed(folder / name) for name in ("bag_1", "bag_2"))
    found = [joint.friction.coulomb.value for joint in written.joints]
    np.testing.assert_allclose(found, profile.coulomb, rtol=0.03)


def test_bag_without_torque_is_refused(bags, capsys):
    folder, profile = bags
    arguments = [str(folder / "bag_1"), "--model", str(profile.body), "--effort", "motor_current"]
    assert main(["identify", "dynamics", *arguments]) == 2
    assert "torque" in capsys.readouterr().err
