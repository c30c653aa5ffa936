"""Arbitrary and damaged input: counted online, refused in files, never anything else."""

from functools import cache

import pytest
import target
from damage import KINDS, MAX_VALUE, damaged
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from targets import TARGETS

EDITS = st.lists(
    st.tuples(
        st.sampled_from(KINDS),
        st.floats(0, 1),
        st.integers(0, MAX_VALUE),
    ),
    min_size=1,
    max_size=8,
)


@cache
def seeds_of(name):
    """Valid samples of a target; some take long to make."""
    return TARGETS[name].seeds()


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
    seeds = seeds_of(name)
    assert seeds
    assert [seed for seed in seeds if not TARGETS[name].run(seed)] == []


@pytest.mark.parametrize("name", TARGETS)
@profile(6)
@given(st.data())
def test_damage_is_counted_or_refused(name, data):
    seed = data.draw(st.sampled_from(seeds_of(name)))
    TARGETS[name].run(damaged(seed, data.draw(EDITS)))


@pytest.mark.parametrize("name", TARGETS)
@profile(3)
@given(data=st.binary(max_size=400))
def test_any_bytes_are_counted_or_refused(name, data):
    TARGETS[name].run(data)
