"""A store of message definitions that parses a definition when somebody asks for it."""

from __future__ import annotations

from collections import UserDict
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, TypeVar, cast

from rosbags.typesys.store import Typestore

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Typesdict

Value = TypeVar("Value")


class _Entries(UserDict[str, Value]):
    """Entries found one by one; a name that is not found so, or counting them, loads all."""

    def __init__(
        self, find: Callable[[str], dict[str, Value]], load: Callable[[], dict[str, Value]]
    ) -> None:
        super().__init__()
        self._find = find
        self._load: Callable[[], dict[str, Value]] | None = load

    def quick(self, name: str) -> bool:
        """Return whether an entry can be had without loading all."""
        if name not in self.data:
            self.data = self._find(name) | self.data
        return name in self.data

    def _complete(self) -> None:
        if self._load is not None:
            load, self._load = self._load, None
            self.data = load() | self.data

    def __contains__(self, name: object) -> bool:
        if not self.quick(str(name)):
            self._complete()
        return name in self.data

    def __missing__(self, name: str) -> Value:
        if name in self:
            return self.data[name]
        raise KeyError(name)

    def __iter__(self) -> Iterator[str]:
        self._complete()
        return super().__iter__()

    def __len__(self) -> int:
        self._complete()
        return super().__len__()


class LazyStore(Typestore):
    """Definitions of messages; making all of them takes longer than reading a short bag.

    Args:
        find: Returns the definition of a type, and of those in it, if it can be had quickly;
            else nothing.
        load: Makes the store of all types, with a Python class for each.
    """

    def __init__(self, find: Callable[[str], Typesdict], load: Callable[[], Typestore]) -> None:
        super().__init__()
        self._entries = _Entries(find, lambda: load().fielddefs)
        self.fielddefs = cast("Typesdict", self._entries)
        self.types = cast("Any", _Entries(lambda _: {}, lambda: load().types))

    def quick(self, name: str) -> bool:
        """Return whether a definition can be had without making all."""
        return self._entries.quick(name)
