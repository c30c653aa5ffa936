"""The history in a real browser: from a year to a minute and back, by mouse, keyboard and phone."""

import shutil
import time
from contextlib import contextmanager

import pytest

from chromium import browser, needs_browser
from histories import DAY, HOUR, MINUTE, START, Robot, record_days
from robot_energy_history.store import HistoryStore
from robot_energy_report.page.access import page_access
from robot_energy_report.page.hub import PageHub
from robot_energy_report.page.settings import PageSettings
from robot_energy_report.page.web_server import PageServer

pytestmark = [needs_browser, pytest.mark.filterwarnings("ignore::ResourceWarning")]
TOKEN = "0123456789abcdef0123"
EVIL = "<img src=x onerror=window.evil=1>"
DASH = "\u2013"
BARS = "document.querySelectorAll('#bars g')"
PERIOD = "document.getElementById('period').textContent"


@pytest.fixture(scope="module")
def window():
    with browser() as found:
        yield found


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two robots that worked, were off for an hour and worked again; one has a hostile name."""
    folder = tmp_path_factory.mktemp("page") / "history"
    store = HistoryStore(folder)
    store.open()
    for name in ("cell1/a", EVIL):
        robot = Robot()
        for hour in range(6):
            if hour == 3:
                robot.step_clock(HOUR)
                robot.reset()
                continue
            store.add(name, [robot.minute(1000) for _ in range(60)])
            assert store.write(robot.now), store.trouble
    job = dict.fromkeys(
        ("gap_ns", "compared_ns", "predicted_return_microjoule", "measured_microjoule",
         "predicted_microjoule_at_meter", "peak_power"), 0,
    )  # fmt: skip
    job |= {"id": 1, "start": START, "stop": START + MINUTE, "name": EVIL, "observed_ns": MINUTE,
            "predicted_import_microjoule": 60 * 10**9}  # fmt: skip
    store.add_jobs("cell1/a", [job])
    assert store.write(START + DAY), store.trouble
    store.close()
    return folder


@contextmanager
def served(folder, token):
    token.write_text(TOKEN)
    token.chmod(0o600)
    hub = PageHub("", PageSettings(), history_folder=folder)
    hub.tick(time.monotonic())
    server = PageServer(hub, page_access(token_file=str(token), allow_control=True))
    try:
        yield server.url
    finally:
        server.close()


@pytest.fixture(scope="module")
def url(folder, tmp_path_factory):
    with served(folder, tmp_path_factory.mktemp("token") / "token") as address:
        yield address


@pytest.fixture
def opened(window, url):
    def open_page(query, width=1400, url=url):
        window.dark(False)
        window.complaints()
        window.open(f"{url}history{query}&timezone=UTC", width, 900)
        window.wait(f"{BARS}.length", "the bars")
        return window

    return open_page


def names(window):
    """What each bar says of itself."""
    return window.run(f"return [...{BARS}].map(bar => bar.getAttribute('aria-label'))")


def shown(window, period, count):
    window.wait(f"{PERIOD}.startsWith('{period}') && {BARS}.length === {count}", period)


def test_clicks_lead_from_a_year_to_a_minute_and_back(opened):
    from selenium.webdriver import ActionChains

    window = opened("?period=year&at=2026-01-01&robot=cell1/a")
    shown(window, "2026", 12)
    assert names(window)[0].startswith("January 2026: 5.000 kWh")
    for place, period, count in (
        (0, "January 2026", 31),
        (0, "Thursday", 24),
        (4, "2026-01-01 04:00", 60),
    ):
        frame = window.driver.find_elements("css selector", "#bars g .frame")[place]
        ActionChains(window.driver).click(frame).perform()
        shown(window, period, count)
    assert names(window)[7] == "2026-01-01 04:07 to 04:08: 16.67 Wh"
    assert window.text("energy") == "1.000 kWh"
    for period, count in (("Thursday", 24), ("January 2026", 31), ("2026", 12)):
        window.click("#out")
        shown(window, period, count)
    window.driver.back()
    shown(window, "January 2026", 31)
    assert window.complaints() == []


def test_the_keyboard_goes_from_bar_to_bar_and_opens_one(opened):
    from selenium.webdriver.common.keys import Keys

    window = opened("?period=month&at=2026-01-01&robot=cell1/a")
    window.run("document.querySelector('#bars g[tabindex=\"0\"]').focus()")
    window.driver.switch_to.active_element.send_keys(Keys.END)
    window.wait("document.activeElement.dataset.place === '30'", "the last day")
    assert window.text("bar-note").endswith("not recorded")
    window.driver.switch_to.active_element.send_keys(Keys.HOME)
    window.driver.switch_to.active_element.send_keys(Keys.ENTER)
    shown(window, "Thursday 2026-01-01", 24)


def test_the_focus_stays_on_the_page_where_what_had_it_is_gone(opened):
    from selenium.webdriver.common.keys import Keys

    window = opened("?period=month&at=2026-01-01")
    place = "document.activeElement.dataset.place"
    window.run("document.getElementById('out').focus()")
    window.driver.switch_to.active_element.send_keys(Keys.ENTER)
    shown(window, "2026", 12)  # the button is disabled
    window.wait(f"{place} === '0'", "the newest bar")
    window.run("document.querySelector('#robots tbody button').focus()")
    window.driver.switch_to.active_element.send_keys(Keys.ENTER)
    window.wait(f"location.search.includes('robot=') && {place} === '0'", "one robot")
    assert window.complaints() == []


def test_what_is_not_recorded_is_a_dash_and_never_zero(opened):
    window = opened("?period=day&at=2026-01-01&robot=cell1/a")
    assert names(window)[3] == "2026-01-01 03:00 to 04:00: not recorded"
    bar = f"{BARS}[3]"
    assert window.run(f"return {bar}.querySelector('text').textContent") == DASH
    assert window.run(f"return {bar}.querySelectorAll('rect:not(.frame):not(.unseen)').length") == 0
    assert window.run(f"return {BARS}[2].querySelector('.unseen')") is None
    assert "no price" not in window.text("cost-note")
    assert (window.text("cost"), window.text("co2")) == (DASH, DASH)
    assert "not recorded" in window.text("energy-note")  # nothing on the day before
    empty = opened("?period=day&at=2025-01-01")
    assert empty.text("energy") == DASH
    assert empty.text("standby") == DASH


@pytest.mark.parametrize(("width", "dark"), [(1400, False), (390, True)])
def test_no_serious_fault_and_nothing_wider_than_the_page(opened, width, dark):
    window = opened("?period=day&at=2026-01-01", width)
    window.dark(dark)
    window.run("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    window.click("#span")
    assert window.faults() == []
    assert window.run("return document.documentElement.scrollWidth") == width
    assert window.complaints() == []


COMPARED = (
    "?period=month&at=2026-03-01&robot=cell1/a&baseline_start=2026-01-01"
    "&baseline_stop=2026-03-01&driver=parts"
)


@pytest.fixture(scope="module")
def compared_url(tmp_path_factory):
    folder = tmp_path_factory.mktemp("savings") / "history"
    record_days(folder, {"cell1/a": 0.06, "cell1/b": 0.0})
    with served(folder, folder.parent / "token") as address:
        yield address


@pytest.mark.parametrize(("width", "dark"), [(1400, True), (390, False)])
def test_savings_and_friction_are_read_by_keys_and_without_fault(opened, compared_url, width, dark):
    from selenium.webdriver.common.keys import Keys

    window = opened(COMPARED, width, compared_url)
    window.dark(dark)
    window.wait("document.querySelectorAll('#cusum svg').length", "the savings")
    assert window.text("saved").startswith("A saving: 26.")
    assert "CV(RMSE) 1.3 %" in window.text("saving-model")
    for figure, note, said in (
        ("cusum", "cusum-note", "Monday 2026-03-30: used "),
        ("per-part", "per-part-note", "Monday 2026-03-30: "),
        ("friction", "friction-note", "Monday 2026-03-30: elbow 1.176, wrist 1.000"),
    ):
        window.run("document.querySelector(`#${arguments[0]} svg`).focus()", figure)
        window.driver.switch_to.active_element.send_keys(Keys.ARROW_LEFT, Keys.ARROW_LEFT)
        assert window.text(note).startswith(said)
    assert window.faults() == []
    assert window.run("return document.documentElement.scrollWidth") == width
    assert window.complaints() == []


def test_the_form_compares_a_period_and_a_day_that_deviates_opens(opened, compared_url):
    window = opened("?period=month&at=2026-03-01", url=compared_url)
    start = "document.getElementById('baseline-start').value"
    window.wait(f"{start} === '2025-12-31'", "60 days before")
    window.run(f"{start} = '2026-01-01'")
    window.click("#baseline button[type=submit]")
    window.wait("document.querySelectorAll('#saving-robots tbody tr').length === 2", "robots")
    assert window.text("saved") == "1 of 2 robots saved surely"
    window.click("#saving-robots tbody button")
    window.wait("document.querySelectorAll('#deviations tbody tr').length === 8", "days")
    assert "baseline_start=2026-01-01" in window.driver.current_url
    window.click("#deviations tbody button")
    window.wait(f"{BARS}.length === 24", "the day")
    window.wait("!document.getElementById('savings').hidden", "its saving")
    window.click("#baseline-clear")
    window.wait("document.getElementById('savings').hidden", "the page without a baseline")
    assert window.complaints() == []


def test_names_from_outside_are_text(opened):
    window = opened("?period=day&at=2026-01-01")
    assert EVIL in window.text("robots")
    assert EVIL in window.text("jobs")
    assert EVIL in window.text("legend")
    assert any(EVIL in name for name in names(window))
    assert window.run("return window.evil ?? null") is None
    assert window.complaints() == []


def test_prices_are_set_on_the_page_with_the_token(opened, folder, tmp_path):
    own = shutil.copytree(folder, tmp_path / "history")
    with served(own, tmp_path / "token") as url:
        set_prices(opened("?period=day&at=2026-01-01&robot=cell1/a", url=url))


def set_prices(window):
    assert window.text("cost") == DASH
    window.run("document.getElementById('tariff-card').open = true")
    window.run(
        "const set = (id, text) => { document.getElementById(id).value = text; };"
        "set('tariff-begin', '2026-01-01'); set('tariff-price', '0,30'); set('tariff-zone', 'UTC');"
        "set('tariff-times', '00:00-02:00 0.1'); set('tariff-co2', '0.4');"
    )
    window.click("#tariff button")
    window.wait("!document.getElementById('access').hidden", "the question for the token")
    window.run(f"document.getElementById('token').value = '{TOKEN}'")
    window.click("#access button")
    window.wait("document.getElementById('access').hidden", "the page with the token")
    window.click("#tariff button")
    window.wait("document.getElementById('cost').textContent === '1.10 EUR'", "the cost", 30)
    assert window.text("co2") == "2.00 kg"
    window.complaints()  # 401 of the first request
    window.run("document.getElementById('tariff-times').value = 'at night 0.1'")
    window.click("#tariff button")
    window.wait("document.getElementById('tariff-answer').textContent.includes('22:00')", "help")


def test_the_live_page_leads_to_the_history_and_back(window, url):
    window.open(f"{url}#token={TOKEN}")
    window.wait("!document.getElementById('past').hidden", "the link")
    window.click("#past")
    window.wait(f"location.pathname === '/history' && {PERIOD}", "the history")
    assert window.run("return location.hash") == f"#token={TOKEN}"
    window.click("#live")
    window.wait("location.pathname === '/' && document.getElementById('past')", "the live page")
    assert window.run("return location.hash") == f"#token={TOKEN}"
