"""What a reader of an HTML report finds in it."""

from __future__ import annotations

import re
from html.parser import HTMLParser

VOID = {"meta", "img", "link"}


class Reader(HTMLParser):
    """Collects cells and checks that every element is closed in order."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.cells: list[str] = []
        self.notes = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")
        self.notes += ("class", "note") in attrs

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("td", "th"):
            self.cells[-1] += data


def read(page: str) -> Reader:
    """Read a page, which must be whole: every element closed, nothing loaded from elsewhere."""
    reader = Reader()
    reader.feed(page)
    assert re.findall(r'(?:src|href)="(?!data:|#)', page) == []
    assert reader.open == []
    return reader
