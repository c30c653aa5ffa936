"""The live page of 60 robots: an overview of all, search, cells, and one robot whole."""

import time
from threading import Event, Thread

import pytest

from chromium import browser, needs_browser
from page_messages import power_states, registers
from robot_energy_report.page.access import page_access
from robot_energy_report.page.hub import PageHub
from robot_energy_report.page.settings import PageSettings
from robot_energy_report.page.web_server import PageServer

pytestmark = [needs_browser, pytest.mark.filterwarnings("ignore::ResourceWarning")]
ROWS = "document.querySelectorAll('#robots tbody tr')"


@pytest.fixture(scope="module")
def page():
    """Robots of six cells that go on, and a window."""
    hub, ended = PageHub("", PageSettings(), live=False), Event()
    for number in range(60):
        robot = hub.robot(f"cell{number // 10}/r{number:02d}")
        robot.take_power(power_states([1.0], [100.0 + number]), 0.0)
        robot.take_registers(registers(10.0 * (100.0 + number)))  # of ten seconds

    def go_on():
        while not ended.wait(0.1):
            hub.tick(time.monotonic())

    hub.tick(time.monotonic())
    thread = Thread(target=go_on)
    thread.start()
    server = PageServer(hub, page_access())
    with browser() as window:
        yield hub, server.url, window
    ended.set()
    thread.join()
    server.close()


def opened(page, width=1400):
    _, url, window = page
    window.complaints()
    window.open(url, width)
    window.wait(f"{ROWS}.length === 60", "all robots")
    return window


@pytest.mark.parametrize(("width", "dark"), [(1400, False), (390, True)])
def test_search_and_cells_lead_to_one_robot_of_many(page, width, dark):
    from selenium.webdriver.common.keys import Keys

    window = opened(page, width)
    window.dark(dark)
    assert window.text("title") == "cell0/r00"
    assert window.text("power") == "100 W"
    cells = window.run(
        "return [...document.querySelectorAll('#cells tbody tr')].map(r => r.cells[3].textContent)"
    )
    assert cells[2] == "1245 W"
    window.driver.find_element("css selector", "#cells tbody tr:nth-child(4) button").send_keys(
        Keys.ENTER
    )
    window.wait(f"{ROWS}.length === 10", "the robots of a cell")
    assert "10 of 60 robots" in window.text("fleet-note")
    button = window.driver.find_element("css selector", "#robots tbody tr:nth-child(4) button")
    button.send_keys(Keys.ENTER)
    window.wait("document.getElementById('title').textContent === 'cell3/r33'", "the robot")
    window.wait("document.getElementById('power').textContent === '133 W'", "its power")
    assert "robot=cell3%2Fr33" in window.driver.current_url
    window.run("window.seen = document.activeElement")
    number = page[0].events_of("")["fleet"][0]
    window.wait("document.getElementById('status').textContent !== 'connecting'", "figures")
    limit = time.monotonic() + 60
    alone = {"cell3/r33": 1}  # once the connection before has ended
    while page[0].events_of("")["fleet"][0] <= number or page[0].watched != alone:
        assert time.monotonic() < limit
        time.sleep(0.05)
    assert window.run("return document.activeElement === window.seen && seen.tagName === 'BUTTON'")
    assert window.faults() == []
    assert window.run("return document.documentElement.scrollWidth") == width
    assert window.complaints() == []
    window.open(window.driver.current_url, width)
    window.wait("document.getElementById('title').textContent === 'cell3/r33'", "the same robot")
