"""Keeps what was learned of one robot on disk, one pair of slots for each model file.

The same for the estimated temperatures of its motors, in slots of their own.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from robot_energy.condition.learner import ConditionLearner, ConditionRecord
from robot_energy.condition.record import FORMAT_VERSION, THERMAL_VERSION, ThermalRecord
from robot_energy.condition.thermal_observer import ThermalObserver
from robot_energy.model import RobotModel
from robot_energy.store.account_store import file_name_of, identity_of
from robot_energy.store.slots import SlotPair, SlotStore, Stored, Submit, at_once


class ConditionStore(SlotStore[Any]):
    """Keeps learned figures or estimated temperatures in state files; without a folder, nothing."""

    def __init__(
        self,
        learner: ConditionLearner | ThermalObserver,
        model: RobotModel,
        folder: Path | None,
        submit: Submit = at_once,
        node: str = "",
    ) -> None:
        slots: SlotPair[Any] | None = None
        if folder is not None and learner.learns:
            what, version, record = (
                ("learned", FORMAT_VERSION, ConditionRecord)
                if isinstance(learner, ConditionLearner)
                else ("thermal", THERMAL_VERSION, ThermalRecord)
            )
            name = f"{file_name_of(identity_of(model, node))}-{what}-{model.model_id}"
            slots = SlotPair(folder, name, version, record.from_json)
        super().__init__(slots, submit)
        self._learner = learner

    def close(self, patience: float | None = None) -> None:
        """Write a last time and let another monitor write.

        Args:
            patience: How long to wait for the disk, twice at most. [s]
        """
        self._finish(patience)
        if self._slots is not None and self._slots.held:
            self.begin()
            self._finish(patience)
            self._release()

    def _payload(self) -> bytes | None:
        state = self._learner.state()
        return None if state is None else state.to_json()

    def _adopt(self, stored: Stored[Any]) -> None:
        if stored.notices and stored.value is None:
            learned = isinstance(self._learner, ConditionLearner)
            self.notices.append(f"{'learned figures' if learned else 'temperatures'} begin again")
        if stored.value is not None:
            self._learner.restore(stored.value)
        self.trouble = ""
