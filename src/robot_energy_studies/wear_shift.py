"""When wear of one axis is found on the rig.

Friction of one axis is multiplied in the plant, and the monitor sees joint states, temperatures
and motor torque alone. The hall swings between 15 and 60 degC once a day, and the payload changes
every half hour; half of the changes are unknown to the monitor.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from robot_energy.condition.wear import WearMonitor
from robot_energy.foundation.described import Described
from robot_energy.model import load
from robot_energy.model.payload import payload
from robot_energy.timeline.blocks import Learning
from robot_energy_rig import PlantProfile, RigConfig, VirtualRig
from robot_energy_studies.learning_study import joint_block, pipeline_of, work

COLD, HOT = 15.0, 60.0  # of the hall [degC]
RATE = 25.0  # of the joint states [Hz]
CHANGE_EVERY = 30  # min between two payloads
HIDDEN = 3.0  # greatest mass that the monitor does not get [kg]
DAY_HOURS = 24  # h


class WearRow(Described):
    """One axis that was made to wear."""

    joint: int
    found: Annotated[
        float, "Time from the beginning of wear until the alarm; NaN if there was none. [h]"
    ]
    motion: Annotated[float, "Motion of this axis in that time. [h]"]
    named: Annotated[tuple[int, ...], "Axes with an alarm that somebody should look at."]
    size: Annotated[float, "Change stated at the end. [-]"]
    std: Annotated[float, "Its standard deviation. [-]"]


class Shift:
    """A rig at work in a hall that swings, with payloads that change, watched by a monitor."""

    def __init__(self, profile: PlantProfile, hard: bool = True) -> None:
        self._model = load(profile.body)
        config = RigConfig.hard() if hard else RigConfig()
        start = (COLD + HOT) / 2
        self._rig = VirtualRig(profile, work(profile, 0), config, 0, start, start, rate_hz=RATE)
        self._pipeline = pipeline_of(self._model, Learning.OBSERVE, True)
        self._random = np.random.default_rng(0)
        self._minute = 0
        learner = self._pipeline.condition
        self.monitor: WearMonitor = learner.wear

    def run(self, minutes: int, wear: np.ndarray | None = None) -> None:
        """Work on.

        Args:
            wear: Factor on the friction of each axis, shape (n,); None leaves it. [-]
        """
        for _ in range(minutes):
            swing = np.sin(2 * np.pi * self._minute / (60 * DAY_HOURS))
            ambient = (COLD + HOT) / 2 + (HOT - COLD) / 2 * swing
            self._rig.change(ambient_degc=float(ambient), wear=wear)
            if self._minute % CHANGE_EVERY == 0:
                self._carry()
            output = self._rig.step(round(60 * RATE))
            self._pipeline.step(joint_block(output.joints), output.temperatures, output.meter)
            self._minute += 1

    def _carry(self) -> None:
        """Take another payload, known to the monitor or not."""
        if not self._model.payload:
            return
        body = self._model.payload[0]
        kind = self._random.integers(4)
        known = body.mass * (self._random.uniform(0.2, 1.0) if kind == 2 else 1.0)
        true = known + (self._random.uniform(0.0, HIDDEN) if kind == 3 else 0.0)
        carried = [
            payload(body.link, float(mass), body.centre_of_mass, body.inertia)
            for mass in (true, known)
        ]
        self._rig.change(payload=carried[:1])
        self._pipeline.torque.set_payload(carried[1])

    def hours(self, joint: int) -> float:
        """Return how long an axis has moved. [h]"""
        return self.monitor.state().hours[joint]

    @property
    def alarms(self) -> tuple[int, ...]:
        """Axes whose friction has risen, by the monitor."""
        tests = self.monitor.joints
        return tuple(
            joint for joint, test in enumerate(tests) if test.changes and not test.drift.fell
        )


def detection(shift: Shift, joint: int, rise: float, before: float, after: float) -> WearRow:
    """Return when the wear of one axis is found.

    Args:
        rise: Of its friction, at once. [-]
        before: Time without wear. [h]
        after: Time with it. [h]
    """
    shift.run(round(60 * before))
    tests = shift.monitor.joints
    found, motion, worn = float("nan"), float("nan"), np.ones(len(tests))
    worn[joint] += rise
    begun = shift.hours(joint)
    for minute in range(1, round(60 * after) + 1):
        shift.run(1, worn)
        if np.isnan(found) and joint in shift.alarms:
            found, motion = minute / 60, shift.hours(joint) - begun
    drift = tests[joint].drift
    return WearRow(joint, found, motion, shift.alarms, drift.size, drift.std)
