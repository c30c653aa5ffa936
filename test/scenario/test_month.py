"""The long run of `make soak`, half an hour of it."""

import month
import pytest

from robot_energy.accounting.exact_sum import ExactSum


@pytest.fixture
def missed():
    def run(cycles):
        return [figure.what for figure in month.simulate(cycles).figures() if not figure.reached]

    return run


@pytest.mark.long
def test_half_an_hour_is_booked_to_the_microjoule(missed):
    assert missed(3) == []


@pytest.mark.long
def test_a_sum_in_floats_is_noticed(missed, monkeypatch):
    """The reference is not a copy of what it checks: a sum that rounds is found."""

    def add(self, energy, first=0):
        more = (energy.sum(axis=0) * 1e6).astype("int64")
        self._microjoule = self._microjoule.copy()
        self._microjoule[first : first + len(more)] += more

    monkeypatch.setattr(ExactSum, "add", add)
    assert "largest error" in missed(1)[0]
