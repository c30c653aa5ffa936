"""Markdown templates as parts of a page, in their order."""

import jinja2
import pytest
from jinja2 import DictLoader

from robot_energy_papers import pages
from robot_energy_report.document import Document

TEMPLATE = """{% set share = 0.123 %}
# Title of {{ name }}

A lead
of two lines.

## Section

> Mind
this.

Text with `code`, {{ share|signed }}, {{ none|signed }} and {{ 1234|kilo }}.

```
robot-energy {{ name }}
```

Table: Powers
| part | {{ 60|whole(" degC") }} |
{{ ["a|b", "1"]|row }}
{{ ["**sum**", "2"]|row }}

![What is
seen](drawn)

@part
"""


class Recorder(Document):
    """A page that notes what is written to it."""

    def __init__(self, title="", lead=""):
        super().__init__(title, lead)
        self.parts = [("title", title, lead)]

    def heading(self, text, depth=2):
        self.parts.append(("heading", text, depth))

    def paragraph(self, text="", kind="paragraph"):
        self.parts.append((kind, text))

    def note(self, text):
        self.parts.append(("note", text))

    def table(self, title, columns, rows, total=None):
        self.parts.append(("table", title, columns, rows, total))

    def figure(self, draw, caption):
        self.parts.append(("figure", draw, caption))


@pytest.fixture
def templates(monkeypatch):
    loader = DictLoader({"page.md.j2": TEMPLATE, "text.md.j2": "## Of {{ name }}\n\nOne\nline."})
    monkeypatch.setattr(pages, "PackageLoader", lambda package: loader)
    monkeypatch.setattr(pages, "Document", Recorder)


def test_every_kind_of_block_becomes_its_part_of_the_page(templates):
    pieces = {"drawn": object(), "part": lambda page: page.paragraph("from Python")}
    page = pages.document("page", {"name": "x", "none": None}, pieces)
    assert page.parts == [
        ("title", "Title of x", "A lead of two lines."),
        ("heading", "Section", 2),
        ("note", "Mind this."),
        ("paragraph", "Text with `code`, +12.3 %, - and 1.2."),
        ("command", "robot-energy x"),
        ("table", "Powers", ["part", "60 degC"], [["a|b", "1"]], ["sum", "2"]),
        ("figure", pieces["drawn"], "What is seen"),
        ("paragraph", "from Python"),
    ]


def test_text_alone_goes_to_any_page(templates):
    page = Recorder()
    pages.print_template("text", {"name": "it"}, page)
    assert page.parts[1:] == [("heading", "Of it", 2), ("paragraph", "One line.")]


def test_a_name_that_nobody_gives_is_an_error(templates):
    with pytest.raises(jinja2.UndefinedError, match="'name' is undefined"):
        pages.print_template("text", {}, Recorder())
