"""The command `robot-energy completion`: a script for a shell."""

from __future__ import annotations

import sys
from argparse import Namespace

from robot_energy_cli.command import Command


def _run(args: Namespace) -> int:
    import shtab

    from robot_energy_cli.main import build_parser

    sys.stdout.write(shtab.complete(build_parser(), args.shell))
    return 0


COMMAND = Command(
    "completion",
    "print the completion script of a shell",
    _run,
    {"shell": ("the shell", {"choices": ("bash", "zsh", "tcsh")})},
    "Print a script that completes commands, options and files.",
    """\
bash: add this line to ~/.bashrc
    eval "$(robot-energy completion bash)"

zsh: write it to a file _robot-energy in a folder of $fpath
    robot-energy completion zsh > ~/.zfunc/_robot-energy
""",
)
