"""One BLAS thread for small matrices."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any, ParamSpec, TypeVar

from robot_energy.foundation.extras import require

P = ParamSpec("P")
T = TypeVar("T")


def one_thread(function: Callable[P, T]) -> Callable[P, T]:
    """Return a function that keeps to one BLAS thread while it runs.

    The matrices of the fits are small: more threads only wait for each other.
    """

    @wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        with _blas(len(sys.modules)).limit(limits=1):
            return function(*args, **kwargs)

    return run


@lru_cache(1)
def _blas(modules: int) -> Any:
    """Libraries that are loaded, looked up again once more modules are."""
    del modules
    require("threadpoolctl", "identification")
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
