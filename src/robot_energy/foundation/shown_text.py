"""Text from outside, made safe to show: names, notes and reasons of messages and files."""

from __future__ import annotations

MAX_SHOWN = 200  # characters of one text that are shown
MAX_LINE = 4000  # characters of one line of ours, in which such texts are quoted


def shown(text: str, limit: int = MAX_SHOWN) -> str:
    r"""Return a text without anything that acts on a terminal or forges a line of a log.

    Control and format characters, line separators and lone surrogates are written as
    escapes (``\x1b``, ``\u202e``); a longer text is cut, with a mark.
    """
    part = text[: limit + 1]
    safe = part
    if not part.isprintable():
        safe = "".join(
            c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in part
        )
    return safe if len(safe) <= limit and len(part) == len(text) else safe[: limit - 3] + "..."


def shown_lines(text: str) -> str:
    """Return a text of our own that quotes others, with its own line ends, safe to show."""
    return "\n".join(shown(part, MAX_LINE) for part in text.split("\n"))
