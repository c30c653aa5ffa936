"""What the power stage asks of a condition, by one that learns nothing and changes much."""

import numpy as np
import pytest

import robots
from robot_energy.pipeline import PowerStage, Settings, TorqueStage
from robot_energy.timeline.blocks import Quality


class Doubled:
    """Friction twice that of the model from the second half on, 10 W and 5 W more losses."""

    def __init__(self, middle_ns):
        self.middle_ns, self.called, self.taken = middle_ns, [], []
        self.in_use, self.fan_odds = False, 1.0

    def measure(self, block):
        self.called.append("measure")

    def cuts(self, stamp_ns, before_ns, rising):
        assert rising
        assert before_ns <= stamp_ns[0]
        return np.flatnonzero(stamp_ns == self.middle_ns).tolist()

    def estimate(self, begin_ns, stuck, reading_degc, viscous, std, shared, quality):
        assert not stuck.any()
        self.called.append("estimate")
        self.in_use = begin_ns >= self.middle_ns
        quality |= np.uint32(Quality.TEMPERATURE_ESTIMATED)
        return np.full_like(reading_degc, 33.0), np.full_like(reading_degc, 44.0)

    def learned(self, motor_velocity, motor_temperature_degc):
        assert (motor_temperature_degc == 44.0).all()  # what friction follows
        self.called.append("learned")
        return 2.0, 10.0, 5.0

    def step(self, block, reading_degc):
        self.called.append("step")
        self.taken.append((len(block), reading_degc))

    def restart(self):
        self.called.append("restart")

    def flush(self):
        self.called.append("flush")


def test_a_stage_predicts_as_its_condition_says():
    stamp = np.arange(100) / 100
    speed = np.full((100, 1), 3.0)
    block = robots.joint_block(stamp, speed * stamp[:, None], speed, np.zeros((100, 1)))
    condition = Doubled(500_000_000)
    model, settings = robots.one_wheel(), Settings(temperature_wait=0.0)
    stage = PowerStage(model, settings, condition)
    power = stage.step(TorqueStage(model, settings).plan(block))
    assert stage.flush() is None
    # 33 W of friction, 20 W and 30 W of losses by the model: see test_energy_pipeline.py
    np.testing.assert_allclose(power.friction_power[:, 0], [33.0] * 50 + [66.0] * 50)
    np.testing.assert_allclose(power.loss_dc, [20.0] * 50 + [30.0] * 50)
    np.testing.assert_allclose(power.loss_grid, [30.0] * 50 + [35.0] * 50)
    assert power.coulomb[-1, 0] == pytest.approx(2 * power.coulomb[0, 0])
    learned = (power.quality & np.uint32(Quality.LEARNED)) > 0
    np.testing.assert_array_equal(learned, np.arange(100) >= 50)
    assert ((power.quality & np.uint32(Quality.TEMPERATURE_ESTIMATED)) > 0).all()
    assert (power.motor_temperature_degc == 33.0).all()
    assert condition.called == ["estimate", "step", "estimate", "learned", "step", "flush"]
    assert [count for count, _ in condition.taken] == [50, 50]
    assert all(np.isnan(reading).all() for _, reading in condition.taken)  # not the estimate
