"""The same G-code with other feeds: what an operator sets as feed override, written into it."""

from __future__ import annotations

import re

COMMENT_OR_FEED = re.compile(r"\([^)]*\)|;.*|[Ff]\s*([0-9]*\.?[0-9]+)")
COMMENT = re.compile(r"\([^)]*\)|;.*")
OTHER_CODE = re.compile(r"[Mm]\s*\d|[Gg]\s*0*(?:10|11|28|29)(?!\d)")
DECIMALS = 3  # of a feed in mm or inch per minute


def with_feed(text: str, factor: float) -> str:
    """Return a program whose feeds are all multiplied; G0 without a feed keeps its speed.

    Args:
        text: G-code.
        factor: > 0. [-]
    """

    def scaled(found: re.Match[str]) -> str:
        if found[1] is None:
            return found[0]
        return f"F{round(float(found[1]) * factor, DECIMALS):.10g}"

    return "".join(
        line if OTHER_CODE.search(COMMENT.sub("", line)) else COMMENT_OR_FEED.sub(scaled, line)
        for line in text.splitlines(keepends=True)
    )
