"""Loads outside of the cabinet on the page and in its metrics."""

import math

import pytest

from page_messages import recorded
from robot_energy.model.auxiliary import AuxiliaryLoad
from robot_energy_report.page.metrics import metrics_text


def entry(name, **states):
    figures = {key: {"value": value, "tag": "assumed"} for key, value in states.items()}
    return AuxiliaryLoad.model_validate({"name": name, "states": figures})


@pytest.fixture(scope="module")
def page():
    """A panel of 35 W, and a lamp whose state nobody says."""
    found, result = recorded(auxiliary=(entry("panel", on=35.0), entry("lamp", off=1.0, on=9.0)))
    return found, result


def test_rows_have_state_power_and_energy(page):
    robot = page[0].hub.state(0.0)["robots"][0]
    panel, lamp = robot["auxiliary"]
    seconds = robot["registers"]["observed_time"]
    assert (panel["name"], panel["state"], panel["power"]) == ("panel", "on", 35.0)
    assert panel["energy"] == pytest.approx(35.0 * seconds, rel=1e-4)
    assert (lamp["state"], lamp["power"], lamp["known_time"]) == (None, None, 0.0)
    assert lamp["missing_time"] == pytest.approx(seconds, rel=1e-4)
    assert robot["outlet_power"] is None
    alarms = [one for one in robot["alarms"] if one["name"] == "lamp"]
    assert [one["message"] for one in alarms] == ["its state is not known"]


def test_both_pictures_show_what_is_known(page):
    robot = page[0].hub.state(0.0)["robots"][0]
    for name in ("flow", "energy_flow"):
        labels = robot[name]["labels"].values()
        assert "panel" in labels, name
        assert "Outlet" in labels, name
        assert not any("lamp" in label for label in labels), name


def test_metrics_have_a_label_for_each_load(page):
    text = metrics_text(page[0].hub, 0.0).decode()
    lines = {line.rpartition(" ")[0]: line.rpartition(" ")[2] for line in text.splitlines()}
    robot = page[0].hub.state(0.0)["robots"][0]["name"]

    def value(name, load):
        return float(lines[f'{name}{{load="{load}",robot="{robot}"}}'])

    assert value("robot_auxiliary_power_watts", "panel") == 35.0
    assert math.isnan(value("robot_auxiliary_power_watts", "lamp"))
    assert value("robot_auxiliary_missing_seconds_total", "lamp") > 1.0
