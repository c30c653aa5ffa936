"""A report in a real browser: one file that draws itself, on paper too."""

import re

import pytest

from chromium import browser, needs_browser
from places import ROOT
from robot_energy_cli import main

pytestmark = [needs_browser, pytest.mark.filterwarnings("ignore::ResourceWarning")]
BAGS = [str(ROOT / "bags" / name) for name in ("kr16_cold", "kr16_warm")]


@pytest.fixture(scope="module")
def window():
    with browser() as found:
        yield found


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    assert main(["report", *BAGS, "--model", "kr16", "--out", str(path)]) == 0
    return path.as_uri()


@pytest.mark.parametrize(("width", "dark"), [(1400, False), (390, True)])
def test_the_report_draws_itself_without_fault(window, report, width, dark):
    window.dark(dark)
    window.complaints()
    window.open(report, width, 900)
    assert window.complaints() == []
    assert all(name.startswith("data:") for name in window.requests())
    drawn = window.run(
        "return [...document.querySelectorAll('[data-flow]')].map(host => [...host"
        ".querySelectorAll('rect')].map(n => [+n.dataset.in, +n.dataset.out, n.dataset.inner]))"
    )
    assert len(drawn) == 3
    for nodes in drawn:
        assert len(nodes) > 10
        assert all(into == out for into, out, inner in nodes if inner == "true")
    assert window.run("return document.documentElement.scrollWidth") == width
    terms = window.run(
        "return document.querySelector('#terms table').getBoundingClientRect().width"
    )
    assert terms > 0.5 * min(width, 1000)  # a meaning is a line, not a column of single words
    # What is read as text is not cut, also where the table below it is scrolled.
    assert not window.run(
        "return [...document.querySelectorAll('caption, td:only-of-type:not(.n)')].filter(one =>"
        "one.getBoundingClientRect().right > innerWidth).map(one => one.textContent)"
    )
    window.run("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    assert window.faults() == []


CROSSED = """
return [...document.querySelectorAll('[data-flow] svg')].flatMap(svg =>
  [...svg.querySelectorAll('text')].filter(text => {
    const box = text.getBBox();
    const middle = box.y + box.height / 2;
    const places = Array.from({length: 21}, (_, k) => box.x + box.width * k / 20);
    return [...svg.querySelectorAll('path.link')].some(
      band => places.some(x => band.isPointInStroke(new DOMPoint(x, middle))));
  }).map(text => text.textContent))
"""


def test_no_flow_crosses_a_label(window, report):
    window.open(report, 1400, 900)
    assert window.run("return document.querySelectorAll('[data-flow] svg text').length") > 30
    assert window.run(CROSSED) == []


def test_colours_are_chosen_with_a_button(window, report):
    window.dark(False)
    window.open(report)
    back = "return getComputedStyle(document.body).backgroundColor"
    light = window.run(back)
    window.click("#theme")
    assert window.run(back) == light
    window.click("#theme")
    assert window.run(back) != light


def test_a_report_is_printed_as_pdf_and_replaced(tmp_path, capsys):
    path = tmp_path / "report.pdf"
    for _ in range(2):
        assert main(["replay", BAGS[0], "--model", "kr16", "--report", str(path)]) == 0
    data = path.read_bytes()
    assert data.startswith(b"%PDF-")
    assert len(re.findall(rb"/Type /Page\b", data)) >= 3
    assert [one.name for one in tmp_path.iterdir()] == ["report.pdf"]
    path.write_bytes(b"%PDF-1.4 of another program")
    assert main(["replay", BAGS[0], "--model", "kr16", "--report", str(path)]) == 2
