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
import time
from collections.abc import Sequence
from pathlib import Path

from rclpy.executors import SingleThreadedExecutor

from robot_energy.foundation.errors import RobotEnergyError
from ros2_energy_monitor.base.parameters import NO_FOLDER
from ros2_energy_monitor.base.run_node import StopSignal, ros
from ros2_energy_monitor.demo.demo_identification import PLANT_SEED, identify_plant
from ros2_energy_monitor.demo.demo_page import PAGE, draw_page, free_port, save_page
from ros2_energy_monitor.demo.demo_replay import show_bags
from ros2_energy_monitor.demo.processes import NodeProcesses
from ros2_energy_monitor.nodes.console import Console

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
            if end is not None and not stop.received:
                print(console.board.energy_error(), flush=True)
                print(save_page(url, folder), flush=True)
            console.close()
            executor.shutdown()
            console.destroy_node()
        well = _verdict(children, started=end is not None, stopped=stop.received)
    if (folder / PAGE).exists() and not stop.received:
        print(draw_page(folder), flush=True)
    return well


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
