"""Payloads set at run time <-> ``ros2_energy_msgs/Payload`` and ``SetPayload``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray

from robot_energy.accounting.plain_text import MAX_LINK, require_plain_text
from robot_energy.bag.cdr.decode import Decoder, Encoder, RawBatch, Run, stamp_columns
from robot_energy.bag.cdr.types import typestore as default_typestore
from robot_energy.foundation.errors import PayloadError, RobotEnergyError
from robot_energy.foundation.shown_text import shown
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.messages.fields import FRAME, STAMP
from robot_energy.model.payload import Payload, payload, several_carried
from robot_energy.physics.urdf.parse import INERTIA
from robot_energy.timeline.stamps import (
    BAD_STAMP,
    MAX_STAMP_NS,
    SECOND_NS,
    is_valid_time,
    readable_time,
)

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

    from robot_energy.pipeline.torque_stage import PayloadChange

PAYLOAD = "ros2_energy_msgs/msg/Payload"
COM = ("x", "y", "z")
FIELDS = (
    FRAME,
    "inertia.m",
    *(f"inertia.com.{axis}" for axis in COM),
    *(f"inertia.{entry}" for entry in INERTIA),  # as `model.payload.Payload` has them
)
FIELDS_OF_0_1 = ("link", "mass", "centre_of_mass", "inertia")
"""Fields of the message in release 0.1; its inertia has the order of `INERTIA`."""

SetPayload = Callable[[Payload, int | None], "PayloadChange"]  # `TorqueStage.set_payload`


@dataclass(frozen=True)
class SetPayloadAnswer:
    """What to answer, and what to publish."""

    success: bool
    message: Annotated[str, "What was accepted, or why not."]
    change: Annotated[
        PayloadChange | None, "The change; None if it was refused, and the old payload stays."
    ] = None

    @property
    def from_ns(self) -> int:
        """Instant from which the payload counts; 0 if it was refused. [ns]"""
        return 0 if self.change is None else self.change.from_ns


def answer_set_payload(set_payload: SetPayload, request: Any) -> SetPayloadAnswer:
    """Return the answer to a request, carried out; it never raises for what the request holds."""
    header, inertia = request.payload.header, request.payload.inertia
    seconds, nanoseconds = int(header.stamp.sec), int(header.stamp.nanosec)
    from_ns = seconds * SECOND_NS + nanoseconds
    try:
        _check_link(str(header.frame_id))
        if not is_valid_time(max(seconds, 0), nanoseconds):  # before 1970: it has passed
            raise PayloadError(
                f"header.stamp is {seconds} s and {nanoseconds} ns",
                f"a time from 0 to {MAX_STAMP_NS // SECOND_NS} s with less than 1e9 ns",
                "leave it at zero for the next joint state",
            )
        body = payload(
            str(header.frame_id),
            float(inertia.m),
            [getattr(inertia.com, axis) for axis in COM],
            [getattr(inertia, entry) for entry in INERTIA],
        )
        change = set_payload(body, from_ns if from_ns > 0 else None)
    except RobotEnergyError as error:
        return SetPayloadAnswer(False, str(error))
    link = shown(body.link)
    what = f"{body.mass:g} kg on '{link}'" if body.mass else f"nothing on '{link}'"
    since = f"from {readable_time(change.from_ns)} on" if change.from_ns else "from the start"
    several = several_carried(change.carried)
    message = f"the robot carries {what} {since}" + (f"; {several}" if several else "")
    return SetPayloadAnswer(True, message, change)


class PayloadWriter:
    """Serialises changes of the payload."""

    def __init__(self, model_id: str) -> None:
        self._model_id = model_id

    def encode(self, change: PayloadChange) -> NDArray[np.uint8]:
        """Return one serialised message, shape (1, size)."""
        body = change.payload
        values = (body.mass, *body.centre_of_mass, *body.inertia)
        encoder = Encoder(PAYLOAD, {FRAME: body.link, "model_id": self._model_id})
        return encoder.encode(
            {
                **stamp_columns(np.array([change.from_ns])),
                **dict(zip(FIELDS[1:], values, strict=True)),
            },
            1,
        )


class PayloadReader:
    """Reads payload messages and puts them into force by their stamps.

    The payload is a fact about the robot, not a figure of a model: messages that were
    written with another model file count as well. Messages of release 0.1 are read where the
    source has their definition.
    """

    def __init__(self, set_payload: SetPayload, typestore: Typestore | None = None) -> None:
        self.rejections = RejectionLog()
        self.changes: list[PayloadChange] = []
        self.refused = ""  # why the last refused message was, one sentence; empty if none was
        self._set_payload = set_payload
        store = typestore or default_typestore()
        names = {name for name, _ in store.fielddefs[PAYLOAD][1]}
        self._fields = FIELDS_OF_0_1 if names.issuperset(FIELDS_OF_0_1) else FIELDS
        self._decoder = Decoder(PAYLOAD, (*STAMP, *self._fields), store)

    def step(self, batch: RawBatch) -> None:
        """Take messages in order of arrival."""
        self.rejections.received += len(batch)
        decoded = self._decoder.decode(batch)
        self.rejections.reject("malformed", len(decoded.malformed))
        rows = [(row, run, index) for run in decoded.runs for index, row in enumerate(run.rows)]
        for _, run, index in sorted(rows, key=lambda entry: entry[0]):
            seconds, nanoseconds = (int(run.array(field)[index]) for field in STAMP)
            if not is_valid_time(seconds, nanoseconds):
                self.rejections.reject(BAD_STAMP)
                continue
            try:
                from_ns = seconds * SECOND_NS + nanoseconds
                self.changes.append(self._set_payload(self._body(run, index), from_ns))
                self.rejections.accepted += 1
            except RobotEnergyError as error:
                self.refused = str(error)
                self.rejections.reject("impossible_payload")

    def _body(self, run: Run, index: int) -> Payload:
        """The payload of one message."""
        link, *columns = self._fields
        _check_link(str(run.columns[link]))
        mass, *rest = np.hstack([run.array(name)[index] for name in columns]).tolist()
        return payload(str(run.columns[link]), mass, rest[:3], rest[3:])


def _check_link(link: str) -> None:
    """Refuse what no link is called; an unknown one is refused by the robot."""
    if link:
        require_plain_text("a name of a link", link, MAX_LINK, PayloadError)
