"""Lists every text that a user can meet: help, errors, reports, page, messages, documents.

``python .ci/words.py`` prints them with their places; ``--banned`` prints where words occur that
the glossary does not allow, in comments, documentation strings and tests as well.
"""

from __future__ import annotations

import argparse
import ast
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
GLOSSARY = ROOT / "src/doc/glossary.md"
HEADING = "## Words that are not used"
TEXT = re.compile(r"\w\W+\w")  # two words: what has fewer is a name
JS_TEXT = re.compile(r"""(["'`])((?:(?!\1)[^\\\n]|\\.)*)\1|>([^<>{}\n]+)<""")
PLAIN = ("*.msg", "*.srv", "*.md", "*.rst", "*.yaml", "*.j2")
# Records say what was so then, and the glossary names the words itself.
RECORDS = ("src/doc/decisions/", "CHANGELOG", "src/doc/glossary.md", "test/docs/test_words.py")
METHOD = re.compile(r"\.\w+\(|def \w+\(")  # of files: ``log.tell()``


def tracked(*patterns: str) -> list[Path]:
    """Files of the project, without records and links."""
    done = subprocess.run(
        ["git", "ls-files", *patterns], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return [
        ROOT / name
        for name in done.stdout.splitlines()
        if not any(record in name for record in RECORDS) and (ROOT / name).is_file()
    ]


def texts() -> Iterator[tuple[Path, int, str]]:
    """Yield file, line and text of all that a user can meet."""
    for path in tracked("src/robot_energy*.py", "ros2_energy_monitor/ros2_energy_monitor/*.py"):
        yield from ((path, line, text) for line, text in of_python(path))
    for path in tracked("src/*.js", "src/*.html"):
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            for match in JS_TEXT.finditer(line):
                text = match[2] or match[3] or ""
                if TEXT.search(text):
                    yield path, number, text.strip()
    for path in tracked(*PLAIN):
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            if TEXT.search(line):
                yield path, number, line.strip()


def of_python(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the texts of a module but its documentation; what is computed is ``{}``."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    documentation = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    joined = [node for node in ast.walk(tree) if isinstance(node, ast.JoinedStr)]
    inner = documentation | {id(part) for node in joined for part in node.values}
    for node in ast.walk(tree):
        text = ""
        if isinstance(node, ast.JoinedStr):
            text = "".join(
                str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values
            )
        elif isinstance(node, ast.Constant) and id(node) not in inner:
            text = node.value if isinstance(node.value, str) else ""
        if TEXT.search(text):
            yield getattr(node, "lineno", 0), " ".join(text.split())


def banned() -> dict[str, str]:
    """Words that are not used, with what to write instead, from the table of the glossary."""
    section = GLOSSARY.read_text(encoding="utf-8").split(HEADING)[1].split("\n## ")[0]
    rows = [line.strip("| ").split("|") for line in section.splitlines() if line.startswith("|")]
    return {
        word.strip(): cells[1].strip()
        for cells in rows[2:]
        for word in cells[0].split(",")
    }  # fmt: skip


def offences() -> Iterator[tuple[Path, int, str]]:
    """Yield file, line and word wherever a word occurs that is not used."""
    words = "|".join(map(re.escape, banned()))
    pattern = re.compile(rf"(?<![\w-])({words})(?![\w-])", re.IGNORECASE)
    for path in tracked("*.py", "*.js", "*.html", "*.css", "*.ipynb", ".ci/*", *PLAIN):
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            for match in pattern.finditer(METHOD.sub("", line)):
                yield path, number, match[0]


def main() -> int:
    """Print the list."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--banned", action="store_true", help="only words that are not used")
    found = list(offences() if parser.parse_args().banned else texts())
    for path, line, text in found:
        print(f"{path.relative_to(ROOT)}:{line}: {text}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
