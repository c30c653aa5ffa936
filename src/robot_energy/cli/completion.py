"""`robot-energy completion`: the completion script of a shell."""

from __future__ import annotations

import sys
from argparse import Namespace
from typing import Any

from robot_energy.cli.terminal import add_command

SHELLS = ("bash", "zsh", "tcsh")

EPILOG = """\
bash: add  eval "$(robot-energy completion bash)"  to ~/.bashrc
zsh:  write it to a file _robot-energy in a folder of $fpath
"""


def add_parser(commands: Any) -> None:
    """Add the sub-command.

    Args:
        commands: What `ArgumentParser.add_subparsers` returned.
    """
    text = "print the completion script of a shell"
    description = "Print a script that completes commands, options and files."
    parser = add_command(commands, "completion", run, text, description, EPILOG)
    parser.add_argument("shell", choices=SHELLS, help="the shell")


def run(args: Namespace) -> int:
    """Print the script.

    Args:
        args: Of the command, with the name of the shell.

    Returns:
        Exit code 0.
    """
    import shtab

    from robot_energy.cli.main import build_parser

    sys.stdout.write(shtab.complete(build_parser(), args.shell))
    return 0
