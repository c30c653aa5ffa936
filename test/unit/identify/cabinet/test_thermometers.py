"""What thermometers show of motors that are equally warm."""

from types import SimpleNamespace

import numpy as np
import pytest

from robot_energy_identify.cabinet.thermometers import errors_of, thermometers_of

ERROR = np.array([-1.0, 3.0, -2.0])


def test_begins_of_a_robot_that_had_rested_show_what_thermometers_are_off():
    found = errors_of(np.array([20.0, 40.0, 20.5])[:, None] + ERROR)
    assert found.error == pytest.approx(ERROR)
    assert found.std == pytest.approx(0.3 / np.sqrt(3.0))
    whole = errors_of(np.array([[19.0, 24.0, 18.0], [39.0, 43.0, 38.0]]))
    assert whole.error == pytest.approx([-1.17, 3.33, -2.17], abs=0.01)
    assert whole.std == pytest.approx(np.sqrt(2 * (1 + 4 + 1) / 36 / 2 / 2))


def test_a_begin_with_motors_warm_from_work_is_left_out():
    warm = 40.0 + ERROR + [3.0, 0.0, -3.0]
    found = errors_of(np.vstack([20.0 + ERROR, 40.0 + ERROR, warm]))
    assert found.error == pytest.approx(ERROR)


@pytest.mark.parametrize(
    "begins",
    [
        [20.0 + ERROR],
        [20.0 + ERROR, 29.0 + ERROR],  # warm motors may differ as much at both
        [20.0 + ERROR, 40.0 + ERROR + [3.0, 0.0, -3.0]],
        [20.0 + 2.2 * ERROR, 40.0 + 2.2 * ERROR],  # 6.6 K are no thermometer
    ],
)
def test_other_begins_do_not(begins):
    assert errors_of(np.array(begins)) is None


def test_the_first_ten_seconds_of_a_recording_count_once_they_are_read():
    """A sample every second; a motor is unknown for two, and warms up after ten."""

    def part(path, degc, unknown=0.0):
        second = np.arange(20)
        readings = degc + ERROR + np.where(second < 10, 0.0, 9.0)[:, None] * [1.0, 0.0, 0.0]
        readings[second < 2, 1] += unknown
        power = SimpleNamespace(stamp_ns=second * 10**9, motor_temperature_degc=readings)
        return SimpleNamespace(path=path, power=power)

    cold, warm = part("a", 20.0, np.nan), part("b", 40.0)
    later = part("a", 60.0 + 3.0 * ERROR)  # of a recording that began before
    assert thermometers_of([cold, later, warm]).error == pytest.approx(ERROR)
    assert thermometers_of([cold, later]) is None
    assert thermometers_of([part("a", np.nan), part("b", np.nan)]) is None
    assert thermometers_of([]) is None
