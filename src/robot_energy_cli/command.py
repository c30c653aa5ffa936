"""Sub-commands as data: how each is listed, explained and run, and with which options."""

from __future__ import annotations

import math
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable, Iterable, Mapping
from dataclasses import field
from inspect import cleandoc, signature
from typing import Annotated, Any

from robot_energy.foundation.described import Described
from robot_energy.foundation.options import MAX_NUMBER, Option, options_of


def number_type(
    what: str, low: float, high: float, open_low: bool = False, words: tuple[str, ...] = ()
) -> Callable[[str], float | str]:
    """Return a type of arguments.

    Args:
        low: Least value. [its unit]
        high: Greatest value. [its unit]
    """

    def read(text: str) -> float | str:
        if text in words:
            return text
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high or (open_low and value == low):
            raise ArgumentTypeError(f"'{text[:40]}' is not a {what}")
        return value

    return read


number = number_type(f"number from -{MAX_NUMBER:g} to {MAX_NUMBER:g}", -MAX_NUMBER, MAX_NUMBER)
positive = number_type("time in s (above 0)", 0.0, 1e6, open_low=True)
frequency = number_type("frequency in Hz (above 0)", 0.0, MAX_NUMBER, open_low=True)


def whole(text: str) -> int:
    """Return a whole number; an `ArgumentTypeError` if it is none, or beyond 1e9."""
    value = float(number(text))
    if value != int(value):
        raise ArgumentTypeError(f"'{text[:40]}' is not a whole number")
    return int(value)


COUNT = "N"
UNITS = {
    COUNT, "A", "D", "DEGC", "F", "FACTOR", "H", "HZ", "KG", "M", "MM", "MM_PER_S", "MS", "M_PER_S",
    "GB", "K", "PERCENT", "S", "SHARE", "V", "W", "X",
}  # fmt: skip
"""What stands for a number."""
REQUIRED: dict[str, Any] = {"required": True}
LIST: dict[str, Any] = {"nargs": "+"}
SEVERAL: dict[str, Any] = {"action": "append", "default": []}
Options = Mapping[str, "str | tuple[str, dict[str, Any]] | Options"]
"""What each option is or does, perhaps with further words, by its spelling: see `add_option`.

A table in the table is a group of options by its title, perhaps with a line that explains it; of
those of `ONE_OF` only one may be given.
"""
ONE_OF = "one of"
Run = Callable[[Namespace], int]


class Command(Described):
    """A sub-command."""

    name: str
    text: str
    run: Annotated[Run, "Returns the exit code: 0, or 3 if a bag is damaged and was read in part."]
    options: Options | Callable[[ArgumentParser], None] = field(default_factory=dict[str, str])
    description: Annotated[str, "What it does, in its own help; empty for that of the list."] = ""
    epilog: str = ""

    @classmethod
    def of(
        cls, doc: str | None, run: Run, options: Options | Callable[[ArgumentParser], None]
    ) -> Command:
        """Return the command that the docstring of its module, or of its function, describes.

        Its first line has name and text, the rest what the command does, then ``examples:``.
        """
        first, _, rest = cleandoc(doc or "").partition("\n\n")
        name, _, text = first.partition("`: ")
        description, example, epilog = rest.partition("\nexample")
        text = " ".join(text.split()).rstrip(".")
        return cls(name.split()[-1], text, run, options, description, example.strip() + epilog)

    def add_parser(self, commands: Any) -> None:
        """Add it, with the option that all commands have."""
        commands.add_parser(
            self.name,
            help=self.text,
            description=self.description or self.text,
            epilog=self.epilog,
            options=self._add_options,
        )

    def _add_options(self, parser: ArgumentParser) -> None:
        add_option(parser, "--debug", "show the traceback of an error")
        parser.set_defaults(run=self.run)
        if callable(self.options):
            self.options(parser)
        else:
            add_options(parser, self.options)


class Group(Described):
    """A sub-command that has sub-commands."""

    name: str
    text: str
    description: str
    title: str
    metavar: str
    parts: Annotated[Callable[[], Iterable[Command]], "Gives them; asked once all kinds are known."]
    default: Annotated[tuple[str, str, Run] | None, "The one that need not be named."] = None

    def add_parser(self, commands: Any) -> None:
        """Add it with its sub-commands."""
        commands.add_parser(
            self.name, help=self.text, description=self.description, options=self._add_parts
        )

    def _add_parts(self, parser: ArgumentParser) -> None:
        own = parser.add_subparsers(
            title=self.title, metavar=self.metavar, required=self.default is None
        )
        if self.default is not None:
            name, text, run = self.default
            parser.set_defaults(run=run)
            own.add_parser(name, help=text).set_defaults(run=run)
        for part in self.parts():
            part.add_parser(own)


def add_options(group: Any, options: Options) -> None:
    """Add options from a table."""
    for spelled, said in options.items():
        match said:
            case str():
                add_option(group, spelled, said)
            case tuple():
                add_option(group, spelled, said[0], **said[1])
            case _ if spelled == ONE_OF:
                add_options(group.add_mutually_exclusive_group(), said)
            case _:
                title, _, line = spelled.partition("\n")
                add_options(group.add_argument_group(title, line or None), said)


def add_option(group: Any, spelled: str, text: str, **words: Any) -> None:
    """Add an option or argument.

    Args:
        spelled: As its help shows it: ``--out FILE`` takes a text, ``--rate HZ`` a number, as its
            unit says, and ``--details`` nothing, unless further words say more. ``bag`` and
            ``bags BAG`` are arguments; ``--html/--report FILE`` has two names.
    """
    name, _, metavar = spelled.partition(" ")
    if name.startswith("--") and not metavar and not words:
        words["action"] = "store_true"
    elif metavar in UNITS:
        words = {"type": whole if metavar == COUNT else number, "metavar": metavar, **words}
    elif metavar:
        words["metavar"] = metavar
    group.add_argument(*name.split("/"), help=text, **words)


def flags(options: type, *chosen: str) -> dict[str, tuple[str, dict[str, Any]]]:
    """Return a table of the options of a verb that have these names, or belong to these groups."""
    return dict(
        _flag(name, option)
        for name, option in options_of(options).items()
        if {name, option.group} & {*chosen}
    )


def _flag(name: str, option: Option) -> tuple[str, tuple[str, dict[str, Any]]]:
    words: dict[str, Any] = {}
    if option.choices:
        words = {"choices": option.choices, "type": type(option.choices[0])}
    elif option.unit not in ("", "1"):
        words["type"] = number_type(option.expected[2:], option.low, option.high)
    if option.several:
        words |= LIST if option.several == "in a row" else SEVERAL
    if option.default is not None and option.default is not False:
        words["default"] = option.default
    value = option.value or (COUNT if option.unit == "1" else option.unit.upper())
    return f"--{name.replace('_', '-')} {value}".rstrip(), (option.help, words)


def keywords_of(verb: Callable[..., object], args: Namespace) -> dict[str, Any]:
    """Return what was typed under the names of the keywords of a public function."""
    taken = signature(verb).parameters.values()
    names = [each.name for each in taken if each.kind is each.KEYWORD_ONLY]
    return {name: getattr(args, name) for name in names if name in args}
