"""Options of the verbs: each said once, for the keyword, the command and the documentation.

The options of a verb are the keys of a TypedDict. The annotation of a key says what it is:
``Annotated[float | None, Option("length of a cycle", unit="s", low=0.0)]``. What only Python can
be given has a sentence in place of the `Option`.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass
from difflib import get_close_matches
from numbers import Real
from typing import Annotated, Literal, TypeVar, cast

from robot_energy.foundation.errors import OptionError, ParameterError
from robot_energy.foundation.kinds import LIKELY

Verb = TypeVar("Verb", bound=Callable[..., object])
MAX_NUMBER = 1e9  # larger than any figure of a robot, whatever its unit
FLAG = re.compile(r"--([a-z-]+)")


@dataclass(frozen=True)
class Option:
    """What one option is."""

    text: Annotated[
        str, "What it does, in words that fit the command as well as the documentation."
    ]
    unit: Annotated[str, "Of a number; ``1`` for a whole one."] = ""
    absent: Annotated[
        str, "What holds where it is not given and no `default` says so; empty if the text does."
    ] = ""
    value: Annotated[str, "What stands for any other value in the help; empty for a switch."] = ""
    low: Annotated[float, "Least number allowed. [its unit]"] = -MAX_NUMBER
    high: Annotated[float, "Greatest number allowed. [its unit]"] = MAX_NUMBER
    choices: Annotated[tuple[object, ...], "The values allowed; empty for any."] = ()
    default: Annotated[object, "Value where none is given."] = None
    several: Annotated[
        Literal["", "in a row", "repeated"], "How a command takes several values."
    ] = ""
    group: Annotated[str, "Title in the help."] = ""

    @property
    def expected(self) -> str:
        """What a value must be, in words."""
        if self.choices:
            return f"one of {', '.join(map(str, self.choices))}"
        if isinstance(self.default, bool):
            return "True or False"
        return f"a number from {self.low:g} to {self.high:g}"

    def check(self, name: str, value: object, verb: str) -> None:
        several = self.several and not isinstance(value, str)
        values = cast("Collection[object]", value) if several else (value,)
        fits = not self.choices or all(one in self.choices for one in values)
        if isinstance(self.default, bool):
            fits = isinstance(value, bool)
        if self.unit and not self.choices:
            fits = not isinstance(value, bool) and isinstance(value, Real)
            fits = fits and self.low <= cast("float", value) <= self.high
            fits = fits and (self.unit != "1" or value == int(cast("float", value)))
        if not fits:
            raise ParameterError(f"parameter '{name}' of {verb} is {value!r}", self.expected)

    @property
    def help(self) -> str:
        """What it is, in the help of the command."""
        about = ["one of %(choices)s"] if self.value and self.choices else []
        about += [f"default: {self.absent}"] if self.absent else []
        return f"{self.text} ({'; '.join(about)})" if about else self.text

    def __str__(self) -> str:
        text = self.help.replace("%(choices)s", ", ".join(map(str, self.choices)))
        text = FLAG.sub(lambda flag: f"``{flag[1].replace('-', '_')}``", text)
        return f"{text[:1].upper()}{text[1:]}." + (f" [{self.unit}]" if self.unit else "")


def options_of(options: type) -> dict[str, Option]:
    """Return what a command can be given of the options of a verb."""
    kinds = inspect.get_annotations(options)
    return {
        name: kind.__metadata__[0]
        for name, kind in kinds.items()
        if isinstance(kind.__metadata__[0], Option)
    }


def takes(options: type) -> Callable[[Verb], Verb]:
    """Return a decorator that shows the options of a verb in place of ``**options``.

    The verb refuses an option that it does not show, as an `OptionError`, and a value that makes
    no sense. What is None was not given.
    """
    kinds, checks = inspect.get_annotations(options), options_of(options)
    shared = [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=checks[name].default if name in checks else None,
            annotation=getattr(kind.__origin__, "__forward_arg__", kind.__origin__),
        )
        for name, kind in kinds.items()
    ]

    def shown(verb: Verb) -> Verb:
        signature = inspect.signature(verb)
        own = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        known = [parameter.name for parameter in (*own, *shared)]

        @functools.wraps(verb)
        def checked(*values: object, **given: object) -> object:
            for name in sorted({*given} - {*known}):
                near = get_close_matches(name, known, 1, LIKELY)
                expected = f"'{near[0]}'?" if near else f"one of {', '.join(sorted(known))}"
                raise OptionError(f"{verb.__name__} has no option '{name}'", expected)
            used = {name: v for name, v in given.items() if v is not None or name not in kinds}
            for name, value in used.items():
                if name in checks:
                    checks[name].check(name, value, verb.__name__)
            return verb(*values, **used)

        checked.__dict__["__signature__"] = signature.replace(parameters=[*own, *shared])
        return cast(Verb, checked)

    return shown
