"""What the thermometers of the motors show while all motors are equally warm.

After hours at rest all motors are as warm as the air, and thermometer i reads ``T + o_i``. A motor
that has worked is warmer than the air by a share of its own of what the robot is warmer, so
``r_i - mean(r)`` is then no constant. Begins of recordings at which it is the same although the
robot was by `WARMER` warmer are those of a robot that had rested, and show o_i.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from robot_energy.foundation.described import Described
from robot_energy.timeline.blocks import Float
from robot_energy_identify.data.recordings import Recording
from robot_energy_identify.thermal.gear import MAX_OFFSET

BEGIN_NS = 10_000_000_000  # of a recording, whose readings count
WARMER = 10.0  # K between two begins
AGREE = 1.5  # K by which one thermometer may differ between them
REST_FIRST = f"begin two recordings after hours at rest, one of them {WARMER:g} K warmer"
NOISE = 0.3  # K, of readings of whole kelvins at one begin


class Thermometers(Described):
    """Errors of the thermometers of a robot."""

    error: Annotated[tuple[float, ...], "What each shows above the mean of all. [K]"]
    std: Annotated[float, "Of each of them. [K]"]


def thermometers_of(recordings: Sequence[Recording]) -> Thermometers | None:
    """Return the errors of thermometers that recordings show; None where they do not."""
    begins: list[Float] = []
    for part in {part.path: part for part in reversed(recordings)}.values():
        stamp, degc = part.power.stamp_ns, part.power.motor_temperature_degc
        read = (stamp < stamp[0] + BEGIN_NS) & np.isfinite(degc).all(axis=1)
        if read.any():
            begins.append(degc[read].mean(axis=0))
    return errors_of(np.array(begins)) if begins else None


def errors_of(begins_degc: Float) -> Thermometers | None:
    """Return the errors of thermometers by their readings at begins, see `thermometers_of`.

    Args:
        begins_degc: Shape (R, n), R >= 1. [degC]
    """
    level = begins_degc.mean(axis=1)
    apart = begins_degc - level[:, None]
    coldest = int(np.argmin(level))
    same = np.abs(apart - apart[coldest]).max(axis=1) <= AGREE
    error = apart[same].mean(axis=0)
    if np.ptp(level[same]) < WARMER or np.abs(error).max() > MAX_OFFSET:
        return None
    free = same.sum() - 1
    scatter = ((apart[same] - error) ** 2).sum() / max(free * (begins_degc.shape[1] - 1), 1)
    return Thermometers(
        tuple(np.round(error, 2).tolist()), float(np.sqrt(max(scatter, NOISE**2) / same.sum()))
    )
