"""What identification writes of the response of a meter, and which models keep their identity."""

from __future__ import annotations

import pytest

from robot_energy.accounting.meter_response import MeterResponse
from robot_energy.model.load import load, save
from robot_energy_identify.drives.delays import with_response
from robot_energy_identify.stats.lag import Delay
from robot_energy_report.identify_all import changes
from robots import one_wheel


def found(value: float, sure: bool = True) -> Delay:
    return Delay(value, 0.006, 0.9, value if sure else 0.0, False, 1.0)


def test_what_is_sure_is_written_and_read_again(tmp_path):
    given = one_wheel()
    model = with_response(given, found(0.275), found(0.04), "three bags")
    save(model, tmp_path / "model.yaml")
    again = load(tmp_path / "model.yaml")
    assert MeterResponse.of(again) == MeterResponse(0.275, 0.04, stated=True)
    assert again.meter.time_constant.tag == "identified"
    assert again.meter.time_constant.std == pytest.approx(0.006)
    assert [one.name for one in changes(given, again)] == [
        "low pass of the meter", "delay of the meter",
    ]  # fmt: skip
    assert again.model_id != given.model_id


@pytest.mark.parametrize(
    ("low_pass", "delay"), [(None, None), (found(0.2, sure=False), None), (None, found(-0.03))]
)
def test_a_model_without_a_sure_response_keeps_its_identity(low_pass, delay):
    given = one_wheel()
    assert with_response(given, low_pass, delay, "bags") is given
    assert MeterResponse.of(given) is None


def test_a_delay_alone_leaves_the_low_pass_absent():
    model = with_response(one_wheel(), found(0.3, sure=False), found(0.04), "bags")
    assert model.meter.time_constant is None
    assert MeterResponse.of(model) == MeterResponse(0.0, 0.04, stated=True)
