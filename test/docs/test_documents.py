"""What the documents say is what the code does."""

import re
import shlex
from itertools import pairwise

import pytest

from places import ROOT
from robot_energy.timeline.blocks import (
    MeterLocation,
    MeterMeaning,
    Phase,
    Quality,
    TemperatureOrigin,
)
from robot_energy.timeline.stamps import BACKWARD_JUMP_NS
from robot_energy_cli.main import build_parser, main

README = (ROOT / "README.md").read_text()
COMMANDS = README + (ROOT / "src/doc/commands.md").read_text()
NOMENCLATURE = (ROOT / "src/doc/nomenclature.md").read_text()


def listed_commands():
    """Every `robot-energy` command of README and the list of commands, as it stands there."""
    found = re.findall(r"`(robot-energy [^`]+)`", " ".join(COMMANDS.split()))
    found += re.findall(r"^(robot-energy .+)$", COMMANDS, flags=re.MULTILINE)
    return sorted(set(found))


# Commands that need a file of the reader's own.
OWN_FILES = ("LOG.csv", "log.csv", "MY_ROBOT.yaml", "MAPPING.yaml", "FOLDER")


def test_commands_are_found():
    assert len(listed_commands()) >= 8


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """A folder in place of build, and the commands that have run in it."""
    return tmp_path_factory.mktemp("build"), []


@pytest.mark.parametrize("command", listed_commands())
def test_listed_command_runs(command, build, monkeypatch, capsys):
    folder, done = build
    monkeypatch.chdir(ROOT)
    words = shlex.split(command)[1:]
    if any(name in command for name in OWN_FILES):
        words = [*words[:2], "--help"] if words[0] in ("import", "model", "identify") else words
    if words[0] == "reproduce":  # minutes; the short forms run in test/unit/papers
        build_parser().parse_args(words)
        return
    steps = [words]
    made_by = {"build/fleet": "fleet run", "build/at_work": "simulate --plant-seed"}
    if words[0] in ("fleet", "replay"):  # of what the command before it made
        maker = next((made_by[word] for word in words[1:3] if word in made_by), None)
        begin = f"robot-energy {maker}"
        steps = [*(shlex.split(c)[1:] for c in listed_commands() if c.startswith(begin)), words]
    for step in steps:
        if step not in done:
            places = [str(folder / w[6:]) if w.startswith("build/") else w for w in step]
            if step[:2] == ["fleet", "run"]:  # workers start for seconds
                places += ["--workers", "0"]
            assert main(places) == 0, capsys.readouterr().err
            assert capsys.readouterr().out
            done.append(step)


@pytest.mark.parametrize(
    "target", sorted(set(re.findall(r"(?:`|^)make ([a-z]+)", COMMANDS, flags=re.MULTILINE)))
)
def test_make_target_of_the_readme_exists(target):
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)


@pytest.mark.parametrize(
    "document",
    [
        "README.md",
        *(path.relative_to(ROOT).as_posix() for path in sorted((ROOT / "src/doc").glob("**/*.md"))),
    ],
)
def test_links_lead_somewhere(document):
    path = ROOT / document
    for link in re.findall(r"\]\(([^)#]+)", path.read_text()):
        if not link.startswith("http"):
            assert (path.parent / link).exists(), f"{document} links to {link}"


def test_no_line_begins_with_a_per_cent_sign():
    """The site takes such a line for a comment and does not show it."""
    for path in (ROOT / "src/doc").glob("**/*.md"):
        assert not re.search(r"^ *%.*", path.read_text(), flags=re.MULTILINE), path


def constants(message):
    text = (ROOT / f"ros2_energy_msgs/msg/{message}.msg").read_text()
    return {
        name: int(value)
        for name, value in re.findall(r"^u?int\d+ ([A-Z_]+) *= *(\d+)", text, flags=re.MULTILINE)
    }


@pytest.mark.parametrize(
    ("message", "prefix", "enumeration"),
    [
        ("Quality", "", Quality),
        ("PowerState", "PHASE_", Phase),
        ("PowerState", "LOCATION_", MeterLocation),
        ("PowerReading", "LOCATION_", MeterLocation),
        ("PowerReading", "MEANING_", MeterMeaning),
        ("JointFriction", "SOURCE_", TemperatureOrigin),
    ],
)
def test_constants_of_messages_and_code_are_the_same(message, prefix, enumeration):
    found = {
        name.removeprefix(prefix): value
        for name, value in constants(message).items()
        if name.startswith(prefix)
    }
    expected = {name: int(member) for name, member in enumeration.__members__.items()}
    assert found == expected


def test_nomenclature_names_every_quality_bit_and_reason():
    for bit in Quality:
        assert f"| {int(bit)} | `{bit.name}` |" in NOMENCLATURE
    sources = [
        *(ROOT / "src/robot_energy/inputs").rglob("*.py"),
        *(ROOT / "src/robot_energy/messages").glob("*.py"),
        *(ROOT / "src/robot_energy/accounting").glob("*.py"),
    ]
    reasons = {
        reason
        for path in sources
        for reason in re.findall(r'(?:reject|_refuse)\(\s*"([a-z_]+)"', path.read_text())
    }
    adapters = ROOT / "src/robot_energy/inputs/temperatures/kinds.py"
    reasons |= set(re.findall(r'(?:return|else) "([a-z_]+)"', adapters.read_text()))
    assert reasons
    for reason in reasons:
        assert f"`{reason}`" in NOMENCLATURE, f"the nomenclature lacks the reason {reason}"
    assert BACKWARD_JUMP_NS == 10**9  # "more than 1 s older" in the nomenclature


@pytest.mark.parametrize(
    "message",
    sorted(
        path.relative_to(ROOT / "ros2_energy_msgs").as_posix()
        for path in (ROOT / "ros2_energy_msgs").glob("[ms]*/*.[ms]*")
    ),
)
def test_every_field_of_every_message_is_explained(message):
    lines = (ROOT / "ros2_energy_msgs" / message).read_text().splitlines()
    assert lines[0].startswith("#")
    lines = [line for line in lines if "=" not in line or line.startswith("#")]  # constants
    for before, line in pairwise(lines):
        if re.match(r"^[a-z]\S*(\[\d*\])? [a-z_]+$", line):
            assert before.startswith("#"), f"{message}: '{line}' has no comment above it"


def named_tests(document):
    """Names of tests in a document, as code."""
    return sorted(set(re.findall(r"`(test_\w+)`", (ROOT / document).read_text())))


@pytest.fixture(scope="module")
def existing_tests():
    found = set()
    for folder in ("test", "ros2_energy_monitor/test"):
        for path in (ROOT / folder).rglob("test_*.py"):
            found |= set(re.findall(r"^ *def (test_\w+)", path.read_text(), flags=re.MULTILINE))
    return found


def test_every_proof_of_the_failures_exists(existing_tests):
    named = named_tests("src/doc/failures.md")
    assert len(named) > 60
    assert not [name for name in named if name not in existing_tests]


def test_the_failures_are_numbered_without_a_hole():
    text = (ROOT / "src/doc/failures.md").read_text()
    rows = [int(number) for number in re.findall(r"^\| (\d+) \|", text, flags=re.MULTILINE)]
    assert len(rows) > 90
    assert rows == list(range(1, len(rows) + 1))
