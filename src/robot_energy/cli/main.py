"""Entry of the command: sub-commands, errors, exit codes."""

from __future__ import annotations

import os
import signal
import sys
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Sequence
from importlib.metadata import entry_points
from io import TextIOWrapper
from typing import Any, NoReturn, cast

from robot_energy import __version__
from robot_energy.cli import (
    check,
    completion,
    export,
    identify,
    import_logs,
    info,
    kinds,
    models,
    predict,
    replay,
    report,
    schema,
    simulate,
)
from robot_energy.cli.stopping import Stopped, stoppable
from robot_energy.errors import KindError, RobotEnergyError
from robot_energy.kinds import load_kinds
from robot_energy.shown_text import shown_lines

DONE, UNEXPECTED, REFUSED, DAMAGED = 0, 1, 2, 3

# Libraries that only some commands need, and the extra of the package that brings them.
EXTRAS = {
    "clarabel": "identify",
    "threadpoolctl": "identify",
    "matplotlib": "report",
    "jinja2": "papers",
    "starlette": "dashboard",
    "uvicorn": "dashboard",
    "prometheus_client": "dashboard",
}
COMMANDS = "robot_energy.commands"  # group of entry points: modules with add_parser

EPILOG = """\
examples:
  robot-energy models                                list the shipped models
  robot-energy import ur-rtde log_*.csv --out bag    convert a UR recording to a bag
  robot-energy replay bag --model ur3e --plot p.png  where its energy went
  robot-energy replay bag --model ur3e --compare     compare with friction at one temperature
  robot-energy predict moves.yaml --model kr16 --temperature 20   energy before it is run

exit codes: 0 done; 1 unexpected error; 2 input refused; 3 done, but the bag is damaged
and was read in part; 130, 143, 129 interrupted by Ctrl-C, SIGTERM, SIGHUP
"""


class Parser(ArgumentParser):
    """Quotes wrong arguments, such as names of files, without what acts on a terminal."""

    def error(self, message: str) -> NoReturn:
        """Print usage and what is wrong, and exit."""
        super().error(shown_lines(message))


def build_parser() -> ArgumentParser:
    """Return the parser of the command and all sub-commands."""
    parser = Parser(
        prog="robot-energy",
        description="Compute where each watt of a robot goes, from recorded bags, and compare the "
        "prediction with the meter.",
        epilog=EPILOG,
        formatter_class=RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"robot-energy {__version__}")
    parser.set_defaults(debug=False)
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for module in (
        replay, report, export, import_logs, check, identify, predict, models, kinds, info,
        simulate, schema,
        *_further(),
        completion,
    ):  # fmt: skip
        module.add_parser(commands)
    return parser


def _further() -> list[Any]:
    """Commands of other packages, such as that of the papers, by the entry points they declare."""
    return [entry.load() for entry in entry_points(group=COMMANDS)]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command.

    Args:
        argv: Arguments without the name of the command; None: those of the process.

    Returns:
        The exit code: 0 done, 1 unexpected error, 2 input refused, 3 done with a damaged
        bag, 128 + the number of the signal that ended it.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper) and not stream.encoding.lower().startswith("utf"):
            stream.reconfigure(errors="backslashreplace")  # names may hold any letter
    try:
        load_kinds()
        args = build_parser().parse_args(argv)
    except KindError as error:
        return _fail(str(error), REFUSED)
    except SystemExit as exit_:  # --help, --version, or a wrong argument
        return exit_.code if isinstance(exit_.code, int) else REFUSED
    args.words = tuple(sys.argv[1:] if argv is None else argv)  # for reports
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
        return _fail(f"{place}{error.strerror or error}", REFUSED)
    except Exception as error:  # a bug of ours; the user still gets one sentence
        if args.debug:
            raise
        lacking = str(getattr(error, "name", None) or "").split(".")[0]
        if isinstance(error, ModuleNotFoundError) and lacking in EXTRAS:
            return _fail(
                f"this command needs {lacking}, which is not installed; install it: pip install "
                f"'robot_energy[{EXTRAS[lacking]}]', or {lacking} alone",
                REFUSED,
            )
        text = " ".join(str(error).split()) or "no message"
        return _fail(
            f"unexpected error, {type(error).__name__}: {text}; run again with --debug and "
            "report what it prints",
            UNEXPECTED,
        )


def _fail(text: str, code: int) -> int:
    """Print one sentence."""
    print(f"robot-energy: {shown_lines(' '.join(text.split()))}", file=sys.stderr)
    return code
