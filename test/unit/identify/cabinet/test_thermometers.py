"""What thermometers show of motors that are equally warm."""

import numpy as np
import pytest

from robot_energy_identify.cabinet.thermometers import errors_of

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
    found = errors_of(np.vstack([20.0 + ERROR, 40.0 + ERROR, warm, [np.nan, 30.0, 30.0]]))
    assert found.error == pytest.approx(ERROR)


@pytest.mark.parametrize(
    "begins",
    [
        [20.0 + ERROR],
        [20.0 + ERROR, 29.0 + ERROR],  # warm motors may differ as much at both
        [20.0 + ERROR, 40.0 + ERROR + [3.0, 0.0, -3.0]],
        [20.0 + 2.2 * ERROR, 40.0 + 2.2 * ERROR],  # 6.6 K are no thermometer
        [[np.nan] * 3, [np.nan] * 3],
    ],
)
def test_other_begins_do_not(begins):
    assert errors_of(np.array(begins)) is None
