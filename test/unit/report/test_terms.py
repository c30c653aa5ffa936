"""Reports explain their words: a hint at the first place, a list below, as in the glossary."""

import re

import pytest

from places import ROOT
from robot_energy_report.document import Document
from robot_energy_report.html import page_html
from robot_energy_report.page.saved_page import TERMS, static_file, with_hints

GLOSSARY = (ROOT / "src/doc/glossary.md").read_text(encoding="utf-8")
ROWS = [
    (re.sub(r" \(.*\)", "", cells[0].strip()), cells[1].strip())
    for line in GLOSSARY.splitlines()
    if len(cells := line.strip("|").split("|")) == 3
]


@pytest.mark.parametrize("term", TERMS)
def test_the_glossary_says_the_same(term):
    assert any(name == term and said.startswith(TERMS[term]) for name, said in ROWS)


def test_the_first_place_has_a_hint_and_the_list_its_meaning():
    page = Document("Report", "Lead")
    page.heading("Energy")
    page.paragraph("Predicted 5 J; the residual is 1 J. Residuals of `residual` are small.")
    page.table("Losses", ("part", "J"), [("drive losses", "3"), ("gapless", "2")])
    html = page_html(page)
    body, terms = html.split('id="terms"')
    assert body.count("<abbr") == 3
    assert f'<abbr title="{TERMS["predicted"]}">Predicted</abbr> 5 J' in body
    assert f'<abbr title="{TERMS["residual"]}">residual</abbr> is 1 J. Residuals of' in body
    assert f'<abbr title="{TERMS["drive loss"]}">drive losses</abbr>' in body
    assert "<code>residual</code>" in body
    listed = re.findall(r"<th[^>]*>([^<]+)</th><td[^>]*>([^<]+)<", terms)
    assert dict(listed) == {term: TERMS[term] for term in ("drive loss", "predicted", "residual")}


def test_what_is_no_text_is_left_as_it_is():
    for html in (
        "<h2>Residual</h2>", "<code>hold</code>", '<p title="hold">x</p>', "<pre>gap &lt;</pre>",
        "<figure><p>gap</p></figure>", "<p>threshold, hold_time, gap-less</p>",
    ):  # fmt: skip
        assert with_hints(html) == (html, [])
    assert with_hints("<p><br/>hold</p>")[1] == ["hold"]


@pytest.mark.parametrize("path", ["/", "/history"])
def test_live_pages_list_all_terms_and_have_hints(path):
    html = static_file(path).content.decode()
    assert all(f"<dt>{term}</dt><dd>{meaning}</dd>" in html for term, meaning in TERMS.items())
    assert f'<abbr title="{TERMS["standby" if path == "/history" else "drive loss"]}">' in html
    assert not re.search(r"<option[^>]*>[^<]*<abbr", html)
