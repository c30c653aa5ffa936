# MuJoCo types lack what its compiled parts export, so all of it is Any; see [tool.pyright].
from typing import Any

def __getattr__(name: str) -> Any: ...
