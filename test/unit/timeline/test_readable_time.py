import pytest

from robot_energy.timeline.stamps import MAX_STAMP_NS, readable_time


@pytest.mark.parametrize(
    ("stamp_ns", "text"),
    [
        (0, "0.000 s"),
        (12_500_000_000, "12.500 s"),  # simulated time
        (1_700_000_000_123_999_999, "2023-11-14 22:13:20.123 UTC"),
        (MAX_STAMP_NS, "2038-01-18 03:14:07.000 UTC"),
    ],
)
def test_a_stamp_is_readable(stamp_ns, text):
    assert readable_time(stamp_ns) == text
