"""The command: every option has help, and every command in the how-tos is understood."""

import argparse
import re
import shlex
from collections.abc import Iterator

import pytest

from places import ROOT
from robot_energy_cli.main import build_parser

DOCUMENTS = ("README.md", *sorted(p.name for p in (ROOT / "src/doc").glob("*.md")))


@pytest.fixture(scope="module")
def parser():
    return build_parser()


def parsers(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """A parser and all below it."""
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for child in set(action.choices.values()):
                yield from parsers(child)


def test_every_option_has_help():
    every = list(parsers(build_parser()))
    assert len(every) > 10
    missing = [
        f"{parser.prog} {'/'.join(action.option_strings) or action.dest}"
        for parser in every
        for action in parser._actions
        if not action.help
        and not isinstance(action, argparse._SubParsersAction)
        and action.help is not argparse.SUPPRESS
    ]
    assert not missing


def test_every_command_has_a_line_in_the_list_of_its_parent():
    for parser in parsers(build_parser()):
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                listed = {choice.dest for choice in action._choices_actions if choice.help}
                reached = {id(action.choices[name]) for name in listed}
                assert reached == {id(child) for child in action.choices.values()}


def commands(name: str) -> list[tuple[str, bool]]:
    """Every `robot-energy` command of a document, and whether it stands in a block of code."""
    path = ROOT / name if name == "README.md" else ROOT / "src/doc" / name
    text = re.sub(r"\\\n\s*", " ", path.read_text())
    found = set()
    for block in re.findall(r"```\w*\n(.*?)```", text, flags=re.DOTALL):
        lines = re.findall(r"^\s*(?:\$ )?(robot-energy .+)$", block, flags=re.MULTILINE)
        found |= {(" ".join(line.split()), True) for line in lines}
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    lines = re.findall(r"`(robot-energy\s[^`]+)`", prose)
    return sorted(found | {(" ".join(line.split()), False) for line in lines})


@pytest.mark.parametrize(
    ("document", "command", "whole"),
    [(name, *command) for name in DOCUMENTS for command in commands(name)],
)
def test_the_parser_understands(document, command, whole, parser, capsys):
    """In prose a command may lack what it requires; `...` stands for further options."""
    line = re.sub(r"\$\w+", "1", re.sub(r"\s(>|&&|\||;).*$", "", command))
    words = [word for word in shlex.split(line, comments=True)[1:] if word != "..."]
    code = 0
    try:
        parser.parse_args(words)
    except SystemExit as end:
        code = end.code
    text = capsys.readouterr().err
    incomplete = "required" in text and (not whole or "..." in command)
    assert code == 0 or incomplete, f"{document}: {command}\n{text}"


EXAMPLES = sorted(
    {
        line.strip().partition("  ")[0]
        for parser in parsers(build_parser())
        for line in re.sub(r" *\\\n\s*", " ", parser.epilog or "").splitlines()
        if line.startswith("  robot-energy ")
    }
)


@pytest.mark.parametrize("example", EXAMPLES)
def test_the_parser_understands_the_examples_of_the_help(example, parser):
    words = shlex.split(example.partition("|")[0])
    assert parser.parse_args(words[1:]).run is not None


def test_a_wrong_command_is_found(capsys):
    with pytest.raises(SystemExit) as end:
        build_parser().parse_args(shlex.split("replay bags/kr16_cold --modell kr16"))
    assert end.value.code != 0
