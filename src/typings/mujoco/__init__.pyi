# The types of MuJoCo lack what its compiled parts export, so everything in it is Any; see [tool.pyright].
from typing import Any

def __getattr__(name: str) -> Any: ...
