"""Errors of the library, recognised by their class and fields instead of their sentences."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

import pytest

from robot_energy.foundation.errors import RobotEnergyError


@contextmanager
def refused(
    kind: type[RobotEnergyError],
    found: str | tuple[str, ...] = (),
    expected: str | tuple[str, ...] = (),
    remedy: str | tuple[str, ...] = (),
) -> Generator[Any]:
    """Expect an error whose fields hold certain names, numbers and places.

    Args:
        kind: Class of the error.
        found: What its ``found`` holds; several texts where all of them must be in it.
        expected: The same of its ``expected``.
        remedy: The same of its ``remedy``.

    Yields:
        What `pytest.raises` gives.
    """
    with pytest.raises(kind) as caught:
        yield caught
    for field, texts in (("found", found), ("expected", expected), ("remedy", remedy)):
        for text in (texts,) if isinstance(texts, str) else texts:
            assert text in getattr(caught.value, field), f"{field} of: {caught.value}"
