"""Arbitrary and damaged input: counted online, refused in files, never anything else."""

import pytest
import target
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from targets import TARGETS

EDITS = st.lists(
    st.tuples(
        st.sampled_from(["flip", "put", "cut", "repeat", "number", "splice"]),
        st.floats(0, 1),
        st.integers(0, 2**32 - 1),
    ),
    min_size=1,
    max_size=8,
)
NUMBERS = [b"nan", b"inf", b"-1", b"0", b"1e308", b"1e400", b"9" * 20, b"~", b"[", b"{"]
WORDS = [b"\x00" * 8, b"\xff" * 8, b"\xff\xff\xff\x7f", bytes.fromhex("000000000000f07f"),
         bytes.fromhex("000000000000f87f"), bytes.fromhex("a0c8eb85f3cce17f")]  # fmt: skip


def damaged(seed: bytes, edits) -> bytes:
    """A valid sample after some edits."""
    data = bytearray(seed)
    for kind, share, value in edits:
        place = int(share * len(data))
        if kind == "flip" and data:
            data[min(place, len(data) - 1)] ^= 1 << value % 8
        elif kind == "put":
            word = WORDS[value % len(WORDS)]
            data[place : place + len(word)] = word
        elif kind == "cut":
            del data[place : place + value % 64]
        elif kind == "repeat":
            data[place:place] = data[place : place + value % 64]
        elif kind == "number":
            data[place : place + value % 5] = NUMBERS[value % len(NUMBERS)]
        elif kind == "splice":
            other = value % (len(data) + 1)
            data[place : place + 16] = data[other : other + 16]
    return bytes(data)


@pytest.fixture(scope="module", autouse=True)
def scratch():
    yield
    target.discard_scratch()


def profile(examples):
    return settings(
        max_examples=examples,
        deadline=None,
        derandomize=True,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
    )


@pytest.mark.parametrize("name", TARGETS)
def test_valid_samples_are_taken(name):
    """Otherwise damage to them would prove nothing."""
    seeds = TARGETS[name].seeds()
    assert seeds
    assert [seed for seed in seeds if not TARGETS[name].run(seed)] == []


@pytest.mark.parametrize("name", TARGETS)
@profile(60)
@given(st.data())
def test_damage_is_counted_or_refused(name, data):
    seed = data.draw(st.sampled_from(TARGETS[name].seeds()))
    TARGETS[name].run(damaged(seed, data.draw(EDITS)))


@pytest.mark.parametrize("name", TARGETS)
@profile(20)
@given(data=st.binary(max_size=400))
def test_any_bytes_are_counted_or_refused(name, data):
    TARGETS[name].run(data)
