"""Entry of the command: sub-commands, errors, exit codes."""

from __future__ import annotations

import os
import re
import signal
import sys
import threading
from argparse import (
    Action,
    ArgumentError,
    ArgumentParser,
    HelpFormatter,
    Namespace,
)
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from io import TextIOWrapper
from textwrap import wrap
from types import FrameType
from typing import Any, NoReturn, cast

from robot_energy import __version__
from robot_energy.foundation.errors import KindError, RobotEnergyError
from robot_energy.foundation.extras import is_ours, missing
from robot_energy.foundation.kinds import LIKELY, installed, load_kinds
from robot_energy.foundation.shown_text import shown_lines
from robot_energy.foundation.stopping import DEFAULTS, End
from robot_energy_cli import completion
from robot_energy_cli.command import Command
from robot_energy_cli.commands import COMMANDS


class WrappedHelp(HelpFormatter):
    """Fills paragraphs and keeps examples apart; `HelpFormatter` would make one paragraph.

    In a description or an epilog, lines without indent form a paragraph, up to an empty line.
    An indented line stays a line of its own. An example that is too long is continued after
    a backslash, as a shell reads it, and any other line with a deeper indent.
    """

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        whole = re.sub(r" *\\\n\s*", " ", text.strip("\n"))  # examples that are continued
        lines: list[str] = []
        paragraph: list[str] = []
        for line in [*whole.splitlines(), ""]:
            if line and not line.startswith(" "):
                paragraph.append(line)
                continue
            lines += wrap(" ".join(paragraph), width, break_on_hyphens=False)
            paragraph = []
            lines += _indented(line, width)
        return "\n".join(f"{indent}{line}".rstrip() for line in lines).strip("\n") + "\n"


def _indented(line: str, width: int) -> list[str]:
    if len(line) <= width:
        return [line]
    own = " " * (len(line) - len(line.lstrip()))
    deeper = own + " " * 4
    if not line.startswith(f"{own}robot-energy "):
        return wrap(line, width, subsequent_indent=deeper, break_on_hyphens=False)
    first, *parts = re.split(r" (?=--)", line)  # an option stays with its value
    lines = [first]
    for part in parts:
        if len(lines[-1]) + 1 + len(part) <= width - 2:
            lines[-1] += f" {part}"
        else:
            lines[-1] += " \\"
            lines.append(deeper + part)
    return lines


DONE, UNEXPECTED, REFUSED, DAMAGED = 0, 1, 2, 3

FEW = 6  # choices that are all named, even where one of them is near
ENTRY_POINTS = "robot_energy.commands"  # group of those that have an add_parser

EPILOG = """\
examples:
  robot-energy models                             list the shipped models
  robot-energy import ur-rtde LOG --out bag       a UR recording as a bag
  robot-energy replay bag --model ur3e            where its energy went
  robot-energy replay bag --model ur3e --compare  and with fixed friction
  robot-energy test bag --model ur3e              how good the model is on it
  robot-energy predict moves.yaml --model kr16 --temperature 20
                                                  energy before it is run

exit codes: 0 done; 1 unexpected error; 2 input refused; 3 done, but the bag is damaged
and was read in part; 130, 143, 129 interrupted by Ctrl-C, SIGTERM, SIGHUP
"""


class Parser(ArgumentParser):
    """Says in one line what is wrong with the arguments, and what was probably meant.

    Wrong words, such as names of files, are quoted without what acts on a terminal.
    Sub-commands have this class too, and with it the same form of help.
    """

    def __init__(
        self, options: Callable[[ArgumentParser], None] | None = None, **words: Any
    ) -> None:
        words.setdefault("formatter_class", WrappedHelp)
        super().__init__(**words)
        self._options = options

    def complete(self) -> None:
        """Add the options that are still missing."""
        options, self._options = self._options, None
        if options is not None:
            options(self)

    def format_help(self) -> str:
        """Return the help, with all options."""
        self.complete()
        return super().format_help()

    def error(self, message: str) -> NoReturn:
        """Print what is wrong and where the help is, and exit."""
        text = message.replace("the following arguments are required:", "required:")
        for action in self._actions:
            choices: Any = action.choices
            if isinstance(choices, dict) and text == f"required: {action.metavar}":
                text += f", one of {', '.join(cast('dict[str, Any]', choices))}"
        self.exit(REFUSED, shown_lines(f"{self.prog}: {text} (see {self.prog} --help)") + "\n")

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[Any, list[str]]:
        """Return the values, no words; unknown options are refused first, not as missing ones."""
        self.complete()
        words = list(sys.argv[1:] if args is None else args)
        for word in words:
            if word == "--" or (self._subparsers is not None and not word.startswith("-")):
                break  # what follows is not an option, or that of a sub-command
            name = word.partition("=")[0]
            known = [option for option in self._option_string_actions if option.startswith("--")]
            if re.fullmatch("--[a-z][a-z0-9-]*", name) and not any(
                option.startswith(name) for option in known
            ):
                near = _near(name, known)
                self.error(f"there is no option {name}{near and f'; did you mean {near}?'}")
        found, rest = super().parse_known_args(words, namespace)
        if rest:
            self.error(f"too many arguments: {' '.join(rest)}")
        return found, rest

    def _check_value(self, action: Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            names = [str(choice) for choice in action.choices]
            what = action.metavar if isinstance(action.metavar, str) else ""
            place = "/".join(action.option_strings) or what.lower() or action.dest
            near = _near(str(value), names)
            parts = [f"there is no {place} '{value}'"]
            if near:
                parts.append(f"did you mean {near}?")
            if not near or len(names) <= FEW:
                parts.append(f"choose from {', '.join(names)}")
            raise ArgumentError(None, "; ".join(parts).replace("?;", "?"))


def _near(word: str, names: Sequence[str]) -> str:
    return next(iter(get_close_matches(word, names, n=1, cutoff=LIKELY)), "")


class _Version(Action):
    def __call__(self, parser: ArgumentParser, *_: Any) -> None:
        from robot_energy.physics import kernels  # loads numpy

        form = "without compiled kernels" if kernels.compiled is None else "with compiled kernels"
        print(f"robot-energy {__version__} {form}")
        parser.exit()


def build_parser() -> ArgumentParser:
    """Return the parser of the command and all sub-commands, with all options."""
    parser = _parser()
    waiting = [parser]
    while waiting:
        one = waiting.pop()
        one.complete()
        for action in one._actions:  # argparse has no other way to them
            if isinstance(action.choices, dict):
                waiting += cast("dict[str, Parser]", action.choices).values()
    return parser


def _parser() -> Parser:
    """Return the same; a sub-command has its options once it is asked for."""
    parser = Parser(
        prog="robot-energy",
        description="Compute where each watt of a robot goes, from recorded bags, and compare the "
        "prediction with the meter. `import` turns other recordings into bags: UR RTDE (CSV) "
        "and any table as CSV, gzip or Parquet.",
        epilog=EPILOG,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    parser.set_defaults(debug=False, run=_run_help)
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")
    # Those of other packages, such as that of the papers, by the entry points they declare.
    further = [entry.load() for entry in installed(ENTRY_POINTS)]
    for command in (*COMMANDS, *further, completion.COMMAND, HELP):
        command.add_parser(commands)
    return parser


def _run_help(args: Namespace) -> int:
    try:
        _parser().parse_args([*getattr(args, "words", ()), "--help"])
    except SystemExit as exit_:
        return exit_.code if isinstance(exit_.code, int) else REFUSED
    return DONE


HELP = Command(
    "help",
    "show the help of a command",
    _run_help,
    {"words COMMAND": ("and its subject, if any", {"nargs": "*"})},
)


class Stopped(KeyboardInterrupt):
    """A signal to stop was received."""

    def __init__(self, number: int) -> None:
        self.number = signal.Signals(number)
        super().__init__(self.number.name)


@contextmanager
def stoppable() -> Generator[None]:
    """Raise `Stopped` in the block on SIGTERM and SIGHUP, KeyboardInterrupt on SIGINT.

    Those that are ignored, as under nohup, or have a handler of others are left alone.
    """
    main = threading.current_thread() is threading.main_thread()
    found = {number: signal.getsignal(number) for number in DEFAULTS if main}
    changed = {
        number: handler
        for number, handler in found.items()
        if isinstance(handler, End) or handler is signal.SIG_DFL
    }
    try:
        for number in changed:
            asked = signal.default_int_handler if number == signal.SIGINT else _stop
            signal.signal(number, asked)
        yield
    finally:
        for number, handler in changed.items():
            signal.signal(number, handler)


def _stop(number: int, frame: FrameType | None) -> None:
    del frame
    raise Stopped(number)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command.

    Args:
        argv: Arguments without the name of the command; None: those of the process.

    Returns:
        The exit code: 0 done, 1 unexpected error, 2 input refused, 3 done with a damaged
        bag, 128 + the number of the signal that ended it.
    """
    # Before numpy is imported: matrices are small, and more threads only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # No plugin of pydantic is used; to look for one reads all installed packages again.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper) and not stream.encoding.lower().startswith("utf"):
            stream.reconfigure(errors="backslashreplace")  # names may hold any letter
    try:
        load_kinds()
        args = _parser().parse_args(argv)
    except KindError as error:
        return _fail(str(error), REFUSED)
    except SystemExit as exit_:  # --help, --version, or a wrong argument
        return exit_.code if isinstance(exit_.code, int) else REFUSED
    args.command = tuple(sys.argv[1:] if argv is None else argv)  # for reports
    run = cast("Callable[[Namespace], int]", args.run)
    try:
        with stoppable():
            code = run(args)
            sys.stdout.flush()
        return code
    except KeyboardInterrupt as stop:
        number = stop.number if isinstance(stop, Stopped) else signal.SIGINT
        return _fail(f"interrupted ({number.name})", 128 + number)
    except BrokenPipeError:  # the reader of our output has seen enough, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except RobotEnergyError as error:
        if args.debug:
            raise
        return _fail(str(error), REFUSED)
    except OSError as error:
        if args.debug:
            raise
        place = f"{error.filename}: " if error.filename else ""
        remedy = "; expected access rights to it" if isinstance(error, PermissionError) else ""
        return _fail(f"{place}{error.strerror or error}{remedy}", REFUSED)
    except Exception as error:  # a bug of ours; the user still gets one sentence
        if args.debug:
            raise
        lacking = error.name if isinstance(error, ModuleNotFoundError) else None
        if lacking is not None and is_ours(lacking):
            return _fail(str(missing(lacking, "this command")), REFUSED)
        text = " ".join(str(error).split()) or "no message"
        return _fail(
            f"unexpected error, {type(error).__name__}: {text}; run again with --debug and "
            "report what it prints",
            UNEXPECTED,
        )


def _fail(text: str, code: int) -> int:
    print(f"robot-energy: {shown_lines(' '.join(text.split()))}", file=sys.stderr)
    return code
