# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""The held-out motions of the study of paper A, live through the three nodes.

The energies that they publish are compared with those of the replay. All nodes end with their
parent, whatever happens to it.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any, Self

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from ros2_energy_msgs.msg import EnergyRegisters

from robot_energy.bag import BagReader
from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import ReportError, RobotEnergyError
from robot_energy.messages.fields import JOINT_STATES_TOPIC, METER_TOPIC, TEMPERATURES_TOPIC
from ros2_energy_monitor.base.parameters import NO_FOLDER
from ros2_energy_monitor.base.publishers import REGISTERS_TOPIC, reliable
from ros2_energy_monitor.base.run_node import StopSignal, ros
from ros2_energy_monitor.base.shared_memory import clear_ports
from ros2_energy_monitor.nodes.player import LEAD, Player, pausing

PR_SET_PDEATHSIG = 1
GRACE = 30.0  # in which a node ends after SIGINT on any machine, before SIGKILL [s]


class NodeProcesses:
    """Starts nodes of this package and stops them at the end of the `with` block."""

    def __init__(self, log_folder: Path, environment: dict[str, str]) -> None:
        self._folder = log_folder
        self._environment = environment
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, **parameters: object) -> None:
        """Start a node."""
        self._folder.mkdir(parents=True, exist_ok=True)
        words = [f"{key}:={value}" for key, value in parameters.items()]
        options = ["--ros-args", *(word for pair in words for word in ("-p", pair))]
        with self.log(name).open("wb") as log:
            self._running[name] = subprocess.Popen(
                [sys.executable, "-m", "ros2_energy_monitor", name, *options],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=self._environment,
                preexec_fn=_end_with_parent,
            )

    def log(self, name: str) -> Path:
        """Return the file with a node's output."""
        return self._folder / f"{name}.log"

    def ended(self) -> list[str]:
        """Return the nodes that have ended, which they should not by themselves."""
        return [name for name, child in self._running.items() if child.poll() is not None]

    def stop(self, *names: str) -> dict[str, int]:
        """Return the exit codes of some nodes or all; what does not end is killed."""
        chosen = {name: self._running.pop(name) for name in names or tuple(self._running)}
        for child in chosen.values():
            if child.poll() is None:
                child.send_signal(signal.SIGINT)
        deadline = time.monotonic() + GRACE
        for child in chosen.values():
            try:
                child.wait(timeout=max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()
        return {name: child.returncode for name, child in chosen.items()}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()


def _end_with_parent() -> None:
    """Have the kernel end this child when its parent dies without stopping it (Linux)."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


MODEL = "follows"  # of the study: friction follows temperature, plain as in the paper
TOPICS = (JOINT_STATES_TOPIC, TEMPERATURES_TOPIC, METER_TOPIC)
MET = {  # inputs of the monitors by the status that counts their publishers
    "torque_monitor: joint states": ("input_publishers",),
    "friction_monitor: motor temperatures": ("input_publishers",),
    "power_monitor: energy": (
        "input_publishers",
        "friction_input_publishers",
        "meter_input_publishers",
    ),
}
SAME = 1e-6  # share by which energies of nodes and replay may differ
MAX_START_TIME = 60.0  # s until the monitors listen


class Expected(Described):
    """What the study says of one recording, by replay."""

    bag: Path
    robot_degc: float
    measured: Annotated[float, "Energy by the meter. [J]"]
    predicted: Annotated[float, "By the model, over the same time. [J]"]


def read_study(folder: Path) -> list[Expected]:
    """Return what a study says of its held-out recordings."""
    try:
        sets = json.loads((folder / "figures.json").read_text(encoding="utf-8"))["sets"]
        return [
            Expected(
                folder / "bags" / entry["bag"],
                entry["robot_degc"],
                entry["measured_energy"],
                entry["predicted_energy"][MODEL],
            )
            for entry in sets
        ]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ReportError(
            f"'{folder}' holds no study of paper A ({error})",
            "the folder that --out named",
            "make one with robot-energy reproduce paper-a --quick --out build/paper_a",
        ) from error


def live_energies(
    expected: Expected, model: Path, rate: float, log: Path, stop: StopSignal
) -> EnergyRegisters | None:
    """Return the last registers of three monitors to which a recording was played; None if none.

    Args:
        rate: Times the speed of nature, > 0. [-]
    """
    with ros([]) as context, NodeProcesses(log, dict(os.environ)) as children:
        children.start(
            "torque_monitor", model=model, **{"joint_states.effort_meaning": "motor_torque"}
        )
        children.start("friction_monitor", model=model)
        children.start("power_monitor", model=model, state_folder=NO_FOLDER)
        node = rclpy.create_node("live_study", context=context)
        seen = _Seen(node)
        with pausing(node, stop) as pause:
            player = Player(node, BagReader(expected.bag), rate, TOPICS)
            limit = time.monotonic() + MAX_START_TIME
            while not seen.met() and time.monotonic() < limit and pause(0.05):
                pass
            if seen.met():
                player.play(pause)
            pause(LEAD)
            for name in ("torque_monitor", "friction_monitor", "power_monitor"):
                children.stop(name)  # each hands on what it has left
                pause(LEAD)
            return None if stop.received else seen.registers


class _Seen:
    """What the monitors say."""

    def __init__(self, node: Node) -> None:
        self.registers: Any = None
        self._publishers: dict[tuple[str, str], float] = {}
        node.create_subscription(EnergyRegisters, REGISTERS_TOPIC, self._take, reliable(100))
        node.create_subscription(DiagnosticArray, "/diagnostics", self._look, reliable(100))

    def met(self) -> bool:
        """Whether every input of every monitor has met its publisher."""
        return all(
            self._publishers.get((name, key), 0) > 0 for name, keys in MET.items() for key in keys
        )

    def _take(self, registers: EnergyRegisters) -> None:
        self.registers = registers

    def _look(self, message: DiagnosticArray) -> None:
        for status in message.status:
            for pair in status.values:
                if pair.key in MET.get(status.name, ()):
                    self._publishers[status.name, pair.key] = float(pair.value)


def main(args: Sequence[str] | None = None) -> int:
    """Play the recordings of a study.

    Returns:
        Exit code: 0 if nodes and replay agree, 1 if not, 2 if there is no study, 130 if
        interrupted.
    """
    parser = argparse.ArgumentParser(
        prog="live_study", description="Play a study of paper A through the three nodes."
    )
    parser.add_argument("study", type=Path, help="folder of `robot-energy reproduce paper-a`")
    parser.add_argument("--rate", type=float, default=10.0, help="times the speed of nature")
    options = parser.parse_args(args)
    if not 0 < options.rate < float("inf"):
        parser.error(f"--rate is {options.rate:g}; expected a finite factor > 0")
    os.environ["ROS_DOMAIN_ID"] = str(os.getpid() % 100 + 1)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    stop = StopSignal()
    study: Path = options.study.resolve()
    log = study.with_name(f"{study.name}_log")  # next to the study, which stays what it is
    try:
        studied = read_study(options.study)
        for sentence in clear_ports():
            print(sentence, flush=True)
        print(f"virtual rig; {options.rate:g} times the speed of nature; predicted over measured")
        print("recording                  degC    replay   three nodes", flush=True)
        agree = True
        for one in studied:
            found = live_energies(one, options.study / "identified.yaml", options.rate, log, stop)
            if stop.received:
                print("interrupted; all nodes are stopped", flush=True)
                return 130
            agree &= _tell(one, found)
    except RobotEnergyError as error:
        print(f"live_study: {error}", flush=True)
        return 2
    if agree:
        print("nodes and replay agree", flush=True)
        return 0
    print(
        "nodes and replay differ: messages are lost where the computer is too busy for this rate; "
        f"close other programs, or play slower, such as with --rate {options.rate / 4:g}",
        flush=True,
    )
    return 1


def _tell(expected: Expected, found: Any) -> bool:
    replayed = expected.predicted / expected.measured - 1.0
    start = f"{expected.bag.name:24s} {expected.robot_degc:6.1f}  {replayed:+7.2%}"
    if found is None:
        print(f"{start}   nothing was published; see the log folder of the study", flush=True)
        return False
    same = (
        abs(found.predicted_energy_at_meter / expected.predicted - 1.0) <= SAME
        and abs(found.measured_energy / expected.measured - 1.0) <= SAME
    )
    live = found.predicted_energy_at_meter / found.measured_energy - 1.0
    reached = found.measured_energy / expected.measured
    counted = f"   differs: the nodes counted {100 * reached:.2f} % of the measured energy"
    why = "" if same else counted
    print(f"{start}   {live:+11.2%}{why}", flush=True)
    return same
