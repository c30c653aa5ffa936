"""Options of the tests."""

import gc

import pytest
from hypothesis import HealthCheck, settings

# A busy machine is not a failure: properties have no deadline, and examples may be slow to draw.
# Examples are the same in every run, so that only a change of the code makes a test fail; test/fuzz
# looks for new ones.
settings.register_profile(
    "robot_energy",
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("robot_energy")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-golden",
        action="store_true",
        help="write the golden results again instead of comparing with them",
    )


def pytest_collection_finish() -> None:
    """Keep the collector from what stays: going through it again took a tenth of the time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 20, 20)
