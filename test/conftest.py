"""Options of the tests."""

import pytest
from hypothesis import settings

# A busy machine is no failure: properties have no deadline.
settings.register_profile("robot_energy", deadline=None)
settings.load_profile("robot_energy")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-golden",
        action="store_true",
        help="write the golden results anew instead of comparing with them",
    )
