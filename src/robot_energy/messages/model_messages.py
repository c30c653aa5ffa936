"""Messages that one model's monitors send each other -> blocks."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from robot_energy.bag.cdr.decode import Decoder, RawBatch, Run
from robot_energy.inputs.rejection_log import RejectionLog
from robot_energy.messages.fields import FRAME, RECORDING, STAMP
from robot_energy.timeline.blocks import Block
from robot_energy.timeline.stamps import BAD_STAMP, Reach
from robot_energy.timeline.streams import StreamSplitter

B = TypeVar("B", bound=Block)
HEADER = (*(*STAMP, FRAME, "model_id", "joint_names", "quality"),)


class ModelMessageReader(Generic[B]):
    """Reads messages of one model; refuses those of others and of other times.

    Attributes:
        recording: Whether the newest batch has messages of a recording that is played.
    """

    def __init__(
        self,
        msgtype: str,
        joint_names: Sequence[str],
        model_id: str,
        arrays: Sequence[str],
        fields: Sequence[str],
        reach: Reach,
    ) -> None:
        self.rejections = RejectionLog()
        self.recording = False
        self._stream = StreamSplitter[B](reach, self.rejections.reject)
        self.epochs = self._stream.epochs
        self._identity = (tuple(joint_names), model_id)
        self._arrays = tuple(arrays)
        self._decoder = Decoder(msgtype, (*HEADER, *arrays, *fields))

    def restart(self) -> None:
        """Drop what waits, as after an error. The account is left alone."""
        self._stream.restart()

    @abstractmethod
    def _block(self, run: Run, arrays: dict[str, Any]) -> tuple[B, NDArray[np.bool_]]:
        """Return the messages of a run, and which of them have stamps within the range."""

    def _read(self, batch: RawBatch) -> B | None:
        """Return the usable messages of a batch in order of arrival, or None if there are none."""
        self.rejections.received += len(batch)
        decoded = self._decoder.decode(batch)
        self.rejections.reject("malformed", len(decoded.malformed))
        self.recording = any(run.columns[FRAME] == RECORDING for run in decoded.runs)
        blocks: list[B] = []
        rows: list[NDArray[np.int64]] = []
        for run in decoded.runs:
            arrays = {name: run.array(name) for name in self._arrays}
            if (run.columns["joint_names"], run.columns["model_id"]) != self._identity:
                self.rejections.reject("other_model", len(run.rows))
            elif any(array.shape[1] != len(self._identity[0]) for array in arrays.values()):
                self.rejections.reject("wrong_length", len(run.rows))
            else:
                block, valid = self._block(run, arrays)
                self.rejections.reject(BAD_STAMP, int((~valid).sum()))
                blocks.append(block[valid])
                rows.append(run.rows[valid])
        if not any(map(len, blocks)):
            return None
        return type(blocks[0]).arranged(blocks, rows)[0]
