"""Every example and notebook runs as it stands and prints figures."""

import json
import runpy
from pathlib import Path

import matplotlib as mpl
import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "src/examples/python").glob("*.py"))


def test_there_are_six():
    assert len(EXAMPLES) == 6


@pytest.mark.parametrize(
    "example",
    [
        pytest.param(path, marks=pytest.mark.long if path.stem == "wear_alarm" else ())
        for path in EXAMPLES
    ],
    ids=lambda path: path.stem,
)
def test_example_runs(example, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(example), run_name="__main__")
    shown = capsys.readouterr().out
    assert any(character.isdigit() for character in shown)
    assert "nan" not in shown.lower().split()
    if example.stem == "wear_alarm":
        assert "friction of joint_a2 rose" in shown.splitlines()[-1]


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_example_is_on_the_site(example):
    assert f"examples/python/{example.name}" in (ROOT / "src/doc/examples.md").read_text()


NOTEBOOKS = sorted((ROOT / "src/examples/notebooks").glob("*.ipynb"))


def test_there_are_four_notebooks():
    assert len(NOTEBOOKS) == 4


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(notebook, monkeypatch, capsys):
    from matplotlib import pyplot

    mpl.use("Agg")
    monkeypatch.chdir(notebook.parent)  # as Jupyter does, wherever it was started
    cells = json.loads(notebook.read_text())["cells"]
    names: dict[str, object] = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            assert not cell["outputs"], "kept without outputs"
            exec(compile("".join(cell["source"]), notebook.name, "exec"), names)
    assert pyplot.get_fignums()
    pyplot.close("all")
    assert "%" in capsys.readouterr().out or "kJ" in notebook.read_text()


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_on_the_site(notebook):
    assert f"examples/notebooks/{notebook.name}" in (ROOT / "src/doc/examples.md").read_text()
