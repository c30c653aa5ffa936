"""Two publishers of the same joint: found by what they say, refused while they do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from robot_energy.inputs.joint_states.jumps import Directions, PositionJumpDetector
from robot_energy.inputs.joint_states.partial_states import MergedStates
from robot_energy.physics.urdf.checks import JointLimits
from robot_energy.timeline.gaps import SECOND_NS

CLEAN_NS = SECOND_NS  # how long it must be quiet before samples are used again
LONGEST_STEP_NS = SECOND_NS // 10  # more than this between two samples is no time watched
QUARANTINE_NS = SECOND_NS // 4  # how long a leap waits for the leap back


class PublisherConflictFilter:
    """Refuses samples while two publishers contradict each other.

    Signs of a second publisher: messages of one stamp that differ, stamps of two clocks that
    take turns, and positions that leap forth and back (see `PositionJumpDetector`). Samples
    after a lone leap wait a quarter of a second: if it leaps back, they are refused with it,
    so that nothing of a false position is used. A leap that stays is a jump of one publisher (an
    encoder referenced anew) and begins a new segment. After a sign, samples are refused
    until a second has passed without another.

    Args:
        n_joints: Number of joints of the model.
        limits: Limits from the URDF; None to allow what any joint can do.

    Attributes:
        count: Signs seen.
        joints: Joints whose positions gave a sign, shape (n,).
        refused: Samples refused.
        first_ns: Stamp of the first sign; None if there was none. [ns]
        last_ns: Stamp of the last sign. [ns]
    """

    def __init__(self, n_joints: int, limits: JointLimits | None = None) -> None:
        self.count = 0
        self.joints = np.zeros(n_joints, dtype=np.bool_)
        self.refused = 0
        self.first_ns: int | None = None
        self.last_ns: int | None = None
        self._steps = PositionJumpDetector.of(n_joints, limits)
        self._held: MergedStates | None = None
        self._last_ns: int | None = None
        self._to_watch = 0  # time that must pass without a sign [ns]
        self._broken = False  # samples were refused before the next one

    @property
    def waiting(self) -> int:
        """Samples that wait whether a leap comes back."""
        return 0 if self._held is None else len(self._held)

    def begin_epoch(self, restless: bool, stamp_ns: int) -> MergedStates | None:
        """Note that the stamps jumped back.

        Args:
            restless: Whether they did so twice within a second: two clocks take turns.
            stamp_ns: First stamp of the new epoch. [ns]

        Returns:
            The samples that waited, or None.
        """
        held = self.flush()
        self._steps.begin_epoch()
        self._last_ns = None
        if restless:
            self._note(stamp_ns)
        return held

    def step(self, samples: MergedStates) -> MergedStates | None:
        """Take samples of one epoch in time order; return those that can be used."""
        leaps = self._steps.leaps(samples.stamp_ns, samples.joint_position)
        calm = leaps is None and self._steps.calm and not self._to_watch
        if calm and not bool(samples.disputed.any()):
            out = samples
        else:
            if leaps is None:
                leaps = np.zeros(samples.joint_position.shape, dtype=np.int8)
            out = self._judge(samples, leaps)
        self._last_ns = int(samples.stamp_ns[-1])
        return out

    def flush(self) -> MergedStates | None:
        """Return the samples that wait; nothing says that they are wrong."""
        held, self._held = self._held, None
        if held is not None:
            held.broken[0] = True
        return held

    def _note(self, stamp_ns: int) -> None:
        self.count += 1
        self.first_ns = stamp_ns if self.first_ns is None else self.first_ns
        self.last_ns = stamp_ns
        self._to_watch = CLEAN_NS

    def _judge(self, samples: MergedStates, leaps: Directions) -> MergedStates | None:
        """Go through the samples one by one."""
        whole = samples if self._held is None else MergedStates.concatenate([self._held, samples])
        held = list(range(self.waiting))
        first = len(held)
        broken = whole.broken.copy()
        used: list[int] = []
        last = self._last_ns
        steps = self._steps
        for row, stamp in enumerate(samples.stamp_ns.tolist()):
            back = steps.back(stamp, leaps[row])
            elapsed = 0 if last is None else min(stamp - last, LONGEST_STEP_NS)
            last = stamp
            self._to_watch = max(0, self._to_watch - elapsed)
            if samples.disputed[row] or bool(back.any()):
                self.joints |= back
                self._note(stamp)
                self.refused += len(held)
                self._broken |= bool(held)
                held = []
            if self._to_watch:
                self.refused += 1
                self._broken = True
                continue
            index = first + row
            broken[index] |= self._broken
            self._broken = False
            lone = steps.lone != 0
            if bool((lone & (stamp - steps.lone_ns <= QUARANTINE_NS)).any()):
                held.append(index)
                continue
            if held:
                broken[held[0]] |= bool(lone.any())
                used += held
                held = []
            used.append(index)
        whole = replace(whole, broken=broken)
        self._held = whole[np.asarray(held, dtype=np.int64)] if held else None
        return whole[np.asarray(used, dtype=np.int64)] if used else None
