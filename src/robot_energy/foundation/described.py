"""Classes whose annotations say what their fields are: for help, schemas and documentation.

``rms: Annotated[float, "Error of the power. [W]"]``. The unit stands in brackets at the end.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass, field
from typing import TypeVar, dataclass_transform

from robot_energy.foundation.options import Option

Class = TypeVar("Class", bound=type)


def texts_of(kind: type) -> dict[str, str]:
    """Return what the annotations of a class and of its bases say of each name, in words."""
    texts: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        for name, annotation in inspect.get_annotations(base, eval_str=True).items():
            about = getattr(annotation, "__metadata__", (None,))[-1]
            if isinstance(about, str | Option):
                texts[name] = str(about)
    return texts


def documented(kind: Class) -> Class:
    """Return a class, its docstring with what its annotations say."""
    kind.__doc__ = inspect.cleandoc(kind.__doc__ or "") + section_of(kind)
    return kind


def section_of(kind: type) -> str:
    lines = "".join(f"\n    {name}: {text}" for name, text in texts_of(kind).items())
    return f"\n\nAttributes:{lines}" if lines else ""


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
class Described:
    """Base of frozen dataclasses, which need no decorator; their docstring has all fields."""

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True)(documented(cls))
