"""Tables of kinds: everything that is of one kind of drive model, friction law, meter ...

A kind is one object with all its parts; what stands in layers above its table is a `Part`.
Nobody compares the name of a kind: who needs to know something of it asks for a field.
"""

from __future__ import annotations

import difflib
import importlib.util
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoints, entry_points
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, Generic, TypeVar

from robot_energy.foundation.errors import KindError

LIKELY = 0.6  # likeness of two words from which one may be a misspelling of the other
GROUP = "robot_energy.kinds"  # of entry points: modules that register kinds when imported
VARIABLE = "ROBOT_ENERGY_KINDS"  # of the environment: files that register kinds


@dataclass(frozen=True, kw_only=True)
class Kind:
    """What every kind says of itself."""

    name: str
    label: str
    line: str


class Part:
    """A function of a layer above the table of its kind, imported when it is first called.

    So a table is complete whatever was imported before, and imports nothing from above.

    Args:
        name: As ``package.module:function``.
    """

    def __init__(self, name: str) -> None:
        self.name = name

    def __call__(self, *args: Any) -> Any:
        return resolve_name(self.name)(*args)


K = TypeVar("K", bound=Kind)


class Kinds(dict[str, K], Generic[K]):
    """A table of kinds by name, in the order of registration.

    An unknown name is a `KindError` that names the nearest.
    """

    def __init__(self, what: str, *kinds: K) -> None:
        super().__init__({kind.name: kind for kind in kinds})
        self.what = what
        self._listeners: list[Callable[[], None]] = []

    def __missing__(self, name: str) -> K:
        raise KindError(f"the {self.what} '{name}' is unknown", self.expected, self.remedy(name))

    @property
    def expected(self) -> str:
        return "one of " + ", ".join(f"'{name}'" for name in self)

    def remedy(self, name: str) -> str:
        """Return what to write instead of a wrong name; empty where none is near."""
        near = difflib.get_close_matches(name, self, n=1, cutoff=LIKELY)
        return f"write '{near[0]}'" if near else ""

    def register(self, kind: K) -> K:
        """Return a kind, which is known from now on."""
        if kind.name in self:
            raise KindError(f"the {self.what} '{kind.name}' is there already", "another name")
        self[kind.name] = kind
        try:
            self._changed()
        except Exception:
            self.remove(kind.name)
            raise
        return kind

    def remove(self, name: str) -> None:
        del self[name]
        self._changed()

    def on_change(self, listener: Callable[[], None]) -> None:
        self._listeners.append(listener)

    def _changed(self) -> None:
        for listener in self._listeners:
            listener()


def load_kinds() -> None:
    """Import what registers kinds of the user, each once.

    These are the modules of the entry points of `GROUP` and the files that the environment
    variable `VARIABLE` lists.
    """
    for entry in installed(GROUP):
        entry.load()
    for text in filter(None, os.environ.get(VARIABLE, "").split(os.pathsep)):
        path = Path(text).resolve()
        if path not in _loaded:
            _run(path)
            _loaded.add(path)


def installed(group: str) -> EntryPoints:
    """Return what the installed packages declare, read once: that takes 30 ms."""
    return _entry_points().select(group=group)


_entry_points = cache(entry_points)


_loaded: set[Path] = set()


def _run(path: Path) -> None:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None or not path.is_file():
        raise KindError(f"{VARIABLE} names {path}", "a Python file that registers kinds")
    try:
        spec.loader.exec_module(importlib.util.module_from_spec(spec))
    except KindError:
        raise
    except Exception as error:
        raise KindError(
            f"{path} cannot be run ({type(error).__name__}: {error})",
            "a Python file that registers kinds",
            f"correct it, or leave it out of {VARIABLE}",
        ) from error
