"""What is computed at some samples only, cut and joined."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import pytest

from robot_energy.timeline.blocks import Float, HeldRows, Rows

HELD = HeldRows(
    np.arange(8.0).reshape(4, 2),
    np.array([0, 0, 1, 1, 2, 3]),
    np.array([True, False, True, False, True, True]),
)


def test_a_part_holds_what_its_samples_held():
    for rows in (slice(2, 5), np.array([4, 1]), np.array([False, True, True, False, False, True])):
        part = HELD[rows]
        np.testing.assert_array_equal(part, np.asarray(HELD)[rows])
        np.testing.assert_array_equal(part.begins, HELD.begins[rows])
    assert np.asarray(HELD[slice(0, 0)]).shape == (0, 2)


def test_a_part_that_is_joined_again_and_again_does_not_grow():
    """As the last sample of each block in front of the next one."""
    last = HELD[slice(-1, None)]
    for _ in range(50):
        block = HeldRows.concatenate([last, HELD])
        np.testing.assert_array_equal(np.asarray(block)[1:], HELD)
        last = block[slice(-1, None)]
    assert len(block.values) == 5


class Sampled(Rows):
    speed: Annotated[Float, "Shape (N,)."]
    load: Annotated[Float | None, "Shape (N,)."] = None


def test_what_some_rows_lack_is_refused_in_either_order():
    """It would be dropped, or stand at other samples."""
    bare, loaded = Sampled(np.zeros(2)), Sampled(np.zeros(3), np.ones(3))
    assert Sampled.concatenate([bare, bare]).load is None
    np.testing.assert_array_equal(Sampled.concatenate([loaded, loaded]).load, np.ones(6))
    for blocks, words in (
        ([bare, loaded], "load is in some"),
        ([bare, bare, loaded], "load is in some"),
        ([loaded, bare], "same number of dimensions"),  # as numpy says
    ):
        with pytest.raises(ValueError, match=words):
            Sampled.concatenate(blocks)
