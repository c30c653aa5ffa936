"""A recorded bag on the page: the replay's results take the way of the live messages."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robot_energy.bag.cdr import RawBatch
from robot_energy.foundation.shown_text import shown_lines
from robot_energy.messages.fields import ENERGY_REGISTERS
from robot_energy.messages.friction import JOINT_FRICTION, FrictionWriter
from robot_energy.messages.power import POWER_STATE, PowerStateWriter
from robot_energy.messages.registers import RegistersWriter, interval_fields
from robot_energy.model import RobotModel
from robot_energy.pipeline import Output
from robot_energy.replay.bag_replay import Replay
from robot_energy.timeline.blocks import MeterLocation
from robot_energy_report.page.alarms import PageFinding
from robot_energy_report.page.hub import PageHub
from robot_energy_report.page.robot_state import RobotState
from robot_energy_report.page.settings import PageSettings

BAD_BAG = "record it again; what could be read is shown"


class RecordedPage:
    """Fills a page from a replay."""

    period = 0.1  # of the means that go into the history [s]

    def __init__(self, title: str, model: RobotModel, settings: PageSettings) -> None:
        self.hub = PageHub(title, settings, live=False)
        self._robot = self.hub.robots[title] = RobotState(title, settings, live=False)
        self._names = model.joint_names
        self._unmodelled = model.unmodelled
        identity = (model.joint_names, model.model_id, model.auxiliary or (), model.unmodelled)
        self._power = PowerStateWriter(*identity)
        self._registers = RegistersWriter(*identity)
        self._friction = FrictionWriter(model)
        self._location = MeterLocation.UNKNOWN

    def take(self, output: Output) -> None:
        """Take what one step of the pipeline gave; for ``on_output`` of a replay."""
        if output.friction is not None:
            self._robot.take_friction(
                _batch(JOINT_FRICTION, self._friction.encode(output.friction))
            )
        if output.meter is not None:
            self._location = output.meter.location
        if output.means is not None:
            rows = self._power.encode(output.means, self._location)
            self._robot.take_power(_batch(POWER_STATE, rows), 0.0)

    def finish(self, result: Replay) -> None:
        """Take the registers, job intervals and remarks of the whole recording."""
        account = result.account
        rows = self._registers.encode(account, ended=True)
        if rows is not None:
            self._robot.take_registers(_batch(ENERGY_REGISTERS, rows))
        self._robot.take_intervals(
            [
                interval_fields(one, self._names, account.calibration, self._unmodelled)
                for one in account.list_intervals()
            ]
        )
        bad = [
            PageFinding("ERROR", f"bag {n}", said, BAD_BAG) for n, said in _counted(result.problems)
        ]
        notes = [PageFinding("OK", f"note {n}", said) for n, said in _counted(result.notes)]
        self._robot.take_findings([*bad, *notes])
        self.hub.tick(0.0)

    def state(self) -> dict[str, Any]:
        """Return everything as plain values, for `saved_page`."""
        return self.hub.state(0.0)


def _counted(sentences: list[str]) -> Iterable[tuple[int, str]]:
    return enumerate(map(shown_lines, sentences), 1)


def _batch(msgtype: str, rows: NDArray[np.uint8]) -> RawBatch:
    return RawBatch.from_messages("page", msgtype, [0] * len(rows), [one.tobytes() for one in rows])
