"""The study of advice: the rig applies an advice, and counts are of claims."""

import advice_study
import numpy as np
import pytest
from advice_study import AdvisedPlant, JudgedAdvice, count

from robot_energy_fleet.advice.claims import Claim


def test_the_rig_applies_what_was_advised(tmp_path, monkeypatch):
    monkeypatch.setattr(advice_study, "PERIODS", 1)
    monkeypatch.setattr(advice_study, "MOVES", 3)
    plant = AdvisedPlant(tmp_path, 100)
    places = plant.program.via
    claims = [
        Claim("regenerative", 1.0, np.array([1.0]), "assumed", "", ""),
        waiting(places[1], places),
    ]
    supply, pose = plant.judge([(one, True) for one in claims])
    assert 0.0 <= supply.truth < 0.1 * supply.energy
    (there,) = plant.judge([(waiting(places[2], places), True)])
    # moving the wait from one place to the other saves what the way back costs
    dwell = plant.program.dwell[1:].sum()
    assert pose.truth != pytest.approx(there.truth)
    assert abs(pose.truth - there.truth) < dwell * 1000.0


def waiting(place, places):
    """To wait at one of the places that the meter has seen."""
    one = np.array([1.0])
    return Claim("waiting_pose", 1.0, one, "measured", "", "", joint_position=place, places=places)


def test_only_claims_are_counted_as_right_or_wrong():
    rows = [
        JudgedAdvice(1, "standby", True, 10.0, 2.0, 9.0, 100.0),
        JudgedAdvice(2, "standby", True, 10.0, 2.0, -9.0, 100.0),
        JudgedAdvice(3, "standby", True, 1.0, 2.0, -0.5, 100.0),
    ]
    (line,) = count(rows)
    assert "with a meter: 2 of 3 claimed, 1 of these with the right sign; 2 of 3 bands" in line
