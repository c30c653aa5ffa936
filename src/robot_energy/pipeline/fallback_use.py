"""How many samples had to do without a motor temperature, and why."""

from __future__ import annotations

import numpy as np

from robot_energy.pipeline.friction_timeline import FrictionTimeline
from robot_energy.timeline.blocks import NANOSECOND, Float, Int

APART_NS = 5_000_000_000  # stamps that far from the torques' are another clock's [ns]


class FallbackUse:
    """Counts the samples whose friction is that of the fallback temperature.

    Args:
        fallback_degc: The temperature used instead. [degC]

    Attributes:
        stale: Samples with a motor whose temperature is too old, and none missing.
        apart_ns: Stamp of the nearest temperature minus that of the last such sample; None
            if no temperature has come. [ns]
        silence_ns: Longest time that such a sample lay behind the last temperature of its
            motor. [ns]
    """

    def __init__(self, fallback_degc: float) -> None:
        self.samples = 0
        self.missing = 0
        self.stale = 0
        self.apart_ns: int | None = None
        self.silence_ns = 0
        self._fallback_degc = fallback_degc

    def note(
        self, stamp_ns: Int, temperature_degc: Float, seen_ns: Int, timeline: FrictionTimeline
    ) -> None:
        """Take samples.

        Args:
            stamp_ns: Shape (N,), N >= 1. [ns]
            temperature_degc: In use, shape (N, n); NaN where the fallback is. [degC]
            seen_ns: Stamps of the temperatures known at the last sample, shape (n,); 0 where
                none is. [ns]
        """
        self.samples += len(stamp_ns)
        if np.isfinite(temperature_degc.sum()):
            return
        lacking = np.logical_or.reduce(np.isnan(temperature_degc), axis=1)
        count = int(lacking.sum())
        if bool((seen_ns > 0).all()):
            self.stale += count
        else:
            self.missing += count
        if not lacking[-1]:
            return
        now = int(stamp_ns[-1])
        known = seen_ns[seen_ns > 0]
        behind = int(known.max()) - now if len(known) else None
        coming = timeline.next_ns(now)
        ahead = None if coming is None else coming - now
        found = [each for each in (behind, ahead) if each is not None]
        self.apart_ns = min(found, key=abs) if found else None
        too_old = np.isnan(temperature_degc[-1]) & (seen_ns > 0)
        if too_old.any():
            self.silence_ns = max(self.silence_ns, now - int(seen_ns[too_old].min()))

    def of_another_time(self, ahead_ns: int | None) -> bool:
        """Return whether the stamps of the temperatures are from another clock.

        Args:
            ahead_ns: How far they are ahead of those of the torques on arrival, negative where
                they are behind; None where that is not known. [ns]
        """
        far = self.apart_ns is not None and abs(self.apart_ns) > APART_NS
        return far and ahead_ns is not None and abs(ahead_ns) > APART_NS

    def sentence(self, ahead_ns: int | None) -> str:
        """Return what a user should know of it; empty if every sample had its temperatures."""
        count = self.missing + self.stale
        if not count:
            return ""
        why = "missing" if not self.stale else "stale" if not self.missing else "missing or stale"
        text = (
            f"{count} of {self.samples} joint samples used the fallback temperature of "
            f"{self._fallback_degc:g} degC: a motor temperature was {why}"
        )
        if self.of_another_time(ahead_ns) and ahead_ns is not None:
            way = "ahead of" if ahead_ns > 0 else "behind"
            text += (
                f"; its stamps are {abs(ahead_ns) * NANOSECOND:.1f} s {way} those of the joint "
                "states: synchronise the clocks"
            )
        elif self.silence_ns:
            text += (
                f"; no new one for up to {self.silence_ns * NANOSECOND:.1f} s: check its driver "
                "or topic"
            )
        return text
