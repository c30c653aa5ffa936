# Copyright 2026 Robot energy maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0 Unless required by applicable law or agreed to in
# writing, software distributed under the License is distributed on an "AS IS" BASIS, WITHOUT
# WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
# language governing permissions and limitations under the License.

"""Publishes what a monitor learns of its robot, reports it, and keeps it on disk."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.node import Node
from ros2_energy_msgs.msg import FrictionCondition, JointCondition
from ros2_energy_msgs.msg import WearAlarm as WearAlarmMessage

from robot_energy.condition.joint_friction import BUCKET_DEGC, BUCKET_SPEED
from robot_energy.condition.learner import ConditionLearner
from robot_energy.condition.wear import REMEDY, WearAlarm
from robot_energy.foundation.units import SECOND_NS
from robot_energy.model import RobotModel
from robot_energy.store.condition_store import ConditionStore
from robot_energy.timeline.stamps import bounded
from ros2_energy_monitor.base.checkpoints import CLOSING, OPENING
from ros2_energy_monitor.base.parameters import folder_of
from ros2_energy_monitor.base.publishers import CONDITION_TOPIC, latched
from ros2_energy_monitor.diagnostics.reporter import WARN, StatusBuilder

PERIOD = 10.0  # between two messages without news [s]
KEEP_PERIOD = 300.0  # between two writes; what is learned since is lost with the power [s]


class ConditionPublisher:
    """Publishes ``energy/condition`` and keeps learned figures; `open` creates, `close` ends.

    Args:
        learner: Kept on disk with its temperatures.
        state_folder: Parameter that names the folder of the state files.
    """

    def __init__(
        self,
        node: Node,
        model: RobotModel,
        learner: ConditionLearner,
        state_folder: str,
    ) -> None:
        self._node, self._model, self._learner = node, model, learner
        self._kept_things = [kept for kept in (learner, learner.thermal) if kept.learns]
        self._folder = folder_of(state_folder)
        self._publisher: Any = None
        self._thread: ThreadPoolExecutor | None = None
        self._stores: list[ConditionStore] = []
        self._shown: tuple[int | None, tuple[WearAlarm, ...]] = (None, ())
        self._published = self._kept = time.monotonic()
        self._trouble = ""
        self._aside: list[Any] | None = None  # what was learned of the robot before a recording

    def open(self) -> None:
        """Create the publisher, and read from disk what was learned before."""
        if not self._kept_things:
            return
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="condition")
        owner = self._node.get_fully_qualified_name()
        self._stores = [
            ConditionStore(kept, self._model, self._folder, self._thread.submit, owner)
            for kept in self._kept_things
        ]
        for store in self._stores:
            store.open(OPENING)
        self._log_news()
        if self._learner.learns:
            self._publisher = self._node.create_publisher(
                FrictionCondition, CONDITION_TOPIC, latched(1)
            )
            self._publish()

    def close(self) -> None:
        """Write a last time; safe also after an `open` that failed."""
        self.end_recording()
        for store in self._stores:
            store.close(CLOSING)
        self._log_news()
        if self._thread is not None:
            self._thread.shutdown(wait=False)
        self._publisher = None
        self._stores = []

    def begin_recording(self) -> None:
        """Keep what was learned of the robot as it is; what a recording teaches is dropped."""
        if self._aside is None:
            self._aside = [kept.state() for kept in self._kept_things]

    def end_recording(self) -> None:
        """Go on with what was learned of the robot before the recording."""
        if self._aside is None:
            return
        for kept, state in zip(self._kept_things, self._aside, strict=True):
            if state is not None:
                kept.restore(state)
        self._aside = None

    def report(self) -> None:
        """Publish what is new, and write from time to time; call once a second."""
        for store in self._stores:
            store.poll()
        now = time.monotonic()
        if self._stores and self._aside is None and now - self._kept >= KEEP_PERIOD:
            self._kept = now
            for store in self._stores:
                store.begin()
            self._log_news()
        if self._publisher is None or self._learner.end_ns == self._shown[0]:
            return
        if now - self._published >= PERIOD or len(self._learner.wear.alarms) != len(self._shown[1]):
            self._publish()

    def findings(self) -> StatusBuilder:
        """Say what was learned, and which axis has changed."""
        learner, found = self._learner, StatusBuilder("condition")
        factor, offset = learner.meter.filtered
        found.values |= {
            "learning": str(learner.learning),
            "in_use": int(learner.in_use),
            "meter_windows": learner.meter.windows,
            "friction_factor": factor,
            "loss_offset_w": offset,
        }
        multipliers = zip(self._model.joint_names, learner.friction.filtered.tolist(), strict=True)
        found.values |= {f"multiplier_{name}": value for name, value in multipliers}
        thermal = self._learner.thermal
        for place, name in enumerate(self._model.joint_names):
            if thermal.gears[place]:
                found.values[f"gear_degc_{name}"] = float(thermal.friction_degc[place])
                found.values[f"gear_std_k_{name}"] = float(thermal.friction_std[place])
        for alarm in learner.wear.alarms:
            if alarm.warns:
                found.add(WARN, alarm.sentence, REMEDY)
            else:
                found.notes.append(alarm.sentence)
        for store in self._stores:
            if store.trouble:
                found.add(WARN, store.trouble.rstrip("."), "check the state folder")
        return found

    def _publish(self) -> None:
        learner = self._learner
        self._shown = (learner.end_ns, learner.wear.alarms)
        self._published = time.monotonic()
        message = FrictionCondition(
            model_id=self._model.model_id,
            learning=str(learner.learning),
            in_use=learner.in_use,
            meter_valid=learner.meter.valid,
            windows=learner.meter.windows,
            windows_refused=learner.meter.refused,
            bucket_temperature_degc=BUCKET_DEGC.tolist(),
            bucket_speed=BUCKET_SPEED.tolist(),
            joints=self._joints(),
            alarms=[_alarm(alarm) for alarm in learner.wear.alarms],
        )
        message.header.stamp = _time(learner.end_ns)
        message.friction_factor_raw, message.loss_offset_raw = learner.meter.raw
        message.friction_factor, message.loss_offset = learner.meter.filtered
        message.friction_factor_std, message.loss_offset_std = learner.meter.std
        self._publisher.publish(message)

    def _joints(self) -> list[JointCondition]:
        friction = self._learner.friction
        rows = zip(
            self._model.joint_names,
            friction.raw.tolist(),
            friction.filtered.tolist(),
            friction.valid.tolist(),
            friction.parts.tolist(),
            friction.refused.tolist(),
            friction.buckets,
            friction.bucket_time,
            strict=True,
        )
        return [
            JointCondition(
                name=name,
                multiplier_raw=raw,
                multiplier=filtered,
                valid=valid,
                parts=parts,
                parts_refused=refused,
                bucket_multiplier=buckets.reshape(-1).tolist(),
                bucket_time=times.reshape(-1).tolist(),
            )
            for name, raw, filtered, valid, parts, refused, buckets, times in rows
        ]

    def _log_news(self) -> None:
        log = self._node.get_logger()
        for store in self._stores:
            for notice in store.notices:
                log.warning(f"learned figures: {notice}")
            store.notices.clear()
        trouble = next((store.trouble for store in self._stores if store.trouble), "")
        if trouble != self._trouble:
            self._trouble = trouble
            log.error(self._trouble) if self._trouble else log.info("learned figures are kept")


def _alarm(alarm: WearAlarm) -> WearAlarmMessage:
    kind = WearAlarmMessage.ROSE if alarm.warns else WearAlarmMessage.FELL
    return WearAlarmMessage(
        joint=alarm.joint,
        kind=kind,
        change=alarm.drift.size,
        change_std=alarm.drift.std,
        since=_time(alarm.drift.since_ns),
        certainty=alarm.sure,
        text=alarm.sentence,
    )


def _time(stamp_ns: int | None) -> Time:
    seconds, rest = divmod(bounded(stamp_ns or 0), SECOND_NS)
    return Time(sec=seconds, nanosec=rest)
