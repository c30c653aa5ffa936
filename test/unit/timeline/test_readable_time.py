import pytest

from robot_energy.timeline.stamps import MAX_STAMP_NS, is_valid_time, readable_time


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


@pytest.mark.parametrize(
    ("seconds", "nanoseconds", "valid"),
    [
        (0, 0, True),
        (1_700_000_000, 999_999_999, True),
        (-1, 5, False),
        (2**31 - 1, 0, False),  # stamps end a day before their seconds
        (5, 1_000_000_000, False),
        (5, -1, False),
    ],
)
def test_a_time_of_a_message_is_valid_or_not(seconds, nanoseconds, valid):
    assert is_valid_time(seconds, nanoseconds) is valid
