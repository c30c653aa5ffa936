"""``FrictionCondition`` -> what was learned of the friction of each joint: wear over months."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robot_energy.bag.cdr.batch import RawBatch
from robot_energy.bag.cdr.decode import Decoder, stamp_ns
from robot_energy.messages.fields import STAMP

CONDITION_TYPE = "ros2_energy_msgs/msg/FrictionCondition"
_FIELDS = (*STAMP, "model_id", "joints.name", "joints.multiplier", "joints.valid")


@dataclass(frozen=True)
class LearnedFriction:
    """Friction of the joints of one robot over that of its model file, as learned by an instant.

    Attributes:
        stamp_ns: Newest sample learned from. [ns]
        model_id: Of the model that it is relative to.
        ratios: By joint, of those where it is valid. [-]
    """

    stamp_ns: int
    model_id: str
    ratios: dict[str, float]


class FrictionDecoder:
    """Decodes what monitors have learned of one robot; what is malformed is left out."""

    def __init__(self) -> None:
        self._decoder = Decoder(CONDITION_TYPE, _FIELDS)

    def decode(self, batch: RawBatch) -> list[LearnedFriction]:
        """Return what the messages of a batch say; those without a valid joint say nothing."""
        found: list[LearnedFriction] = []
        for run in self._decoder.decode(batch).runs:
            names, stamps = run.names("joints.name"), stamp_ns(run).tolist()
            ratios = run.array("joints.multiplier").tolist()
            valid = run.array("joints.valid").tolist()
            for stamp, own, known in zip(stamps, ratios, valid, strict=True):
                kept = {
                    name: ratio
                    for name, ratio, use in zip(names, own, known, strict=True)
                    if use and math.isfinite(ratio)
                }
                if kept and stamp > 0:
                    found.append(LearnedFriction(stamp, str(run.columns["model_id"]), kept))
        return found
