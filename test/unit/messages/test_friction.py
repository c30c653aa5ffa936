"""Friction messages: what is sent next to the coefficients."""

from __future__ import annotations

import numpy as np

from robot_energy.bag.cdr.decode import Decoder, RawBatch
from robot_energy.messages.friction import ARRAYS, JOINT_FRICTION, FrictionReader, FrictionWriter
from robot_energy.model import RobotModel, load
from robot_energy.pipeline import FrictionStage
from robot_energy.timeline.blocks import TemperatureBlock

MEASURED = 0  # joint with a temperature; all others have none


def model() -> RobotModel:
    """The KR 16 class with a deviation of 1 % of the hot friction on every axis."""
    model = load("kr16")
    joints = []
    for joint in model.joints:
        law = joint.friction.viscous
        law = law.model_copy(update={"std": 0.01 * law.a.value})
        friction = joint.friction.model_copy(update={"viscous": law})
        joints.append(joint.model_copy(update={"friction": friction}))
    return model.model_copy(update={"joints": joints}).with_urdf(model.urdf_xml, model.source)


def test_a_motor_outside_its_law_is_named_with_temperature_and_range() -> None:
    known = model()
    stage = FrictionStage(known)
    values = np.full((1, len(known.joints)), 45.0)
    values[0, MEASURED] = 91.26
    stage.step(TemperatureBlock(np.array([10**18]), values))
    assert stage.outside() == {"joint_a1": "91.3 degC, fitted from 20 to 80 degC"}


def test_an_axis_without_temperature_has_the_wider_deviation() -> None:
    known = model()
    stage = FrictionStage(known)
    values = np.full((1, len(known.joints)), np.nan)
    values[0, MEASURED] = 45.0
    sent = stage.step(TemperatureBlock(np.array([10**18]), values))
    assert sent is not None
    rows = [row.tobytes() for row in FrictionWriter(known).encode(sent)]
    batch = RawBatch.from_messages("/f", JOINT_FRICTION, sent.stamp_ns, rows)
    (run,) = Decoder(JOINT_FRICTION, ("viscous_std", "viscous_fallback_std")).decode(batch).runs
    std, fallback = run.array("viscous_std")[0], run.array("viscous_fallback_std")[0]
    law = known.joints[MEASURED].friction.viscous
    assert std[MEASURED] == 0.01 * law.a.value
    others = np.arange(len(std)) != MEASURED
    np.testing.assert_array_equal(std[others], fallback[others])
    assert (
        fallback > 10 * np.array([0.01 * j.friction.viscous.a.value for j in known.joints])
    ).all()
    found = FrictionReader(known).decode(batch)
    assert found is not None
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(found, name), getattr(sent, name))
