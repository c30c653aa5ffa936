"""Runs the blocks of code of a page of the site, and compares or writes what they show.

``python .ci/pages.py PAGE`` runs it and says where the page shows another output than the
program; ``--write`` writes outputs and pictures into the page instead. A block ``console`` has
commands after ``$`` with their output, a block ``python`` is followed by what it prints (a block
``text``) or by its picture. Blocks of other languages are left alone.
"""

from __future__ import annotations

import argparse
import contextlib
import difflib
import io
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
BLOCK = re.compile(r"^```(console|python)\n(.*?)^```\n(?:\n```text\n(.*?)^```\n)?", re.M | re.S)
PICTURE = re.compile(r"\n!\[[^\]]*\]\(([^)]+)\)\n")
SIZE, DPI = (7.0, 3.4), 100


def run(page: Path, folder: Path) -> str:
    """Return the text of a page with the outputs of its blocks as they are.

    Args:
        page: Markdown.
        folder: Where its pictures are written.

    Raises:
        SystemExit: If a command fails.
    """
    text = page.read_text(encoding="utf-8")
    names: dict[str, Any] = {"__name__": page.stem}
    parts: list[str] = []
    end = 0
    for block in BLOCK.finditer(text):
        parts.append(text[end : block.start()])
        end = block.end()
        if block[1] == "console":
            parts.append(f"```console\n{of_commands(block[2])}```\n")
            continue
        printed = of_python(block[2], names, page)
        shown = f"\n```text\n{printed}```\n" if printed else ""
        parts.append(f"```python\n{block[2]}```\n{shown}")
        if picture := PICTURE.match(text, end):
            draw(folder / Path(picture[1]).name)
    return "".join([*parts, text[end:]])


def of_commands(content: str) -> str:
    """Run the commands of a block; return it with their output."""
    lines: list[str] = []
    commands = re.findall(r"^\$ (.*(?:\\\n.*)*)$", content, re.M)
    for command in commands:
        done = subprocess.run(
            command, shell=True, cwd=ROOT, capture_output=True, text=True, check=False,
            env={**os.environ, "COLUMNS": "100"},
        )  # fmt: skip
        if done.returncode:
            raise SystemExit(f"{command}\nended with {done.returncode}: {done.stderr}{done.stdout}")
        lines += [f"$ {command}", *(line.rstrip() for line in done.stdout.splitlines())]
    return "".join(f"{line}\n" for line in lines)


def of_python(code: str, names: dict[str, Any], page: Path) -> str:
    """Run a block of Python; return what it prints."""
    import matplotlib as mpl
    from matplotlib import pyplot

    mpl.use("Agg")
    mpl.rcParams["figure.figsize"] = SIZE
    pyplot.close("all")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.chdir(ROOT):
        exec(compile(code, str(page), "exec"), names)  # the pages are ours
    return printed.getvalue()


def draw(path: Path) -> None:
    """Write the newest figure."""
    from matplotlib import pyplot

    path.parent.mkdir(parents=True, exist_ok=True)
    pyplot.savefig(path, dpi=DPI, metadata={"Software": None})


def main() -> int:
    """Run pages; return 1 if one shows another output than its code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pages", nargs="+", type=Path, metavar="PAGE")
    parser.add_argument("--write", action="store_true", help="write outputs and pictures")
    given = parser.parse_args()
    differ = False
    for page in given.pages:
        folder = page.parent / f"images/{page.stem}"
        made = run(page, folder if given.write else ROOT / f"build/pages/{page.stem}")
        before = page.read_text(encoding="utf-8")
        if given.write:
            page.write_text(made, encoding="utf-8")
        elif made != before:
            differ = True
            lines = [before.splitlines(), made.splitlines()]
            print("\n".join(difflib.unified_diff(*lines, str(page), "as it runs", lineterm="")))
    return int(differ)


if __name__ == "__main__":
    sys.exit(main())
