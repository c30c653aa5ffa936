"""`robot-energy completion`: the completion script of a shell."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from typing import Any

SHELLS = ("bash", "zsh", "tcsh")

EPILOG = """\
bash: add  eval "$(robot-energy completion bash)"  to ~/.bashrc
zsh:  write it to a file _robot-energy in a folder of $fpath
"""


def add_parser(commands: Any) -> None:
    """Add the sub-command."""
    parser: ArgumentParser = commands.add_parser(
        "completion",
        help="print the completion script of a shell",
        description="Print a script that completes commands, options and files.",
        epilog=EPILOG,
        formatter_class=RawDescriptionHelpFormatter,
    )
    parser.add_argument("shell", choices=SHELLS, help="the shell")
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Print the script; return the exit code."""
    import shtab

    from robot_energy.cli.main import build_parser

    sys.stdout.write(shtab.complete(build_parser(), args.shell))
    return 0
