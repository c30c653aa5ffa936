"""Any sequence of service calls, steps of the clock, kills and restarts keeps what it said."""

import pytest
import services
import target
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_energy.timeline.stamps import MAX_STAMP_NS

LIMITS = st.sampled_from([0, 1, 2**31 - 1, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1, MAX_STAMP_NS])
NUMBERS = LIMITS | st.integers(0, 2**64 - 1)
TEXTS = st.text(max_size=8) | st.sampled_from(
    ["job", "\U0001f916" * 74, '"' * 100, "x" * 100, "a\nb", "\x1b", " "]
)
CALLS = st.builds(
    services.call,
    st.sampled_from(services.OPERATIONS),
    NUMBERS.map(lambda number: number & ~1023),
    TEXTS,
)


@pytest.fixture(scope="module", autouse=True)
def scratch():
    yield
    target.discard_scratch()


@settings(deadline=None, max_examples=25)
@given(calls=st.lists(CALLS, max_size=25))
def test_what_was_acknowledged_is_there_and_never_more_than_was_measured(calls):
    services.services(b"".join(calls))
