"""Thermal networks recovered from heat and temperature that were integrated here."""

import json
import os
from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from logbook import mapping, write_csv
from places import ROOT
from robot_energy.foundation.errors import LogFormatError, NotIdentifiableError
from robot_energy_cli.identify_inputs import IdentifyInputs
from robot_energy_cli.main import main
from robot_energy_identify.thermal.network import (
    WINDOW,
    ThermalRun,
    fit_network,
    fit_networks,
    runs_of_log,
    runs_of_recordings,
)
from robot_energy_logs.log_import import open_logs

DATA = os.environ.get("ROBOT_ENERGY_DATA")
AIR = 22.0


def run(hours, seed, structure=True, noise=0.1, start=(AIR, AIR)):
    """Work and rest of random length; C 1500 J/K, G 3 W/K; structure 6000 J/K, 2 W/K, share 0.3."""
    rng = np.random.default_rng(seed)
    rows = round(hours * 3600 / WINDOW)
    level = np.repeat(rng.choice([0.0, 0.3, 1.0], rows // 60 + 1), 60)[:rows]
    drive, friction = 30.0 * level, 50.0 * level

    def balance(time, degc):
        row = min(int(time / WINDOW), rows - 1)
        if not structure:
            return [(drive[row] + friction[row] - 3.0 * (degc[0] - AIR)) / 1500.0, 0.0]
        flow = 3.0 * (degc[0] - degc[1])
        gear = 0.7 * friction[row] + flow - 2.0 * (degc[1] - AIR)
        return [(drive[row] + 0.3 * friction[row] - flow) / 1500.0, gear / 6000.0]

    time = np.arange(1, rows + 1) * WINDOW
    found = solve_ivp(balance, (0.0, time[-1]), start, t_eval=time, max_step=WINDOW, rtol=1e-6)
    degc = found.y[0] + rng.normal(scale=noise, size=rows)
    return ThermalRun(time - WINDOW, drive, friction, np.ones(rows), degc, float(start[0]))


def test_two_nodes_are_found_where_there_are_two():
    fit = fit_network("axle", [run(3, 1), run(3, 2)], AIR)
    network = fit.network
    assert network.structure_capacity is not None
    assert network.capacity.value == pytest.approx(1500.0, rel=0.1)
    assert network.conductance.value == pytest.approx(3.0, rel=0.1)
    assert network.structure_capacity.value == pytest.approx(6000.0, rel=0.15)
    assert network.structure_conductance.value == pytest.approx(2.0, rel=0.1)
    assert network.friction_to_motor.value == pytest.approx(0.3, abs=0.05)
    assert fit.rms < 0.3
    assert network.std == fit.rms
    assert fit.orders["one node"] > 2 * fit.orders["two nodes"]
    assert (fit.held_out, fit.runs) == ("runs", 2)


def test_one_node_where_there_is_one():
    fit = fit_network("axle", [run(3, 1, structure=False), run(3, 2, structure=False)], AIR)
    assert fit.network.capacity.value == pytest.approx(1500.0, rel=0.05)
    assert fit.motor_time_constant == pytest.approx(500.0, rel=0.05)
    assert fit.rms < 0.3


def test_the_only_run_is_tested_on_its_end():
    fit = fit_network("axle", [run(4, 3)], AIR)
    assert fit.held_out == "end of the run"
    assert fit.rms < 1.0 < fit.held_rms


def small(tau, seconds, on=120.0):
    """Blocks of a small motor, G 0.5 W/K: 20 W and nothing in turn, each an exponential by hand.

    Joint states at 10 Hz; the thermometer is read once a second, and the reading holds.
    """
    time = np.arange(0.0, seconds, 0.1)
    number, read = (time // on).astype(int), np.floor(time)
    degc, begin = np.empty(len(time)), AIR
    for k in range(number[-1] + 1):
        end = AIR + (20.0 / 0.5 if k % 2 == 0 else 0.0)
        rows = (read // on).astype(int) == k
        degc[rows] = end + (begin - end) * np.exp(-(read[rows] - k * on) / tau)
        begin = end + (begin - end) * np.exp(-on / tau)
    degc += np.random.default_rng(0).normal(scale=0.05, size=len(time))[read.astype(int)]
    heat = np.where(number % 2 == 0, 20.0, 0.0)[:, None]
    power = SimpleNamespace(
        stamp_ns=np.round(time * 1e9).astype(np.int64),
        drive_loss=heat,
        friction_power=np.zeros_like(heat),
        motor_temperature_degc=degc[:, None],
    )
    return runs_of_recordings([SimpleNamespace(power=power)], 0)


@pytest.mark.parametrize("seconds", [300.0, 900.0])
def test_a_small_motor_of_forty_seconds_is_found_in_minutes(seconds):
    fit = fit_network("axle", small(40.0, seconds), AIR)
    assert fit.motor_time_constant == pytest.approx(40.0, rel=0.02)
    assert fit.network.conductance.value == pytest.approx(0.5, rel=0.01)
    assert fit.rms < 0.1
    assert fit.hours * 3600.0 == pytest.approx(seconds, abs=5.0)


def test_minutes_are_too_short_for_a_motor_of_a_quarter_of_an_hour():
    with pytest.raises(NotIdentifiableError, match=r"has 300 s .* 5 time constants"):
        fit_network("axle", small(900.0, 300.0, on=200.0), AIR)


def test_what_cannot_say_is_refused_with_what_to_record():
    with pytest.raises(NotIdentifiableError, match="Record longer"):
        fit_network("axle", [run(0.1, 1)], AIR)
    flat = run(2, 1)
    still = replace(flat, motor_temperature_degc=np.full(len(flat), 30.0), start_degc=30.0)
    with pytest.raises(NotIdentifiableError, match=r"warms by 0\.0 K"):
        fit_network("axle", [still], AIR)
    rng = np.random.default_rng(0)
    noise = rng.normal(scale=4.0, size=(2, len(flat)))  # nothing to do with the heat
    others = [replace(flat, motor_temperature_degc=40.0 + part, start_degc=40.0) for part in noise]
    with pytest.raises(NotIdentifiableError, match="first reading, held"):
        fit_network("axle", others, AIR)
    with pytest.raises(NotIdentifiableError, match="no motor temperature is known"):
        fit_networks(["axle"], [[]])


MOTOR = {
    "names": ["axle"],
    "effort": {"columns": ["i"], "unit": "ampere"},
    "temperature": {"columns": ["degc"], "unit": "degc"},
}


@pytest.mark.parametrize("in_files", [True, False])
def test_runs_of_a_log_that_count_from_zero_are_kept_apart(tmp_path, in_files):
    """A stalled motor, twice from cold, each run with a clock of its own; no velocities."""
    seconds = np.arange(0.0, 1200.0, 5.0)
    rows = [f"{t},{level},{AIR + 0.01 * t:.3f},{level}" for level in (1, 2) for t in seconds]
    rows.append("1200,-,30,2")
    parts = [rows[: len(seconds)], rows[len(seconds) :]] if in_files else [rows]
    logs = [write_csv(tmp_path / f"{k}.csv", "t,i,degc,name", part) for k, part in enumerate(parts)]
    runs = {"each_file_is_a_run": True} if in_files else {"run": "name"}
    given = tmp_path / "map.yaml"
    given.write_text(
        json.dumps({"schema_version": 1, "time": {"column": "t", **runs}, "joints": MOTOR})
    )
    inputs = IdentifyInputs(Namespace(log=logs, mapping=given))
    blocks, names = inputs.columns_of_log()
    (note,) = inputs.log_notes
    assert note.startswith("240 of 241" if in_files else "480 of 481")
    assert "where i is '-'" in note
    found = runs_of_log(blocks, 0)
    assert names == ["axle"]
    assert [part.start_degc for part in found] == [AIR, AIR]
    assert [len(part) for part in found] == [120, 120]
    np.testing.assert_allclose(found[1].drive_heat[:-1], 4.0)


@pytest.mark.parametrize("lacking", ["effort", "temperature"])
def test_a_log_without_currents_or_temperatures_is_refused(tmp_path, lacking):
    joints = {**MOTOR, "position": {"columns": ["t"], "unit": "rad"}}
    del joints[lacking]
    spec = mapping(time={"column": "t"}, joints=joints, power=None)
    log = write_csv(tmp_path / "log.csv", "t,i,degc", ["0,1,20", "1,1,20"])
    with pytest.raises(LogFormatError, match=rf"no {lacking} of .*joints\.{lacking}"):
        runs_of_log([part.whole() for part in open_logs([log], spec)], 0)


@pytest.mark.skipif(not DATA, reason="skipped: no data folder (ROBOT_ENERGY_DATA)")
def test_the_afternoon_of_a_real_ur3_follows_from_its_morning(tmp_path):
    from thermal_observer import free_runs

    from robot_energy_logs.log_import import open_logs
    from robot_energy_logs.mapping import load_mapping

    mapping = ROOT / "src/examples/mappings/ur3_cobotops.yaml"
    log = str(Path(DATA) / "ur3_cobotops/dataset_02052023.csv")
    used = load_mapping(mapping)
    (rows,) = [part.whole() for part in open_logs([log], used)]
    found = free_runs(rows, used.joints.names)
    assert len(found) == 6
    assert np.mean([part.rms for part in found]) < 0.5
    report = tmp_path / "ur3.json"
    words = ["identify", "thermal", "--log", log, "--mapping", str(mapping), "--json", str(report)]
    assert main(words) == 0
    axes = json.loads(report.read_text())["axes"]
    assert {axis["name"] for axis in axes} == set(used.joints.names)
    assert all(axis["rms"] < axis["held_rms"] for axis in axes)
