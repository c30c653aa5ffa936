"""Powers of the states of auxiliary loads: by their own meters, and behind one of the outlet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from places import ROOT
from robot_energy import identify_auxiliary
from robot_energy.bag import BagWriter
from robot_energy.bag.cdr import Encoder
from robot_energy.foundation.errors import NotIdentifiableError
from robot_energy.model import load
from robot_energy.model.auxiliary import AuxiliaryLoad
from robot_energy.timeline.blocks import NANOSECOND
from robot_energy_cli.main import main
from robot_energy_identify.auxiliary import StateReadings, fit_own
from robot_energy_plan.motion import Program
from robot_energy_rig import VirtualRig, load_profile
from robot_energy_rig.record import (
    EXTRUDER_HEATS,
    EXTRUDER_OFF,
    EXTRUDER_WORKS,
    PUMP_OFF,
    PUMP_ON,
    STATE,
    RigEncoder,
    record,
)
from robot_energy_rig.record import TYPES as TOPICS

CELL = ROOT / "src/examples/auxiliary/mantis_cell.yaml"
TRUTH = {
    ("pump", "off"): PUMP_OFF,
    ("pump", "on"): PUMP_ON,
    ("extruder", "off"): EXTRUDER_OFF,
    ("extruder", "heats"): EXTRUDER_HEATS,
    ("extruder", "works"): EXTRUDER_WORKS,
}
LAMP, FAN = (3.0, 60.0, 150.0), (0.0, 40.0)  # W, of their states


def standing(seed):
    """A rig that stands still all the time, with active drives."""
    profile = load_profile("mantis")
    program = Program([[0.0, 0.0, 0.0]], profile.motion_limits(profile.mechanics()[0]), 5.0)
    return VirtualRig(profile, program, None, seed)


@pytest.fixture(scope="module")
def cells(tmp_path_factory):
    """Two recordings of pump and extruder."""
    folder = tmp_path_factory.mktemp("cells")
    rigs = [standing(seed) for seed in (1, 2)]
    return [
        record(rig, 50.0, folder / f"cell{n}", auxiliary=True).path for n, rig in enumerate(rigs)
    ]


def test_own_meters_give_the_powers_of_the_rig_with_intervals(cells):
    """Meters of class 0.5, said to be of class 0.5: every 95 % interval holds the truth."""
    found = identify_auxiliary(cells, str(CELL))
    states = {(s.load, s.state): s for fit in found.found.fits for s in fit.states}
    assert states.keys() == TRUTH.keys()
    for key, power in TRUTH.items():
        one = states[key]
        assert abs(one.power - power) < 1.96 * one.std, key
        assert one.std < 0.02 * power + 0.3, key
        assert one.visits >= 2
    for fit in found.found.fits:
        assert fit.used
        assert fit.held_out.what == "recordings"
        assert fit.held_out.rms < fit.held_out.rms_before
        assert abs(fit.held_out.energy_error) < 0.01


def test_the_model_file_has_them_with_tag_and_deviation(cells, tmp_path, capsys):
    out = tmp_path / "identified.yaml"
    names = [str(path) for path in cells]
    assert main(["identify", "auxiliary", *names, "--model", str(CELL), "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "Power of each state" in shown
    model = load(str(out))
    pump, _, panel = model.auxiliary
    assert pump.states["on"].tag == "identified"
    assert pump.states["on"].std > 0
    assert pump.states["on"].source == "cell0, cell1"
    assert panel == load(str(CELL)).auxiliary[2]  # nothing measures the panel
    assert model.changed(auxiliary=None).model_id == load(str(CELL)).changed(
        auxiliary=None, provenance=model.provenance
    ).model_id  # fmt: skip


def outlet_bag(path, seed, alone=True, seconds=45.0):
    """A standing robot; lamp and fan switch, and the meter of the outlet sees them all."""
    rig = standing(seed)
    encoder, state = RigEncoder(rig.joint_names), Encoder(STATE)
    begin = rig.stamp_ns
    output = rig.step(round(seconds / rig.period))
    generator = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 1e-3)
    slot = (time // 3.0).astype(int)  # every 3 s somebody switches
    lamp = generator.integers(0, 3, slot.max() + 1)
    lamp[:3] = 0, 1, 2
    fan = generator.integers(0, 2, slot.max() + 1) if alone else (lamp > 0).astype(int)
    power = np.array(LAMP)[lamp[slot]] + np.array(FAN)[fan[slot]]
    energy = np.concatenate([[0.0], np.cumsum(power * 1e-3)])
    meter = output.meter
    until = (meter.stamp_ns - begin) * NANOSECOND
    at = np.arange(len(energy)) * 1e-3
    used = np.interp(until, at, energy) - np.interp(until - meter.interval, at, energy)
    meter = replace(meter, power=meter.power + used / meter.interval)
    blocks = {
        "/joint_states": (output.joints.stamp_ns, encoder.joint_states(output.joints)),
        "/motor_temperatures": (
            output.temperatures.stamp_ns, encoder.temperatures(output.temperatures),
        ),
        "/power_meter": (meter.stamp_ns, encoder.meter(meter)),
    }  # fmt: skip
    switched = begin + np.arange(len(lamp)) * 3_000_000_000
    for name, numbers in (("lamp", lamp), ("fan", fan)):
        rows = state.encode({"data": numbers.astype(np.uint8)}, len(numbers))
        blocks[f"/auxiliary/{name}/state"] = switched, rows
    with BagWriter(path) as bag:
        for topic, (stamp, rows) in blocks.items():
            bag.add_topic(topic, TOPICS.get(topic, STATE))
            bag.write(topic, stamp, rows)
    return path


def cell_of_lamp_and_fan():
    def entry(name, powers):
        figures = {f"s{n}": {"value": p, "tag": "assumed"} for n, p in enumerate(powers)}
        return AuxiliaryLoad.model_validate({"name": name, "states": figures})

    loads = entry("lamp", (LAMP[0], 100.0, 100.0)), entry("fan", (FAN[0], 100.0))
    return load("mantis").changed(auxiliary=loads)


def test_a_meter_of_the_outlet_shows_differences_while_the_robot_stands(tmp_path):
    bags = [outlet_bag(tmp_path / f"bag{seed}", seed) for seed in (3, 4)]
    found = identify_auxiliary(bags, cell_of_lamp_and_fan(), outlet_meter=True)
    (fit,) = found.found.fits
    states = {(one.load, one.state): one for one in fit.states}
    assert len(states) == 3
    for key, power in {("lamp", "s1"): 60.0, ("lamp", "s2"): 150.0, ("fan", "s1"): 40.0}.items():
        one = states[key]
        assert abs(one.power - power) < max(1.96 * one.std, 0.5), key
        assert one.std < 5.0
    assert fit.used
    assert fit.held_out.rms < 0.2 * fit.held_out.rms_before
    lamp, _ = found.model.auxiliary
    assert lamp.states["s0"].tag == "assumed"
    assert lamp.states["s2"].tag == "identified"
    assert any("differences alone" in note for note in fit.notes)


def test_loads_that_switch_together_are_refused(tmp_path):
    bag = outlet_bag(tmp_path / "bag", 5, alone=False)
    model = cell_of_lamp_and_fan()
    lamp = model.auxiliary[0].model_copy(
        update={"states": {k: model.auxiliary[0].states[k] for k in ("s0", "s1", "s2")}}
    )
    model = model.changed(auxiliary=(lamp, model.auxiliary[1]))
    with pytest.raises(NotIdentifiableError, match="do not distinguish"):
        identify_auxiliary(bag, model, outlet_meter=True)


def test_what_is_missing_is_named(cells):
    with pytest.raises(NotIdentifiableError, match="no auxiliary load"):
        identify_auxiliary(cells, "mantis")
    with pytest.raises(NotIdentifiableError, match="State --outlet-meter"):
        identify_auxiliary(cells, cell_of_lamp_and_fan())


def test_intervals_hold_the_truth_as_often_as_they_say():
    """150 loads drawn at random: gain within the class of the meter, scatter of every visit."""
    generator = np.random.default_rng(7)
    figures = {"on": {"value": 1.0, "tag": "assumed"}}
    entry = AuxiliaryLoad.model_validate({"name": "oven", "states": figures})
    inside = 0
    for _ in range(150):
        visit = np.repeat(np.arange(10), 20)
        gain = 1.0 + generator.uniform(-0.01, 0.01)
        scatter = generator.normal(0.0, 5.0, 10)[visit] + generator.normal(0.0, 3.0, len(visit))
        power = gain * (500.0 + scatter)
        zeros = np.zeros((len(visit), 1), dtype=np.int64)
        part = StateReadings(power, np.ones(len(visit)), zeros, visit, power)
        (one,) = fit_own(entry, [part], 0.01 / np.sqrt(3.0)).states
        inside += abs(one.power - 500.0) < 1.96 * one.std
    assert 0.91 <= inside / 150 <= 0.99
