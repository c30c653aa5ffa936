"""The words of the glossary: what it does not allow occurs nowhere; the list shows every text."""

import runpy
from pathlib import Path

import pytest

from places import ROOT

WORDS = runpy.run_path(str(ROOT / ".ci/words.py"))


def test_no_word_occurs_that_the_glossary_does_not_allow():
    found = [f"{path.relative_to(ROOT)}:{line}: {word}" for path, line, word in WORDS["offences"]()]
    assert found == []


def test_the_words_have_another_instead():
    banned = WORDS["banned"]()
    assert banned["beside"] == "next to, compared with, apart from"
    assert all(banned.values())


def test_a_forbidden_word_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "module.py"
    path.write_text('log.tell()\nx = "It could not be Told"\nbesides = 1  # anew_name\n')
    monkeypatch.setitem(WORDS["offences"].__globals__, "tracked", lambda *_: [path])
    assert [(line, word) for _, line, word in WORDS["offences"]()] == [(2, "Told")]


def test_texts_are_listed_and_documentation_is_not(tmp_path: Path):
    path = tmp_path / "module.py"
    path.write_text(
        '"""Its documentation."""\nname = "name"\nraise E(f"{name} is not {2}", "two words")\n'
    )
    assert list(WORDS["of_python"](path)) == [(3, "{} is not {}"), (3, "two words")]
