"""Keeps the energy account of one robot on disk: restores, checkpoints, recovers."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from robot_energy.accounting.account import EnergyAccount
from robot_energy.accounting.exact_sum import PER_JOULE
from robot_energy.accounting.plain_text import MAX_TEXT
from robot_energy.accounting.record import (
    FORMAT_VERSION,
    AccountRecord,
    Identity,
    TraceEntry,
    TraceKind,
)
from robot_energy.foundation.errors import RegisterError, StateFileError
from robot_energy.foundation.shown_text import shown
from robot_energy.model import RobotModel
from robot_energy.store.slots import SlotPair, SlotStore, Stored, Submit, at_once, follows, is_newer


def identity_of(model: RobotModel, node: str = "") -> Identity:
    """Return whose registers a node counts with a model; a replay has no name of a node."""
    return Identity(
        robot_type=model.robot.type,
        robot_serial=model.robot.serial or "",
        joint_names=tuple(model.joint_names),
        model_id=model.model_id,
        node=node,
    )


def file_name_of(identity: Identity) -> str:
    """Return how the names of the state files of an account begin, readable and unique.

    That is the full name of the node, if there is one, with type and serial of the robot.
    """
    parts = [identity.robot_type, identity.robot_serial]
    if identity.node:
        parts.insert(0, identity.node)
    readable = re.sub(r"[^a-z0-9]+", "-", " ".join(parts).lower()).strip("-")[:60]
    digits = hashlib.sha256("\n".join(parts).encode()).hexdigest()
    return f"{readable or 'robot'}-{digits[: 16 if identity.node else 8]}"


def load_account(
    account: EnergyAccount,
    model: RobotModel,
    folder: Path | None,
    submit: Submit = at_once,
    node: str = "",
) -> AccountStore:
    """Return the account store of a robot; without a folder it keeps nothing."""
    identity = identity_of(model, node)
    slots = None
    if folder is not None:
        slots = SlotPair(folder, file_name_of(identity), FORMAT_VERSION, AccountRecord.from_json)
    return AccountStore(account, identity, slots, submit)


class AccountStore(SlotStore[AccountRecord]):
    """Keeps an energy account in state files.

    Args:
        slots: Their state files; None keeps nothing.

    Attributes:
        folder: Where the state files lie; None keeps nothing.
        loaded: Whether the state files were read, so that this is the robot's account.
        sequence: Number of our newest checkpoint; 0 before the first.
    """

    def __init__(
        self,
        account: EnergyAccount,
        identity: Identity,
        slots: SlotPair[AccountRecord] | None,
        submit: Submit = at_once,
    ) -> None:
        super().__init__(slots, submit)
        self.account = account
        self.loaded = slots is None
        self.folder = None if slots is None else slots.folder
        self._identity = identity
        self.sequence = 0
        self._aside: AccountRecord | None = None  # the robot's, while the account counts another's
        self._attempted = 0  # `sequence`, or that of a write that failed and may yet be on disk

    @property
    def is_aside(self) -> bool:
        """Whether the account counts what is not the robot's, such as a recording."""
        return self._aside is not None

    def set_aside(self) -> None:
        """Keep the robot's account as it stands; the account counts from zero, and is not kept."""
        if self._aside is None:
            self._aside = self.account.state(self._identity)
        self.account.begin()

    def take_back(self) -> None:
        """Go on with the robot's account; what was counted meanwhile is dropped."""
        if self._aside is not None:
            record, self._aside = self._aside, None
            self.account.resume(record)

    @property
    def busy(self) -> bool:
        return self._pending is not None

    def poll(self) -> bool | None:
        """Take the result of the disk's work: see `SlotStore`."""
        outcome = super().poll()
        if outcome and self._slots is not None:
            self.sequence = self._slots.sequence
        return outcome

    def checkpoint(self, patience: float | None = None) -> bool:
        """Whether the account is on disk as it stands now.

        Args:
            patience: How long to wait for the disk, twice at most; None for ever. [s]
        """
        self.open(patience)
        if self._slots is None or not self._slots.held:
            return False
        return self.begin() and bool(self._finish(patience))

    def require(self) -> None:
        if not self.loaded:
            raise RegisterError(
                "the registers of this robot have not been read yet",
                "state files that can be read",
                self.trouble or "wait a moment",
            )

    def close(self, patience: float | None = None) -> bool:
        """Whether the last checkpoint is on disk; let another monitor write.

        Args:
            patience: How long to wait for the disk, twice at most. [s]
        """
        done = self.checkpoint(patience)
        self._release()
        return done

    def _payload(self) -> bytes:
        assert self._slots is not None
        self._attempted = follows(self._slots.sequence)
        record = self.account.state(self._identity) if self._aside is None else self._aside
        return record.to_json()

    def _finish(self, patience: float | None) -> bool | None:
        outcome = super()._finish(patience)
        if self._pending is None:
            return outcome
        self.trouble = self.cause = f"the disk has not answered for {patience:g} s"
        self.remedy = ""
        return False

    def _adopt(self, stored: Stored[AccountRecord]) -> None:
        """Continue from what is on disk, unless the robot's account is its continuation."""
        if self._aside is None:
            self._continue(stored)
            return
        other = self.account.state(self._identity)
        self.take_back()
        try:
            self._continue(stored)
        finally:
            self._aside = self.account.state(self._identity)
            self.account.resume(other)

    def _continue(self, stored: Stored[AccountRecord]) -> None:
        for notice in stored.notices:
            self._note("file_lost", notice)
        if self.loaded and not is_newer(stored.sequence, self._attempted):
            return  # the folder was away for a while
        record = stored.value
        try:
            if record is not None:
                record = self._fitting(record)
        except StateFileError:
            assert self._slots is not None
            self._slots.release()  # the next checkpoint tries again
            raise
        self.loaded = True
        if record is None:
            if stored.notices:
                self._began_anew("no state file could be used")
            return
        lost = self.account.trace.entries  # of the files that were read just now
        start_ns = self.account.start_ns
        if start_ns is None or (record.end_ns is not None and start_ns < record.end_ns):
            self.account.restore(record)
            for entry in lost:
                self.account.trace.add(entry)
            how = "" if start_ns is None else "; what was counted meanwhile is dropped"
        else:
            self.account.precede(record)
            how = "; what was counted meanwhile is added"
        self.sequence = self._attempted = stored.sequence
        self._note("restart", f"continued by model {self._identity.model_id}{how}")
        if record.identity.model_id != self._identity.model_id:
            before, after = record.identity.model_id, self._identity.model_id
            self.account.calibration.reset()
            self._note("model_changed", f"model {before} counted until here, {after} from here")
            self.notices.append(f"the registers of model {before} go on with model {after}")

    def _fitting(self, record: AccountRecord) -> AccountRecord | None:
        """Return the record for our joints; None, after moving it aside, if it is of others."""
        assert self._slots is not None
        mine, found = self._identity, record.identity
        if found.node != mine.node:
            reason = f"the state is of node '{shown(found.node)}'"
        elif (found.robot_type, found.robot_serial) != (mine.robot_type, mine.robot_serial):
            reason = f"the state is of robot '{found.robot_type}' '{found.robot_serial}'"
        elif sorted(found.joint_names) != sorted(mine.joint_names):
            reason = (
                f"the state is of joints {', '.join(found.joint_names)}, "
                f"the model has {', '.join(mine.joint_names)}"
            )
        else:
            return record.arranged(mine.joint_names, self._loads(record))
        self._began_anew(f"{reason}: {', '.join(self._slots.set_aside())}")
        return None

    def _loads(self, record: AccountRecord) -> list[str]:
        """Names of the auxiliary loads that are counted; what changed is noted."""
        loads, kept = self.account.totals().auxiliary, record.totals.auxiliary
        for name in sorted(loads.keys() - kept.keys()):
            self._note("register_added", f"auxiliary load '{name}' counts from here")
        for name in sorted(kept.keys() - loads.keys()):
            joule = kept[name].energy_microjoule / PER_JOULE
            self.notices.append(
                f"the model has no auxiliary load '{name}' any more; it had counted {joule:.1f} J"
            )
            self._note("model_changed", self.notices[-1])
        return list(loads)

    def _began_anew(self, reason: str) -> None:
        self._note("began_anew", reason)
        self.notices.append(f"the registers begin at zero: {reason}")

    def _note(self, kind: TraceKind, text: str) -> None:
        entry = TraceEntry(kind=kind, stamp_ns=self.account.end_ns, text=shown(text, MAX_TEXT))
        self.account.trace.add(entry)
