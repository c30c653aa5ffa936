"""Robots on one DC bus, against energies solved by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_energy.foundation.errors import MotionError
from robot_energy.model.schema import Cabinet
from robot_energy_plan.shared_bus import exchange, shared_cabinet
from robots import figure

POWER, LOSS, HALF = 1000.0, 150.0, 2.0  # W, W, s
LINK = {
    "capacitance": figure(2e-3),
    "nominal_voltage": figure(560.0),
    "chopper_voltage": figure(700.0),
}  # swing 0.5 * 2e-3 * (490000 - 313600) = 176.4 J


def cabinet(**extra):
    return Cabinet.model_validate({"loss_grid": figure(0.0), "loss_dc": figure(LOSS), **extra})


def opposite():
    """Square powers in opposite phase, one period; edges last 1 ns."""
    edge = round(HALF * 1e9)
    stamp = np.array([0, edge, edge + 1, 2 * edge])
    square = POWER * np.array([1.0, 1.0, -1.0, -1.0])
    return stamp, np.stack([square, -square])


def test_square_powers_in_opposite_phase():
    stamp, power = opposite()
    found = exchange(stamp, power, [cabinet(), cabinet()])
    # apart: each draws P + L for half the period and brakes P - L for the other half
    apart = [found.grid_energy(one) for one in found.own]
    assert apart == pytest.approx([(POWER + LOSS) * HALF] * 2, rel=1e-6)
    assert found.brake_energy(found.own[0]) == pytest.approx((POWER - LOSS) * HALF, rel=1e-6)
    # on one bus the powers cancel: only the losses of both are drawn, all the time
    assert found.grid_energy(found.shared) == pytest.approx(2 * LOSS * 2 * HALF, rel=1e-6)
    assert found.brake_energy(found.shared) == 0.0
    assert found.saved == pytest.approx(2 * (POWER - LOSS) * HALF, rel=1e-6)
    assert found.peak_power([found.shared]) == pytest.approx(2 * LOSS)
    assert found.duration == pytest.approx(2 * HALF)


def test_with_less_room_in_the_capacitors_less_is_saved():
    """Of ``2 S`` that both links of two alike robots give back, four fifths are left."""
    stamp = np.arange(4001) * 1_000_000
    square = POWER * np.where(stamp < 2e9, -1.0, 1.0)
    found = exchange(stamp, np.stack([square, square]), [cabinet(capacitor=LINK)] * 2)
    assert found.saved == pytest.approx(0.0, abs=1e-3)
    assert found.for_want_of_room == pytest.approx(0.2 * 2 * 176.4, rel=0.01)
    assert exchange(*opposite(), [cabinet()] * 2).for_want_of_room == 0.0


def test_robots_in_phase_save_nothing_without_a_capacitor():
    stamp, power = opposite()
    found = exchange(stamp, np.stack([power[0], power[0]]), [cabinet(), cabinet()])
    assert found.saved == pytest.approx(0.0, abs=1e-6)
    assert found.brake_energy(found.shared) == pytest.approx(2 * (POWER - LOSS) * HALF, rel=1e-6)


def test_capacitors_are_in_parallel_between_the_common_voltages():
    low = LINK | {"nominal_voltage": figure(570.0), "chopper_voltage": figure(680.0)}
    found = shared_cabinet([cabinet(capacitor=LINK), cabinet(capacitor=low), cabinet()])
    # the higher rectified voltage, the lower chopper, both capacitors
    assert found.capacitor.swing == pytest.approx(0.5 * 4e-3 * (680.0**2 - 570.0**2))
    assert found.loss_dc.value == 3 * LOSS
    with pytest.raises(MotionError, match="another chopper starts at 52 V"):
        shared_cabinet(
            [
                cabinet(capacitor=LINK),
                cabinet(
                    capacitor=LINK
                    | {"nominal_voltage": figure(48.0), "chopper_voltage": figure(52.0)}
                ),
            ]
        )


def test_the_capacitor_of_one_serves_the_other():
    """A robot without a capacitor brakes 500 J, of which the other's capacitor keeps 176.4 J."""
    time = np.linspace(0.0, 2.0, 2001)
    brakes = np.where(time <= 1.0, -LOSS - 500.0, -LOSS)
    rests = np.full_like(time, -LOSS)
    found = exchange(
        np.rint(time * 1e9).astype(np.int64),
        np.stack([brakes, rests]),
        [cabinet(), cabinet(capacitor=LINK)],
    )
    apart = sum(map(found.brake_energy, found.own))
    assert apart == pytest.approx(500.0, rel=1e-3)
    assert apart - found.brake_energy(found.shared) == pytest.approx(176.4, rel=1e-3)


def test_what_is_not_known_of_one_robot_counts_for_none():
    power = np.array([[100.0, np.nan, 100.0, 100.0], [200.0] * 4])
    found = exchange(np.arange(4) * 10**9, power, [cabinet(), cabinet(capacitor=LINK)])
    assert np.isnan(found.own[1].capacitor_power[1] + found.own[1].grid_power[1])
    assert found.duration == 1.0
    assert found.grid_energy(found.own[1]) == pytest.approx(200.0 + LOSS)


def test_a_regenerative_supply_returns_what_the_bus_does_not_use():
    stamp, power = opposite()
    robots = [cabinet(regeneration_efficiency=figure(0.8)), cabinet()]
    found = exchange(stamp, power, robots)
    assert found.brake_energy(found.own[0]) == 0.0
    assert found.saved == pytest.approx((1 + 0.2) * (POWER - LOSS) * HALF, rel=1e-6)
    together = exchange(stamp, np.stack([power[0], power[0]]), robots)  # it takes what both brake
    assert together.saved == pytest.approx(0.8 * (POWER - LOSS) * HALF, rel=1e-6)


@given(st.lists(st.lists(st.floats(-1e4, 1e4), min_size=5, max_size=5), min_size=2, max_size=4))
def test_one_bus_never_needs_more_and_every_balance_closes(powers):
    stamp, power = np.arange(5) * 10**8, np.array(powers)
    cabinets = [cabinet(capacitor=LINK)] * len(powers)
    found = exchange(stamp, power, cabinets)
    assert exchange(stamp, power, [cabinet()] * len(powers)).saved >= -1e-6
    flows = found.shared
    left = flows.grid_power - flows.brake_power - flows.capacitor_power - flows.loss_dc
    np.testing.assert_allclose(left, power.sum(axis=0), atol=1e-7)
