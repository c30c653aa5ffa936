"""The set-up installs nothing that is not pinned by hash, and no system package unasked."""

import contextlib
import importlib.util
import os
import pty
import re
import shutil
import subprocess
import sys

import pytest

from places import ROOT

CI = ROOT / ".ci"
NEEDED = ("bash", "dirname", "sed", "paste", "tail", "mkdir", "cat", "env")


@pytest.mark.parametrize("path", sorted(CI.glob("requirements*.txt")), ids=lambda path: path.name)
def test_every_pinned_distribution_carries_a_hash(path):
    pins = [line for line in path.read_text().splitlines() if re.match(r"[a-z]", line)]
    assert pins
    assert [line for line in pins if not re.fullmatch(r"\S+==\S[^\\]*\\", line)] == []
    assert len(re.findall(r"\\\n    --hash=sha256:[0-9a-f]{64}$", path.read_text(), re.M)) >= len(
        pins
    )


def script(name):
    """Load a module of `.ci`."""
    spec = importlib.util.spec_from_file_location(name, CI / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


IDL = """
module p { module msg {
  struct A { @verbatim (language="comment", text="%s") double x; };
}; };
"""


# lark, which that parser is made with
@pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")
def test_a_definition_is_parsed_once_and_again_when_it_changes(tmp_path, monkeypatch):
    from rosidl_parser import parser
    from rosidl_parser.definition import IdlLocator

    parsed = []
    parse = parser.parse_idl_string
    monkeypatch.setattr(parser, "parse_idl_string", lambda text: parsed.append(text) or parse(text))
    for comment in ("W", "W", "J"):
        (tmp_path / "A.idl").write_text(IDL % comment)
        found = script("parsed_once").parse_idl_file(IdlLocator(tmp_path, "A.idl"))
        (own,) = parse(IDL % comment).elements
        (kept,) = found.content.elements
        (member,) = kept.structure.members
        assert member.type == own.structure.members[0].type
        assert member.get_annotation_value("verbatim")["text"] == comment
    assert parsed == [IDL % "W", IDL % "J"]


@pytest.mark.parametrize(
    ("name", "by_pip"), [("PIP_INDEX_URL", True), ("PIP_PROXY", True), ("PIP_TIMEOUT", False)]
)
def test_pip_installs_where_its_settings_say_where_from(name, by_pip):
    command = [sys.executable, "-m", "pip", "config", "list"]
    settings = {"PIP_CONFIG_FILE": os.devnull, name: "7"}
    said = subprocess.run(command, env=settings, capture_output=True, text=True, check=True).stdout
    assert "7" in said
    assert bool(script("workspace").PIP_ALONE.search(said)) is by_pip


@pytest.fixture
def bare(tmp_path):
    """A machine with apt and without compilers, whose root runs the set-up."""
    tools = tmp_path / "bin"
    tools.mkdir()
    for name in NEEDED:
        (tools / name).symlink_to(shutil.which(name))
    for name, text in {"id": "echo 0", "apt-get": f"echo $@ >>{tmp_path}/apt; exit 1"}.items():
        (tools / name).write_text(f"#!{shutil.which('bash')}\n{text}\n")
        (tools / name).chmod(0o755)
    (tmp_path / ".ci").mkdir()
    shutil.copy(CI / "setup", tmp_path / ".ci/setup")
    return tmp_path


def set_up(folder, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, **settings):
    """Start the set-up there; return the process."""
    python = os.path.realpath(sys.executable)
    settings = {"PATH": str(folder / "bin"), "PYTHON": python, **settings}
    command = [folder / ".ci/setup"]
    return subprocess.Popen(command, stdin=stdin, stderr=stderr, env=settings, text=True)


@pytest.mark.parametrize("settings", [{"CI": "true"}, {"YES": "1"}], ids=str)
def test_apt_is_used_without_a_question_where_that_was_said(bare, settings):
    process = set_up(bare, **settings)
    process.communicate(timeout=60)
    assert process.returncode == 1
    assert (bare / "apt").read_text().startswith("update")


@pytest.mark.parametrize("settings", [{}, {"CI": "false"}, {"YES": "no"}], ids=str)
def test_apt_is_not_used_where_nobody_can_be_asked(bare, settings):
    process = set_up(bare, **settings)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 1
    assert not (bare / "apt").exists()
    assert "YES=1" in said
    assert "apt-get install make cmake gcc g++" in said


def until_closed(terminal):
    """Return all that is written to a terminal until its last writer is gone."""
    said = b""
    with contextlib.suppress(OSError):  # EIO says that the other end is closed
        while got := os.read(terminal, 10_000):
            said += got
    return said.decode()


@pytest.mark.parametrize(("answer", "used"), [("y\n", True), ("n\n", False), ("\n", False)])
def test_a_human_is_asked_before_apt_is_used(bare, answer, used):
    ours, theirs = pty.openpty()
    try:
        os.write(ours, answer.encode())
        process = set_up(bare, stdin=theirs, stderr=theirs)
        os.close(theirs)
        said = until_closed(ours)
        assert process.wait(timeout=60) == 1
    finally:
        os.close(ours)
    assert "make cmake gcc g++" in said
    assert (bare / "apt").exists() == used
