# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Predictions in a process of their own, for a monitor that goes on meanwhile.

``python -m ros2_energy_monitor.services.prediction_process`` reads from its standard input: pickled
keyword arguments of what answers, then the request as ROS serialises it. It writes pickled answers.
Only the process that started it feeds it.
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable
from typing import Any

from robot_energy.foundation.errors import RobotEnergyError
from robot_energy.foundation.kinds import load_kinds

Answer = dict[str, Any]


class PredictionProcess:
    """Starts the process, asks it and ends it; `end` may be called by any thread."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> subprocess.Popen[bytes]:
        """Start it, unless it runs."""
        process = self._process
        if process is None or process.poll() is not None:
            self.end()  # closes the pipes of one that has ended by itself
            threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
            self._process = process = subprocess.Popen(
                [sys.executable, "-m", __name__],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env={**os.environ, **threads},
                process_group=0,  # Ctrl-C is for the monitor, which ends this
            )
        return process

    def ask(self, asked: dict[str, Any], request: memoryview) -> None:
        """Ask for an answer.

        Args:
            asked: Keyword arguments of what answers; its name as ``answer``.
        """
        process = self.start()
        assert process.stdin is not None
        pickle.dump(asked | {"size": len(request)}, process.stdin)
        process.stdin.write(request)
        process.stdin.flush()

    def answer(self, timeout: float) -> Answer | None:
        """Return fields of the response, or an ``error`` of the program; None while it works.

        Args:
            timeout: Longest wait for it. [s]
        """
        process = self._process
        if process is None or process.stdout is None:
            return {"error": "the process that predicts was ended"}
        if not select.select([process.stdout], [], [], timeout)[0]:
            return None
        try:
            return pickle.load(process.stdout)
        except EOFError:
            return {"error": f"the process that predicts has ended with {process.wait()}"}

    def end(self) -> None:
        """End it; its memory is given back."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    pipe.close()


def main() -> None:
    """Answer what comes on standard input, until it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is not an answer
    load_kinds()
    # Heavy: imported before the first request comes.
    import scipy.interpolate  # noqa: F401
    from ros2_energy_msgs.srv import CompareTrajectories, PredictTrajectory

    import robot_energy_plan.optimization.comparison
    import robot_energy_plan.prediction  # noqa: F401
    from ros2_energy_monitor.services.raw_service import CMessage
    from ros2_energy_monitor.services.trajectory_answers import compared, predicted

    answers: dict[str, tuple[Any, Callable[..., Answer]]] = {
        "predict_trajectory": (PredictTrajectory, predicted),
        "compare_trajectories": (CompareTrajectories, compared),
    }
    while True:
        try:
            asked = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        kind, work = answers[asked.pop("answer")]
        memory = CMessage(kind.Request).deserialise(sys.stdin.buffer.read(asked.pop("size")))
        try:
            answer = {"success": True, **work(request=memory.read(), **asked)}
        except RobotEnergyError as error:
            answer = {"message": str(error)}
        except Exception:
            answer = {"error": traceback.format_exc()}
        memory.free()
        pickle.dump(answer, out)
        out.flush()


if __name__ == "__main__":
    main()
