"""Pages whose outputs are those of the programs: the program that makes and compares them."""

import re
import runpy
from pathlib import Path

import pytest

from places import ROOT

PAGES = runpy.run_path(str(ROOT / ".ci/pages.py"))
DOC = ROOT / "src/doc"
PAGE = """# Page

```console
$ echo one; \\
    echo two
one
two
$ true
```

```python
value = 6
print(value)
```

```text
6
```

```python
from matplotlib import pyplot

axes = pyplot.subplots()[1]
axes.plot([0, value])
```

![A line](images/page/line.png)

```bash
false
```
"""


@pytest.fixture
def page(tmp_path: Path) -> Path:
    path = tmp_path / "page.md"
    path.write_text(PAGE)
    return path


def test_what_a_page_shows_is_made_again(page: Path):
    assert PAGES["run"](page, page.parent / "drawn") == PAGE
    assert (page.parent / "drawn/line.png").read_bytes().startswith(b"\x89PNG")


def test_another_output_is_found(page: Path):
    page.write_text(PAGE.replace("two\n$", "2\n$").replace("\n6\n", "\n7\n"))
    assert PAGES["run"](page, page.parent) == PAGE


def test_a_command_that_fails_ends_it(page: Path):
    page.write_text(PAGE.replace("$ true", "$ ls /nowhere"))
    with pytest.raises(SystemExit, match="ls /nowhere"):
        PAGES["run"](page, page.parent)


def pictures(name: str) -> list[str]:
    return re.findall(r"^!\[[^\]]+\]\(([^)]+)\)$", (DOC / name).read_text(), flags=re.M)


@pytest.mark.parametrize(("name", "least"), [("gallery.md", 12), ("concepts.md", 5)])
def test_every_section_has_its_picture(name: str, least: int):
    shown = pictures(name)
    folder = DOC / f"images/{Path(name).stem}"
    assert {f"images/{folder.name}/{path.name}" for path in folder.iterdir()} == set(shown)
    assert len(shown) >= least
    assert sum(path.stat().st_size for path in folder.iterdir()) < 1_000_000


def test_the_tutorial_shows_outputs():
    console = PAGES["BLOCK"].findall((DOC / "tutorial.md").read_text())
    shown = [line for _, block, _ in console for line in block.splitlines()]
    assert sum(line.startswith("$ robot-energy ") for line in shown) >= 10
    assert sum(not line.startswith("$ ") for line in shown) >= 10


def test_a_type_of_the_site_has_no_text():
    without_texts = runpy.run_path(str(DOC / "conf.py"))["without_texts"]
    shown = ":vartype a: ~typing.Annotated[int | None, robot.Option(text=mass, [kg], low=1)]"
    assert without_texts(shown) == ":vartype a: int | None"
    shown = "(a: Annotated[Literal['x', 'y'], \"a's kind\"] = 'x', b: Annotated[str, 'name']='y')"
    assert without_texts(shown) == "(a: Literal['x', 'y'] = 'x', b: str='y')"
