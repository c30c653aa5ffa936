"""Which bags, or stretches of one, are fitted together and which are held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from robot_energy.blocks import NANOSECOND
from robot_energy.identify.data.bags import Bag, Span
from robot_energy.identify.provenance import require_distinct
from robot_energy.identify.stats.cross_validation import FOLDS

Kind = Literal["test", "recordings", "blocks"]
GUARD = 0.5  # s left out of the fit on both sides of a block


@dataclass(frozen=True)
class Fold:
    """What is fitted together and what is tested on it.

    Attributes:
        train: Bags of the fit.
        test: Bags, or stretches, that the fit does not see.
    """

    train: tuple[Bag, ...]
    test: tuple[Bag, ...]


def folds_of(
    bags: Sequence[Bag], tests: Sequence[Bag], spans: Sequence[Span]
) -> tuple[Kind, list[Fold]]:
    """Decide what is held out.

    Args:
        bags: Of the fit.
        tests: Bags for the test alone; may be empty.
        spans: First and last stamp of each bag of the fit. [ns]

    Returns:
        ``test`` where there are such bags, ``recordings`` where there are several, else
        ``blocks``; and the folds.

    Raises:
        BagError: If a test holds the messages of a bag of the fit.
    """
    if tests:
        require_distinct([bag.path for bag in bags], [bag.path for bag in tests])
        return "test", [Fold(tuple(bags), tuple(tests))]
    if len(bags) > 1:
        count = min(FOLDS, len(bags))  # neighbours, often alike in temperature, go apart
        return "recordings", [
            Fold(
                tuple(bag for place, bag in enumerate(bags) if place % count != number),
                tuple(bags[number::count]),
            )
            for number in range(count)
        ]
    start, end = spans[0]
    edges = np.linspace(0, end - start, FOLDS + 1).astype(np.int64).tolist()
    guard = round(min(GUARD / NANOSECOND, (end - start) / (4 * FOLDS)))
    blocks = [(start + edges[k], start + edges[k + 1]) for k in range(FOLDS)]
    return "blocks", [Fold((bags[0].without(b, guard),), (bags[0].only(b),)) for b in blocks]
