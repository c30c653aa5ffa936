# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Checks once after the start whether the robot fits its model, as `robot-energy check` does.

What the pipeline gave is kept until the robot has moved long enough; then a process of low
priority makes the checks, so that a tick only keeps references to blocks that exist anyway.
"""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import fields
from typing import Any

import numpy as np

from robot_energy.inputs.sources import Inputs
from robot_energy.inputs.temperatures.temperatures import TemperatureIngest
from robot_energy.model import RobotModel
from robot_energy.pipeline import EnergyPipeline, Output
from robot_energy.timeline.blocks import (
    NANOSECOND,
    EffortMeaning,
    MeterBlock,
    PowerBlock,
    TorqueBlock,
)
from ros2_energy_monitor.base.guard import Guard
from ros2_energy_monitor.base.node_parameters import EnergyParameters
from ros2_energy_monitor.diagnostics.reporter import ERROR, WARN, StatusBuilder

MAX_SAMPLES = 20_000  # kept; about 1.2 kB each for six joints
NICENESS = 19  # of the process: it gives way to all others
LEVELS = {"error": ERROR, "warning": WARN}
Answer = dict[str, Any]


class ModelCheck:
    """Keeps what the checks need, has them made once, and reports what they found.

    Args:
        motion: Time in motion after which the checks are made; 0 for never. [s]

    Attributes:
        outputs: What the steps of the pipeline gave since `findings` were asked for.
    """

    def __init__(
        self,
        motion: float,
        model: RobotModel,
        effort: EffortMeaning,
        parameters: EnergyParameters,
        pipeline: EnergyPipeline,
        temperatures: TemperatureIngest,
        guard: Guard,
    ) -> None:
        self._needed_ns, self._guard = round(motion / NANOSECOND), guard
        self._model, self._effort = model, effort
        self._inputs = Inputs(**{one.name: getattr(parameters, one.name) for one in fields(Inputs)})
        self._pipeline, self._temperatures = pipeline, temperatures
        self._standstill = np.array([joint.standstill_velocity for joint in model.joints])
        self.outputs: list[Output] = []
        self._kept: deque[tuple[Output, int, int]] = deque()  # with samples, time in motion
        self._samples = self._moving_ns = self._last_ns = 0
        self._thread: ThreadPoolExecutor | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._work: Future[Answer] | None = None
        self._closed = self._failed = False

    def _take(self) -> None:
        """Keep what the steps gave, and begin the checks once the robot moved enough."""
        outputs, self.outputs = self.outputs, []
        if not self._needed_ns or self._work is not None or self._closed:
            return
        for output in outputs:
            torque = output.torque
            if torque is None and output.power is None and output.meter is None:
                continue
            count, moving_ns = (0, 0) if torque is None else (len(torque), self._motion_of(torque))
            self._kept.append((output, count, moving_ns))
            self._samples += count
            self._moving_ns += moving_ns
        while self._samples > MAX_SAMPLES:  # the oldest go
            _, fewer, less_ns = self._kept.popleft()
            self._samples -= fewer
            self._moving_ns -= less_ns
        full = self._samples > 0.9 * MAX_SAMPLES and 2 * self._moving_ns > self._needed_ns
        if full or self._moving_ns >= self._needed_ns:
            outputs = [output for output, _, _ in self._kept]
            self._kept.clear()
            self._thread = ThreadPoolExecutor(1, thread_name_prefix="model_check")
            self._work = self._thread.submit(self._run, outputs, self._settings())

    def _motion_of(self, torque: TorqueBlock) -> int:
        """Time in which some joint moved. [ns]"""
        step = np.diff(torque.stamp_ns, prepend=self._last_ns or torque.stamp_ns[0])
        self._last_ns = int(torque.stamp_ns[-1])
        moving = (np.abs(torque.joint_velocity) > self._standstill).any(axis=1)
        return int(step[moving & (step > 0) & (step < 1 / NANOSECOND)].sum())

    def _run(self, outputs: list[Output], settings: dict[str, Any]) -> Answer:
        """Have a process make the checks; runs in a thread that waits for it."""
        command = [sys.executable, "-m", "robot_energy_identify.check.process", str(NICENESS)]
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env={**os.environ, **threads}
        )
        if self._closed:
            self._process.kill()
        power = [one.power for one in outputs if one.power is not None]
        meter = [one.meter for one in outputs if one.meter is not None]
        blocks = {
            "torque": TorqueBlock.concatenate([o.torque for o in outputs if o.torque is not None]),
            "power": PowerBlock.concatenate(power) if power else None,
            "meter": MeterBlock.concatenate(meter) if meter else None,
        }
        answer, _ = self._process.communicate(pickle.dumps(blocks | settings))
        return json.loads(answer)

    def _settings(self) -> dict[str, Any]:
        """What the checks need besides the blocks; read here, as sums change with every tick."""
        stage, account = self._pipeline.torque, self._pipeline.account
        stuck = zip(self._model.joint_names, self._pipeline.power.watch.stuck, strict=True)
        return {
            "model": self._model,
            "effort": self._effort,
            "inputs": self._inputs,
            "carried": stage.robot.payload,
            "remarks": {
                "temperatures": tuple(self._temperatures.doubts)
                if self._temperatures.rejections.accepted
                else None,
                "stuck": tuple(name for name, is_so in stuck if is_so),
                "meter": tuple(account.judgement.findings(account.comparison)),
                "effort_factors": stage.effort_check.factors(),
            },
        }

    def close(self) -> None:
        self._closed = True
        self._kept.clear()
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
        if self._thread is not None:
            self._thread.shutdown(wait=False, cancel_futures=True)

    def findings(self) -> StatusBuilder:
        """Make the status: the remedy first, as some tools cut a message at 128 characters."""
        self._take()
        found = StatusBuilder("model check")
        found.values["moving_time"] = self._moving_ns * NANOSECOND
        if not self._needed_ns:
            found.notes.append("off (parameter model_check)")
        elif self._work is None:
            found.notes.append(
                f"waits for {self._needed_ns * NANOSECOND:g} s of motion, "
                f"{self._moving_ns * NANOSECOND:.0f} s seen"
            )
        elif not self._work.done():
            found.notes.append("the model is being checked")
        elif self._closed or self._work.exception() is not None:
            found.notes.append("the check was given up")
            if not self._closed and not self._failed:
                self._failed = True
                self._guard.note("model_check", Exception(repr(self._work.exception())))
        else:
            self._report(self._work.result(), found)
        return found

    def _report(self, answer: Answer, found: StatusBuilder) -> None:
        for one in answer["findings"]:
            text = one["sentence"]
            if one["remedy"]:
                place = f" in the {one['remedy_in']}" if one["remedy_in"] else ""
                text = f"{one['remedy']}{place}: {text}"
            key = ".".join((one["cause"], *one["subject"][:1]))
            found.values[key] = one["evidence"]
            if one["severity"] in LEVELS:
                found.add(LEVELS[one["severity"]], text)
        checked = ", ".join(answer["checked"]) or "nothing"
        found.notes.append(f"no mistake found; checked: {checked}")
        found.remarks += [f"{name} not checked: {why}" for name, why in answer["skipped"].items()]
