"""How the help of every command is written: no line is wider than the terminal."""

from __future__ import annotations

import re
from argparse import HelpFormatter
from textwrap import wrap


class WrappedHelp(HelpFormatter):
    """Fills paragraphs and keeps examples apart; `HelpFormatter` would make one paragraph.

    In a description or an epilog, lines without indent form a paragraph, up to an empty line.
    An indented line stays a line of its own. An example that is too long is continued after
    a backslash, as a shell reads it, and any other line with a deeper indent.
    """

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        whole = re.sub(r" *\\\n\s*", " ", text.strip("\n"))  # examples that are continued
        lines: list[str] = []
        paragraph: list[str] = []
        for line in [*whole.splitlines(), ""]:
            if line and not line.startswith(" "):
                paragraph.append(line)
                continue
            lines += wrap(" ".join(paragraph), width, break_on_hyphens=False)
            paragraph = []
            lines += _indented(line, width)
        return "\n".join(f"{indent}{line}".rstrip() for line in lines).strip("\n") + "\n"


def _indented(line: str, width: int) -> list[str]:
    """One line as several that are no wider."""
    if len(line) <= width:
        return [line]
    own = " " * (len(line) - len(line.lstrip()))
    deeper = own + " " * 4
    if not line.startswith(f"{own}robot-energy "):
        return wrap(line, width, subsequent_indent=deeper, break_on_hyphens=False)
    first, *parts = re.split(r" (?=--)", line)  # an option stays with its value
    lines = [first]
    for part in parts:
        if len(lines[-1]) + 1 + len(part) <= width - 2:
            lines[-1] += f" {part}"
        else:
            lines[-1] += " \\"
            lines.append(deeper + part)
    return lines
