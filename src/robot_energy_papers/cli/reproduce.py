"""`robot-energy reproduce`: the experiments of the papers, done again."""

from __future__ import annotations

from argparse import ArgumentParser
from typing import Any

from robot_energy_papers.cli import reproduce_paper_a, reproduce_paper_b


def add_parser(commands: Any) -> None:
    """Add the sub-command and what can be reproduced."""
    parser: ArgumentParser = commands.add_parser(
        "reproduce",
        help="repeat the experiments of the papers on the virtual rig",
        description="Repeat the experiments of a paper; every figure states its data.",
    )
    papers = parser.add_subparsers(title="papers", metavar="PAPER", required=True)
    for module in (reproduce_paper_a, reproduce_paper_b):
        module.add_parser(papers)
