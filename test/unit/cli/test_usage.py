"""Wrong arguments: one line says what is wrong, what was probably meant, and where the help is."""

from argparse import ArgumentParser, _SubParsersAction
from collections.abc import Iterator

import pytest

from places import ROOT
from robot_energy_cli import main
from robot_energy_cli.main import WrappedHelp, build_parser

PROGRAMS = ROOT / "src/examples/programs"
PROGRAM, LAYER = PROGRAMS / "kr16_pick_and_place.yaml", PROGRAMS / "wall_layer.gcode"
AT = ("--model", "kr16", "--temperature", "20")
BAGS, URDF = ROOT / "bags", ROOT / "src/robot_energy/models/ur5e.urdf"


@pytest.mark.parametrize("words", [[], ["help"], ["--help"]])
def test_the_command_alone_prints_its_help(words, capsys):
    assert main(words) == 0
    out, err = capsys.readouterr()
    assert "exit codes:" in out
    assert err == ""


def every(parser: ArgumentParser) -> Iterator[ArgumentParser]:
    """The parser and those of all its commands."""
    yield parser
    for action in parser._actions:
        if isinstance(action, _SubParsersAction):
            for command in action.choices.values():
                yield from every(command)


@pytest.mark.parametrize("columns", ["40", "80", "200"])
def test_every_command_has_help_and_usage(columns, monkeypatch):
    monkeypatch.setenv("COLUMNS", columns)
    parsers = list(every(build_parser()))
    assert len(parsers) > 40
    for parser in parsers:
        assert parser.format_help().startswith(parser.format_usage())


def test_no_line_of_any_help_is_wider_than_80_columns(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    wide = [
        f"{parser.prog}: {line}"
        for parser in every(build_parser())
        for line in parser.format_help().splitlines()
        if len(line) > 80
    ]
    assert not wide


def test_every_help_is_written_by_one_class():
    assert {parser.formatter_class for parser in every(build_parser())} == {WrappedHelp}


def test_paragraphs_are_filled_and_examples_stay_commands(monkeypatch):
    monkeypatch.setenv("COLUMNS", "42")
    parser = ArgumentParser(
        prog="p",
        formatter_class=WrappedHelp,
        add_help=False,
        description="One sentence\nin two lines of the source.\n\nAnother paragraph.",
        epilog="examples:\n  robot-energy short\n"
        "  robot-energy long --model m.yaml \\\n    --effort motor_torque --out o.yaml\n",
    )
    assert parser.format_help().splitlines()[2:] == [
        "One sentence in two lines of the source.",
        "",
        "Another paragraph.",
        "",
        "examples:",
        "  robot-energy short",
        "  robot-energy long --model m.yaml \\",
        "      --effort motor_torque \\",
        "      --out o.yaml",
    ]


@pytest.mark.parametrize("option", ["--inputs", "--model", "--effort", "--report", "--json"])
def test_an_option_names_its_value_alike_in_all_commands(option):
    names = {
        action.metavar
        for parser in every(build_parser())
        for action in parser._actions
        if option in action.option_strings
    }
    assert len(names) == 1, names
    assert None not in names


def test_help_of_a_subject(capsys):
    assert main(["help", "identify", "dynamics"]) == 0
    assert capsys.readouterr().out.startswith("usage: robot-energy identify dynamics ")


@pytest.mark.parametrize(
    ("words", "who", "said"),
    [
        (["repaly", "bag"], "robot-energy", "no command 'repaly'; did you mean replay?"),
        (["help", "repaly"], "robot-energy", "did you mean replay?"),
        (["fly"], "robot-energy", "no command 'fly'; choose from replay, report,"),
        (["predict", "p", "--modle", "kr16"], "robot-energy predict", "did you mean --model?"),
        (["predict", "p", "--modle=kr16"], "robot-energy predict", "no option --modle;"),
        (["identify", "all", "--efort=x"], "robot-energy identify all", "did you mean --effort?"),
        (["replay", "b", "--effort", "motor_torqe"], "robot-energy replay", "mean motor_torque?"),
        (["replay", "a", "b"], "robot-energy replay", "too many arguments: b"),
        (["replay"], "robot-energy replay", "required: bag"),
        (["identify"], "robot-energy identify", "required: STEP, one of all, excitation,"),
        (["identify", "bag"], "robot-energy identify", "no step 'bag'; choose from all,"),
        (["history"], "robot-energy history", "required: ACTION, one of export, report,"),
        (["model", "chek", "kr16"], "robot-energy model", "did you mean check?"),
        (["--verson"], "robot-energy", "did you mean --version?"),
        (["replay", "b\x1b[2J", "c\x1b[2J"], "robot-energy replay", r"too many arguments: c\x1b["),
    ],
)
def test_a_wrong_word_is_answered_in_one_line(words, who, said, capsys):
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"{who}: ")
    assert said in err
    assert err.endswith(f" (see {who} --help)\n")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["replay", str(BAGS), "--model", "kr16"],
            f"name one in it, such as {BAGS}/drawn_test_cold;",
        ),
        (["replay", str(BAGS / "kr16_cold")], "`robot-energy models` lists the shipped models"),
        (["model", "check", str(URDF)], "begin one from it with `robot-energy model init`"),
        (["predict", str(PROGRAM), *AT, "--payload", "8@flang"], "link_6, flange, tool0."),
        (["predict", str(LAYER), *AT], "move the work piece (--base), or begin with another"),
        (["shared-bus", str(BAGS / "kr16_cold"), "--model", "kr16"], "one for each robot"),
        (
            ["check", str(BAGS / "kr16_cold"), *AT[:2], "--effort", "joint_torque"],
            "parameter file (--inputs), or --effort motor_torque\n",
        ),
        (
            ["identify", "dynamics", str(BAGS / "kr16_cold"), *AT[:2], "--effort", "joint_torque"],
            "{effort_meaning: motor_torque}, or --effort motor_torque;",
        ),
        (["fleet", "run", "gone", "--model", "kr16", "--out", "new"], "gone does not exist"),
        (["fleet", "report", "gone"], "gone does not exist"),
    ],
)
def test_a_wrong_file_is_answered_with_what_to_type(words, said, capsys):
    assert main(words) == 2
    assert said.lower() in "".join(capsys.readouterr()).lower()


def test_what_begins_like_one_option_is_that_option(capsys):
    assert main(["replay", "/nothing", "--mod", "kr16"]) == 2
    assert "/nothing" in capsys.readouterr().err
