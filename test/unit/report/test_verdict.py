"""What a report says of a test: by the meter, by torque without one, or not at all."""

import numpy as np
import pytest

from robot_energy_identify.stats import held_out_energy as parts
from robot_energy_report.formats import grouped
from robot_energy_report.held_out import not_judged, verdict

NONE = np.empty((0, 1))


def without_meter(new: float, shaft: float = 10.0) -> parts.HeldOutEnergy:
    nan = float("nan")
    predictions = {
        stage: parts.HeldOutPrediction((), 0.0, nan, 9.0, error, NONE)
        for stage, error in (("given", 0.3), ("friction", new))
    }
    entry = parts.Tested(
        "bag", 0.0, nan, shaft, shaft, predictions, 0, None, NONE[:, 0], NONE, (), 0.0
    )
    return parts.HeldOutEnergy("test", ("given", "friction"), (entry,))


def test_no_test_is_said_as_asked():
    text, better = verdict(None)
    assert "--no-test" in text
    assert "meter" not in text
    assert not better


@pytest.mark.parametrize(("new", "better"), [(0.1, True), (0.4, False)])
def test_without_a_meter_the_torque_decides(new, better):
    text, said = verdict(without_meter(new))
    assert said is better
    assert f"30.0 % as given, {100 * new:.1f} % new" in text
    assert ("not better" in text) is not better


def test_without_meter_and_torque_nothing_is_claimed():
    text, better = verdict(without_meter(0.1, shaft=float("nan")))
    assert "record the meter's topic" in text
    assert not better


def at_a_meter(**joints: parts.OutsideFit | None) -> parts.HeldOutEnergy:
    """Recordings on which the new model reads 30 % low, and 1 % where it knows the temperature."""
    tested = []
    for name, outside in joints.items():
        new = 700.0 if outside else 990.0
        predictions = {
            stage: parts.HeldOutPrediction((), energy, abs(energy - 1000.0), 9.0, 0.1, NONE)
            for stage, energy in (("given", 950.0), ("friction", new))
        }
        beyond = 20.0 if outside else 0.0
        row = (name, 10.0, 1000.0, 10.0, 10.0, predictions, 0, None, NONE[:, 0], NONE, (), beyond)
        tested.append(parts.Tested(*row, outside))
    return parts.HeldOutEnergy("recordings", ("given", "friction"), tuple(tested))


COLD = parts.OutsideFit("a1", (18.0, 25.0), (41.0, 64.0))


def test_outside_the_fit_nothing_is_judged():
    test = at_a_meter(cold=COLD)
    text, better = verdict(test)
    assert not better
    assert "not judged" in text
    assert "%" not in text
    assert "cold (a1 at 18 to 25 degC, its fit at 41 to 64 degC)" in not_judged(test)


def test_recordings_outside_the_fit_change_no_verdict():
    text, better = verdict(at_a_meter(cold=COLD, warm=None))
    assert better
    assert "5.0 % as given, 1.0 % new" in text
    assert "30.0 %" not in text
    assert not_judged(at_a_meter(warm=None)) == ""


def test_notes_of_several_axes_become_one():
    notes = ["a1: too slow", "a2: too slow", "a2: at the bound", "no meter"]
    assert grouped(notes) == ["a1, a2: too slow", "a2: at the bound", "no meter"]
