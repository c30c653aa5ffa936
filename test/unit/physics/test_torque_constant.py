"""Warm magnets by hand: half of a torque constant is left at 120 degC."""

import numpy as np
import pytest

from robot_energy.foundation.errors import ModelFileError
from robot_energy.model import validate
from robot_energy.physics.drives_and_cabinet import drive_from_model
from robot_energy.physics.torque_constant import TorqueConstants
from robot_energy.pipeline import EnergyPipeline, Settings
from robot_energy.timeline.blocks import EffortMeaning, PowerBlock
from robots import figure
from warm_wheel import readings, turning, wheel

FALL = 0.005  # 1/K
COPPER = 3.0
HOT = 120.0  # degC
EFFORT = 7.0


def model(fall: float | None = FALL, kind: str = "loss_model"):
    data = wheel(gear=False).model_dump(mode="json", exclude_none=True)
    if fall is not None:
        data["joints"][0]["torque_constant_fall"] = figure(fall)
    data["joints"][0]["losses"] = {
        **{name: figure(0.0) for name in ("constant", "linear", "quadratic")},
        "copper": figure(COPPER),
        "copper_temperature_coefficient": figure(0.004),
    }
    data["joints"][0]["loss_map"] = {
        "motor_velocity": [0.0, 100.0], "motor_torque": [0.0, 1.0, 100.0],
        "loss": [[0.0, 2.0, 200.0]] * 2, "tag": "assumed",
        "copper_temperature_coefficient": figure(0.0),
    }  # fmt: skip
    return validate(data | {"drive": kind}, "")


def test_what_is_left_of_a_torque_constant():
    """The temperature that is not known is taken for 40 degC, as that of the windings."""
    constants = TorqueConstants.of(model())
    assert constants is not None
    left = constants.left(np.array([[20.0], [HOT], [np.nan]]))
    np.testing.assert_allclose(left, [[1.0], [0.5], [0.9]], rtol=1e-15)
    assert TorqueConstants.of(model(None)) is None


def test_windings_are_heated_by_the_torque_that_the_current_would_make_if_magnets_were_cold():
    given = [np.array([[value]]) for value in (-4.0, 10.0, 2.0, HOT)]
    # 2 N m take the current of 4: 3 (1 + 0.004 * 100) 16
    power, _ = drive_from_model(model()).input_power(*given)
    assert power[0, 0] == pytest.approx(-4.0 + 67.2, rel=1e-14)
    cold, _ = drive_from_model(model(None)).input_power(*given)
    assert cold[0, 0] == pytest.approx(-4.0 + 16.8, rel=1e-14)
    by_map, _ = drive_from_model(model(kind="loss_map")).input_power(*given)
    assert by_map[0, 0] == pytest.approx(-4.0 + 8.0, rel=1e-14)


def measured_at(degc, meaning, own):
    pipeline = EnergyPipeline(own, Settings(effort=meaning))
    block = turning(3.0, effort=np.full(6, EFFORT))
    parts = [pipeline.step(block, readings(3, degc)).power, pipeline.flush().power]
    return PowerBlock.concatenate([part for part in parts if part is not None])


def test_a_torque_known_by_its_current_is_that_of_the_shaft():
    warm = measured_at(HOT, EffortMeaning.MOTOR_TORQUE, model())
    np.testing.assert_allclose(warm.motor_torque_measured, 0.5 * EFFORT, rtol=1e-15)
    np.testing.assert_allclose(
        warm.shaft_power_measured, 0.5 * EFFORT * warm.motor_velocity, rtol=1e-15
    )
    cold = measured_at(20.0, EffortMeaning.MOTOR_TORQUE, model())
    np.testing.assert_array_equal(cold.motor_torque_measured, EFFORT)


def test_a_torque_sensor_knows_no_magnets():
    meaning = EffortMeaning.JOINT_TORQUE
    found, plain = (measured_at(HOT, meaning, one) for one in (model(), model(None)))
    np.testing.assert_array_equal(found.motor_torque_measured, plain.motor_torque_measured)


def test_a_fall_of_0_changes_nothing_to_the_bit():
    none, absent = (
        measured_at(HOT, EffortMeaning.MOTOR_TORQUE, model(fall)) for fall in (0.0, None)
    )
    for name in ("motor_torque_measured", "drive_loss", "grid_power"):
        np.testing.assert_array_equal(getattr(none, name), getattr(absent, name))


def test_a_fall_beyond_that_of_any_magnet_is_refused():
    with pytest.raises(ModelFileError, match="torque_constant_fall"):
        model(0.0051)


def test_a_model_without_it_keeps_its_identity():
    assert model(None).model_id == validate(model(None).model_dump(mode="json"), "").model_id
    assert model().model_id != model(None).model_id
