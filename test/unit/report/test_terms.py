"""Reports explain their words in a list below, as in the glossary."""

import re

import pytest

from places import ROOT
from robot_energy_report.document import Document
from robot_energy_report.html import page_html
from robot_energy_report.page.saved_page import TERMS, static_file, terms_in

GLOSSARY = (ROOT / "src/doc/glossary.md").read_text(encoding="utf-8")
ROWS = [
    (re.sub(r" \(.*\)", "", cells[0].strip()), cells[1].strip())
    for line in GLOSSARY.splitlines()
    if len(cells := line.strip("|").split("|")) == 3
]


@pytest.mark.parametrize("term", TERMS)
def test_the_glossary_says_the_same(term):
    assert any(name == term and said.startswith(TERMS[term]) for name, said in ROWS)


def test_the_terms_that_occur_are_listed_with_their_meaning():
    page = Document("Report", "Lead")
    page.heading("Energy")
    page.paragraph("Predicted 5 J; the residual is 1 J. What `hold` is, nobody knows.")
    page.table("Losses", ("part", "J"), [("drive losses", "3"), ("gapless", "2")])
    terms = page_html(page).partition('id="terms"')[2]
    listed = re.findall(r"<th[^>]*>([^<]+)</th><td[^>]*>([^<]+)<", terms)
    assert dict(listed) == {term: TERMS[term] for term in ("drive loss", "predicted", "residual")}


def test_what_is_no_text_names_no_term():
    for html in (
        "<code>hold</code>", '<p title="hold">x</p>', "<pre>gap &lt;</pre>",
        "<figure><p>gap</p></figure>", "<p>threshold, hold_time, gap-less</p>",
    ):  # fmt: skip
        assert terms_in(html) == []
    assert terms_in("<p><br/>hold</p>") == ["hold"]


@pytest.mark.parametrize("path", ["/", "/history"])
def test_live_pages_list_all_terms(path):
    html = static_file(path).content.decode()
    assert all(f"<dt>{term}</dt><dd>{meaning}</dd>" in html for term, meaning in TERMS.items())
