# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Nodes as child processes, which end with their parent, whatever happens to it."""

from __future__ import annotations

import ctypes
import signal
import subprocess
import sys
import time
from contextlib import AbstractContextManager
from pathlib import Path

PR_SET_PDEATHSIG = 1
GRACE = 30.0  # in which a node ends after SIGINT on any machine, before SIGKILL [s]


class NodeProcesses(AbstractContextManager["NodeProcesses"]):
    """Starts nodes of this package and stops them at the end of the `with` block."""

    def __init__(self, log_folder: Path, environment: dict[str, str]) -> None:
        self._folder = log_folder
        self._environment = environment
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, **parameters: object) -> None:
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

    def __exit__(self, *error: object) -> None:
        self.stop()


def _end_with_parent() -> None:
    """Have the kernel end this child when its parent dies without stopping it (Linux)."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
