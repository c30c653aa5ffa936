# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The demonstration behind `make demo`: a virtual robot warms up under its monitors.

Its model is identified first, from training bags; bags of other motions are predicted at the end.
"""

from __future__ import annotations

import argparse
import os
import socket
import time
import urllib.request
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated

from rclpy.executors import SingleThreadedExecutor
from rich.console import Console as Terminal

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import BagError, RobotEnergyError
from robot_energy.foundation.units import JOULE_PER_WH
from robot_energy.model import RobotModel, load
from robot_energy.physics.friction import with_fixed_friction
from robot_energy.replay.bag_replay import Replay, replay
from robot_energy_report.printing import table
from ros2_energy_monitor.base.parameters import NO_FOLDER
from ros2_energy_monitor.base.run_node import StopSignal, ros
from ros2_energy_monitor.demo.node_processes import NodeProcesses
from ros2_energy_monitor.nodes.console import Console

PLANT_SEED = 1  # the first one; figures of the plant were not looked at
TRAINING = ("drawn_train_cold", "drawn_train_middle", "drawn_train_warm")
START = "kr16"  # bodies and gears, and first figures of everything else
FILE = "identified.yaml"
COLD_DEGC, WARM_DEGC = 22.0, 60.0  # where a fixed model would have been identified
BAGS = {"drawn_test_cold": WARM_DEGC, "drawn_test_warm": COLD_DEGC}  # the fixed model in its figure


def bundled(bags: Path, names: Iterable[str]) -> list[Path]:
    paths = [bags / name for name in names]
    for path in paths:
        if not path.exists():
            raise BagError(
                f"the bag {path.name} is not in {bags.resolve()}",
                "the bags of the repository",
                "start the demonstration at the top of the repository or name --bags",
            )
    return paths


def identify_plant(bags: Path, out: Path) -> str:
    """Return the model file of the plant, identified from its training bags."""
    # Slow to import, and of no use to the live part.
    from robot_energy_identify.api.identify import identify_all
    from robot_energy_report.document import Document
    from robot_energy_report.identify_all import identification_overview
    from robot_energy_report.printing import print_document

    paths, file = bundled(bags, TRAINING), out / FILE
    out.mkdir(parents=True, exist_ok=True)
    command = f"robot-energy identify all {' '.join(map(str, paths))} --model {START}"
    print(f"Identify: {command} --effort motor_torque --no-test --out {file}", flush=True)
    result = identify_all(paths, START, "motor_torque", held_out=False)
    page = Document()
    identification_overview(result.found, page)
    print_document(page, Terminal())
    result.save(file)
    return str(file)


class Row(Described):
    """One bag."""

    bag: str
    measured: Annotated[float, "Energy by the meter. [J]"]
    aware: Annotated[float, "Predicted with friction that follows the temperature. [J]"]
    fixed: Annotated[
        dict[float, float],
        "Predicted with friction of one temperature, by that temperature. [J by degC]",
    ]
    figure: Path


def show_bags(bags: Path, out: Path, model_name: str) -> list[Row]:
    """Return one row per bundled bag, after printing the table and writing the figures."""
    model = load(model_name)
    out.mkdir(parents=True, exist_ok=True)
    rows = [_row(path, model, out) for path in bundled(bags, BAGS)]
    table(
        Terminal(),
        "Energy from the grid, held-out bags of the virtual rig",
        ("bag", "measured [Wh]", "friction", "predicted [Wh]", "error"),
        [
            (
                row.bag,
                f"{row.measured / JOULE_PER_WH:.2f}",
                kind,
                f"{energy / JOULE_PER_WH:.2f}",
                f"{100.0 * (energy / row.measured - 1.0):+.1f} %",
            )
            for row in rows
            for kind, energy in (
                ("follows temperature", row.aware),
                *((f"fixed at {degc:g} degC", energy) for degc, energy in row.fixed.items()),
            )
        ],
    )
    for row in rows:
        print(f"figure: {row.figure}", flush=True)
    return rows


def _row(bag: Path, model: RobotModel, out: Path) -> Row:
    # Matplotlib is slow to import and of no use to the live part.
    from robot_energy_report.replay_figures import compared_series, power_and_energy

    first = replay(bag, model, keep_curves=True)
    fixed = {
        degc: replay(bag, with_fixed_friction(model, degc), keep_curves=True)
        for degc in (COLD_DEGC, WARM_DEGC)
    }
    shown = BAGS[bag.name]
    aware = compared_series(first, "predicted, friction follows temperature")
    other = compared_series(fixed[shown], f"predicted, friction fixed at {shown:g} degC", "fixed")
    if aware is None or other is None:
        raise BagError(f"{bag} has no meter reading to compare with", "a recording with a meter")
    figure = out / f"{bag.name}.png"
    power_and_energy(
        [*aware, other[1]], figure, f"{bag.name}: virtual rig, drawn plant of the KR 16 class"
    )
    return Row(
        bag.name,
        first.account.comparison.measured_energy,
        _predicted(first),
        {degc: _predicted(result) for degc, result in fixed.items()},
        figure,
    )


def _predicted(result: Replay) -> float:
    return result.account.comparison.predicted_energy


PAGE = "energy_page.html"
PATIENCE = 30.0  # for the page [s]


def free_port() -> int:
    """Return a TCP port of this computer that nothing uses."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def save_page(url: str, folder: Path) -> str:
    """Return a sentence on the page, saved as it stands."""
    page = folder / PAGE
    try:
        with urllib.request.urlopen(f"{url}saved.html", timeout=PATIENCE) as answer:
            page.write_bytes(answer.read())
    except OSError as error:
        return f"the energy page could not be saved ({error})"
    return f"energy page saved to {page}"


MONITORS = ("torque_monitor", "friction_monitor", "power_monitor")
THERMAL_SPEEDUP = 5.0  # times nature; faster, the gears would lag behind their motors
START_DEGC = 25.0  # inside the temperatures of the training bags for every thermometer [degC]
MAX_START_TIME = 60.0  # for all topics to arrive, on a machine that does much else [s]


def live(seconds: float, model: str, folder: Path, stop: StopSignal) -> bool:
    """Whether robot, monitors and console ran until the end and ended cleanly.

    Args:
        seconds: How long to show it. [s]
    """
    environment = {
        "ROS_DOMAIN_ID": str(os.getpid() % 100 + 1),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    os.environ.update(environment)
    print(
        f"Live for {seconds:g} s: a virtual robot, not a real one, that warms up "
        f"{THERMAL_SPEEDUP:g} times as fast as a robot does",
        flush=True,
    )
    with NodeProcesses(folder, dict(os.environ)) as children:
        children.start(
            "virtual_robot",
            thermal_speedup=THERMAL_SPEEDUP,
            start_temperature_degc=START_DEGC,
            plant_seed=PLANT_SEED,
            hard=True,
        )
        for name in MONITORS:
            keep_nothing = {"state_folder": NO_FOLDER} if name == "power_monitor" else {}
            children.start(name, model=model, **keep_nothing)
        port = free_port()
        url = f"http://127.0.0.1:{port}/"
        children.start("energy_dashboard", port=port)
        print(f"Energy page while it runs: {url}", flush=True)
        with ros([]) as context:
            console = Console(context=context)
            executor = SingleThreadedExecutor(context=context)
            executor.add_node(console)
            limit = time.monotonic() + MAX_START_TIME
            end: float | None = None
            while not stop.received and not children.ended():
                executor.spin_once(timeout_sec=0.1)
                now = time.monotonic()
                if end is None and console.board.complete:
                    end = now + seconds
                if now > (limit if end is None else end):
                    break
            console.close()
            if end is not None and not stop.received:
                print(console.board.energy_error(), flush=True)
                print(save_page(url, folder), flush=True)
            executor.shutdown()
            console.destroy_node()
        return _verdict(children, started=end is not None, stopped=stop.received)


def _verdict(children: NodeProcesses, *, started: bool, stopped: bool) -> bool:
    """Stop the nodes and say what went wrong, if anything did."""
    early = [] if stopped else children.ended()
    codes = children.stop()
    for name in early:
        lines = children.log(name).read_text(errors="replace").splitlines()
        print(f"{name} ended by itself: {lines[-1] if lines else 'without a word'}", flush=True)
    if not started and not early and not stopped:
        print(f"the monitors published nothing within {MAX_START_TIME:g} s", flush=True)
    bad = [name for name, code in codes.items() if code and name not in early]
    for name in bad:
        print(f"{name} ended with code {codes[name]}; see {children.log(name)}", flush=True)
    return not (early or bad) and (started or stopped)


def main(args: Sequence[str] | None = None) -> int:
    """Run the demonstration.

    Returns:
        Exit code: 0 if all went well, 1 if a node failed, 2 if a bag cannot be used, 130 if it was
        interrupted.
    """
    parser = argparse.ArgumentParser(
        prog="demo",
        description="Identify a virtual robot, monitor it while it warms up, test its model.",
    )
    parser.add_argument("--seconds", type=float, default=40.0, help="live part [s]")
    parser.add_argument("--out", type=Path, default=Path("build/demo"), help="folder to write to")
    parser.add_argument("--bags", type=Path, default=Path("bags"), help="folder of the bags")
    parser.add_argument("--model", help="use this model and identify none")
    options = parser.parse_args(args)
    stop = StopSignal()
    try:
        model = options.model or identify_plant(options.bags, options.out)
        well = options.seconds <= 0 or live(options.seconds, model, options.out, stop)
        if stop.received:
            print("interrupted; all nodes are stopped", flush=True)
            return 130
        show_bags(options.bags, options.out, model)
    except RobotEnergyError as error:
        print(error, flush=True)
        return 2
    return 0 if well else 1
