"""Entry of the command: sub-commands, errors, exit codes."""

from __future__ import annotations

import os
import sys
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Sequence
from typing import cast

from robot_energy import __version__
from robot_energy.cli import (
    identify,
    import_logs,
    info,
    models,
    predict,
    replay,
    reproduce,
    simulate,
)
from robot_energy.errors import RobotEnergyError

DONE, UNEXPECTED, REFUSED, DAMAGED, INTERRUPTED = 0, 1, 2, 3, 130

EPILOG = """\
examples:
  robot-energy models                                list the shipped models
  robot-energy import ur-rtde log_*.csv --out bag    turn a UR recording into a bag
  robot-energy replay bag --model ur3e --plot p.png  where its energy went
  robot-energy replay bag --model ur3e --compare     beside friction that knows no temperature
  robot-energy predict moves.yaml --model kr16 --temperature 20   energy before it is run

exit codes: 0 done; 1 unexpected error; 2 input refused; 3 done, but the bag is damaged
and was read in part; 130 interrupted
"""


def build_parser() -> ArgumentParser:
    """Return the parser of the command and all sub-commands."""
    parser = ArgumentParser(
        prog="robot-energy",
        description="Where each watt of a robot goes: predicted beside measured, from recorded "
        "bags.",
        epilog=EPILOG,
        formatter_class=RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"robot-energy {__version__}")
    parser.set_defaults(debug=False)
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for module in (replay, import_logs, identify, predict, models, info, simulate, reproduce):
        module.add_parser(commands)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command.

    Args:
        argv: Arguments without the name of the command; None: those of the process.

    Returns:
        The exit code: 0 done, 1 unexpected error, 2 input refused, 3 done with a damaged
        bag, 130 interrupted.
    """
    try:
        args = build_parser().parse_args(argv)
    except SystemExit as exit_:  # --help, --version, or a wrong argument
        return exit_.code if isinstance(exit_.code, int) else REFUSED
    args.words = tuple(sys.argv[1:] if argv is None else argv)  # for reports
    run = cast("Callable[[Namespace], int]", args.run)
    try:
        code = run(args)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        return _fail("interrupted", INTERRUPTED)
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
        text = " ".join(str(error).split()) or "no message"
        return _fail(
            f"unexpected error, {type(error).__name__}: {text}; run again with --debug and "
            "report what it prints",
            UNEXPECTED,
        )


def _fail(text: str, code: int) -> int:
    """Print one sentence."""
    print(f"robot-energy: {' '.join(text.split())}", file=sys.stderr)
    return code
