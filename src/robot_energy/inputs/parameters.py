"""Dataclasses whose fields are parameters: described once, read from a node or from a file.

`assemble` asks for every value by name, and adds whose they are to the errors of `__post_init__`.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import MISSING, field, fields, replace
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, cast, get_type_hints

from robot_energy.foundation.described import Described
from robot_energy.foundation.errors import ParameterError
from robot_energy.foundation.options import options_of
from robot_energy.inputs.options import InputOptions

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

D = TypeVar("D", bound="DataclassInstance")
KINDS: dict[Any, str] = {
    bool: "true or false",
    int: "an integer",
    float: "a number",
    str: "a text",
    tuple[str, ...]: "a list of texts",
    tuple[float, ...]: "a list of numbers",
}
MAX_BYTES = 1024 * 1024  # of a parameter file
HEADER, RECEIVE = "header", "receive"  # sources of stamps, the same words for every input
MESSAGES, POSITIONS = "messages", "positions"  # sources of velocities
GROUP_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


class Parameter(Described):
    """One parameter: its full name and what its field says about it."""

    name: Annotated[str, "Full name, such as ``motors.topic``."]
    kind: Any
    default: Annotated[Any, "Value where none is given; ``dataclasses.MISSING`` if it is required."]
    description: str = ""
    bounds: Annotated[
        tuple[float, float] | None, "Least and greatest value allowed; None for any."
    ] = None
    choices: Annotated[tuple[str, ...], "The texts allowed; empty for any."] = ()

    @property
    def expected(self) -> str:
        """What a value must be, in words."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        kind = KINDS[self.kind]
        return "{} from {} to {}".format(kind, *self.bounds) if self.bounds else kind

    def check(self, value: Any, owner: str) -> Any:
        """Return a value in the type of the field.

        Args:
            value: As given; an integer serves as a number, a list as a tuple. Empty texts
                in a list count for nothing, as some formats cannot say an empty list.
        """
        given = value
        if self.kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if self.kind == tuple[float, ...]:
            return self._numbers(value, owner)
        if self.kind == tuple[str, ...]:
            fits = isinstance(value, list | tuple)
            items = cast("Sequence[Any]", value) if fits else ()
            fits = fits and all(isinstance(item, str) for item in items)
            value = tuple(item for item in items if item)
        else:
            fits = type(value) is self.kind
            fits = fits and not (self.kind is float and not math.isfinite(value))
        if fits and self.bounds is not None:
            fits = self.bounds[0] <= value <= self.bounds[1]
        if not fits or (self.choices and value not in self.choices):
            raise ParameterError(f"parameter '{self.name}' of {owner} is {given!r}", self.expected)
        return value

    def _numbers(self, value: Any, owner: str) -> tuple[float, ...]:
        """Check a list of numbers, each in the range; services of ROS bring an array."""
        items = cast("Sequence[Any]", value) if isinstance(value, list | tuple | array) else ()
        one = replace(self, kind=float)
        try:
            found = tuple(one.check(item, owner) for item in items)
        except ParameterError:
            found = ()
        if not found:
            given = list(items) or cast("Any", value)
            raise ParameterError(f"parameter '{self.name}' of {owner} is {given!r}", self.expected)
        return found


def parameter(
    description: str,
    default: Any = MISSING,
    bounds: tuple[float, float] | None = None,
    choices: Collection[str] = (),
) -> Any:
    """Return a field that describes one parameter; without a default it is required.

    Args:
        bounds: Least and greatest value allowed; None for any. [unit of the parameter]
        choices: The texts allowed, or a table of kinds; empty for any.
    """
    metadata = {"description": description, "bounds": bounds, "choices": choices}
    return field(default=default, metadata=metadata)


def setting(name: str, default: Any, bounds: tuple[float, float] | None = None) -> Any:
    """Return a field with the text, range and choices of an option that verbs have as well.

    Args:
        bounds: Least and greatest value, where a node allows less. [unit of the option]
    """
    option = options_of(InputOptions)[name]
    text, unit = str(replace(option, absent="", unit="", value="")).removesuffix("."), option.unit
    if not unit:
        return parameter(f"{text}.", default, choices=cast("Any", option.choices))
    return parameter(f"{text} [{unit}].", default, bounds or (option.low, option.high))


def group(cls: type[D]) -> D:
    """A field that holds the parameters of ``cls`` as ``<field>.<name>``, as in ``meter.topic``."""
    return field(default_factory=cls, metadata={"group": cls, "how": "named"})


def named_groups(
    cls: type[D],
    description: str,
    *names: str,
    check: Callable[[Mapping[str, D]], None] = lambda groups: None,
) -> Mapping[str, D]:
    """Return a field of any number of ``cls`` by name; the names are a parameter.

    For each name N there are the parameters ``N.<name>``.

    Args:
        cls: The dataclass of one group; all its fields must have defaults.
        check: Raises a `ParameterError` if the groups do not fit together.
    """
    metadata = {
        "group": cls,
        "how": "many",
        "description": description,
        "names": names,
        "check": check,
    }
    made: Mapping[str, D] = field(
        default_factory=lambda: {name: cls() for name in names}, metadata=metadata
    )
    return made


def assemble(cls: type[D], value_of: Callable[[Parameter], Any], owner: str) -> D:
    """Return an instance of a dataclass of parameters, each asked for once, in order."""
    taken = {entry.name for entry in fields(cls)}
    return _assemble(cls, value_of, owner, "", taken)


def _assemble(
    cls: type[D], value_of: Callable[[Parameter], Any], owner: str, prefix: str, taken: set[str]
) -> D:
    values: dict[str, Any] = {}
    hints = get_type_hints(cls)
    for entry in fields(cls):
        name, about = prefix + entry.name, entry.metadata
        inner = cast("type[Any]", about.get("group"))
        match about.get("how"):
            case "named":
                value = _assemble(inner, value_of, owner, f"{name}.", taken)
            case "many":
                asked = Parameter(name, tuple[str, ...], about["names"], about["description"])
                names = _group_names(value_of(asked), name, owner, taken)
                value = {
                    each: _assemble(inner, value_of, owner, f"{prefix}{each}.", taken)
                    for each in names
                }
                _own(about["check"], value, owner, prefix)
            case _:
                rest = {key: about[key] for key in ("description", "bounds")}
                rest["choices"] = tuple(about["choices"])
                value = value_of(Parameter(name, hints[entry.name], entry.default, **rest))
        values[entry.name] = value
    return _own(lambda given: cls(**given), values, owner, prefix)


def _own(action: Callable[[Any], Any], value: Any, owner: str, prefix: str) -> Any:
    """Do something with values; say in its error whose they are."""
    try:
        return action(value)
    except ParameterError as error:
        whose = f"'{prefix[:-1]}' of {owner}" if prefix else owner
        raise ParameterError(f"{whose}: {error.found}", error.expected, error.remedy) from None


def _group_names(
    names: tuple[str, ...], parameter_name: str, owner: str, taken: set[str]
) -> tuple[str, ...]:
    for name in names:
        if not GROUP_NAME.fullmatch(name) or names.count(name) > 1 or name in taken:
            why = "twice" if names.count(name) > 1 else "which cannot name a group"
            raise ParameterError(
                f"parameter '{parameter_name}' of {owner} has '{name}' {why}",
                "names of letters, digits and _, each once, and of no other parameter",
            )
    return names
