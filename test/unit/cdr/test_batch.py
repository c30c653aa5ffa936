"""RawBatch: messages inside one buffer."""

import numpy as np
import pytest

from refusals import refused
from robot_energy.bag.cdr import RawBatch
from robot_energy.foundation.errors import ShapeError


def test_messages_received_one_by_one_are_kept_whole():
    batch = RawBatch.from_messages("/a", "x/msg/Y", [5, 7, 9], [b"one", b"", b"three"])
    assert len(batch) == 3
    assert [batch.row(i) for i in range(3)] == [b"one", b"", b"three"]
    assert batch.row(-1) == b"three"
    assert batch.offset.tolist() == [0, 3, 3]
    assert batch.length.tolist() == [3, 0, 5]
    assert batch.log_time_ns.dtype == np.int64


def test_no_messages_make_an_empty_batch():
    assert len(RawBatch.from_messages("/a", "x/msg/Y", [], [])) == 0


def test_as_many_times_as_messages_are_asked_for():
    with refused(ShapeError, found=("2 messages", "/a", "(1,)"), expected="(2,)"):
        RawBatch.from_messages("/a", "x/msg/Y", [1], [b"a", b"b"])


@pytest.mark.parametrize(("offset", "length"), [(-1, 2), (2, 3), (5, 0), (0, -1)])
def test_a_row_outside_the_buffer_is_refused(offset, length):
    batch = RawBatch(
        "/a",
        "x/msg/Y",
        np.array([0]),
        np.zeros(4, np.uint8),
        np.array([offset]),
        np.array([length]),
    )
    with pytest.raises(ShapeError):
        batch.row(0)
