# Clarabel ships no types. Everything in it is Any, on purpose; see [tool.pyright].
from typing import Any

def __getattr__(name: str) -> Any: ...
