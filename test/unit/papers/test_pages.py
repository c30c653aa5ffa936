"""Markdown templates as pages, and as text for a terminal."""

from io import StringIO

import jinja2
import pytest
from jinja2 import DictLoader
from rich.console import Console

from robot_energy.report.document import Document
from robot_energy.report.html import page_html
from robot_energy.report.printing import print_document
from robot_energy_papers import pages

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


@pytest.fixture
def templates(monkeypatch):
    loader = DictLoader({"page.md.j2": TEMPLATE, "text.md.j2": "## Of {{ name }}\n\nOne\nline."})
    monkeypatch.setattr(pages, "PackageLoader", lambda package: loader)


def test_every_kind_of_block_becomes_its_part_of_the_page(templates):
    pieces = {
        "drawn": lambda target: target.write(b"<svg/>"),
        "part": lambda page: page.paragraph("from Python"),
    }
    html = page_html(pages.document("page", {"name": "x", "none": None}, pieces))
    assert "<h1>Title of x</h1>" in html
    assert '<p class="lead">A lead of two lines.</p>' in html
    assert ">Section</h2>" in html
    assert '<p class="note">Mind this.</p>' in html
    assert "<p>Text with <code>code</code>, +12.3 %, - and 1.2.</p>" in html
    assert "<pre><code>robot-energy x</code></pre>" in html
    assert "<caption>Powers</caption>" in html
    assert "60 degC" in html
    assert ">a|b</td>" in html  # a bar within a cell
    assert '<tr class="total"><td class="text">sum</td>' in html
    assert "<figcaption>What is seen</figcaption>" in html
    assert html.index("</figure>") < html.index("from Python")


def test_the_same_blocks_on_a_terminal(templates):
    out, page = StringIO(), Document()
    pages.print_template("text", {"name": "it"}, page)
    print_document(page, Console(file=out, width=60))
    assert out.getvalue() == "\nOF IT\nOne line.\n"


def test_a_name_that_nobody_gives_is_an_error(templates):
    with pytest.raises(jinja2.UndefinedError, match="'name' is undefined"):
        pages.print_template("text", {}, Document())
