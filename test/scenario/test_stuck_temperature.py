"""The virtual rig warms up while one of its thermometers hangs."""

import numpy as np
import pytest

from plants import joint_block
from robot_energy.model import load
from robot_energy.pipeline import EnergyPipeline
from robot_energy.timeline.blocks import Quality, TemperatureBlock
from robot_energy_plan.motion import random_program
from robot_energy_rig import RigConfig, VirtualRig, load_profile

PROFILE = load_profile("kr16")
PROGRAM = random_program(PROFILE.motion_limits(PROFILE.mechanics()[0]), 1)
MODEL = load("kr16")
RATE = 25.0  # Hz


def run(minutes: int, held: int | None, **shape: float) -> tuple[EnergyPipeline, np.ndarray]:
    """The pipeline behind a rig, and the last true reading; one thermometer may hang."""
    config = RigConfig(thermal_speedup=shape.pop("thermal_speedup", 1.0))
    rig = VirtualRig(PROFILE, PROGRAM, config, rate_hz=RATE, **shape)
    pipeline = EnergyPipeline(MODEL)
    first: float | None = None
    degc = np.empty((0, 6))
    for _ in range(minutes):
        output = rig.step(int(60 * RATE))
        assert output.temperatures is not None
        degc = output.temperatures.motor_temperature_degc.copy()
        if held is not None:
            first = float(degc[0, held]) if first is None else first
            said = degc.copy()
            said[:, held] = first
        else:
            said = degc
        readings = TemperatureBlock(output.temperatures.stamp_ns, said)
        pipeline.step(joint_block(output.joints), readings)
    return pipeline, degc[-1]


@pytest.mark.parametrize(("axis", "minutes"), [(0, 11), (3, 10)])
def test_a_thermometer_that_hangs_while_the_robot_warms_up_is_found(axis, minutes):
    """Within some ten minutes, that is before it is wrong by 20 K, and no other is blamed."""
    pipeline, degc = run(minutes, held=axis)
    assert np.flatnonzero(pipeline.power.watch.stuck).tolist() == [axis]
    assert pipeline.account.counts.quality[Quality.TEMPERATURE_STUCK] > 0
    assert degc[axis] - 20.0 < 20.0


def test_thermometers_that_work_are_never_blamed():
    """Warming up and then in equilibrium, with steps of 1 K: no false find in 25 minutes."""
    pipeline, degc = run(25, held=None, thermal_speedup=40.0)
    assert degc.min() > 50.0
    assert pipeline.account.counts.quality[Quality.TEMPERATURE_STUCK] == 0
