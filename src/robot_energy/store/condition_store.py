"""Keeps what was learned of one robot on disk, one pair of slots for each model file.

The same for the estimated temperatures of its motors, in slots of their own.

As for the registers, the disk may be full, read-only or gone at any time: learning goes on in
memory, `ConditionStore.trouble` says why, and the next write tries again.
"""

from __future__ import annotations

from concurrent.futures import Future, wait
from pathlib import Path
from typing import Any, Protocol, cast

from robot_energy.condition.learner import ConditionLearner
from robot_energy.condition.record import (
    FORMAT_VERSION,
    ConditionPart,
    ConditionRecord,
    ThermalRecord,
)
from robot_energy.errors import StateFileError
from robot_energy.model import RobotModel
from robot_energy.store.account_store import Submit, at_once, file_name_of, identity_of
from robot_energy.store.slots import SlotPair, Stored


class Kept(Protocol):
    """What has a state that is kept: the learner, and the thermal observer."""

    @property
    def learns(self) -> bool:
        """Whether there is anything to keep."""
        ...

    def state(self) -> ConditionPart | None:
        """Return the state; None before there is one."""
        ...

    def restore(self, record: Any) -> None:
        """Continue from a state.

        Args:
            record: Of the same model file.
        """
        ...


class ConditionStore:
    """Keeps learned figures in state files, or estimated temperatures.

    Args:
        learner: What learns, or estimates.
        model: The robot's model; another model file has other state files.
        folder: Where they lie; None keeps nothing.
        submit: Does work on the disk; jobs must run one after the other.
        node: Full name of the node that learns. Empty for none.

    Attributes:
        trouble: Why nothing can be kept at present; empty while all is well.
        notices: What the user should know, oldest first; take them out.
        writes: Writes that reached the disk.
    """

    def __init__(
        self,
        learner: Kept,
        model: RobotModel,
        folder: Path | None,
        submit: Submit = at_once,
        node: str = "",
    ) -> None:
        self.trouble = ""
        self.notices: list[str] = []
        self.writes = 0
        self._learner = learner
        self._submit = submit
        self._pending: Future[Any] | None = None
        self._slots: SlotPair[Any] | None = None
        if folder is not None and learner.learns:
            what, record = (
                ("learned", ConditionRecord)
                if isinstance(learner, ConditionLearner)
                else ("thermal", ThermalRecord)
            )
            name = f"{file_name_of(identity_of(model, node))}-{what}-{model.model_id}"
            self._slots = SlotPair(folder, name, FORMAT_VERSION, record.from_json)

    def open(self, patience: float | None = None) -> None:
        """Take the lock of the files and continue from what is there.

        Args:
            patience: How long to wait for the disk; None for ever. [s]
        """
        if self._slots is not None and not self._slots.held:
            self.begin()
            self._finish(patience)

    def begin(self) -> None:
        """Begin to write what is learned by now, or try to open the folder."""
        if self._slots is None or self._pending is not None:
            return
        if not self._slots.held:
            self._pending = self._submit(self._slots.acquire)
            return
        slots, state = self._slots, self._learner.state()
        if state is not None:
            payload = state.to_json()
            self._pending = self._submit(lambda: slots.write(payload))

    def poll(self) -> None:
        """Take the result of the disk's work, if it has ended."""
        if self._pending is None or not self._pending.done():
            return
        job, self._pending = self._pending, None
        try:
            result = job.result()
            if isinstance(result, Stored):
                stored = cast("Stored[Any]", result)
                self.notices += stored.notices
                if stored.value is not None:
                    self._learner.restore(stored.value)
            else:
                self.writes += 1
            self.trouble = ""
        except StateFileError as error:
            self.trouble = str(error)

    def close(self, patience: float | None = None) -> None:
        """Write a last time and let another monitor write.

        Args:
            patience: How long to wait for the disk, twice at most. [s]
        """
        self._finish(patience)
        if self._slots is None or not self._slots.held:
            return
        self.begin()
        self._finish(patience)
        if self._pending is None:
            self._slots.release()

    def _finish(self, patience: float | None) -> None:
        if self._pending is not None:
            wait([self._pending], patience)
            self.poll()
