"""`robot-energy reproduce`: the experiments of the papers, done again."""

from __future__ import annotations

from argparse import ArgumentParser
from typing import Any

from robot_energy.cli import reproduce_paper_a, reproduce_paper_b


def add_parser(commands: Any) -> None:
    """Add the sub-command and what can be reproduced."""
    parser: ArgumentParser = commands.add_parser(
        "reproduce",
        help="the experiments of the papers, done again on the virtual rig",
        description="Do the experiments of a paper again; every figure says what it is of.",
    )
    papers = parser.add_subparsers(title="papers", metavar="PAPER", required=True)
    for module in (reproduce_paper_a, reproduce_paper_b):
        module.add_parser(papers)
